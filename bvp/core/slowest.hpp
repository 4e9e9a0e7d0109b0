/// Where a motion with smooth forces and two degrees of freedom is slowest, or nearest to the origin: scans for orbits
/// begin there.
///
/// On its way from the origin a motion is slowest where the velocity is perpendicular to the acceleration. From start to
/// start the part of the velocity along that perpendicular changes its sign where the motion reaches rest. The distance
/// from the origin does the same with displacement and velocity.
#pragma once

#include "jet.hpp"
#include "taylor.hpp"

namespace saltus {

/// An instant, and what changes its sign from start to start where an orbit begins.
struct Slowest {
    double time, value;
};

namespace slowest_detail {

/// v . a, and the part of v across a; or (of_distance) u . v, and the part of u across v.
struct Across {
    double along, value;
};
inline Across across(Matrix<const double> step, double t, bool of_distance) {
    Local<Jet<double, 1>, 4> state(4);
    Jet<double, 1> at(t);
    at.slopes[0] = 1.0;
    evaluate_series(step, at, state);
    double x = value(state[2]), y = value(state[3]), a = state[2].slopes[0], b = state[3].slopes[0];
    if (of_distance) a = x, b = y, x = value(state[0]), y = value(state[1]);
    const double size = std::sqrt(a * a + b * b);
    return {x * a + y * b, size > 0.0 ? (x * b - y * a) / size : 0.0};
}

}  // namespace slowest_detail

/// The instants of a flight at which the speed is least, or the distance from the origin. Each step is looked at in so
/// many parts: two extrema within one can be missed.
inline std::vector<Slowest> slowest_instants(const TaylorPath& path, bool of_distance, int parts) {
    std::vector<Slowest> found;
    for (int s = 0; s < path.steps(); ++s) {
        const Matrix<const double> step = path.step(s);
        const double begin = path.times[s], length = path.times[s + 1] - begin;
        double before = slowest_detail::across(step, 0.0, of_distance).along;
        for (int part = 0; part < parts; ++part) {
            double low = length * part / parts, high = length * (part + 1) / parts;
            const double after = slowest_detail::across(step, high, of_distance).along;
            if (before < 0.0 && after >= 0.0) {
                double f_low = before, f_high = after, root = low, value = 0.0;
                for (int round = 0; round < 60; ++round) {
                    root = low + f_low / (f_low - f_high) * (high - low);
                    const auto here = slowest_detail::across(step, root, of_distance);
                    value = here.value;
                    // Illinois' rule: the value of an end that stays is halved.
                    if (here.along < 0.0) low = root, f_low = here.along, f_high *= 0.5;
                    else high = root, f_high = here.along, f_low *= 0.5;
                    if (here.along == 0.0 || high - low <= 1e-15 * length || !(low <= root && root <= high)) break;
                }
                found.push_back({begin + root, value});
            }
            before = after;
        }
    }
    return found;
}

}  // namespace saltus
