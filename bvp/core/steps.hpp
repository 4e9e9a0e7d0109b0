/// Impacts found in steps of fixed length, equation (11).
///
/// The cubic with the values and slopes of w at both ends of a step of h lies within its four Bezier coefficients. It
/// differs from w by at most W h^4/384, where |w''''| <= W.
///
///     If all coefficients are farther than this from the bounds, the step has no impact.
///     If w passes a bound and |w'| > J h^2/8 at both ends, where |w'''| <= J, then w' keeps its sign and the step has
///     exactly one impact.
///     Otherwise the step is halved.
///
/// Off the stop that the flight leaves, the distance over the time, a cubic, has to stay positive. What needs steps
/// below h/2^11 is declined.
#pragma once

#include <algorithm>

#include "contact.hpp"
#include "step_table.hpp"

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

class StepWalk;

/// Who sees nothing of a walk: see `PeakObserver`.
struct NoObserver {
    static constexpr bool is_idle() { return true; }
    void begin(const StepWalk&, Values) {}
    void pass(double, double, double, const double*) {}
};

/// One walk along a flight, past all its stops.
class StepWalk {
public:
    enum Reason { NONE, HIT, DECLINED, UNFINISHED };
    /// A step that holds exactly one impact, about the time of that, and bounds of |w''| and |w'''|.
    struct Hit {
        int contact;
        double begin, end, guess, curvature, jerk;
    };

    StepWalk(const StepStops& stops, double horizon)
        : stops_(stops.list()), table_(stops.table()), contacts_(stops.contacts()), horizon_(horizon) {}
    /// Begin, or go on, at a state computed for the present time. False where a contact other than the one it leaves is
    /// near.
    bool start(Values z, int leaving);
    /// Step on to the horizon or an impact. UNFINISHED: after many steps, so that rounding errors do not accumulate.
    /// `observer` sees each step before the impact. Without impacts ahead the walk goes on while it is not idle.
    template <class Observer>
    Reason go(Observer& observer);
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
        double curvature, third, fourth, noise;
        double side = 0.0;  // that the flight leaves: +1 upper, -1 lower
        double bend, jerk;  // w'' and w''' there
        bool far = false;   // w cannot reach a bound any more
    };
    enum Verdict { CLEAR, CROSSED, UNDECIDED };

    template <int P, class Observer>
    Reason go_on(Observer& observer);
    Verdict judge(int stop, double h, bool fresh) const;
    Reason reach(int stop, double h, const double* next);

    std::span<const StepStops::Stop> stops_;
    const StepTable& table_;
    const Contacts& contacts_;
    double horizon_, t_ = 0.0;
    Hit hit_;
    bool fresh_ = false;  // the flight leaves a stop
    Seen seen_[StepStops::MOST];
    double radii_[StepStops::MOST_PAIRS], buffers_[2][2 * StepStops::MOST_PAIRS];
    double* state_ = buffers_[0];
};

/// The first entries of row . state.
inline double part_of(const double* row, const double* state, int size) {
    double total = 0.0;
    for (int r = 0; r < size; ++r) total += row[r] * state[r];
    return total;
}

/// Whether a distance that is 0 stays positive over a step of h, by its three derivatives at the begin and a bound of
/// the fourth: the Bezier coefficients of the distance over the time, a cubic, are positive.
inline bool moves_away(double slope, double bend, double jerk, double fourth, double h) {
    return slope > 0.0 && slope + bend * h / 6.0 > 0.0 && slope + bend * h / 3.0 + jerk * h * h / 18.0 > 0.0 &&
           slope + bend * h / 2.0 + jerk * h * h / 6.0 - fourth * h * h * h / 24.0 > 0.0;
}

inline StepWalk::Verdict StepWalk::judge(int s, double h, bool fresh) const {
    const StepStops::Stop& stop = stops_[s];
    const Seen& seen = seen_[s];
    // Equation (11): the inner Bezier coefficients, and the error of the cubic.
    const double w = seen.w, v = seen.v, wn = seen.next_w, vn = seen.next_v;
    const double first = w + h * v * (1.0 / 3.0), second = wn - h * vn * (1.0 / 3.0);
    const double error = seen.fourth * (h * h * h * h * (1.0 / 384.0)) + seen.noise;
    bool above = std::max(std::max(first, second), std::max(w, wn)) + error < stop.upper;
    bool below = std::min(std::min(first, second), std::min(w, wn)) - error > stop.lower;
    if (fresh && seen.side != 0.0) {
        const double away = -seen.side;
        if (!moves_away(away * v, away * seen.bend, away * seen.jerk, seen.fourth, h)) return UNDECIDED;
        (seen.side > 0.0 ? above : below) = true;
    }
    if (above && below) return CLEAR;
    const bool passes = (wn > stop.upper + seen.noise && v > 0.0) || (wn < stop.lower - seen.noise && v < 0.0);
    const bool steadily = v * vn > 0.0 && std::min(std::fabs(v), std::fabs(vn)) > seen.third * (h * h * 0.125);
    return passes && steadily ? CROSSED : UNDECIDED;
}

template <int P, class Observer>
StepWalk::Reason StepWalk::go_on(Observer& observer) {
    // rounding errors do not accumulate; bounds of a decaying motion become less
    const int most = table_.is_steady() ? 1024 : 16;
    const int count = P == DYNAMIC ? table_.count() : P;
    double *state = state_, *next = state_ == buffers_[0] ? buffers_[1] : buffers_[0];
    bool all_far = true;
    for (size_t s = 0; s < stops_.size(); ++s) all_far = all_far && seen_[s].far;
    int level = 0;
    bool fresh = fresh_;
    for (int steps = 0; t_ < horizon_;) {
        if (all_far && observer.is_idle()) return NONE;
        if (steps == most) return UNFINISHED;
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
            const Verdict verdict = judge(s, h, fresh);
            undecided = verdict == UNDECIDED || (verdict == CROSSED && ahead >= 0);
            if (verdict == CROSSED) ahead = s;
        }
        if (undecided) {
            if (++level == StepTable::LEVELS) return DECLINED;
            continue;
        }
        if (ahead >= 0) return reach(ahead, h, next);
        if (!observer.is_idle()) observer.pass(t_, h, horizon_ - t_, next);
        for (size_t s = 0; s < stops_.size(); ++s)
            seen_[s].w = seen_[s].next_w, seen_[s].v = seen_[s].next_v;
        std::swap(state, next);
        state_ = state;
        fresh = false;
        t_ += h;
        if (level > 0) --level;
        ++steps;
    }
    return NONE;
}

template <class Observer>
StepWalk::Reason StepWalk::go(Observer& observer) {
    bool all_far = observer.is_idle();
    for (size_t s = 0; s < stops_.size(); ++s) all_far = all_far && seen_[s].far;
    if (all_far) return NONE;
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

}  // namespace saltus
