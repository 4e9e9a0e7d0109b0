/// One flight as the events along it see it: the seam between flights and searches in time.
///
/// A path is made by path_of(flight, z, duration), and has these members; flights of other kinds provide the same.
///     SIZE, PAIRS                   entries of a state and pairs of its table of steps where the compiler knows them, else DYNAMIC
///     size(), begin()               entries of a state; the state at the begin
///     state(t, out)                 the state at a time
///     rate(state, out)              z' at a state of the path
///     fastest()                     a rate that bounds how fast the terms of its series can grow
///     is_steady()                   whether bounds of one instant hold at all later ones
///     growth()                      > 0: they hold for 1/growth at most
///     window(t, length)             the part of a time after t over which `bounds` holds
///     bounds(row, t, state, window) bounds of |f|, |f''|, |f'''| of f = row . z over a window after t
///     rounding_level(row, z)        sixteen rounding errors of row . z
///     parting(contacts, c, ..)      see `Parting`
///     series(row, out)              out[k - 1] = f^(k)(0)/k!; returns a rate that bounds how fast the terms can grow
///     steps()                       the table of its steps of fixed length, or nullptr
///     track(functional, duration)   f, f', f'' at a time, and bounds of |f''| and |f'''|: see `LinearTrack`
#pragma once

#include <algorithm>

#include "contact.hpp"
#include "linear_flight.hpp"

namespace saltus {

/// Rows of a linear functional f = value . z and of f' and f''.
struct Functional {
    Values value, rate, second;
};

/// A functional and two derivatives at one instant.
struct Sample {
    double value, slope, bend;
};

/// The part of a step of h at which a functional passes a bound, by the polynomial of fifth order through both ends: a
/// cubic and what the second derivatives add. It is nearer than the cubic by two orders, which saves most of the work on
/// the exact flight.
inline double zero_in_step(const Sample& begin, const Sample& end, double h, double bound) {
    const double leaving = h * begin.slope, coming = h * end.slope, rise = end.value - begin.value;
    const double second = 3.0 * rise - 2.0 * leaving - coming, third = leaving + coming - 2.0 * rise;
    const double more = 0.5 * (h * h * begin.bend) - second, change = 0.5 * (h * h * end.bend) - second - 3.0 * third - more;
    double s = (bound - begin.value) / rise;
    for (int count = 0; count < 2; ++count) {
        const double rest = 1.0 - s, window = s * rest, extra = more + change * s;
        const double value = begin.value + s * (leaving + s * (second + s * third)) + window * window * extra - bound;
        const double slope =
            leaving + s * (2.0 * second + 3.0 * s * third) + window * (2.0 * (rest - s) * extra + window * change);
        if (slope != 0.0) s = std::min(std::max(s - value / slope, 0.0), 1.0);
    }
    return s;
}

/// How a contact without distance, rate and acceleration goes on.
struct Parting {
    double time;  // for which it is certain to separate; 0: it presses
    int order;    // of the first derivative of its distance that is not 0 to rounding; 0: the distance stays 0
};

/// 2 d/(-d' + sqrt(d'^2 + 2 W d)), the positive zero in equation (3), in the form that does not cancel; infinite where
/// d never returns to 0.
inline double free_step(double d, double slope, double second_bound) {
    if (slope < 0.0) return 2.0 * d / (-slope + std::sqrt(slope * slope + 2.0 * second_bound * d));
    if (second_bound <= 0.0) return INFINITE;
    return (slope + std::sqrt(slope * slope + 2.0 * second_bound * d)) / second_bound;
}

inline constexpr int NEAR_TERMS = 14;
/// |B| t up to which the series from the start of a flight is used: its terms truncate below 1e-19.
inline constexpr double NEAR_REACH = 0.25;

/// C(t) and S(t) of each pair of a linear flight at the last time for which they were computed: all searches along a
/// flight pass its end.
template <int N>
struct EndWaves {
    explicit EndWaves(int size) : entries(size) {}
    double time = NOT_A_NUMBER;
    Local<double, N> entries;
};

/// A functional along a linear flight. Where no block damps or grows it is a sum over the pairs of alpha C(t) + beta
/// S(t): one sine and cosine of each pair give f, f' and f''.
template <int N>
class LinearTrack {
public:
    LinearTrack(const LinearFlight<N>& flight, const Functional& rows, Values z, double duration, EndWaves<N>& end)
        : flight_(flight), rows_(rows), z_(z), end_(end), parts_(flight.size()), duration_(duration),
          pure_(flight.is_steady()) {
        for (const Block& block : flight.blocks()) pure_ = pure_ && block.is_pair();
        if (!pure_) {
            bounds_ = flight.bounds(rows.value, z, duration);
            return;
        }
        const Matrix<const double> b = flight.matrix();
        int k = 0;
        for (const Block& block : flight.blocks()) {
            const int i = block.first, j = block.second;
            const double alpha = rows.value[i] * z[i] + rows.value[j] * z[j];
            const double beta = rows.value[i] * (b(i, i) * z[i] + b(i, j) * z[j]) +
                rows.value[j] * (b(j, i) * z[i] + b(j, j) * z[j]);
            parts_[k++] = alpha, parts_[k++] = beta;
            const double square = -block.delta, frequency = block.root;
            const double slope = std::sqrt(square * alpha * alpha + beta * beta);
            const double level = std::min(frequency > 0.0 ? slope / frequency : INFINITE,
                                          std::fabs(alpha) + std::fabs(beta) * duration);
            bounds_.add(level, frequency * slope, square * slope);
        }
        bounds_.second *= 1.0 + 1e-12, bounds_.third *= 1.0 + 1e-12;
    }

    double duration() const { return duration_; }
    double level() const { return bounds_.level; }
    /// Bounds of |f''| and |f'''| from t on, and the time up to which they hold.
    Bounds bounds(double) const { return bounds_; }
    double until(double) const { return INFINITE; }

    Sample at(double t) {
        Sample out{0.0, 0.0, 0.0};
        if (!pure_) {
            flight_.end(z_, t, parts_);
            const Values state = parts_;
            return {dot(rows_.value, state), dot(rows_.rate, state), dot(rows_.second, state)};
        }
        const bool ends = t == duration_;
        int k = 0;
        for (const Block& block : flight_.blocks()) {
            double c = 1.0, s = 0.0;
            const double alpha = parts_[k], beta = parts_[k + 1];
            if (ends && t == end_.time) c = end_.entries[k], s = end_.entries[k + 1];
            else if (t != 0.0) circular(block.delta, block.root, t, c, s);  // every search begins at 0
            if (ends) end_.entries[k] = c, end_.entries[k + 1] = s;
            k += 2;
            const double here = alpha * c + beta * s;
            out.value += here;
            out.slope += beta * c + block.delta * alpha * s;
            out.bend += block.delta * here;
        }
        if (ends) end_.time = t;
        return out;
    }

private:
    const LinearFlight<N>& flight_;
    Functional rows_;
    Values z_;
    EndWaves<N>& end_;
    Local<double, N> parts_;
    Bounds bounds_;
    double duration_;
    bool pure_;
};

/// The path of a linear flight from z, which it keeps a view of. P: see `StepTable::pairs`; N may be DYNAMIC beside it.
template <int N, int P = DYNAMIC>
class LinearPath {
public:
    static constexpr int SIZE = P == DYNAMIC ? N : 2 * P, PAIRS = P;
    LinearPath(const LinearFlight<N>& flight, Values z)
        : flight_(flight), z_(z), end_(flight.size()), turns_(flight.steps().is_usable() ? flight.steps().count() : 0),
          later_(turns_.cosine.size()) {}

    constexpr int size() const {
        if constexpr (SIZE != DYNAMIC) return SIZE;
        return flight_.size();
    }
    Values begin() const { return z_; }
    template <class Out>
    void state(double t, Out&& out) const {
        const Vector<double> to(out);
        if (P != DYNAMIC || flight_.steps().is_usable()) flight_.steps().flow(z_.data(), turns(t), to.data());
        else flight_.end(z_, t, to);
    }
    /// The turns of the table of steps at a time. Next to the last time that took sines and exponentials it takes none.
    const StepTable::Turns<P>& turns(double t) const {
        const StepTable& table = flight_.steps();
        const double change = t - turned_;
        if (!(std::fabs(change) <= table.slight())) {
            table.turn(t, turns_);
            turned_ = t;
        }
        if (t == turned_) return turns_;
        if (t != turned_later_) table.turn_slightly(turns_, change, later_);
        turned_later_ = t;
        return later_;
    }
    void rate(Values state, Vector<double> out) const {
        if constexpr (P != DYNAMIC) flight_.steps().template rate<P>(state.data(), out.data());
        else flight_.rate(state, out);
    }
    bool is_steady() const { return flight_.is_steady(); }
    double fastest() const { return flight_.fastest(); }
    double growth() const { return flight_.growth(); }
    double window(double, double length) const { return length; }
    Bounds bounds(Values row, double, Values state, double window) const { return flight_.bounds(row, state, window); }
    double rounding_level(Values row, Values z) const { return flight_.rounding_level(row, z); }
    const StepTable* steps() const { return flight_.steps().is_usable() ? &flight_.steps() : nullptr; }
    LinearTrack<N> track(const Functional& rows, double duration) const {
        return {flight_, rows, z_, duration, end_};
    }

    double series(Values row, Vector<double> out) const {
        State state(size()), other(size());
        copy(z_, state);
        double factor = 1.0;
        for (int k = 0; k < int(out.size()); ++k) {
            differentiate(state, other);
            factor /= k + 1;
            out[k] = dot(row, Values(state)) * factor;
        }
        return flight_.fastest();
    }

    Parting parting(const Contacts& contacts, int c, double horizon, double window) const {
        const Values row = contacts.acceleration[c];
        State state(size()), other(size());
        int order = 3;
        copy(z_, state);
        differentiate(state, other);
        while (std::fabs(dot(row, Values(state))) <= rounding_level(row, state)) {
            // Derivatives that are 0 up to the number of states vanish for ever (Cayley and Hamilton).
            if (order > size()) return {0.0, 0};
            differentiate(state, other);
            ++order;
        }
        const double lead = -contacts.side[c] * dot(row, Values(state));
        if (lead < 0.0) return {0.0, order};
        if (order == 3) {
            const double fourth = flight_.bounds(row, z_, window).second;
            return {fourth > 0.0 ? std::min(lead / fourth, window) : window, order};
        }
        // While a derivative is positive, those below it, and the distance, rise from 0. It is followed towards its
        // zero; then the derivative below it is, down to the rate.
        constexpr int RUNGS = 8;
        double time = 0.0, step = horizon;
        for (int level = order; level > 0; --level) {
            for (int rung = 0; rung < RUNGS; ++rung) {
                this->state(time, state);
                step = positive_step(contacts, c, level, state, std::min(4.0 * step, horizon - time));
                time += step;
                if (step <= 0.01 * time) break;
            }
            step = std::max(step, 0.01 * time);
        }
        return {time, order};
    }

private:
    using State = Local<double, SIZE>;

    void differentiate(State& state, State& other) const {
        flight_.rate(Values(state), other);
        copy(Values(other), state);
    }

    /// A time, up to `longest`, in which the derivative of order `level` of a contact's distance stays positive; 0
    /// where it is not above rounding.
    double positive_step(const Contacts& contacts, int c, int level, Values z, double longest) const {
        const Values row = level > 1 ? contacts.acceleration[c] : contacts.rate[c];
        State begin(size()), state(size()), other(size());
        copy(z, begin);
        for (int k = 2; k < level; ++k) differentiate(begin, other);
        const double value = -contacts.side[c] * dot(row, Values(begin));
        if (value <= rounding_level(row, begin)) return 0.0;
        double step = longest;
        for (int halving = 0; halving < 60; ++halving, step *= 0.5) {
            // The value exceeds the other terms of its Taylor series, and the remainder.
            copy(Values(begin), state);
            double change = 0.0, factor = 1.0;
            for (int k = 1; k < NEAR_TERMS; ++k) {
                differentiate(state, other);
                factor *= step / k;
                change += factor * std::fabs(dot(row, Values(state)));
            }
            differentiate(state, other);
            if (change + factor * step / NEAR_TERMS * flight_.bounds(row, state, step).level < value) return step;
        }
        return 0.0;
    }

    const LinearFlight<N>& flight_;
    Values z_;
    mutable EndWaves<SIZE> end_;
    mutable StepTable::Turns<P> turns_, later_;
    mutable double turned_ = INFINITE, turned_later_ = INFINITE;  // the times of both
};

/// The path of the flight from z, over a duration. A linear one is known at all times.
template <int N>
LinearPath<N> path_of(const LinearFlight<N>& flight, Values z, double) { return {flight, z}; }

}  // namespace saltus
