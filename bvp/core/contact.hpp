/// Contacts and restitution at an impact, in any number type: equations (4) and (27).
///
/// Restitution R is linear, so it maps a perturbation as it maps a state. But a perturbed motion arrives at another time. After the
/// flight time t the state is z-, and the perturbation dz of the start has become exp(B t) dz. The arrival moves by
///     dt = -(g . exp(B t) dz)/(g . B z-)
/// and the perturbation on the stop, after the impact, is J dz + F dt with J = R exp(B t) and F = R B z-.
#pragma once

#include "array.hpp"

namespace saltus {

/// Rows of m contacts: w = gap . z, w' = rate . z, w'' = acceleration . z; z+ = z - (1 + r) push (rate . z) at an impact.
struct Contacts {
    Array<> gap, rate, acceleration, push;  // (m, N)
    std::vector<double> side;               // (m,) +1 upper, -1 lower
    std::vector<double> bound, restitution;  // (m,)
    int count() const { return int(side.size()); }
};

/// out = z - jump push (rate . z), equation (4): jump = 1 + r; 0 leaves the impact out. `out` may be z.
template <class P, class Z, class J, class Out>
inline void apply_impact(Values rate, const P& push, const J& jump, const Z& z, Out&& out) {
    const auto change = jump * dot(rate, z);
    for (int r = 0; r < int(rate.size()); ++r) out[r] = z[r] - push[r] * change;
}

/// The impact of each column of a matrix, in place.
inline void impact_columns(Values rate, Values push, double jump, Matrix<double> matrix) {
    for (int c = 0; c < matrix.columns(); ++c) {
        double change = 0.0;
        for (int r = 0; r < matrix.rows(); ++r) change += rate[r] * matrix(r, c);
        change *= jump;
        if (change == 0.0) continue;
        for (int r = 0; r < matrix.rows(); ++r) matrix(r, c) -= push[r] * change;
    }
}

/// Move a perturbation along the flow onto gap . z = constant: change += velocity dt. Returns dt, equation (27).
template <class Velocity, class Change>
inline double arrive(Values gap, const Velocity& velocity, Change&& change) {
    const double shift = -dot(gap, change) / dot(gap, velocity);
    for (int r = 0; r < int(gap.size()); ++r) change[r] += shift * velocity[r];
    return shift;
}

}  // namespace saltus
