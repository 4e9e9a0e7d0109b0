/// The decision about one flight of an interval of starts, from its ends and its middle.
///
/// For two degrees of freedom an orbit between ends is a zero of two numbers in the plane of start and time: the
/// displacements (origin), the velocities (rest), or the velocity along the stop at an impact (stop). An interval of
/// starts is closed for one flight when
///
///     all its starts have the same impacts. The sensitivity z' at both ends and in the middle agrees, so all flights
///     stay in a tube about
///         the middle one, with |z'| times the half width of the interval as its radius;
///     no turning point inside the tube reaches a stop, or only one does, monotonically and at an end of the interval;
///     no impact's speed reaches zero, or it does so monotonically at an end;
///     at each crossing of the tube by zero, the Jacobian of (start, time) varies by less than its size. There is then
///     at most one orbit, and
///         Newton's method finds it.
#pragma once

#include "arcs.hpp"

namespace saltus {

/// A scan of starts: its curve, end sets and limits. For MIDDLE it looks for the states after the impacts that end
/// flights which begin up to the time `latest`.
struct StartSearch {
    Starts starts;
    std::array<double, 4> times;  // for each kind of far end the longest time; negative where it is not looked for
    std::array<int, 4> impacts;   // and the most inner impacts
    bool fold;       // whether a mirror image stands for the states after the impacts at the lower stop
    double longest;  // time that starts are followed for
    double latest;   // time up to which flights begin
    int most;        // and impacts
};

/// Factor on the bounds that are drawn from samples.
inline constexpr double TUBE_MARGIN = 1.2;

/// CLOSED: decided. JUMP: the ends are on different sides of a grazing. DONE: no more flights. ENDLESS: more impacts
/// than are followed. GRAZED is said of what a grazing leaves out. The others are reasons to split an interval: some
/// starts have no such flight; one stays pressed against a stop; some leave the time searched; the impacts differ; it
/// is too wide at the start; its variation is not even; a turning point may touch a stop; an impact's speed may reach
/// zero; an impact may be skimmed over; it is not decided what it holds of orbits that end at an origin, at rest, at a
/// stop.
enum class Verdict {
    CLOSED, SPLIT, JUMP, DONE, ENDLESS, GRAZED,
    ENDED = 10, PRESSED, LATE, DIFFERENT, COARSE, UNEVEN, TOUCHES, SLOW, SKIMS, NEAR_ORIGIN, NEAR_REST, NEAR_STOP
};

/// One start of an interval, and d theta/d x there.
struct Sample3 {
    Followed* followed;
    double jacobian;
};

/// An interval of half width r in x: its low end, its middle and its high end. grain: of the starts, as floating-point
/// numbers.
struct StartInterval {
    Sample3 a, m, b;
    double r, grain;
};

/// Times of the crossings of each kind of far end that can hold an orbit, one each at most; for STOP that of the
/// impact.
struct Crossings {
    static constexpr int MOST = 8;
    double time[3][MOST];
    int count[3] = {0, 0, 0};
};

/// Judge flight k of an interval.
Verdict flight_verdict(const StartSearch& search, int k, const StartInterval& interval, Crossings& found);

/// Bounds for one flight from all starts within r of the middle.
struct Tube {
    Moving middle;  // at the begin of the flight, and its derivative by x
    double since;   // time of the begin
    double r;
    double width;   // how much the displacements (velocities) of starts may differ from that
};

/// A time interval of a flight near a crossing, and when the distance was least.
struct Visit {
    double entered, left, nearest;
};

/// Whether one crossing by zero displacement (ORIGIN) or velocity (REST) can hold an orbit: 0 no, 1 one at most, -1
/// undecided; and its time.
std::pair<int, double> crossing(const PlanarSystem& system, FarEnd kind, const Tube& tube, const Visit& visit);

/// Whether a positive quantity stays positive over an interval of half width r, from its values and derivatives at both
/// ends and the middle. It may be zero at an end. noise: its rounding error.
bool positive_between(const Varied& a, const Varied& m, const Varied& b, double r, double noise);

/// Distance to a stop, anywhere in a flight, below which a touch cannot be distinguished from a hit.
double touch_distance(const PlanarSystem& system, const FlightRecord& flight);

/// An interval of starts, with a margin for Newton's method outside it.
struct StartBracket {
    double low, high, beyond_low, beyond_high;
};

/// An orbit in the plane of start and time within flight k, and the residual of the far end's condition.
struct Zero {
    bool converged = false;
    int followed = 0;  // starts
    double theta = 0.0, time = 0.0, residual = 0.0;
};

/// Newton's method for one orbit from the middle of an interval, kept inside it, where all starts have the impacts of
/// `pattern`.
Zero refine_zero(const StartSearch& search, FarEnd kind, int k, double theta, double time, const StartBracket& bracket,
                 const Followed& pattern, Followed& scratch);

}  // namespace saltus
