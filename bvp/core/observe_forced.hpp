/// What is seen along the flights of an orbit under loads: admissibility, contact forces, speeds of impacts, flight times.
#pragma once

#include "forced.hpp"
#include "loaded_path.hpp"
#include "observe.hpp"

namespace saltus {

/// Part of an orbit by which one of two impacts at once may come before or after the other, where they do not act on each
/// other.
inline constexpr double AT_ONCE = 1e-12;

/// Rounding of the instants of such impacts, as a part of the orbit, times the conditioning of the equations: beside several folds at
/// once these move each by itself. And the largest that is allowed for.
inline constexpr double INSTANT_ROUNDING = 1e-16, MOST_ROUNDING = 1e-8;

/// Part of a flight in which a stop that opens without speed is not searched for another touch.
inline constexpr double SHORTEST = 1e-7;

/// Change of a gap's rate by an impulse, as a part of its terms, that is none.
inline constexpr double INTERACTION_LEVEL = 1e-13;

/// Stops of a system under loads.
struct ForcedWatch {
    Array<> gaps;                   // (S, N)
    std::vector<int> lower, upper;  // (S,) entries of the bounds
    std::vector<int> stop;          // (k + 1,) of each node; -1: none
    Array<int> force;               // (modes, S) row of a contact force of the events; -1: the stop is open
    std::vector<int> opens;         // (k + 1,) contact mode if the stop of an impact without rebound stayed closed; else -1
    int stops() const { return gaps.rows(); }
};

/// Fills a point from `clearance` to `gave_up`, and `speeds`, for an orbit y whose flights were computed last.
template <class Problem>
class ForcedObservation {
    static constexpr bool SMOOTH = Problem::SMOOTH;
    using Path = std::conditional_t<SMOOTH, SmoothLoadedPath, LoadedPath<Problem::SIZE>>;

public:
    ForcedObservation(const Problem& problem, const ForcedWatch& watch, Values y, const typename Problem::Flown& flown,
                      Point& point)
        : problem_(problem), watch_(watch), y_(y), flown_(flown), point_(point),
          reach_(problem.motion_size(y, flown).velocity) {}

    void run() {
        point_.gave_up = 0.0;
        note_speeds();
        note_contacts();
    }

private:
    int before(int i) const { return problem_.before(i); }
    int mode(int i) const { return problem_.events().mode[i]; }
    double duration(int i) const { return flown_.durations[i]; }
    Values node(int i) const { return flown_.starts[i]; }
    Values end(int i) const { return flown_.before[i]; }

    /// The slowest impact, the product of all speeds, and the shortest flight.
    void note_speeds() {
        double slowest = INFINITE, elapsed = 0.0, speeds = 1.0, shortest = INFINITE, whole = 0.0;
        int slowest_node = -1, shortest_index = 0;
        for (int i = 0; i <= problem_.inner(); ++i) whole += duration(i);
        const double rounding = point_.conditioning > 0.0 ? std::min(INSTANT_ROUNDING / point_.conditioning, MOST_ROUNDING) : 0.0;
        for (int i = 0; i <= problem_.inner(); ++i) {
            elapsed += duration(i);
            // Two impacts at once that do not act on each other have no order: a flight of no time between them ends nothing.
            const double lasting = duration(i) + (have_no_order(i) ? (AT_ONCE + rounding) * whole : 0.0);
            if (lasting < shortest - TIE * elapsed) shortest_index = i;
            shortest = std::min(shortest, lasting);
            if (!problem_.hits(i)) continue;
            const double speed = problem_.events().side[i] * dot(problem_.events().rate[i], end(i));
            speeds *= speed / reach_;
            if (speed < slowest - TIE * reach_) slowest_node = i;
            slowest = std::min(slowest, speed);
        }
        point_.speed = slowest;
        point_.speed_node = slowest_node;
        point_.speeds = speeds;
        point_.flight = shortest;
        point_.flight_index = shortest_index;
    }

    /// Whether flight i lies between impacts at two stops that do not act on each other.
    bool have_no_order(int i) const {
        const int first = before(i);
        if (first == i || !problem_.hits(i) || !problem_.hits(first) || watch_.stop[first] == watch_.stop[i]) return false;
        double change = 0.0, size = 0.0;
        for (int r = 0; r < problem_.size(); ++r) {
            const double part = problem_.events().rate(i, r) * problem_.push(first, flown_.at)[r];
            change += part;
            size += std::fabs(part);
        }
        return std::fabs(change) <= INTERACTION_LEVEL * size;
    }

    /// The nearest contact that is no impact, and the least contact force.
    void note_contacts() {
        const int k = problem_.inner(), n = problem_.size() / 2;
        point_.clearance_flight = point_.clearance_stop = point_.clearance_side = point_.clearance_time = 0.0;
        double earliest = INFINITE, elapsed = 0.0;
        std::optional<Path> path;
        int present = -1;
        const std::vector<double> none(2 * problem_.harmonics(), 0.0);
        for (int i = 0; i <= k; ++i) {
            const double length = duration(i), slack = INSTANT * length, last = i == k ? length - slack : INFINITE;
            elapsed += length;
            if (!(length > 0.0)) continue;
            if (mode(i) != present) {
                present = mode(i);
                path.emplace(problem_.flight(i, flown_.at), flown_.at.drives[present]);
                rows_ = Array<>(4 * watch_.stops(), path->size());
                for (int stop = 0; stop < watch_.stops(); ++stop) {
                    const Matrix<double> rows = Matrix<double>(rows_).rows(4 * stop, 4);
                    if (const int row = watch_.force(present, stop); row >= 0) {
                        // The contact force takes the place of the distance.
                        std::vector<double> state(problem_.size()), loads(none);
                        for (int r = 0; r < problem_.size(); ++r) state[r] = -problem_.pull(row, flown_.at)[r];
                        for (int q = 0; q < int(loads.size()); ++q)
                            loads[q] = dot(problem_.reach(row, flown_.at), flown_.at.forces[q]);
                        path->functional(state, loads, rows);
                    } else {
                        path->functional(watch_.gaps[stop], none, rows);
                    }
                }
            }
            path->begin(node(i), flown_.begins[i]);
            for (int stop = 0; stop < watch_.stops(); ++stop) {
                const bool closed = watch_.force(present, stop) >= 0;
                const Matrix<double> rows = Matrix<double>(rows_).rows(4 * stop, 4);
                const ObservedGap gap{rows[0], rows[1], rows[2], rows[3],
                                      closed ? 0.0 : flown_.at.entries[watch_.lower[stop]],
                                      closed ? INFINITE : flown_.at.entries[watch_.upper[stop]]};
                const Values c = watch_.gaps[stop].first(n);
                const double tie = std::max(tie_of(c, c, node(i).first(n), node(i).subspan(n), length),
                                            tie_of(c, c, end(i).first(n), end(i).subspan(n), length));
                const double horizon = path->growth() > 0.0 ? std::min(length, PIECE_GROWTH / path->growth()) : length;
                const double start = lift_off(i, stop, *path, gap, horizon);
                Clearance nearest = path->clearance(gap, start, length, tie, last);
                if (std::isnan(nearest.distance)) point_.gave_up = 1.0, nearest = Clearance();
                if (watch_.stop[i] != stop && !closed)
                    take_end(i, c, gap, length, tie, length > last ? INFINITE : slack, nearest);
                if (problem_.is_summed(i) && watch_.stop[i] != stop && !closed)
                    take_chatter(i, c, gap, length, tie, length > last ? INFINITE : slack, nearest);
                // At a tie the earlier instant of the orbit counts.
                const double moment = nearest.time > last ? 0.0 : elapsed - length + nearest.time;
                if (nearest.distance < best_ - tie || (nearest.distance < best_ + tie && moment < earliest - slack)) {
                    earliest = moment;
                    note_place(i, stop, nearest.side, nearest.time);
                }
                best_ = std::min(best_, nearest.distance);
            }
            note_chatter(i, length);
            note_forces(i, length);
        }
        point_.clearance = best_;
    }

    void note_place(int i, int stop, double side, double time) {
        point_.clearance_flight = i, point_.clearance_stop = stop;
        point_.clearance_side = side, point_.clearance_time = time;
    }

    /// The end of flight i can bend the path of a gap, or is a plain cut at its turning point.
    void take_end(int i, Values c, const ObservedGap& gap, double length, double tie, double slack, Clearance& nearest) const {
        const int n = int(c.size()), next = i < problem_.inner() ? i + 1 : 0;
        const double sign = i < problem_.inner() ? 1.0 : problem_.closure().sign;
        const double w = dot(c, end(i).first(n)), rate = dot(c, end(i).subspan(n)), after = sign * dot(c, node(next).subspan(n));
        if (rate >= 0.0 && after <= 0.0) nearest.take({gap.upper - w, 1.0, length}, tie, slack);
        if (rate <= 0.0 && after >= 0.0) nearest.take({w - gap.lower, -1.0, length}, tie, slack);
    }

    /// Chatter is short: another stop is beyond its bound at the end if it is hit meanwhile.
    void take_chatter(int i, Values c, const ObservedGap& gap, double length, double tie, double slack, Clearance& nearest) const {
        const int next = i < problem_.inner() ? i + 1 : 0;
        const double w = (next > 0 ? 1.0 : problem_.closure().sign) * dot(c, node(next).first(c.size()));
        const double below = gap.upper - w, above = w - gap.lower;
        nearest.take({std::min(below, above), below < above + tie ? 1.0 : -1.0, length}, tie, slack);
    }

    /// How much longer the chatter at the end of flight i could last, and by how many digits its sum is better than it has to be.
    void note_chatter(int i, double length) {
        if constexpr (!SMOOTH) {
            if (!problem_.is_summed(i)) return;
            const int next = i < problem_.inner() ? i + 1 : 0;
            const auto& flight = problem_.flight(i, flown_.at);
            const double base = flown_.at.entries[problem_.frequency()];
            double fastest = flight.free().fastest();
            for (int h = 0; h < problem_.harmonics(); ++h) fastest = std::max(fastest, flight.harmonic(h) * base);
            const double room = LONGEST_CHATTER - flown_.lasted[next] * flown_.at.cycle * fastest;
            const double digits = log10_of(CHATTER_ERROR / std::max(flown_.errors[next], LEAST_CHATTER_ERROR));
            if (std::isnan(room) || std::isnan(digits)) point_.gave_up = 1.0;
            if (!(std::min(room, digits) * problem_.units()[0] < best_)) return;
            best_ = std::min(room, digits) * problem_.units()[0];
            note_place(i, watch_.stop[i], 0.0, room < digits ? length : 0.0);
        }
    }
    static double log10_of(double x) { return log(x) / 2.302585092994046; }

    /// The time after the begin of flight i in which a stop that has opened without speed surely goes on to open; 0 for
    /// other stops.
    double lift_off(int i, int stop, const Path& path, const ObservedGap& gap, double horizon) const {
        const int first = before(i);
        if (problem_.modes() == 1 || stop != watch_.stop[first] || watch_.force(mode(i), stop) >= 0) return 0.0;
        if constexpr (SMOOTH) return 0.0;  // no stop sticks
        else return lift_off_time(first, path, gap, horizon);
    }

    double lift_off_time(int first, const Path& path, const ObservedGap& gap, double horizon) const {
        const bool released = problem_.events().release[first] >= 0;
        if (!released && problem_.rebound(first, flown_.at) != 1.0) return 0.0;
        const Bounds bounds = path.linear().bounds(gap.rate, path.state(), horizon);
        // w' = w'' t + w''' t^2/2 keeps its sign up to 2 w''/max w''', and without w'' up to 3 w'''/max w''''.
        double safe = bounds.second > 0.0 ? 2.0 * std::fabs(dot(gap.second, path.state())) / bounds.second : 0.0;
        if (released && bounds.third > 0.0) safe = 3.0 * std::fabs(dot(gap.third, path.state())) / bounds.third;
        // Where the contact force vanishes with them, rounding would decide.
        return std::min(std::max(0.5 * safe, SHORTEST * horizon), horizon);
    }

    /// Contact forces at the ends of flight i: at its begin the stops that stick press, and one that an impact without
    /// rebound leaves open pulls. At its end those press that do not open.
    void note_forces(int i, double length) {
        if (problem_.modes() == 1) return;
        const int first = before(i), left = watch_.opens[first];
        const auto note = [&](double force, int stop, double time) {
            if (!(force < best_)) return;
            best_ = force;
            note_place(i, stop, -1.0, time);
        };
        for (int stop = 0; stop < watch_.stops(); ++stop) {
            if (const int row = watch_.force(mode(i), stop); row >= 0) {
                note(problem_.force(row, flown_.at, node(i), flown_.begins[i]), stop, 0.0);
                if (problem_.events().release[i] != row)
                    note(problem_.force(row, flown_.at, end(i), flown_.turns[i + 1]), stop, length);
            } else if (left >= 0 && problem_.rebound(first, flown_.at) == 1.0 && watch_.force(left, stop) >= 0) {
                note(-problem_.force(watch_.force(left, stop), flown_.at, node(i), flown_.begins[i]), stop, 0.0);
            }
        }
    }

    const Problem& problem_;
    const ForcedWatch& watch_;
    Values y_;
    const typename Problem::Flown& flown_;
    Point& point_;
    double reach_, best_ = INFINITE;
    Array<> rows_;
};

}  // namespace saltus
