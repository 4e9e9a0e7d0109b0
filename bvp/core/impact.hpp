/// The next impact of a flight, by bounds instead of sampling.
///
/// A contact has the signed distance d(t) = side (bound - w(t)), w = gap . z(t), with d >= 0 in free flight. A path
/// bounds |w''| <= W and |w'''| <= J over what is left of the flight. From d, d', d'' at one instant follows, by
/// equations (3) and (25),
///
///     a step without a root       h = 2 d/(-d' + sqrt(d'^2 + 2 W d)),  or  3 d''/J  where d' >= 0 and d'' > 0;
///     a certified root            where d' < 0 and 4 W d <= d'^2: exactly one root within 2 d/|d'|
///                                 (Newton-Kantorovich); d here counts the contact tolerance, so that rounding cannot
///                                 make a hit of a touch;
///                                 or where |d'''| <= J keeps d' below a third of its start until d < 0: d falls
///                                 through its one root;
///     a certified turning point   where d' < 0 < d'' and 4 J |d'| <= d''^2: d falls to its one minimum within
///                                 2 |d'|/d'' and is convex there, so the value at the minimum decides between
///                                 passing, a touch and a hit.
///
/// Steps therefore shrink onto a root quadratically until it is certified, and Newton on the exact flight does the
/// rest. Only the contact just left is treated apart, and only until its distance is well above the tolerance: d(t)/t
/// then comes from the series of d at the start. Most impacts need none of this: the steps of fixed length of
/// `steps.hpp` find them first.
#pragma once

#include <algorithm>

#include <tuple>

#include "path.hpp"
#include "steps.hpp"

namespace saltus {

/// NONE: no impact up to the horizon. PRESSED: the motion stays pressed against the stop it starts on. OUTSIDE: the
/// start lies beyond a stop. EXHAUSTED: the search gave up.
enum class Found { NONE, HIT, TOUCH, PRESSED, OUTSIDE, EXHAUSTED };

struct NextImpact {
    Found found;
    int contact;
    double time;
};

/// THE contact tolerance, a fraction of the sizes that make up a distance, |bound| + sum |g_i z_i|. A turning point of
/// w within it of the bound, on either side, is a touch: it is reported and the motion goes on. Beyond it w crosses and
/// hits.
inline constexpr double CONTACT_TOLERANCE = 1e-13;

/// The distance of a contact at one instant, and the contact tolerance in its units.
struct Gap {
    double d, slope, bend, tolerance;
};

inline Gap gauge(const Contacts& contacts, int c, Values z) {
    const double *gap = contacts.gap[c].data(), *rate = contacts.rate[c].data();
    const double* acceleration = contacts.acceleration[c].data();
    double w = 0.0, slope = 0.0, bend = 0.0, size = std::fabs(contacts.bound[c]);
    for (int r = 0; r < int(z.size()); ++r) {
        const double part = gap[r] * z[r];
        w += part;
        size += std::fabs(part);
        slope += rate[r] * z[r];
        bend += acceleration[r] * z[r];
    }
    const double side = contacts.side[c];
    return {side * (contacts.bound[c] - w), -side * slope, -side * bend, CONTACT_TOLERANCE * size};
}

/// Bounds of |d''| and |d'''|, and the time over which they hold.
struct GapBounds {
    double curvature, jerk, window;
};

/// The zero of d + d' h + d'' h^2/2 nearest to h = 0, for d' < 0; Newton's step if there is no zero.
inline double quadratic_step(double d, double slope, double bend) {
    const double square = slope * slope - 2.0 * bend * d;
    return square > 0.0 ? 2.0 * d / (-slope + std::sqrt(square)) : -d / slope;
}

inline double limited(double bend, double curvature) { return std::max(-curvature, std::min(bend, curvature)); }

/// Refine a nearby zero of d along the exact flight to rounding, by steps of third order; of fourth order where a bound of its
/// fourth derivative is known.
template <class Path>
double polish_root(const Path& path, const Contacts& contacts, int c, double curvature, double jerk, double t, double fourth = INFINITE) {
    constexpr double CLOSE = 0.1;
    Local<double, Path::SIZE> state(path.size()), rate(path.size());
    const double side = contacts.side[c];
    double last = INFINITE;
    for (int count = 0; count < 60; ++count) {
        path.state(t, state);
        const double d = side * (contacts.bound[c] - dot(contacts.gap[c], Values(state)));
        const double slope = -side * dot(contacts.rate[c], Values(state));
        const double bend = limited(-side * dot(contacts.acceleration[c], Values(state)), curvature);
        if (slope >= 0.0) break;
        const double inverse = 1.0 / slope, first = -d * inverse, x = 0.5 * (bend * inverse) * first;
        double step = 0.0, rest = 0.0;
        bool is_series = false;
        if constexpr (requires { path.rate(Values(state), rate); }) {
            is_series = fourth < INFINITE && std::fabs(x) <= CLOSE;
            if (is_series) {  // the zero as a series in d/d', and a bound of its next term
                path.rate(Values(state), rate);
                const double square = first * first, reach = std::fabs(first);
                const double y = limited(-side * dot(contacts.acceleration[c], Values(rate)), jerk) * (inverse * (1.0 / 6.0)) * square;
                step = first * ((1.0 - x) + (2.0 * (x * x) - y));
                rest = reach * (5.0 * std::fabs(x) * (x * x + std::fabs(y)) - fourth * (inverse * (1.0 / 24.0)) * (square * reach));
            }
        }
        if (!is_series) {
            step = quadratic_step(d, slope, bend);
            rest = -jerk * (inverse * (1.0 / 6.0)) * (step * step * std::fabs(step));
        }
        const double size = std::fabs(step);
        t = std::max(t + step, 0.0);
        if (6.0 * rest <= 1e-16 * t || size >= last) break;
        last = size;
    }
    return t;
}

/// What one test of a contact shows: a step without an impact, or what it meets, and when.
struct Judgement {
    enum Verdict { CLEAR, HIT, TOUCH, TURN, CROSSED } verdict;
    double value;  // CLEAR: the step; else the time from now, or the time itself once it is known
};

/// Judge d and its derivatives at one instant. HIT: a certified root at about `value`. TURN: a certified turning point
/// ahead. TOUCH, CROSSED: w is within the tolerance of the bound and past its turning point, or beyond the bound,
/// without a certificate before (roots of third order and more, which the walk in steps of the tolerance finds). fresh:
/// the contact may be within the tolerance because the flight began there, which is no touch.
inline Judgement judge_gap(const Gap& gap, const GapBounds& bounds, bool fresh) {
    const auto [d, slope, bend, tolerance] = gap;
    const auto [curvature, jerk, window] = bounds;
    if (d < -tolerance) return {Judgement::CROSSED, slope < 0.0 ? quadratic_step(d, slope, bend) : 0.0};
    const double distance = std::max(d, 0.0);
    // Equation (3) with the bound over the full flight, then with a tighter one over a short time.
    double step = free_step(distance, slope, curvature);
    const double trial = 2.0 * step, local = jerk * trial / 3.0 - bend;
    if (local < curvature) step = std::max(step, std::min(trial, free_step(distance, slope, std::max(local, 0.0))));
    // Steps must not shrink to nothing within the tolerance; but they stay below it, or a crossing would be missed.
    if (d <= tolerance) step = std::max(step, free_step(distance + 0.25 * tolerance, slope, curvature));
    if (slope >= 0.0) {
        if (d <= tolerance && !fresh) return {Judgement::TOUCH, 0.0};
        if (bend > 0.0 && jerk > 0.0) step = std::max(step, 3.0 * bend / jerk);
        return {Judgement::CLEAR, step};
    }
    if (step >= window) return {Judgement::CLEAR, step};
    // Equation (25), first certificate. The tolerance is added so that rounding cannot make an impact of a touch.
    const double level = distance + tolerance, reach = -2.0 * level / slope;
    if (4.0 * std::min(curvature, std::fabs(bend) + jerk * reach) * level <= slope * slope && reach <= window)
        return {Judgement::HIT, quadratic_step(d, slope, bend)};
    // d' stays below a third of its value until d < 0, so d falls through exactly one zero.
    const double guess = quadratic_step(level, slope, bend), ahead = 1.25 * guess;
    if (ahead <= window && slope + ahead * (bend + 0.5 * jerk * ahead) <= 1.0 / 3.0 * slope &&
        level + ahead * (slope + ahead * (0.5 * bend + jerk * ahead / 6.0)) <= 0.0)
        return {Judgement::HIT, guess};
    // Equation (25), second certificate.
    if (bend > 0.0 && -4.0 * jerk * slope <= bend * bend && -2.0 * slope <= bend * window)
        return {Judgement::TURN, 0.0};
    return {Judgement::CLEAR, step};
}

/// Classify a certified turning point after time t: a hit or touch with its time, or the length of a step from t
/// without either.
template <class Path>
Judgement resolve_turn(const Path& path, const Contacts& contacts, int c, const GapBounds& bounds, double t, Gap gap,
                       bool fresh) {
    Local<double, Path::SIZE> state(path.size());
    // The end that the certificate gives: rounding of what is nearly 0 would lead anywhere.
    const double last = t - 2.0 * gap.slope / gap.bend;
    double turn = t;
    for (int count = 0; count < 30; ++count) {  // Newton's method for d' = 0
        const double change = -gap.slope / gap.bend;
        turn = std::min(std::max(turn + change, t), last);
        if (count > 0 && 0.5 * gap.bend * change * change <= 1e-3 * gap.tolerance) break;
        path.state(turn, state);
        gap = gauge(contacts, c, state);
    }
    const double least = gap.d - 0.5 * gap.slope * gap.slope / gap.bend;
    if (least > gap.tolerance || (fresh && least >= -gap.tolerance)) {
        double ahead = free_step(std::max(least, 0.0), 0.0, bounds.curvature);
        if (bounds.jerk > 0.0 || fresh) ahead = std::max(ahead, 3.0 * gap.bend / bounds.jerk);
        return {Judgement::CLEAR, turn - t + ahead};
    }
    if (least >= -gap.tolerance) return {Judgement::TOUCH, std::max(turn, t)};
    const double start = std::max(turn - std::sqrt(-2.0 * least / gap.bend), t);
    return {Judgement::HIT, polish_root(path, contacts, c, bounds.curvature, bounds.jerk, start)};
}

/// The distance of the contact just left, over the time, from its series at the start.
class NearSeries {
public:
    template <class Path>
    void begin(const Path& path, const Contacts& contacts, int c, int order) {
        reach_ = path.series(contacts.gap[c], terms_);
        for (int k = 0; k < NEAR_TERMS; ++k) terms_[k] = k + 1 < order ? 0.0 : -contacts.side[c] * terms_[k];
    }
    bool has_begun() const { return reach_ >= 0.0; }
    bool holds(double t) const { return reach_ * t <= NEAR_REACH; }

    /// Equation (25) for s(t) = d(t)/t, whose bend is at most J/3: the return, or a step without one.
    Judgement judge(double jerk, double t, double window) const {
        auto [s, fall] = at(t);
        s = std::max(s, 0.0);
        if (fall >= 0.0 || 4.0 * jerk * s > 3.0 * fall * fall || -2.0 * s < fall * window)
            return {Judgement::CLEAR, free_step(s, fall, jerk / 3.0)};
        double root = t, last = INFINITE;
        for (int count = 0; count < 60; ++count) {
            const double step = -s / fall;
            root += step;
            if (std::fabs(step) <= 1e-16 * root || std::fabs(step) >= last) break;
            last = std::fabs(step);
            std::tie(s, fall) = at(root);
        }
        return {Judgement::HIT, root};
    }

private:
    std::pair<double, double> at(double t) const {
        double s = 0.0, derivative = 0.0;
        for (int k = NEAR_TERMS - 1; k >= 0; --k) {
            derivative = derivative * t + s;
            s = s * t + terms_[k];
        }
        return {s, derivative};
    }
    double terms_[NEAR_TERMS];
    double reach_ = -1.0;
};

/// The certified search along one path. Bounds hold over a window: all of the flight where nothing damps or grows.
template <class Path>
class ImpactSearch {
public:
    ImpactSearch(const Path& path, const Contacts& contacts, int leaving, bool released, double horizon)
        : path_(path), contacts_(contacts), given_(leaving >= 0 && !released), released_(released), leaving_(leaving),
          found_{Found::NONE, -1, horizon}, watched_(contacts.count()), state_(path.size()) {}

    NextImpact run() {
        constexpr int STEP_LIMIT = 100'000;
        // Steps after which the bounds of a decaying motion are taken anew: they hold, but it becomes smaller.
        constexpr int RENEW = 8;
        copy(path_.begin(), state_);
        if (const int c = start_contact(); c >= 0) return {Found::OUTSIDE, c, 0.0};
        near_ = leaving_ >= 0;
        for (int c = 0; c < contacts_.count(); ++c) watched_[c] = {};
        const bool steady = path_.is_steady();
        const double growth = path_.growth();
        for (int count = 0; count < STEP_LIMIT; ++count) {
            const bool renew = count == 0 || (!steady && (growth > 0.0 || count % RENEW == 0));
            window_ = steady ? INFINITE : 2.0 * (found_.time - t_);
            if (growth > 0.0) window_ = path_.window(t_, std::min(window_, 1.0 / growth));
            step_ = std::min(window_, found_.time - t_);
            last_renewed_ = -1;
            for (int c = 0; c < contacts_.count(); ++c) {
                if (c == found_.contact) continue;
                if (renew) renew_bounds(c);
                if (watched_[c].is_far || watched_[c].rests) continue;
                if (const Found at_once = look_at(c, count == 0); at_once != Found::NONE) return {at_once, c, 0.0};
            }
            if (t_ + step_ >= found_.time) return found_;
            t_ += step_;
            path_.state(t_, state_);
        }
        return {Found::EXHAUSTED, -1, t_};
    }

private:
    struct Watched {
        double curvature = 0.0, jerk = 0.0;
        bool is_far = false;  // w cannot reach the bound
        bool fresh = true;    // within the tolerance since the start
        bool rests = false;   // the distance stays 0
    };

    /// The contact beyond which the start lies, or -1. If no contact is given, one that z is on becomes the one that
    /// the flight leaves.
    int start_contact() {
        const Values z = path_.begin();
        for (int c = 0; c < contacts_.count(); ++c) {
            if (c == leaving_) continue;
            const Gap gap = gauge(contacts_, c, z);
            // Where the bound and all displacements vanish, rounding is that of the velocities.
            if (!(gap.d >= -gap.tolerance) && !(gap.d >= -path_.rounding_level(contacts_.gap[c], z))) return c;
            if (leaving_ < 0 && gap.d <= gap.tolerance && gap.slope >= -path_.rounding_level(contacts_.rate[c], z))
                leaving_ = c;
        }
        return -1;
    }

    /// Equation (24). The two contacts of one stop share their bounds.
    void renew_bounds(int c) {
        const Values row = contacts_.gap[c];
        if (last_renewed_ < 0 || last_renewed_ != c - 1 ||
            !std::equal(row.begin(), row.end(), contacts_.gap[c - 1].begin()))
            bounds_ = path_.bounds(row, t_, state_, std::min(window_, 2.0 * (found_.time - t_)));
        last_renewed_ = c;
        watched_[c].jerk = bounds_.third;
        watched_[c].curvature = bounds_.second;
        watched_[c].is_far = bounds_.level < contacts_.side[c] * contacts_.bound[c];
    }

    /// Judge a contact at the present time: shorten the step or the horizon. Returns what is found at the start itself,
    /// else NONE.
    Found look_at(int c, bool starts) {
        // A start counts as near its stop until the distance is this many contact tolerances: a return from less, at a
        // speed below 1e-2 or so, would be known no better than rounding of w over that speed.
        constexpr double NEAR = 1e9;
        Watched& watched = watched_[c];
        Gap gap = gauge(contacts_, c, state_);
        // Its rounding is that of the fastest mode, even where that has died out.
        gap.bend = limited(gap.bend, watched.curvature);
        const bool own = c == leaving_ && near_;
        if (own) near_jerk_ = std::max(near_jerk_, watched.jerk);
        if (starts && (own || (gap.d <= gap.tolerance &&
                               std::fabs(gap.slope) <= path_.rounding_level(contacts_.rate[c], path_.begin()))))
            return open(c, gap, own);
        if (own) {
            if (t_ < apart_) {
                step_ = std::min(step_, apart_ - t_);
                return Found::NONE;
            }
            near_ = gap.d <= NEAR * gap.tolerance;
            if (near_) {  // d is rounding, so d(t)/t comes from the series of d at the start
                if (!series_.has_begun()) series_.begin(path_, contacts_, c, order_);
                near_ = series_.holds(t_);
            }
        }
        if (gap.d > gap.tolerance) watched.fresh = false;
        const Judgement seen = c == leaving_ && near_ ? series_.judge(near_jerk_, t_, window_) : judge(c, gap);
        if (seen.verdict == Judgement::CLEAR) step_ = std::min(step_, seen.value);
        else if (seen.value < found_.time)
            found_ = {seen.verdict == Judgement::TOUCH ? Found::TOUCH : Found::HIT, c, seen.value};
        return Found::NONE;
    }

    Judgement judge(int c, const Gap& gap) {
        const Watched& watched = watched_[c];
        const GapBounds bounds{watched.curvature, watched.jerk, window_};
        Judgement seen = judge_gap(gap, bounds, watched.fresh);
        if (seen.verdict == Judgement::HIT || (seen.verdict == Judgement::CROSSED && gap.slope < 0.0))
            return {Judgement::HIT, polish_root(path_, contacts_, c, bounds.curvature, bounds.jerk,
                                                std::max(t_ + seen.value, 0.0))};
        if (seen.verdict == Judgement::TURN) return resolve_turn(path_, contacts_, c, bounds, t_, gap, watched.fresh);
        if (seen.verdict != Judgement::CLEAR) seen.value = t_;
        return seen;
    }

    /// At the start of a flight from a contact the distance is 0 exactly; its derivatives decide whether the contact
    /// opens. Of another one without distance and speed they do, too: these are rounding.
    Found open(int c, const Gap& gap, bool own) {
        // A contact just released counts as being without rate and acceleration within this many roundings: its force
        // has gone through other numbers.
        constexpr double RELEASED = 1000.0;
        const Watched& watched = watched_[c];
        const bool exact = own && given_ && contacts_.restitution[c] != 0.0;
        double force = -INFINITE, still = 0.0, ahead = 0.0;
        if (!(exact && gap.slope > 0.0)) {
            const double factor = own && released_ ? RELEASED : 1.0;
            force = factor * path_.rounding_level(contacts_.acceleration[c], path_.begin());
            still = factor * path_.rounding_level(contacts_.rate[c], path_.begin());
        }
        if (gap.slope < -still) return Found::HIT;
        if (gap.slope <= (exact ? 0.0 : still) && gap.bend <= force) {
            Parting parting{0.0, 2};
            if (gap.bend >= -force) parting = path_.parting(contacts_, c, found_.time, window_);
            if (parting.order == 0) {
                watched_[c].rests = true;  // it stays on the stop without pressing
                return Found::NONE;
            }
            if (parting.time == 0.0) return Found::PRESSED;
            ahead = parting.time;
            if (own) apart_ = parting.time, order_ = parting.order;
        }
        if (gap.bend > 0.0 && watched.jerk > 0.0) ahead = std::max(ahead, 3.0 * gap.bend / watched.jerk);
        ahead = std::max(ahead, free_step(0.0, std::max(gap.slope, 0.0), watched.curvature));
        step_ = std::min(step_, ahead);
        return Found::NONE;
    }

    const Path& path_;
    const Contacts& contacts_;
    bool given_, released_;
    int leaving_;
    NextImpact found_;  // its time is the horizon of what is left
    Local<Watched, DYNAMIC, 16> watched_;
    Local<double, Path::SIZE> state_;  // at t
    NearSeries series_;
    Bounds bounds_;
    int last_renewed_ = -1;
    bool near_ = false;       // the contact just left needs its series
    int order_ = 0;           // of the first derivative with which it opens, where that is above 2
    double apart_ = 0.0;      // time up to which it is certain not to return
    double near_jerk_ = 0.0;
    double t_ = 0.0, step_ = 0.0, window_ = 0.0;
};

/// The next impact by steps of fixed length. Returns false where a certified search has to decide: what is nearly a
/// grazing, slow, or on another contact.
template <class Path, class Observer>
bool step_to_impact(const Path& path, const StepStops& stops, int leaving, double horizon, NextImpact& found,
                    Observer& observer) {
    constexpr int MOST_PARTS = 1000;  // a million steps, where nothing damps
    StepWalk<Path::PAIRS> walk(stops, horizon);
    if (!walk.start(path.begin().data(), leaving)) return false;
    observer.begin(walk, path.begin().data());
    Walked walked = walk.go(observer);
    for (int part = 0; walked == Walked::UNFINISHED; ++part) {
        if (part == MOST_PARTS) return false;
        Local<double, Path::SIZE> state(path.size());
        path.state(walk.time(), state);
        if (!walk.start(state.data(), -1)) return false;
        observer.begin(walk, state.data());
        walked = walk.go(observer);
    }
    found = {Found::NONE, -1, horizon};
    if (walked != Walked::HIT) return walked == Walked::NONE;
    const auto& hit = walk.hit();
    const double time = polish_root(path, stops.contacts(), hit.contact, hit.curvature, hit.jerk, hit.guess, hit.fourth);
    const double slack = 1e-12 * hit.end;
    if (!(time >= hit.begin - slack && time <= hit.end + slack && time > 0.0)) return false;
    if (time <= horizon) found = {Found::HIT, hit.contact, time};
    return true;
}

/// The first hit or touch of a path within 0 <= t <= horizon.
///
/// leaving: the contact that the flight starts on, or -1. Its distance at the start is 0 exactly, and its rate is exact
/// unless restitution has made it 0. released: its force has just come to 0, so distance, rate and acceleration are 0.
/// If no contact is given and z is on one, its rate counts only beyond rounding. Any other contact within the tolerance
/// at the start counts as it moves: away, or a hit at t = 0. stops: of these contacts, made once by who searches often;
/// nullptr: without steps of fixed length.
template <class Path>
NextImpact next_impact_on(const Path& path, const Contacts& contacts, int leaving, bool released, double horizon,
                          const StepStops* stops) {
    NextImpact found;
    NoObserver none;
    if (stops && stops->fit() && !released && step_to_impact(path, *stops, leaving, horizon, found, none)) return found;
    return ImpactSearch<Path>(path, contacts, leaving, released, horizon).run();
}

template <class Path>
NextImpact next_impact_on(const Path& path, const Contacts& contacts, int leaving, bool released, double horizon) {
    if (!path.steps()) return next_impact_on(path, contacts, leaving, released, horizon, nullptr);
    const StepStops stops(*path.steps(), contacts);
    return next_impact_on(path, contacts, leaving, released, horizon, &stops);
}

template <class Flight>
NextImpact next_impact(const Flight& flight, const Contacts& contacts, int leaving, bool released, Values z,
                       double horizon) {
    return next_impact_on(path_of(flight, z, horizon), contacts, leaving, released, horizon);
}

/// The same, but touches are skipped: z moves to the last touch before the hit. The time counts from the z that was
/// given.
template <class Flight>
NextImpact next_hit(const Flight& flight, const Contacts& contacts, const StepStops* stops, int leaving,
                    Vector<double> z, double horizon) {
    double elapsed = 0.0;
    while (true) {
        const auto path = path_of(flight, z, horizon - elapsed);
        NextImpact found = next_impact_on(path, contacts, leaving, false, horizon - elapsed, stops);
        if (found.found == Found::TOUCH) {
            Local<double, Flight::SIZE> state(flight.size());
            path.state(found.time, state);
            copy(Values(state), z);
            leaving = found.contact;
        }
        found.time = elapsed += found.time;
        if (found.found != Found::TOUCH) return found;
    }
}

}  // namespace saltus
