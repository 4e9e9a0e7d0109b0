/// The real Schur form of a square matrix, exchanges of its blocks, and Sylvester's equation between them (Golub and Van Loan, Matrix
/// Computations, 4th ed. 2013, 7.4 to 7.6; Bai and Demmel, Linear Algebra Appl. 186 (1993) 73).
#pragma once

#include "dense.hpp"

namespace saltus {

inline Array<> identity(int size) {
    Array<> out(size, size);
    for (int k = 0; k < size; ++k) out(k, k) = 1.0;
    return out;
}

/// x <- x (1 - factor v v') for the columns from `first` on.
inline void reflect_columns(Array<>& x, Values v, int first, double factor) {
    for (int r = 0; r < x.rows(); ++r) reflect(v, first, int(v.size()), factor, x[r]);
}

/// x <- (1 - factor v v') x for the rows from `first` on.
inline void reflect_from_left(Array<>& x, Values v, int first, double factor) {
    for (int c = 0; c < x.columns(); ++c) {
        double total = 0.0;
        for (int r = first; r < int(v.size()); ++r) total += v[r] * x(r, c);
        total *= factor;
        for (int r = first; r < int(v.size()); ++r) x(r, c) -= total * v[r];
    }
}

/// matrix = q t q' with an orthogonal q and a t whose diagonal blocks are real rates or complex pairs; below them it is 0. A pair has equal
/// diagonal entries.
class SchurForm {
public:
    Array<> t, q;

    explicit SchurForm(Array<> matrix);
    /// From the parts of one. Throws std::invalid_argument where the sizes differ.
    SchurForm(Array<> t, Array<> q);

    int size() const { return t.rows(); }
    /// Size of the block that begins at k.
    int block(int k) const { return k + 1 < size() && t(k + 1, k) != 0.0 ? 2 : 1; }
    /// Move the block that begins at `from` up to `to`, where one begins: the blocks between follow it. Returns whether each exchange was
    /// possible; two blocks of equal rates cannot be told apart.
    bool move(int from, int to);

private:
    void scale(int exponent);
    void to_hessenberg();
    void iterate();
    void standardise(int k);
    bool exchange(int k);
    void rotate(int k, const Rotation& rotation);
};

/// X of A X - X B = C for an upper B in Schur form; false where A and B share a rate. A (m, m), B (k, k), C and X (m, k).
bool solve_sylvester(Matrix<const double> a, Matrix<const double> b, Matrix<const double> c, Matrix<double> x);

}  // namespace saltus
