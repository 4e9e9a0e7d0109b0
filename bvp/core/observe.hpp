/// What is seen along the flights of an orbit: admissibility, speeds of impacts, flight times, half-waves.
#pragma once

#include "extrema.hpp"
#include "point.hpp"
#include "problem.hpp"

namespace saltus {

/// Part of the time to the middle by which an impact that is in the second half can be early, by rounding.
inline constexpr double AT_MIDDLE = 1e-12;

/// Part of a flight by which two instants are apart at least; a turning point is found to a tenth of it.
inline constexpr double INSTANT = 1e-8;

/// Functionals that are observed along each flight, each with its first three derivatives.
struct Observed {
    Array<> rows;  // (4 (S [+ 2]), N) the gaps of S stops, then the velocities of absorber and primary if there are any
    std::vector<double> lower, upper;  // (S,)
    int stops() const { return int(lower.size()); }
    bool has_absorber() const { return rows.rows() > 4 * stops(); }
    Values row(int functional, int derivative) const { return rows[4 * functional + derivative]; }
    ObservedGap gap(int stop) const {
        return {row(stop, 0), row(stop, 1), row(stop, 2), row(stop, 3), lower[stop], upper[stop]};
    }
    Functional functional(int k) const { return {row(k, 0), row(k, 1), row(k, 2)}; }
};

/// Fills a point from `clearance` to `gave_up`, and `speeds`, for one orbit y with the states `ends` at the end of its
/// flights.
template <class Problem>
class Observation {
public:
    Observation(const Problem& problem, const Observed& observed, Values y, Matrix<const double> ends, Point& point)
        : problem_(problem), observed_(observed), y_(y), ends_(ends), point_(point), start_(problem.size()) {
        problem_.start_state(y, start_);
        reach_ = std::sqrt(problem_.flight().twice_energy(start_));
    }

    void run() {
        point_.gave_up = point_.clearance_flight = point_.clearance_stop = point_.clearance_side =
            point_.clearance_time = 0.0;
        note_speeds();
        count_impacts();
        const bool has_waves = !problem_.periodic() && observed_.has_absorber();
        const int stops = observed_.stops();
        Waves absorber, primary;
        Nearest nearest;
        for (int i = 0; i <= problem_.inner(); ++i) {
            const auto path = path_of(problem_.flight(), node(i), duration(i));
            note_contacts(i, path, nearest);
            if (!has_waves) continue;
            count_waves(i, path, observed_.functional(stops), absorber);
            count_waves(i, path, observed_.functional(stops + 1), primary);
        }
        point_.clearance = nearest.distance;
        note_half_waves(has_waves, absorber, primary);
    }

private:
    bool starts_at(End kind) const { return problem_.closure().start == kind; }
    bool ends_at(End kind) const { return problem_.closure().finish == kind; }
    double duration(int i) const { return y_[problem_.time(i)]; }
    Values node(int i) const {
        if (i == 0) return start_;
        return {&y_[problem_.begin(i)], size_t(problem_.size())};
    }
    /// Whether flight i ends with an impact, also at the far end.
    bool ends_with_impact(int i) const { return problem_.hits(i) && (i < problem_.inner() || problem_.ends_at_stop()); }

    /// The slowest impact, the product of all speeds, and the shortest flight.
    void note_speeds() {
        double slowest = INFINITE, elapsed = 0.0, speeds = 1.0;
        int node = -1;
        const int k = problem_.inner(), at_start = problem_.start_node();
        if (starts_at(End::STOP)) {
            slowest = -problem_.side(at_start) * dot(problem_.rate(at_start), start_);
            node = at_start;
            speeds = slowest / reach_;
        }
        double shortest = INFINITE;
        int shortest_index = 0;
        for (int i = 0; i <= k; ++i) {
            elapsed += duration(i);
            if (duration(i) < shortest - TIE * elapsed) shortest_index = i;
            shortest = std::min(shortest, duration(i));
            if (!ends_with_impact(i)) continue;
            const double speed = problem_.side(i) * dot(problem_.rate(i), ends_[i]);
            speeds *= speed / reach_;
            if (speed < slowest - TIE * reach_) node = i;
            slowest = std::min(slowest, speed);
        }
        if (ends_at(End::PERIODIC) && problem_.is_cut(k)) {
            // The start of a closed orbit without impacts is a maximum as long as this is above 0.
            typename Problem::template State<> rate(problem_.size());
            problem_.flight().rate(start_, rate);
            slowest = -dot(problem_.gap(k), Values(rate));
            node = k;
        }
        point_.speed = slowest;
        point_.speed_node = node;
        point_.speeds = speeds;
        point_.flight = shortest;
        point_.flight_index = shortest_index;
    }

    /// The impacts in both quarters of a half period.
    void count_impacts() {
        const double total = problem_.total_time(y_), middle = problem_.closure().quarters == 2 ? 0.5 * total : total;
        double elapsed = 0.0;
        int early = 0, impacts = 0;
        for (int i = 0; i < problem_.inner(); ++i) {
            elapsed += duration(i);
            if (problem_.is_cut(i)) continue;
            ++impacts;
            if (elapsed < middle * (1.0 - AT_MIDDLE)) ++early;
        }
        const bool quarter = problem_.closure().quarters == 1;
        point_.first_quarter = quarter ? impacts : early;
        point_.second_quarter = quarter ? impacts : impacts - early;
    }

    /// The nearest contact so far, its instant, and the time before a flight.
    struct Nearest {
        double distance = INFINITE, earliest = INFINITE, elapsed = 0.0;
    };

    /// The nearest contact of flight i that is no impact: equation (26) between the turning points of each gap.
    template <class Path>
    void note_contacts(int i, const Path& path, Nearest& best) const {
        const double length = duration(i), slack = INSTANT * length;
        const double last = i == problem_.inner() && ends_at(End::PERIODIC) ? length - slack : INFINITE;
        best.elapsed += length;
        if (!(length > 0.0)) return;
        for (int stop = 0; stop < observed_.stops(); ++stop) {
            const ObservedGap gap = observed_.gap(stop);
            const double tie = std::max(tie_of(gap.value, gap.rate, node(i), node(i), length),
                                        tie_of(gap.value, gap.rate, ends_[i], ends_[i], length));
            Clearance nearest = clearance(path, gap, length, tie, last);
            if (std::isnan(nearest.distance)) point_.gave_up = 1.0;
            take_ends(i, stop, gap, tie, last, slack, nearest);
            // At a tie the earlier instant of the orbit counts.
            const double moment = nearest.time > last ? 0.0 : best.elapsed - length + nearest.time;
            if (nearest.distance < best.distance - tie ||
                (nearest.distance < best.distance + tie && moment < best.earliest - slack)) {
                best.earliest = moment;
                point_.clearance_flight = i;
                point_.clearance_stop = stop;
                point_.clearance_side = nearest.side;
                point_.clearance_time = nearest.time;
            }
            if (nearest.distance < best.distance) best.distance = nearest.distance;
        }
    }

    /// Contacts at the ends of a flight: at rest, and where an impact at another stop bends the path of the gap.
    void take_ends(int i, int stop, const ObservedGap& gap, double tie, double last, double slack,
                   Clearance& nearest) const {
        const int k = problem_.inner();
        for (int end = 0; end < 2; ++end) {
            const bool resting = end == 0 ? i == 0 && starts_at(End::REST) : i == k && ends_at(End::REST);
            if (!resting && (observed_.stops() == 1 || !bends(stop, i, end))) continue;
            const double w = dot(gap.value, end == 0 ? node(i) : ends_[i]), above = w - gap.lower,
                         below = gap.upper - w;
            const double instant = end == 0 ? 0.0 : duration(i);
            nearest.take({std::min(below, above), below < above + tie ? 1.0 : -1.0, instant}, tie,
                         instant > last ? INFINITE : slack);
        }
    }

    /// Whether flight i begins (end 0) or ends (end 1) with an impact at another stop. Such an impact bends the path of
    /// this stop's gap, so the gap can have an extremum there that is not a turning point inside a flight.
    bool bends(int stop, int i, int end) const {
        const int node = end == 1 ? i : i > 0 ? i - 1 : problem_.start_node();
        const bool hit = end == 1 ? ends_with_impact(i)
                         : i > 0  ? problem_.hits(node)
                                  : starts_at(End::STOP) || starts_at(End::PERIODIC);
        if (!hit || problem_.contact(node) < 0) return false;
        double apart = 0.0, size = 0.0;
        for (int r = 0; r < problem_.size(); ++r) {
            apart += std::fabs(observed_.row(stop, 0)[r] - problem_.gap(node)[r]);
            size += std::fabs(observed_.row(stop, 0)[r]);
        }
        return apart > 1e-9 * size;
    }

    /// Sign changes of a velocity along the orbit, and its signs at the first and last instants at which it has one (0:
    /// it has none).
    struct Waves {
        int changes = 0, last = 0;
        int first() const { return changes % 2 == 0 ? last : -last; }
    };

    /// Go on counting along flight i. Velocities are zero at rest. After a flight with large accelerations they are so
    /// to more than their rounding. At an origin a velocity can be zero, too: its signs are those that the count takes,
    /// beside the origin.
    template <class Path>
    void count_waves(int i, const Path& path, const Functional& velocity, Waves& found) const {
        const bool from_rest = i == 0 && starts_at(End::REST), to_rest = i == problem_.inner() && ends_at(End::REST);
        const SignChanges part = sign_changes(path, velocity, duration(i), found.last, from_rest, to_rest);
        if (part.changes < 0) point_.gave_up = 1.0;
        found.changes += part.changes;
        found.last = part.sign;
    }

    /// Half-waves of absorber and primary between two ends, and their velocities at origins.
    void note_half_waves(bool has_waves, const Waves& absorber, const Waves& primary) {
        point_.absorber_start = point_.absorber_end = NOT_A_NUMBER;
        point_.in_phase = point_.waves_absorber = point_.waves_primary = -1.0;
        if (!has_waves) return;
        const Values velocity = observed_.row(observed_.stops(), 0);
        // The quarter of an orbit has half of its half-waves but one.
        const bool quarter = problem_.closure().quarters == 1;
        point_.waves_absorber = quarter ? 2 * absorber.changes + 1 : absorber.changes;
        point_.waves_primary = quarter ? 2 * primary.changes + 1 : primary.changes;
        if (starts_at(End::ORIGIN)) {
            point_.absorber_start = dot(velocity, start_);
            point_.in_phase = absorber.first() * primary.first() > 0 ? 1.0 : 0.0;
        }
        if (ends_at(End::ORIGIN)) {
            point_.absorber_end = dot(velocity, ends_[problem_.inner()]);
            if (!(absorber.last * primary.last > 0)) point_.in_phase = 0.0;
        }
    }

    const Problem& problem_;
    const Observed& observed_;
    Values y_;
    Matrix<const double> ends_;
    Point& point_;
    typename Problem::template State<> start_;
    double reach_;
};

}  // namespace saltus
