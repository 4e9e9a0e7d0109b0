/// The modes of undamped free motion: K phi = w^2 M phi.
///
/// Jacobi's method on the pencil scaled by the mass keeps small frequencies accurate beside large ones (Demmel & Veselic, SIAM
/// J. Matrix Anal. Appl. 13 (1992) 1204); two steps of Ogita & Aishima's refinement (Japan J. Indust. Appl. Math. 35 (2018)
/// 1007) on the given matrices remove what the scaling left. A square below the rounding of its own Rayleigh quotient is 0, and
/// so is one below 1e-292.
#pragma once

#include <vector>

#include "array.hpp"

namespace saltus {

/// left right; each entry is summed in the order of the columns.
Array<> product(Matrix<const double> left, Matrix<const double> right);

/// Write X of matrix X = right into `right`; false for a singular matrix.
bool solve_matrix(Array<> matrix, Array<>& right);

/// Write the lower triangular L of matrix = L L'; false where it is not positive definite.
bool cholesky(Matrix<const double> matrix, Array<>& lower);

struct UndampedModes {
    std::vector<double> squares;  // (n,) ascending
    Array<> shapes;               // (n, n) columns with shapes' M shapes = 1; the component with the most kinetic energy is positive

    enum Outcome { FOUND, INDEFINITE, UNSETTLED };
    /// INDEFINITE: the mass is not positive definite. UNSETTLED: Jacobi's method does not converge.
    Outcome find(Matrix<const double> mass, Matrix<const double> stiffness);
};

}  // namespace saltus
