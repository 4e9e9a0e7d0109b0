/// Step control: it accepts or refuses a step, chooses the next length, and selects steps to search for events.
#pragma once

#include "array.hpp"
#include "blocks.hpp"
#include "functions.hpp"

namespace saltus {

/// Verdicts on a step.
enum class Verdict { ACCEPTED, NOT_CONVERGED, SLOW, TURNED, JUMPED };

/// What is looked for in a test function: any sign change; one from above zero; the same, and values below zero; any
/// change.
enum class Watched { CROSSING, GUARD, TERMINAL_GUARD, CHANGE };

/// A test function for branch points falls below this part of its size before, if a branch point is near.
inline constexpr double NEAR_BRANCH_POINT = 0.1;

/// A point that has just passed the goal, nearer to it than this many chords, may be the goal itself: the family may
/// close.
inline constexpr double NEAR_GOAL = 2.0;

/// A chord longer than this many times its step did not come from following the curve.
inline constexpr double LONG_CHORD = 2.0;

/// What of the settings of a run is used at every step.
struct Control {
    double least_turn, slowest;              // smallest cosine between tangents, largest contraction
    double turn_scale, contraction_scale;    // turn angle^2 and contraction in units of their targets
    double growth, easy, shortest, longest;  // of steps
};

/// Distance of two positions.
inline double distance(Values a, Values b) {
    double total = 0.0;
    for (size_t i = 0; i < a.size(); ++i) total += (a[i] - b[i]) * (a[i] - b[i]);
    return std::sqrt(total);
}

/// How far a position is beyond the plane through `goal` at right angles to `direction`.
inline double height(Values position, Values goal, Values direction) {
    double total = 0.0;
    for (size_t i = 0; i < goal.size(); ++i) total += direction[i] * (position[i] - goal[i]);
    return total;
}

/// Arclength of a step from its chord and the cosine of its turn theta: chord (theta/2)/sin(theta/2), as on a circle;
/// of fourth order in the step on any smooth curve.
inline double arclength_of(double chord, double turn) {
    const double half = 0.5 * (1.0 - turn);  // sin(theta/2)^2
    if (!(half > 1e-12)) return chord;
    const double sine = half < 1.0 ? std::sqrt(half) : 1.0;
    return chord * asin(sine) / sine;
}

/// Whether a converged step of length ds is to be refused, and why.
inline Verdict refusal(double turn, double contraction, double chord, double ds, const Control& control) {
    if (!(turn >= control.least_turn)) return Verdict::TURNED;
    if (!(contraction <= control.slowest)) return Verdict::SLOW;
    if (!(chord <= LONG_CHORD * ds)) return Verdict::JUMPED;
    return Verdict::ACCEPTED;
}

/// Length of the step after an accepted one of length ds: turn and contraction both go with its square, and are brought
/// to their targets.
inline double next_step(double ds, double turn, double contraction, const Control& control) {
    const double effort = std::max(control.turn_scale * (1.0 - turn), control.contraction_scale * contraction);
    ds *= effort < control.easy ? control.growth : std::max(0.5, 1.0 / std::sqrt(effort));
    return std::min(std::max(ds, control.shortest), control.longest);
}

/// Whether a function can pass zero twice inside an interval at whose ends it has the values a and b of one sign.
///
/// bend, beside: its second divided differences over the interval and one neighbouring point, and next to these. The
/// function is replaced by the parabola through both ends with the larger bend towards zero, increased by the
/// difference of the two: the error of the interpolant. That parabola c (x - p)(q - x) reaches zero where c length^2 =
/// (sqrt(a) + sqrt(b))^2.
inline bool may_hide(double a, double b, double length, double bend, double beside) {
    if (a < 0.0) a = -a, b = -b, bend = -bend, beside = -beside;
    const double bulge = (std::max(bend, beside) + std::fabs(bend - beside)) * length * length;
    if (bulge <= a + b) return false;
    return bulge > a + b + 2.0 * std::sqrt(a * b);
}

/// Four consecutive points with their test functions, and the arclengths between them. Where there are fewer points,
/// the first ones are not numbers.
struct Consecutive {
    Values values[4];
    double lengths[3];
};

/// Whether a step has to be searched for events: one of the three between the points, by default the last one.
///
/// singular: size of each test function below which its sign is rounding; 0: of no branch point. Where a function is
/// not known at all four points, the step is searched, because its bend is not known.
inline bool watch(std::span<const Watched> kinds, Values singular, const Consecutive& points, int step = 2) {
    const auto& [oldest, older, old, recent] = points.values;
    const auto [first, before, last] = points.lengths;
    for (size_t i = 0; i < kinds.size(); ++i) {
        const double a = points.values[step][i], b = points.values[step + 1][i];
        if (a != a || b != b) continue;
        if (kinds[i] == Watched::CHANGE) {
            if (a != b) return true;
            continue;
        }
        if ((a > 0.0) != (b > 0.0)) {
            if (kinds[i] == Watched::CROSSING || a > 0.0) return true;
            continue;
        }
        if (kinds[i] != Watched::CROSSING && !(a > 0.0)) {
            if (kinds[i] == Watched::TERMINAL_GUARD) return true;
            continue;
        }
        if (oldest[i] != oldest[i] || older[i] != older[i] || old[i] != old[i] || recent[i] != recent[i]) return true;
        if (singular[i] > 0.0 && std::fabs(b) < NEAR_BRANCH_POINT * std::fabs(a)) return true;
        const double rise = (old[i] - older[i]) / before;
        const double bend = ((recent[i] - old[i]) / last - rise) / (before + last);
        const double beside = (rise - (older[i] - oldest[i]) / first) / (first + before);
        if (may_hide(a, b, points.lengths[step], bend, beside)) return true;
    }
    return false;
}

}  // namespace saltus
