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
    Local<double, DYNAMIC, 128> rows_;
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
    Reason go();
    double time() const { return t_; }
    const Hit& hit() const { return hit_; }

private:
    /// What a walk knows of one stop.
    struct Watch {
        double w, v, next_w, next_v;
        double curvature, third, fourth, noise;
        double side = 0.0;  // that the flight leaves: +1 upper, -1 lower
        double bend, jerk;  // w'' and w''' there
        bool far = false;   // w cannot reach a bound any more
    };
    enum Verdict { CLEAR, CROSSED, UNDECIDED };

    template <int P>
    Reason go_on();
    Verdict judge(int stop, double h, bool fresh) const;

    std::span<const StepStops::Stop> stops_;
    const StepTable& table_;
    const Contacts& contacts_;
    double horizon_, t_ = 0.0;
    Hit hit_;
    bool fresh_ = false;  // the flight leaves a stop
    Watch watches_[StepStops::MOST];
    double state_[2][2 * StepStops::MOST_PAIRS];
};

}  // namespace saltus
