/// Sign changes, crossings and extrema of a linear functional f along a path, by bounds instead of sampling.
///
/// With |f''| <= W over the flight, f keeps its sign over the step (|f'| + sqrt(f'^2 + 2 W |f|))/W away from zero (with
/// f' counted against it where it points to zero), and f is monotone over |f'|/W. With |f'''| <= V, f' keeps its sign,
/// and f is monotone, over the step of the same form for f' and f''. Steps take the longest of these, and longer ones
/// where the same holds backwards from their ends, so each holds at most one zero, and that one changes the sign. A step
/// in which f changes by its rounding alone is not divided: what is smaller cannot be seen.
///
/// The searches take a track (see `LinearTrack`): f, f' and f'' at a time, bounds of |f''| and |f'''| and the time up
/// to which they hold.
#pragma once

#include <algorithm>

#include "path.hpp"

namespace saltus {

/// Values up to these have no sign: inside a flight, at its begin and at its end. Where one of the ends is infinite, f
/// is zero there and has the sign that it has beside it.
struct ZeroLevels {
    double inside = 0.0, first = 0.0, last = 0.0;
};

/// Goes along a track from one sign change to the next.
template <class Track>
class SignWalk {
public:
    SignWalk(Track& track, double shortest, ZeroLevels levels, int sign = 0)
        : track_(track), shortest_(shortest), levels_(levels), sign_(sign) {}

    /// Go on to the next sample whose sign is not that before. False at the end of the flight, or where the search
    /// gives up.
    bool next() {
        constexpr int STEP_LIMIT = 100'000;  // a flight of a thousand periods takes some ten thousand
        constexpr double TWO_UNITS = 4e-16, LEAP = 1.6;
        bool found = false;
        while (!found && ahead_ <= track_.duration() && steps_ < STEP_LIMIT) {
            ++steps_;
            const Sample now = track_.at(ahead_);
            double least = ahead_ == 0.0 ? levels_.first : ahead_ >= track_.duration() ? levels_.last : levels_.inside;
            const bool has_sign = std::fabs(now.value) > least;
            if (ahead_ > safe_ && !(has_sign && is_covered(now, ahead_ - here_))) {
                ahead_ = safe_;
                continue;
            }
            before_ = here_, left_ = right_;
            here_ = ahead_, right_ = now;
            bounds_ = track_.bounds(here_);
            forwards_ = reach(now, now.slope, bounds_);
            double step = forwards_.longest();
            f_ = now.value;
            if (least == INFINITE) f_ = here_ == 0.0 ? now.slope : -now.slope, least = 0.0;
            found = std::fabs(f_) > least && (sign_ == 0 || (f_ > 0.0) != (sign_ > 0));
            // Beside a tangency: f and its changes in this time are rounding.
            const double rounding = TWO_UNITS * track_.level();
            if (step * step * bounds_.second < rounding) step = std::sqrt(rounding / bounds_.second);
            const double room = track_.until(here_) - here_;
            step = std::max(std::min(step, room), shortest_);
            safe_ = std::min(track_.duration(), here_ + step);
            // The sign beside a sample without one is not to be missed.
            if (has_sign) step = std::max(step, std::min(LEAP * step, room));
            ahead_ = here_ >= track_.duration() ? INFINITE : std::min(track_.duration(), here_ + step);
        }
        if (!found) return false;
        last_sign_ = sign_;
        sign_ = f_ > 0.0 ? 1 : -1;
        return true;
    }

    /// The sign before the change, and after it; 0: none yet.
    int before() const { return last_sign_; }
    int sign() const { return sign_; }
    bool at_begin() const { return here_ == 0.0; }
    bool gave_up() const { return ahead_ != INFINITE; }
    int steps() const { return steps_; }
    void count_steps(int earlier) { steps_ = earlier; }

    /// The time of the change, between the last two samples, where f changes its sign once.
    double time(double tolerance) {
        double low = before_, high = here_, root = low + zero_in_step(left_, right_, high - low, 0.0) * (high - low);
        const bool positive = f_ <= 0.0;
        for (int count = 0; count < 100; ++count) {
            const double middle = 0.5 * (low + high);
            if (!(low <= root && root <= high)) root = middle;
            const Sample now = track_.at(root);
            ((now.value > 0.0) == positive ? low : high) = root;
            const double divisor = now.slope * now.slope - 0.5 * now.value * now.bend, half = 0.5 * (low + high);
            double better = divisor != 0.0 ? root - now.value * now.slope / divisor : half;  // Halley
            if (!(low <= better && better <= high)) better = half;
            if (std::fabs(better - root) <= tolerance) return better;
            root = better;
        }
        return root;
    }

private:
    /// Times from a sample in which f has no zero, and in which it is monotone, equation (26) for f and for f'. A bound
    /// of 0 is none.
    struct Reach {
        double free = INFINITE, monotone = INFINITE;
        double longest() const { return std::max(free, monotone); }
    };
    /// slope: in the direction of the time that is meant.
    static Reach reach(const Sample& now, double slope, const Bounds& bounds) {
        Reach out;
        if (!(bounds.second > 0.0)) return out;
        out.free = free_step(std::fabs(now.value), now.value >= 0.0 ? slope : -slope, bounds.second);
        out.monotone = std::fabs(slope) / bounds.second;
        if (bounds.third > 0.0)
            out.monotone = std::max(out.monotone,
                                    free_step(std::fabs(slope), slope >= 0.0 ? now.bend : -now.bend, bounds.third));
        return out;
    }

    /// Whether a longer step holds one zero at most, by the reach of both its ends. Where these are two monotone parts,
    /// it holds two only if f first approaches zero and then departs from it, on the same side.
    bool is_covered(const Sample& now, double step) const {
        const Reach back = reach(now, -now.slope, bounds_);
        if (forwards_.free + back.longest() >= step || forwards_.monotone + back.free >= step) return true;
        return forwards_.monotone + back.monotone >= step &&
            (right_.value * now.value < 0.0 || right_.value * right_.slope > 0.0 || now.value * now.slope < 0.0);
    }

    Track& track_;
    double shortest_;
    ZeroLevels levels_;
    int sign_, last_sign_ = 0, steps_ = 0;
    double before_ = 0.0, here_ = 0.0, f_ = 0.0, ahead_ = 0.0, safe_ = 0.0;
    Sample left_{}, right_{};  // at the times before_ and here_
    Bounds bounds_;
    Reach forwards_;
};

/// Sign changes of f along a flight, and its last sign; changes < 0: the search gave up.
struct SignChanges {
    int changes, sign;
};

/// Count the sign changes of a functional for 0 < t < duration after an earlier sign (0: none yet). Values within
/// rounding of zero have no sign. Ends that are known to be zero have the sign of the values beside them: a change that
/// is nearer to such an end than rounding shows is counted.
template <class Path>
SignChanges sign_changes(const Path& path, const Functional& rows, double duration, int sign, bool begins_at_zero,
                         bool ends_at_zero) {
    auto track = path.track(rows, duration);
    const double level = 1e-13 * (track.level() + 1e-300);
    SignWalk walk(track, 1e-13 * duration, {level, begins_at_zero ? INFINITE : level, ends_at_zero ? INFINITE : level},
                  sign);
    int changes = 0;
    while (walk.next()) changes += walk.before() != 0;
    return {walk.gave_up() ? -1 : changes, walk.sign()};
}

/// Times in (0, duration) at which a functional changes its sign, into `times` as far as there is room; a zero at the
/// very end is no change. Returns how many there are, -1 where the search gave up.
template <class Path>
int crossing_times(const Path& path, const Functional& rows, double duration, Vector<double> times) {
    auto track = path.track(rows, duration);
    const double level = 1e-13 * track.level();
    double f = dot(rows.value, path.begin());
    if (std::fabs(f) <= level) f = dot(rows.rate, path.begin());
    SignWalk walk(track, 1e-12 * duration, {0.0, level, level}, f >= 0.0 ? 1 : -1);
    int count = 0;
    for (; walk.next(); ++count)
        if (count < int(times.size())) times[count] = walk.at_begin() ? 0.0 : walk.time(1e-13 * duration);
    return walk.gave_up() ? -1 : count;
}

/// Times in [0, duration) at which a functional crosses zero upwards, into `times`, after an earlier sign (0: none
/// yet). Values within rounding of zero have no sign. A crossing at the beginning, where the flight before ended below
/// zero, is at time 0. Returns their number and the last sign; the number is -1 where the search gave up or there is no
/// room.
template <class Path>
SignChanges rises(const Path& path, const Functional& rows, double duration, int sign, Vector<double> times) {
    auto track = path.track(rows, duration);
    const double level = 1e-13 * (track.level() + 1e-300);
    SignWalk walk(track, 1e-13 * duration, {level, level, level}, sign);
    int count = 0;
    while (walk.next()) {
        if (walk.before() == 0 || walk.sign() < 0) continue;
        if (count < int(times.size())) times[count] = walk.at_begin() ? 0.0 : walk.time(1e-16 * duration);
        ++count;
    }
    return {walk.gave_up() || count > int(times.size()) ? -1 : count, walk.sign()};
}

/// The distance of a gap from a bound at a turning point, the side of that bound, and the time. The distance is
/// infinite if w has no turning point, and not a number if the search gave up.
struct Clearance {
    double distance = INFINITE, side = 0.0, time = 0.0;

    /// Take another contact if it is nearer. At a tie the distance is the smaller one, side and time are those of the
    /// earlier: the second one is where it is not later than the first by `slack`.
    void take(const Clearance& other, double tie, double slack) {
        const double least = std::min(distance, other.distance);
        if (other.distance < distance - tie || (other.distance < distance + tie && other.time < time + slack))
            *this = other;
        distance = least;
    }
};

/// Part of its size by which rounding can change a distance, a speed or a time of an orbit. Of two nearer than this,
/// the earlier counts.
inline constexpr double TIE = 1e-13;

/// Difference of two distances w = gap . position, with the speeds w' = rate . velocity, that is a tie in a flight of
/// `duration`.
inline double tie_of(Values gap, Values rate, Values position, Values velocity, double duration) {
    double size = 0.0;
    for (int r = 0; r < int(gap.size()); ++r)
        size += std::fabs(gap[r] * position[r]) + duration * std::fabs(rate[r] * velocity[r]);
    return TIE * size;
}

/// A gap with its bounds, and the rows of its three derivatives.
struct ObservedGap {
    Values value, rate, second, third;
    double lower, upper;
};

/// What a search of a flight in pieces carries over: the sign of w' before the piece (0: the flight begins), and the
/// steps made.
struct TurnState {
    int sign = 0, steps = 0;
};

/// Find the smallest distance of w from its bounds at the turning points inside a piece of a flight. Of equal distances
/// (`tie`) the first counts. Turning points after the time `last` are at the end of a closed orbit, and so at its
/// begin: at a tie they are the first.
template <class Path>
Clearance nearest_turn(const Path& path, const ObservedGap& gap, double duration, double tie, double last,
                       TurnState& state) {
    auto track = path.track({gap.rate, gap.second, gap.third}, duration);
    SignWalk walk(track, 1e-13 * duration, {}, state.sign);
    walk.count_steps(state.steps);
    Local<double, Path::SIZE> there(path.size());
    Clearance best;
    while (walk.next()) {
        if (walk.before() == 0) continue;
        const double turn = walk.time(1e-9 * duration);
        path.state(turn, there);
        const double w = dot(gap.value, Values(there));
        const bool high = walk.before() > 0;
        best.take({high ? gap.upper - w : w - gap.lower, high ? 1.0 : -1.0, turn}, tie, turn > last ? INFINITE : 0.0);
    }
    state = {walk.sign(), walk.steps()};
    if (walk.gave_up()) best.distance = NOT_A_NUMBER;
    return best;
}

template <class Path>
Clearance clearance(const Path& path, const ObservedGap& gap, double duration, double tie = 0.0,
                    double last = INFINITE) {
    TurnState state;
    return nearest_turn(path, gap, duration, tie, last, state);
}

}  // namespace saltus
