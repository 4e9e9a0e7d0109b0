/// What is known of a point of a family: its numbers, by name.
#pragma once

#include <array>
#include <cstring>

#include "blocks.hpp"

namespace saltus {

/// The names in order, as Python reads them. Under loads the energy is the first released parameter, and the quarter
/// period the period.
#define SALTUS_POINT_NAMES(X) \
    X(converged) X(iterations) X(contraction) X(residual) X(energy) X(quarter_period) X(slope) X(turn) \
    X(branching) X(clearance) X(clearance_flight) X(clearance_stop) X(clearance_side) X(clearance_time) X(speed) \
    X(speed_node) X(flight) X(flight_index) X(absorber_start) X(absorber_end) X(waves_absorber) X(waves_primary) \
    X(first_quarter) X(second_quarter) X(in_phase) X(gave_up) X(a) X(b) X(c) X(d) X(magnified) X(trace) \
    X(determinant) X(larger_real) X(larger_imaginary) X(smaller_real) X(smaller_imaginary) X(trivial) \
    X(singular) X(speeds) X(steepness) X(conditioning)

/// Numbers of a point; NaN where they do not exist, or are not computed.
///
/// converged .. residual: of the corrections. slope: derivative of the energy by arclength. turn: cosine of the angle
/// to the direction before. branching: signed smallest pivot. clearance ..: of the nearest contact. speed: of the
/// slowest impact, at a node. flight: the shortest. absorber_..: its velocity at origins. waves_..: half-waves.
/// .._quarter: impacts. a .. d: the half map. magnified: largest factor by which an impact magnifies rounding. trace ..
/// singular: multipliers. speeds: product of all impact speeds over sqrt(2 h). steepness: change of the scaled unknowns
/// by arclength. conditioning: of the equations.
struct Point {
#define SALTUS_DECLARE(name) double name = NOT_A_NUMBER;
    SALTUS_POINT_NAMES(SALTUS_DECLARE)
#undef SALTUS_DECLARE

    /// Write all numbers into a row of an array.
    void write(double* out) const { std::memcpy(out, this, sizeof(Point)); }
    static Point read(const double* row) {
        Point point;
        std::memcpy(static_cast<void*>(&point), row, sizeof(Point));
        return point;
    }
};

#define SALTUS_NAME(name) #name,
inline constexpr std::array POINT_NAMES{SALTUS_POINT_NAMES(SALTUS_NAME)};
#undef SALTUS_NAME
inline constexpr int POINT_SIZE = int(POINT_NAMES.size());
static_assert(sizeof(Point) == POINT_SIZE * sizeof(double));

}  // namespace saltus
