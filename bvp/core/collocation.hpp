/// Flights by Gauss collocation, for smooth forces of which only values and first derivatives are known.
///
/// The polynomials of degree S whose derivatives are right at S Gauss points of a step (Hairer, Lubich and Wanner,
/// Geometric Numerical Integration, 2nd ed. 2006, II.1.2): their ends have the order 2 S, and the map is symplectic. The
/// accelerations at the points are solved for by Newton's method. The derivatives of the step obey its linearised
/// equations. A step is confirmed, and the next length chosen, by the defect at its ends and between the points: the
/// difference of the polynomial's acceleration from that of the forces along it.
///
/// The step is a polynomial as a Taylor step is, so all that follows a path is the same.
#pragma once

#include "taylor.hpp"

namespace saltus {

/// Gauss points of a step.
inline constexpr int STAGES = 16;

/// Computes flights of equations whose forces are functions, with its work space.
class Collocation {
public:
    explicit Collocation(const SmoothEquations& equations);

    /// The flight of time t from z.
    void fly(Values z, double t, bool with_map, TaylorPath& path);

private:
    int half() const { return equations_.size() / 2; }
    double first_length(double left);
    double step(double left, double direction);
    bool solve(double h);
    void guess(double length);
    void hold_acceleration();
    void place(double h);
    bool evaluate();
    bool linearise(double h);
    void put_inputs(Values z, int column);
    double acceleration(Values z, int column, int r) const;
    double worst_defect(double h, double& speed);
    bool carry(double h);
    double source(const MotionSource& source, int point, int r) const;
    void write_polynomials(double h);

    const SmoothEquations& equations_;
    /// Columns of derivatives: by the begin of the flight, and by the sources.
    int columns() const { return equations_.size() + int(equations_.sources.size()); }

    Array<> begin_, columns_;           // (1, N) state at the begin of the step; (N, N + P) its derivatives
    Array<> rates_, before_;            // (S, n) accelerations at the points; Legendre coefficients of those of the step before
    Array<> states_, values_;           // (S, N) at the points; (registers, S) inputs, forces and derivatives there
    Array<> slopes_;                    // (S, n N) derivatives of the accelerations by the state
    Array<> matrix_, right_, moved_;    // (S n, S n) with its factors; (S n, N + P); (S N, N + P) columns at the points
    Array<> others_, polynomial_;       // (D, N) states between the points; (ORDER + 1, N)
    std::vector<int> pivots_;
    bool has_map_ = false;
    double next_ = 0.0, last_ = 0.0;  // lengths of the next step, and of the one before
};

}  // namespace saltus
