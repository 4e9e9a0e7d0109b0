/// An adaptive scan of a curve of starts.
#include "intervals.hpp"

#include <algorithm>

namespace saltus {

namespace {

/// The first record that is not of one of the ends.
constexpr int FIRST_SPARE = 2;
/// An interval at a grazing stays open if rounding of the starts hides this many times more of it than the contact
/// tolerance does.
constexpr double COARSE = 10.0;
/// How far outside its interval Newton's method may end at a grazing: about what is left out between its two sides.
constexpr double SLIVER = 4e-12;

/// The first of three records from `first` on that is neither of two.
int third(int one, int two, int first) {
    for (int slot = first; slot < first + 3; ++slot)
        if (slot != one && slot != two) return slot;
    return first;
}

}  // namespace

int IntervalScan::follow_into(int record, double theta, double latest, int most) {
    follow(search_.starts, theta, search_.longest, latest, most, records_[record]);
    return records_[record].count;
}

void IntervalScan::leave_open(double theta, double width, int flight, Verdict reason) {
    ++(reason == Verdict::GRAZED ? counts.at_grazing : counts.open);
    openings.push_back({theta, width, flight, reason});
}

void IntervalScan::push_between(const StartMap& map, double low, double high, int i_low, int i_high,
                                const Interval& from) {
    stack_.push_back({map, map.unplace(low), map.unplace(high), i_low, i_high, from.k, from.depth + 1, Verdict::JUMP});
}

void IntervalScan::begin(double low, double high, const StartMap& map, int budget) {
    follow_into(0, low, search_.latest, search_.most);
    follow_into(1, high, search_.latest, search_.most);
    counts.starts += 2;
    budget_ = budget, used_ = 0;
    stack_.clear();
    stack_.push_back({map, map.unplace(low), map.unplace(high), 0, 1, 0, 0, Verdict::SPLIT});
}

bool IntervalScan::go(int passes) {
    for (flights_ = 0; !stack_.empty() && flights_ < passes;) {
        const Interval interval = stack_.back();
        stack_.pop_back();
        split_or_close(interval, passes);
    }
    return stack_.empty();
}

void IntervalScan::split_or_close(Interval interval, int passes) {
    const auto [map, a, b, i_a, i_b, k, depth, before, halfway] = interval;
    const Varied at_a = map.place(a), at_b = map.place(b);
    const double theta_a = at_a.value, theta_b = at_b.value, theta_m = map.place(0.5 * (a + b)).value;
    const double grain = 4.5e-16 * std::max(std::max(std::fabs(theta_a), std::fabs(theta_b)), 1.0);
    const bool narrow = theta_b - theta_a <= 8.0 * grain;
    if (!halfway && (narrow || depth >= DEPTH || used_ >= budget_)) {
        const Followed &one = records_[i_a], &two = records_[i_b];
        const bool parts = k < one.count && k < two.count && one.flights[k].contact != two.flights[k].contact;
        const bool grazed = narrow && (before == Verdict::JUMP || parts);
        leave_open(theta_a, theta_b - theta_a, k, grazed ? Verdict::GRAZED : before);
        if (!grazed && used_ >= budget_) ++counts.budget;
        return;
    }
    const double x_m = map.unplace(theta_m);
    const int i_m = FIRST_SPARE + 3 * depth;
    if (!halfway) {
        flights_ += follow_into(i_m, theta_m, search_.latest, search_.most);
        ++counts.starts;
        ++used_;
    }
    Work work{interval,
              {{&records_[i_a], at_a.rate}, {&records_[i_m], map.place(x_m).rate}, {&records_[i_b], at_b.rate},
                  0.5 * (b - a), grain},
              theta_a, theta_m, theta_b, grain, i_m, map.root_low && a <= 1e-3, map.root_high && b >= 1.0 - 1e-3};
    const Verdict verdict = close(work, passes);
    if (verdict == Verdict::CLOSED) {  // the next call closes it for the flights that are left
        stack_.push_back(work.interval);
        stack_.back().halfway = true;
        return;
    }
    if (verdict == Verdict::DONE) {
        ++counts.closed;
        return;
    }
    if (verdict == Verdict::ENDLESS) return leave_open(theta_a, theta_b - theta_a, work.interval.k, verdict);
    ++counts.split;
    if (verdict == Verdict::JUMP) return split_at_grazing(work);
    stack_.push_back({map, x_m, b, i_m, i_b, work.interval.k, depth + 1, verdict});
    stack_.push_back({map, a, x_m, i_a, i_m, work.interval.k, depth + 1, verdict});
}

Verdict IntervalScan::close(Work& work, int passes) {
    for (int& k = work.interval.k; flights_ < passes; ++k) {
        ++flights_;
        Crossings found;
        Verdict verdict = flight_verdict(search_, k, work.starts, found);
        if (verdict != Verdict::CLOSED) return verdict;
        const size_t first = crossings.size();
        if (!find_orbits(work, found, verdict)) {
            crossings.resize(first);
            return verdict;
        }
        if (k <= search_.impacts[MIDDLE]) add_arc(work);
    }
    return Verdict::CLOSED;
}

/// Find the orbits that the crossings of a closed flight hold. False: Newton's method fails in a wide interval, which
/// is split.
bool IntervalScan::find_orbits(const Work& work, const Crossings& found, Verdict& verdict) {
    const int k = work.interval.k;
    const double beyond_a = work.root_a ? SLIVER : 8.0 * work.grain, beyond_b = work.root_b ? SLIVER : 8.0 * work.grain;
    for (const FarEnd kind : {ORIGIN, REST, STOP})
        for (int c = 0; c < found.count[kind]; ++c) {
            const double time = found.time[kind][c];
            Followed& scratch = records_[work.i_m + 1];
            const Zero zero = refine_zero(search_, kind, k, work.theta_m, time,
                                          {work.theta_a, work.theta_b, beyond_a, beyond_b},
                                          records_[work.i_m], scratch);
            counts.starts += zero.followed;
            used_ += zero.followed;
            flights_ += zero.followed * (k + 1);
            if (!zero.converged && work.theta_b - work.theta_a > 1e6 * work.grain) {
                verdict = Verdict::SPLIT;
                continue;
            }
            if (zero.converged) {
                if (zero.theta < work.theta_a || zero.theta > work.theta_b) continue;
                if (zero.time < -1e-9 || zero.time > scratch.flights[k].duration.value + 1e-9) continue;
            }
            crossings.push_back({kind, k, zero.converged ? zero.theta : work.theta_m,
                                 zero.converged ? zero.time : time, zero.residual,
                                 zero.converged, work.theta_a, work.theta_b});
        }
    return verdict == Verdict::CLOSED;
}

/// Add the image of an interval after the impact that ends a flight, if all three starts have it and are followed
/// beyond it.
void IntervalScan::add_arc(const Work& work) {
    const auto& [interval, starts, theta_a, theta_m, theta_b, grain, i_m, root_a, root_b] = work;
    const int k = interval.k, contact = starts.m.followed->flights[k].contact;
    const std::array<Sample3, 3> samples{starts.a, starts.m, starts.b};
    for (const Sample3& sample : samples)
        if (contact < 0 || sample.followed->flights[k].contact != contact || k + 1 >= sample.followed->count) return;
    const StartMap& map = interval.map;
    const double r = starts.r, rounding = 8.0 * grain / starts.m.jacobian;
    const double before = root_a ? interval.a - map.unplace(std::max(theta_a - SLIVER, map.low)) : rounding;
    const double after = root_b ? map.unplace(std::min(theta_b + SLIVER, map.high)) - interval.b : rounding;
    Arc arc;
    arc.impacts = k + 1;
    arc.side = search_.fold ? 1.0 : search_.starts.system->contacts().side[contact];
    arc.map = map;
    arc.first = interval.a, arc.last = interval.b;
    arc.before = std::min(std::max(before / r, Arc::NEAREST), 0.5);
    arc.after = std::min(std::max(after / r, Arc::NEAREST), 0.5);
    arc.grain = rounding / r;
    for (int i = 0; i < 3; ++i) {
        const FlightRecord& next = samples[i].followed->flights[k + 1];
        arc.points[i] = arc_point(*search_.starts.system, contact, search_.fold, next.begin, r * samples[i].jacobian);
    }
    for (int j = 0; j < 2; ++j) {
        double low = INFINITE, high = -INFINITE;
        for (const Sample3& sample : samples) {
            const Varied& time = sample.followed->flights[k + 1 - j].time;
            const double change = r * sample.jacobian * std::fabs(time.rate) / 3.0;
            low = std::min(low, time.value - change), high = std::max(high, time.value + change);
        }
        const double more = 0.1 * (high - low) + SLACK;
        double* range = j == 0 ? arc.arrived : arc.left;
        range[0] = low - more, range[1] = high + more;
    }
    arc.bound();
    arcs.push_back(arc);
}

/// On one side the flight ends with a slow impact, which would reach speed^2/(2 w'') beyond the stop. On the other side
/// it passes the stop at some distance. Together these are a smooth function of the start. Its secants shrink the
/// bracket.
IntervalScan::Grazing IntervalScan::grazing_between(const Work& work) {
    const auto& [interval, starts, theta_a, theta_m, theta_b, grain, first, root_a, root_b] = work;
    const PlanarSystem& system = *search_.starts.system;
    const int k = interval.k, i_a = interval.i_a, i_b = interval.i_b;
    Grazing out{i_a, i_b, theta_a, theta_b, theta_a, theta_b, false, 0};
    int &one = out.one, &two = out.two;
    double &theta_1 = out.theta_1, &theta_2 = out.theta_2;
    const auto flight = [&](int record) -> FlightRecord& { return records_[record].flights[k]; };
    const auto later = [&] { return flight(one).duration.value < flight(two).duration.value ? two : one; };
    for (int step = 0; step < 300 && theta_2 - theta_1 > 4.0 * grain; ++step) {
        const int late = later(), early = late == one ? two : one;
        find_clearance(system, flight(late), search_.longest);
        const double bend = std::fabs(flight(early).acceleration), speed = flight(early).speed.value;
        const double below = bend > 0.0 ? speed * speed / (2.0 * bend) : INFINITE;
        const double above = std::fabs(flight(late).clearance.value);
        double probe = 0.5 * (theta_1 + theta_2);
        if (step % 3 != 2 && below + above < INFINITE) {
            double part = below / (below + above);
            if (early == two) part = 1.0 - part;
            const double guess = theta_1 + part * (theta_2 - theta_1);
            const double nudge = std::max(2.0 * grain, 0.02 * std::min(guess - theta_1, theta_2 - guess));
            probe = (part < 0.5) == (step % 2 == 0) ? guess + nudge : guess - nudge;
            probe = std::min(std::max(probe, theta_1 + grain), theta_2 - grain);
        }
        if (!(theta_1 < probe && probe < theta_2)) break;
        const int slot = third(one, two, first);
        const int count = follow_into(slot, probe, INFINITE, k);
        ++out.followed;
        if (count <= k) break;
        bool like_one = flight(slot).contact == flight(one).contact;
        if (like_one && flight(one).contact == flight(two).contact)
            like_one = std::fabs(flight(slot).duration.value - flight(one).duration.value) <
                       std::fabs(flight(slot).duration.value - flight(two).duration.value);
        if (like_one) one = slot, theta_1 = probe;
        else two = slot, theta_2 = probe;
    }
    FlightRecord& late = flight(later());
    find_clearance(system, late, search_.longest);
    const double slope = std::fabs(late.clearance.rate), touch = touch_distance(system, late);
    const double offset = std::max(16.0 * grain, slope > 0.0 ? touch / slope : 0.0);
    out.coarse = 16.0 * grain * slope > COARSE * touch;
    const double edge_1 = out.edge_1 = theta_1, edge_2 = out.edge_2 = theta_2;
    theta_1 = std::min(theta_1, edge_2 - std::min(offset, 0.25 * (edge_2 - theta_a)));
    theta_2 = std::max(theta_2, edge_1 + std::min(offset, 0.25 * (theta_b - edge_1)));
    const bool moved_1 = theta_a < theta_1 && theta_1 < edge_1, moved_2 = edge_2 < theta_2 && theta_2 < theta_b;
    // Probes were followed to the grazing only; one that becomes the end of an interval is followed to its end.
    if (moved_1) one = third(one, two, first), follow_into(one, theta_1, search_.latest, search_.most), ++out.followed;
    if (moved_2) two = third(one, two, first), follow_into(two, theta_2, search_.latest, search_.most), ++out.followed;
    if (!moved_1 && one != i_a) follow_into(one, edge_1, search_.latest, search_.most);
    if (!moved_2 && two != i_b) follow_into(two, edge_2, search_.latest, search_.most);
    return out;
}

void IntervalScan::split_at_grazing(const Work& work) {
    const auto& [interval, starts, theta_a, theta_m, theta_b, grain, i_m, root_a, root_b] = work;
    const int k = interval.k;
    const Grazing grazing = grazing_between(work);
    const auto& [one, two, theta_1, theta_2, edge_1, edge_2, coarse, followed] = grazing;
    ++counts.grazings;
    counts.starts += followed;
    used_ += followed;
    flights_ += followed * (k + 1);
    if (edge_2 - edge_1 > 64.0 * grain) leave_open(edge_1, edge_2 - edge_1, k, Verdict::JUMP);
    else if (coarse && k > 0) leave_open(theta_1, theta_2 - theta_1, k, Verdict::GRAZED);
    // The square root starts at grazing itself, and at an end where an earlier one did.
    const bool early_one = records_[one].flights[k].duration.value < records_[two].flights[k].duration.value;
    const StartMap& map = interval.map;
    if (two != interval.i_b && theta_b > theta_2) {
        const StartMap part{early_one ? theta_2 : edge_1, root_b ? map.high : theta_b, !early_one, root_b};
        push_between(part, theta_2, theta_b, two, interval.i_b, interval);
    }
    if (one != interval.i_a && theta_1 > theta_a) {
        const StartMap part{root_a ? map.low : theta_a, early_one ? edge_2 : theta_1, root_a, early_one};
        push_between(part, theta_a, theta_1, interval.i_a, one, interval);
    }
}

}  // namespace saltus
