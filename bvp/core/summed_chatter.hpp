/// Chatter that is summed to its end, equation (44).
///
/// After each impact the gap opens with the speed v, and is hit again after the time t that solves
///     v + t integral of (1 - x) a(x t) dx = 0,   0 <= x <= 1,
/// with the acceleration a of the gap in flight. This form does not cancel in short bounces: the gap itself does not appear,
/// so a bounce ends where it began. The nodes after the impacts are a power series in restitution^k (Koenigs). With q =
/// restitution^stride below 1/2, Neville's scheme takes one power after the other away. In jets it takes the derivatives of
/// the nodes, and of q, to the derivative of their limit.
#pragma once

#include <functional>
#include <vector>

#include "jet.hpp"

namespace saltus {

/// Most orders of the series that are summed.
inline constexpr int CHATTER_ORDERS = 12;

/// Size of the product of the powers that the orders take away, at which no further one is needed.
inline constexpr double CHATTER_REST = 1e-18;

/// Duration of a chatter, times the fastest rate, above which it is not summed.
inline constexpr double LONGEST_CHATTER = 1.0;

/// Largest error of the end of a chatter: the change of the last node by the last order, its state in units of arclength.
inline constexpr double CHATTER_ERROR = 1e-10;
inline constexpr double LEAST_CHATTER_ERROR = 1e-30;

/// A chatter at one stop, from what happens in flights and impacts there.
template <class T>
struct Chatter {
    using State = std::vector<T>;
    T restitution;
    std::function<void(State& z)> impact;
    std::function<T(const State& z)> speed;
    /// The acceleration of the gap a time t after a state, and its rate where that is asked for.
    std::function<T(const State& z, const T& clock, const T& t, double* rate)> acceleration;
    std::function<void(State& z, T& clock, const T& t)> fly;

    /// z, clock become those at the end; NaN where the bounces do not go on. side: that of the stop. units: of the states.
    /// Returns the change by the last order.
    double sum(double side, const std::vector<double>& units, State& z, T& clock) {
        const int count = int(z.size()) + 1;
        const double r = value(restitution);
        const int stride = r > 0.5 ? std::max(1, int(std::ceil(log(0.5) / log(r)))) : 1;
        T ratio = restitution;
        for (int k = 1; k < stride; ++k) ratio = ratio * restitution;
        std::vector<State> table(CHATTER_ORDERS + 1, State(count));
        State limit(count);
        double left = 1.0, error = INFINITE;
        for (int orders = 0;; ++orders) {
            impact(z);
            std::copy(z.begin(), z.end(), limit.begin());
            limit[count - 1] = clock;
            error = extrapolate(orders, ratio, units, table, limit);
            if (orders == CHATTER_ORDERS || left < CHATTER_REST) break;
            for (int k = 0; k <= orders; ++k) left *= value(ratio);
            for (int k = 0; k < stride; ++k) {
                if (k > 0) impact(z);
                if (!bounce(side, z, clock)) {
                    for (T& entry : z) entry = T(NOT_A_NUMBER);
                    clock = T(NOT_A_NUMBER);
                    return NOT_A_NUMBER;
                }
            }
        }
        std::copy(limit.begin(), limit.end() - 1, z.begin());
        clock = limit[count - 1];
        return error;
    }

private:
    /// Take the next node in `next`, of which there were `orders` before, into the table; `next` becomes the limit.
    static double extrapolate(int orders, const T& ratio, const std::vector<double>& units, std::vector<State>& table, State& next) {
        double change = 0.0;
        T power(1.0);
        for (int level = 0; level <= orders; ++level) {
            power = power * ratio;
            for (size_t c = 0; c < next.size(); ++c) {
                const T old = table[level][c], now = next[c];
                table[level][c] = now;
                if (level == orders) continue;
                next[c] = (now - power * old) / (1.0 - power);
                if (level == orders - 1)
                    change = std::max(change, std::fabs(value(next[c]) - value(now)) / (c + 1 < next.size() ? units[c] : 1.0));
            }
        }
        return change;
    }

    /// Fly to the next impact at the same stop; false where there is none.
    bool bounce(double side, State& z, T& clock) {
        // Gauss's rule of eight points.
        static constexpr double PLACES[8] = {0.019855071751231856, 0.10166676129318664, 0.2372337950418355, 0.4082826787521751,
                                             0.5917173212478249,   0.7627662049581645,  0.8983332387068134, 0.9801449282487682};
        static constexpr double WEIGHTS[8] = {0.05061426814518813, 0.11119051722668724, 0.15685332293894364, 0.18134189168918100,
                                              0.18134189168918100, 0.15685332293894364, 0.11119051722668724, 0.05061426814518813};
        constexpr int ROUNDS = 12;  // it takes four
        // Bounces without speed last for no time, and change with the restitution all the same. Beyond 0 they go on as a power
        // series.
        const double sense = value(restitution);
        const T open = speed(z), press = acceleration(z, clock, T(0.0), nullptr);
        T t = -2.0 * open / press;
        const auto lasts = [&] { return 0.0 <= value(t) * sense && value(t) * sense < INFINITE; };
        if (!(side * value(press) > 0.0 && lasts())) return false;
        double last = INFINITE;  // change beside the duration
        for (int round = 0, settled = 0; round < ROUNDS + JET_DEPTH<T> && settled <= JET_DEPTH<T>; ++round) {
            T total(0.0);
            double bend = 0.0;
            for (int g = 0; g < 8; ++g) {
                double rate = 0.0;
                const double weight = WEIGHTS[g] * (1.0 - PLACES[g]);
                const T here = acceleration(z, clock, T(PLACES[g] * t), &rate);
                total += weight * here;
                bend += weight * (value(here) + value(t) * PLACES[g] * rate);
            }
            // With the derivative of the values alone each step adds one order of the derivatives.
            const T change = -(open + t * total) / bend;
            t += change;
            last = std::fabs(value(change)) / std::max(std::fabs(value(t)), 1e-300);
            settled += last <= 2e-16;
        }
        // Where the force hardly presses there is no next impact; its rounding, beside it, is below this.
        constexpr double SETTLED = 1e-8;
        if (!lasts() || !(last <= SETTLED)) return false;
        fly(z, clock, t);
        return true;
    }
};

}  // namespace saltus
