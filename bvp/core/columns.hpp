/// The derivatives of a Taylor flight by its begin: columns, some of them side by side in the registers of a processor.
///
/// A column obeys the linearised motion: its forces are the slopes of the forces, times its inputs. The Taylor
/// coefficients of the slopes are known from the state (section 17 of docs/theory.md). With jets in as many directions
/// in their place a flight took 1.1 times as long with two coordinates and one spring, 1.4 times with three coordinates
/// and four springs.
#pragma once

#include "taylor.hpp"

namespace saltus {

/// Columns that are computed at once, at most.
inline constexpr int LANES = 8;

/// The columns of the derivative of a state by the begin of its flight, as polynomials of the present step.
class Columns {
public:
    explicit Columns(const SmoothEquations& equations);

    /// The identity: a flight begins.
    void begin();
    /// The coefficients about the present columns, from those of the slopes of the forces (registers, ORDER + 1).
    void expand(Matrix<const double> series);
    /// The least ratio of a column's velocities in a step of some length to their coefficients of order ORDER - 1.
    double room(double length) const;
    /// The columns at a time in the step become the present ones.
    void advance(double h);
    /// The present columns, (N, N).
    void write(Matrix<double> map) const;

private:
    /// Side by side: so many columns, from the first one on. Their coefficients (ORDER + 1, N, width) begin at a place.
    struct Group {
        int first, width;
        size_t place;
    };
    /// A derivative of a force by an input: the register of its series.
    struct Line {
        int input, result;
    };
    template <int L, bool NARROW>
    void expand_group(const Group& group, Matrix<const double> series);
    template <int L>
    void advance_group(const Group& group, double h);

    const SmoothEquations& equations_;
    int size_;
    std::vector<Group> groups_;
    std::vector<double> coefficients_;
    std::vector<Line> lines_;                     // in order of the forces
    std::vector<int> begins_;                     // of each force's lines, and the end of the last ones
    std::vector<double> inputs_, sums_, forces_;  // scratch of one group: (I, ORDER, L), (D, 2, L), (F, L)
};

}  // namespace saltus
