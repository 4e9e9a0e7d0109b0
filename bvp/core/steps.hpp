/// Impacts found in steps of fixed length, equation (11).
///
/// The cubic with the values and slopes of w at both ends of a step of h lies within its four Bezier coefficients. It
/// differs from w by at most W h^4/384, where |w''''| <= W.
///
///     If all coefficients are farther than this from the bounds, the step has no impact.
///     If w passes a bound and |w'| > J h^2/8 at both ends, where |w'''| <= J, then w' keeps its sign and the step has
///     exactly one impact. So it has if the Bezier coefficients of w' are on one side of 0, by more than their error.
///     Otherwise the step is halved.
///
/// Off the stop that the flight leaves, the distance over the time, a cubic, has to stay positive. What needs steps
/// below h/2^11 is declined.
#pragma once

#include <algorithm>

#include "path.hpp"

namespace saltus {

/// The stops of a system as walks see them: the contacts of each row, without a copy of the rows where that is
/// possible. It keeps a view of the contacts and of the table.
class StepStops {
public:
    static constexpr int MOST = 8, MOST_PAIRS = 32;
    /// The contacts of one row. A bound that does not exist is infinite.
    struct Stop {
        const double *value, *rate, *acceleration;  // rows of w, w' and w'' over x and then y
        double lower = -INFINITE, upper = INFINITE;
        int low = -1, high = -1;  // the contacts there
        bool plain = true;        // w depends on x, and w' on y only
        const double *reaches, *sizes;  // of w: see `StepTable`
        bool has(int contact) const { return contact >= 0 && (contact == low || contact == high); }
        int contact() const { return high >= 0 ? high : low; }
    };

    StepStops(const StepTable& table, const Contacts& contacts);
    StepStops(const StepStops&) = delete;
    StepStops& operator=(const StepStops&) = delete;

    /// False: there are too many, or several contacts on one side of one row. These are left to the certified search.
    bool fit() const { return fit_; }
    std::span<const Stop> list() const { return {stops_, size_t(count_)}; }
    const StepTable& table() const { return table_; }
    const Contacts& contacts() const { return contacts_; }

private:
    const StepTable& table_;
    const Contacts& contacts_;
    bool fit_ = true;
    int count_ = 0;
    Stop stops_[MOST];
    std::vector<double> rows_;
};

template <int P>
class StepWalk;

/// Who sees nothing of a walk: see `PeakObserver`.
struct NoObserver {
    static constexpr bool is_idle() { return true; }
    template <int P>
    void begin(const StepWalk<P>&, const double*) {}
    void pass(double, double, double, const double*, const double*) {}
};

/// How a walk, or a part of it, ended.
enum class Walked { NONE, HIT, DECLINED, UNFINISHED };

/// One walk along a flight, past all its stops. P: see `StepTable::pairs`.
template <int P = DYNAMIC>
class StepWalk {
public:
    /// A step that holds exactly one impact, about the time of that, and bounds of |w''|, |w'''| and |w''''|.
    struct Hit {
        int contact;
        double begin, end, guess, curvature, jerk, fourth;
    };

    StepWalk(const StepStops& stops, double horizon)
        : stops_(stops.list()), table_(stops.table()), contacts_(stops.contacts()), horizon_(horizon) {
        for (size_t s = 0; s < stops_.size(); ++s) seen_[s].far = false;
    }
    /// Begin, or go on, at a state computed for the present time. False where a contact other than the one it leaves is
    /// near.
    bool start(const double* z, int leaving);
    /// Step on to the horizon or an impact. UNFINISHED: after many steps, so that rounding errors do not accumulate.
    /// `observer` sees each step before the impact. Without impacts ahead the walk goes on while it is not idle.
    template <class Observer>
    Walked go(Observer& observer);
    double time() const { return t_; }
    double horizon() const { return horizon_; }
    /// The present state over x and then y, and the amplitudes of its blocks.
    const double* state() const { return state_; }
    const double* radii() const { return radii_; }
    const Hit& hit() const { return hit_; }

private:
    /// What a walk knows of one stop.
    struct Seen {
        double w, v, next_w, next_v;
        double curvature, third, fourth, fifth, noise;
        double side;        // that the flight leaves: +1 upper, -1 lower
        double bend, jerk;  // w'' and w''' there
        bool far;           // w cannot reach a bound any more
    };
    enum Verdict { CLEAR, CROSSED, PASSED, UNDECIDED };

    template <int COUNT, class Observer>
    Walked go_on(Observer& observer);
    Verdict judge(const StepStops::Stop& stop, const Seen& seen, double h, bool fresh) const;
    bool keeps_on(const StepStops::Stop& stop, const Seen& seen, double h, const double* next) const;
    Walked reach(int stop, double h, const double* next);
    int count() const { return P == DYNAMIC ? table_.count() : P; }

    std::span<const StepStops::Stop> stops_;
    const StepTable& table_;
    const Contacts& contacts_;
    double horizon_, t_ = 0.0;
    Hit hit_;
    bool fresh_ = false;  // the flight leaves a stop
    static constexpr int PAIRS = P == DYNAMIC ? StepStops::MOST_PAIRS : P;
    Seen seen_[StepStops::MOST];
    double radii_[PAIRS], buffers_[2][2 * PAIRS];
    double* state_ = buffers_[0];
};

/// The first entries of row . state.
inline double part_of(const double* row, const double* state, int size) {
    double total = row[0] * state[0];
    for (int r = 1; r < size; ++r) total += row[r] * state[r];
    return total;
}

/// Whether a distance that is 0 stays positive over a step of h, by its three derivatives at the begin and a bound of
/// the fourth: the Bezier coefficients of the distance over the time, a cubic, are positive.
inline bool moves_away(double slope, double bend, double jerk, double fourth, double h) {
    const double first = bend * h, second = jerk * h * h, third = fourth * h * h * h;
    return slope > 0.0 && slope + first * (1.0 / 6.0) > 0.0 && slope + first * (1.0 / 3.0) + second * (1.0 / 18.0) > 0.0 &&
           slope + first * 0.5 + second * (1.0 / 6.0) - third * (1.0 / 24.0) > 0.0;
}

template <int P>
inline StepWalk<P>::Verdict StepWalk<P>::judge(const StepStops::Stop& stop, const Seen& seen, double h, bool fresh) const {
    // Equation (11): the inner Bezier coefficients, and the error of the cubic.
    const double w = seen.w, v = seen.v, wn = seen.next_w, vn = seen.next_v;
    const double first = w + h * v * (1.0 / 3.0), second = wn - h * vn * (1.0 / 3.0);
    const double square = h * h, error = seen.fourth * (square * square * (1.0 / 384.0)) + seen.noise;
    bool above = std::max(std::max(first, second), std::max(w, wn)) + error < stop.upper;
    bool below = std::min(std::min(first, second), std::min(w, wn)) - error > stop.lower;
    if (fresh && seen.side != 0.0) {
        const double away = -seen.side;
        if (!moves_away(away * v, away * seen.bend, away * seen.jerk, seen.fourth, h)) return UNDECIDED;
        (seen.side > 0.0 ? above : below) = true;
    }
    if (above && below) return CLEAR;
    const bool passes = (wn > stop.upper + seen.noise && v > 0.0) || (wn < stop.lower - seen.noise && v < 0.0);
    const bool steadily = v * vn > 0.0 && std::min(std::fabs(v), std::fabs(vn)) > seen.third * (square * 0.125);
    return !passes ? UNDECIDED : steadily ? CROSSED : PASSED;
}

/// Whether w' keeps its sign over a step of h at whose end w is beyond a bound: as equation (11), with w' in place of w.
template <int P>
bool StepWalk<P>::keeps_on(const StepStops::Stop& stop, const Seen& seen, double h, const double* next) const {
    const double up = seen.v > 0.0 ? 1.0 : -1.0, v = up * seen.v, vn = up * seen.next_v;
    const double first = v + h * (1.0 / 3.0) * (up * part_of(stop.acceleration, state_, 2 * count()));
    const double second = vn - h * (1.0 / 3.0) * (up * part_of(stop.acceleration, next, 2 * count()));
    return std::min(std::min(first, second), std::min(v, vn)) > seen.fifth * (h * h * h * h * (1.0 / 384.0));
}

template <int P>
template <int COUNT, class Observer>
Walked StepWalk<P>::go_on(Observer& observer) {
    // rounding errors do not accumulate; bounds of a decaying motion become less
    const int most = table_.is_steady() ? 1024 : 16;
    const int count = COUNT == DYNAMIC ? table_.count() : COUNT;
    double *state = state_, *next = state_ == buffers_[0] ? buffers_[1] : buffers_[0];
    bool all_far = true;
    for (size_t s = 0; s < stops_.size(); ++s) all_far = all_far && seen_[s].far;
    int level = 0;
    bool fresh = fresh_;
    for (int steps = 0; t_ < horizon_;) {
        if (all_far && observer.is_idle()) return Walked::NONE;
        if (steps == most) return Walked::UNFINISHED;
        const double* __restrict e = table_.entries(level);
        const double h = table_.length(level);
        double* __restrict out = next;
        for (int k = 0; k < count; ++k) {
            out[k] = e[k] * state[k] + e[count + k] * state[count + k];
            out[count + k] = e[2 * count + k] * state[k] + e[3 * count + k] * state[count + k];
        }
        bool undecided = false;
        int ahead = -1;
        for (int s = 0; s < int(stops_.size()) && !undecided; ++s) {
            const StepStops::Stop& stop = stops_[s];
            Seen& seen = seen_[s];
            if (seen.far) continue;
            seen.next_w = part_of(stop.value, out, count);
            seen.next_v = part_of(stop.rate + count, out + count, count);
            if (!stop.plain) {
                seen.next_w += part_of(stop.value + count, out + count, count);
                seen.next_v += part_of(stop.rate, out, count);
            }
            Verdict verdict = judge(stop, seen, h, fresh);
            if (verdict == PASSED) verdict = keeps_on(stop, seen, h, out) ? CROSSED : UNDECIDED;
            undecided = verdict == UNDECIDED || (verdict == CROSSED && ahead >= 0);
            if (verdict == CROSSED) ahead = s;
        }
        if (undecided) {
            if (++level == StepTable::LEVELS) return Walked::DECLINED;
            continue;
        }
        if (ahead >= 0) return reach(ahead, h, next);
        if (!observer.is_idle()) observer.pass(t_, h, horizon_ - t_, state, next);
        for (size_t s = 0; s < stops_.size(); ++s)
            seen_[s].w = seen_[s].next_w, seen_[s].v = seen_[s].next_v;
        std::swap(state, next);
        state_ = state;
        fresh = false;
        t_ += h;
        if (level > 0) --level;
        ++steps;
    }
    return Walked::NONE;
}

template <int P>
template <class Observer>
Walked StepWalk<P>::go(Observer& observer) {
    bool all_far = observer.is_idle();
    for (size_t s = 0; s < stops_.size(); ++s) all_far = all_far && seen_[s].far;
    if (all_far) return Walked::NONE;
    if constexpr (P != DYNAMIC) {
        return go_on<P>(observer);
    } else {
        switch (table_.count()) {
            case 1: return go_on<1>(observer);
            case 2: return go_on<2>(observer);
            case 3: return go_on<3>(observer);
            case 4: return go_on<4>(observer);
            case 5: return go_on<5>(observer);
            case 6: return go_on<6>(observer);
            default: return go_on<DYNAMIC>(observer);
        }
    }
}

template <int P>
bool StepWalk<P>::start(const double* z, int leaving) {
    constexpr double NOISE = 1e-12;  // rounding errors of w, as a part of the sizes that make it up: far more than the contact tolerance
    const int size = 2 * count();
    double* state = state_;
    table_.template split<P>(z, state);
    table_.template radii<P>(z, radii_);
    fresh_ = leaving >= 0;
    for (size_t s = 0; s < stops_.size(); ++s) {
        const StepStops::Stop& stop = stops_[s];
        Seen& seen = seen_[s];
        const bool leaves = fresh_ && stop.has(leaving);
        if (seen.far) continue;
        const StepTable::Amplitudes found = table_.template amplitudes<P>(contacts_.gap[stop.contact()], stop.reaches, z, radii_,
                                                              std::max(horizon_ - t_, 0.0));
        seen.curvature = found.second, seen.third = found.third, seen.fourth = found.fourth, seen.fifth = found.fifth;
        seen.noise = NOISE * (part_of(stop.sizes, radii_, size / 2) + std::min(std::fabs(stop.lower), std::fabs(stop.upper)));
        seen.far = !leaves && found.level + seen.noise < std::min(stop.upper, -stop.lower);
        seen.w = part_of(stop.value, state, size);
        seen.v = part_of(stop.rate, state, size);
        seen.side = leaves ? contacts_.side[leaving] : 0.0;
        double below = stop.lower + seen.noise, above = stop.upper - seen.noise;
        if (leaves) {
            if (contacts_.restitution[leaving] == 0.0 || -seen.side * seen.v <= 0.0) return false;
            seen.w = seen.side > 0.0 ? stop.upper : stop.lower;
            (seen.side > 0.0 ? above : below) = seen.side * INFINITE;
            const Values acceleration = contacts_.acceleration[leaving];
            const int entries = P == DYNAMIC ? int(acceleration.size()) : 2 * P;
            Local<double, P == DYNAMIC ? DYNAMIC : 2 * P, 64> rate(entries);
            seen.bend = part_of(acceleration.data(), z, entries);
            table_.template rate<P>(z, rate.data());
            seen.jerk = part_of(acceleration.data(), rate.data(), entries);
        }
        if (!(below < seen.w && seen.w < above)) return false;
    }
    return true;
}

template <int P>
Walked StepWalk<P>::reach(int s, double h, const double* next) {
    const StepStops::Stop& stop = stops_[s];
    const Seen& seen = seen_[s];
    const int size = 2 * count();
    const bool up = seen.v > 0.0;
    const Sample begin{seen.w, seen.v, part_of(stop.acceleration, state_, size)};
    const Sample end{seen.next_w, seen.next_v, part_of(stop.acceleration, next, size)};
    const double part = zero_in_step(begin, end, h, up ? stop.upper : stop.lower);
    hit_ = {up ? stop.high : stop.low, t_, t_ + h, t_ + part * h, seen.curvature, seen.third, seen.fourth};
    return Walked::HIT;
}

}  // namespace saltus
