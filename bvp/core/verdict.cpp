/// The decision about one flight of an interval of starts.
#include "verdict.hpp"

#include <algorithm>

#include "impact.hpp"

namespace saltus {

namespace {

/// How much z' may vary over a closed interval, relative to itself.
constexpr double VARIATION = 0.35;
/// Distance below which a touch cannot be distinguished from a hit, as a part of the sizes that make it up.
constexpr double TOUCHING = 3.0 * CONTACT_TOLERANCE;

/// The place of a far end's condition in a state: displacements or velocities.
int place_of(FarEnd kind) { return kind == ORIGIN ? 0 : 2; }

/// Velocities (ORIGIN) or accelerations (REST) of both modes.
std::array<double, 2> state_rates(const PlanarSystem& system, FarEnd kind, const State4& z) {
    if (kind == ORIGIN) return {z[2], z[3]};
    return {-system.squares()[0] * z[0], -system.squares()[1] * z[1]};
}

/// The search for crossings of zero displacement or velocity by one flight, for all starts of a tube.
class Approaches {
public:
    Approaches(const PlanarSystem& system, FarEnd kind, const Tube& tube, double window, Crossings& found)
        : system_(system), kind_(kind), tube_(tube), window_(window), times_(found.time[kind]),
            count_(found.count[kind]), at_(place_of(kind)) {}

    /// False: the interval must be split.
    bool run() {
        const int order = kind_ == ORIGIN ? 1 : 2;
        double fastest = 0.0, turning = 0.0;
        for (int k = 0; k < 2; ++k) {
            fastest += square(system_.amplitude(k, tube_.middle.z, window_, order));
            turning += square(system_.amplitude(k, tube_.middle.dz, window_, order));
        }
        fastest = std::sqrt(fastest);
        // The distance changes no faster than this, so the steps below cannot pass a crossing.
        const double lipschitz = fastest + TUBE_MARGIN * tube_.r * std::sqrt(turning);
        Visit visit{0.0, 0.0, 0.0};
        bool inside = false;
        double best = INFINITE, t = first_time();
        for (int step = 0; step < 100'000 && !(t > window_); ++step) {
            const Moving now = system_.fly(tube_.middle, t);
            const double size = hypot(now.z[at_], now.z[at_ + 1]);
            const double reach = TUBE_MARGIN * tube_.r * (hypot(now.dz[at_], now.dz[at_ + 1]) + tube_.width);
            if (size <= 1.5 * reach) {
                if (!inside) inside = true, visit.entered = t, best = INFINITE;
                if (size < best) best = size, visit.nearest = t;
                if ((t - visit.entered) * fastest > 30.0 * reach + 1e-12) return false;
                t += std::max(0.3 * reach, 1e-15) / lipschitz;
            } else {
                if (inside && !gather({visit.entered, t, visit.nearest})) return false;
                inside = false;
                t += (size - reach) / lipschitz;
            }
        }
        return t > window_ && (!inside || gather({visit.entered, window_, visit.nearest}));
    }

private:
    static double square(double x) { return x * x; }

    /// The start itself is no crossing: from zero the motion goes on in one direction for at least this long.
    double first_time() const {
        if (tube_.since != 0.0) return 0.0;
        const State4& z = tube_.middle.z;
        const auto [v0, v1] = state_rates(system_, kind_, z);
        double bend = 0.0;
        for (int k = 0; k < 2; ++k) {
            const double amplitude = system_.amplitude(k, z, window_, kind_ == ORIGIN ? 2 : 1);
            bend += square(kind_ == REST ? amplitude * std::fabs(system_.squares()[k]) : amplitude);
        }
        const double rate = v0 * v0 + v1 * v1, size = square(z[at_]) + square(z[at_ + 1]);
        return size <= 1e-20 * rate && bend > 0.0 ? std::sqrt(rate / bend) : 0.0;
    }

    /// Add a crossing that can contain an orbit. False if it is undecided or there is no room.
    bool gather(const Visit& visit) {
        const auto [verdict, time] = crossing(system_, kind_, tube_, visit);
        if (verdict == 0) return true;
        if (verdict < 0 || count_ == Crossings::MOST) return false;
        times_[count_++] = time;
        return true;
    }

    const PlanarSystem& system_;
    FarEnd kind_;
    const Tube& tube_;
    double window_;
    double* times_;
    int& count_;
    int at_;
};

/// One flight of the ends and the middle of an interval.
struct Flights {
    const StartInterval& interval;
    int k;
    FlightRecord &a, &m, &b;

    Flights(const StartInterval& i, int k)
        : interval(i), k(k), a(i.a.followed->flights[k]), m(i.m.followed->flights[k]), b(i.b.followed->flights[k]) {}

    /// `positive_between` for one number of the records. noise: without that of the grain.
    bool stays_positive(Varied FlightRecord::* member, double noise) const {
        const auto scaled = [](const Varied& x, double jacobian) { return Varied{x.value, x.rate * jacobian}; };
        return positive_between(scaled(a.*member, interval.a.jacobian), scaled(m.*member, interval.m.jacobian),
                                scaled(b.*member, interval.b.jacobian), interval.r,
                                noise + 8.0 * interval.grain * std::fabs((m.*member).rate));
    }
    /// The derivatives of a number by x at the ends and in the middle.
    std::array<double, 3> rates(Varied FlightRecord::* member) const {
        return {(a.*member).rate * interval.a.jacobian, (m.*member).rate * interval.m.jacobian,
            (b.*member).rate * interval.b.jacobian};
    }
    std::array<double, 3> rates(int c) const {
        return {a.begin.dz[c] * interval.a.jacobian, m.begin.dz[c] * interval.m.jacobian,
            b.begin.dz[c] * interval.b.jacobian};
    }
    bool any(int contact) const { return a.contact == contact || m.contact == contact || b.contact == contact; }
    bool have_next() const {
        const auto has = [&](const Sample3& sample) { return k + 1 < sample.followed->count; };
        return has(interval.a) && has(interval.m) && has(interval.b);
    }
};

/// Bounds of the flights of an interval about that of the middle.
struct Variation {
    State4 along;  // the derivative of the middle's state by x
    double gap;    // how much the gap coordinate varies
    double displacement, velocity;  // how much derivatives of these vary
    bool even;     // whether the variation is small beside the derivative
};

Variation variation_of(const PlanarSystem& system, const Flights& flights, double window) {
    Variation out;
    State4 vary;
    for (int c = 0; c < 4; ++c) {
        const auto [first, middle, second] = flights.rates(c);
        out.along[c] = middle;
        vary[c] = deviation(first, middle, second);
    }
    double size = 0.0, spread = 0.0, wide = 0.0, force = 0.0, velocity = 0.0;
    const Values gap = system.gap(0);
    for (int c = 0; c < 2; ++c) {
        const double inner = system.amplitude(c, out.along, window, 0), outer = system.amplitude(c, vary, window, 0);
        const double rate = system.amplitude(c, vary, window, 1);
        size += inner * inner;
        spread += outer * outer;
        wide += std::fabs(gap[c]) * (inner + outer);
        force += std::fabs(gap[c] * system.squares()[c]) * (inner + outer);
        velocity += rate * rate;
    }
    // On the section of an impact the gap does not vary: from there its variation grows with time.
    double near = 0.5 * force * window * window;
    for (int c = 0; c < 4; c += 2) {
        const auto first = flights.rates(c), second = flights.rates(c + 1);
        double x[3];
        for (int i = 0; i < 3; ++i) x[i] = gap[0] * first[i] + gap[1] * second[i];
        const double largest = std::fabs(x[1]) + deviation(x[0], x[1], x[2]);
        near += c == 0 ? largest : largest * window;
    }
    out.gap = TUBE_MARGIN * flights.interval.r * std::min(wide, near);
    out.displacement = TUBE_MARGIN * std::sqrt(spread);
    out.velocity = TUBE_MARGIN * std::sqrt(velocity);
    out.even = spread <= VARIATION * VARIATION * size;
    return out;
}

/// Whether the states after the impact differ as their derivatives say.
bool arrives_evenly(const PlanarSystem& system, const Flights& flights) {
    const StartInterval& interval = flights.interval;
    const Flights next(interval, flights.k + 1);
    double off = 0.0, size = 0.0, spread = 0.0, noise = 0.0;
    for (int c = 0; c < 4; ++c) {
        const double square = c >= 2 ? 1.0 : std::fabs(system.squares()[c]), weight = std::sqrt(square);
        const auto [first, middle, second] = next.rates(c);
        const double expected = interval.r / 3.0 * (first + 4.0 * middle + second);
        const double value = weight * (next.b.begin.z[c] - next.a.begin.z[c] - expected);
        const double change = weight * deviation(first, middle, second);
        off += value * value;
        spread += change * change;
        size += weight * weight * middle * middle;
        noise += weight * weight * next.m.begin.z[c] * next.m.begin.z[c];
    }
    if (spread > VARIATION * VARIATION * size) return false;
    const double rounding = SLACK * std::sqrt(noise) + 8.0 * interval.grain / interval.m.jacobian * std::sqrt(size);
    return !(std::sqrt(off) > 0.1 * interval.r * std::sqrt(size) + rounding);
}

}  // namespace

std::pair<int, double> crossing(const PlanarSystem& system, FarEnd kind, const Tube& tube, const Visit& visit) {
    const int at = place_of(kind);
    double t = visit.nearest;
    for (int count = 0; count < 4; ++count) {
        const State4 z = system.fly(tube.middle, t).z;
        const auto [v0, v1] = state_rates(system, kind, z);
        const double square = v0 * v0 + v1 * v1;
        if (square == 0.0) return {-1, t};
        t = std::min(std::max(t - (z[at] * v0 + z[at + 1] * v1) / square, visit.entered), visit.left);
    }
    const Moving now = system.fly(tube.middle, t);
    const auto [v0, v1] = state_rates(system, kind, now.z);
    const auto [w0, w1] = state_rates(system, kind, now.dz);
    const double speed = hypot(v0, v1), u0 = now.dz[at], u1 = now.dz[at + 1];
    const double half = std::max(visit.left - t, t - visit.entered);
    const double s0 = system.squares()[0], s1 = system.squares()[1];
    // Equation (34): residual and derivative across the velocity, at the least distance.
    const double residual = (v0 * now.z[at + 1] - v1 * now.z[at]) / speed, rate = (v0 * u1 - v1 * u0) / speed;
    const double size = hypot(u0, u1);
    const double bend = hypot(-s0 * now.z[at], -s1 * now.z[at + 1]) + (std::fabs(s0) + std::fabs(s1)) * speed * half;
    const double vary = tube.width + half * (hypot(w0, w1) + size * bend / speed);
    if (std::fabs(residual) > TUBE_MARGIN * tube.r * (size + tube.width)) return {0, t};
    if (std::fabs(rate) <= TUBE_MARGIN * vary) return {-1, t};
    if (std::fabs(residual) > TUBE_MARGIN * tube.r * (std::fabs(rate) + vary)) return {0, t};
    return {1, t};
}

Zero refine_zero(const StartSearch& search, FarEnd kind, int k, double theta, double time, const StartBracket& bracket,
                 const Followed& pattern, Followed& scratch) {
    const auto [low, high, beyond_low, beyond_high] = bracket;
    const int at = place_of(kind);
    const double span = high - low;
    double last = INFINITE;
    Zero out;
    for (int& count = out.followed; count < 12; ++count) {
        follow(search.starts, theta, search.longest, INFINITE, k, scratch);
        if (scratch.count <= k) return out;
        for (int i = 0; i < k + (kind == STOP); ++i)
            if (scratch.flights[i].contact != pattern.flights[i].contact) return out;
        const FlightRecord& flight = scratch.flights[k];
        double step;
        if (kind == STOP) {  // the velocity along the stop vanishes
            step = -flight.residual.value / flight.residual.rate;
            time = flight.duration.value;
            out.residual = std::fabs(flight.residual.value);
        } else {  // in (theta, time) the two displacements, or velocities, vanish
            const Moving now = search.starts.system->fly(flight.begin, time);
            const auto [v0, v1] = state_rates(*search.starts.system, kind, now.z);
            const double y0 = now.z[at], y1 = now.z[at + 1], u0 = now.dz[at], u1 = now.dz[at + 1];
            const double determinant = u0 * v1 - u1 * v0;
            if (determinant == 0.0) return out;
            step = (-y0 * v1 + y1 * v0) / determinant;
            time += (-u0 * y1 + u1 * y0) / determinant;
            out.residual = hypot(y0, y1);
        }
        out.theta = theta, out.time = time;
        const double size = std::fabs(step);
        if (!(size < INFINITE)) return out;
        out.converged = size <= 4e-16 * (1.0 + std::fabs(theta)) ||
            (count > 2 && size >= 0.5 * last && last < 1e-8 * span + 1e-13);
        if (!out.converged && ((theta == low && step < 0.0) || (theta == high && step > 0.0))) {
            // It lies outside; how far outside the step says. Within the sliver that a grazing leaves out it is still
            // this interval's.
            if (!(-beyond_low <= step && step <= beyond_high)) out.theta = theta + step;
            out.converged = true;
        }
        if (out.converged) {
            ++count;
            return out;
        }
        theta = std::min(std::max(theta + step, low), high);
        last = size;
    }
    return out;
}

bool positive_between(const Varied& a, const Varied& m, const Varied& b, double r, double noise) {
    if (!(a.value > -noise && m.value > -noise && b.value > -noise)) return false;
    const double least = std::min(std::min(a.value, m.value), b.value);
    const double most = std::max(std::max(std::fabs(a.rate), std::fabs(m.rate)), std::fabs(b.rate));
    if (TUBE_MARGIN * r * most < least) return true;
    const double off = std::fabs(b.value - a.value - r / 3.0 * (a.rate + 4.0 * m.rate + b.rate));
    if (off > 0.1 * r * most + noise + SLACK) return false;
    if ((a.rate > 0.0) != (m.rate > 0.0) || (b.rate > 0.0) != (m.rate > 0.0)) return false;
    return std::min(std::min(std::fabs(a.rate), std::fabs(b.rate)), std::fabs(m.rate)) > 0.2 * most ||
           (std::min(a.value, b.value) < noise && m.value < 10.0 * noise);
}

double touch_distance(const PlanarSystem& system, const FlightRecord& flight) {
    double size = 1.0;
    for (int k = 0; k < 2; ++k)
        size += std::fabs(system.gap(0)[k]) * system.amplitude(k, flight.begin.z, flight.turn, 0);
    return TOUCHING * size;
}

Verdict flight_verdict(const StartSearch& search, int k, const StartInterval& interval, Crossings& found) {
    const PlanarSystem& system = *search.starts.system;
    const auto& [times, impacts] = std::tie(search.times, search.impacts);
    for (int& count : found.count) count = 0;
    double earliest = INFINITE, horizon = -1.0;
    bool all = true, onward = false;
    for (const Sample3* sample : {&interval.a, &interval.m, &interval.b}) {
        if (k < sample->followed->count) earliest = std::min(earliest, sample->followed->flights[k].time.value);
        else all = false;
    }
    for (int kind = 0; kind < 3; ++kind)
        if (k <= impacts[kind] && times[kind] > earliest) {
            horizon = std::max(horizon, times[kind] - earliest);
            onward = onward || k < impacts[kind];
        }
    if (k <= impacts[MIDDLE] && earliest <= search.latest) {
        horizon = std::max(horizon, times[MIDDLE] - earliest);
        onward = true;
    }
    if (horizon < 0.0) return Verdict::DONE;
    if (!all) return Verdict::ENDED;
    // -- how the flight ends
    const Flights flights(interval, k);
    FlightRecord &a = flights.a, &m = flights.m, &b = flights.b;
    if (flights.any(AHEAD)) return Verdict::ENDED;
    if (flights.any(STUCK)) return Verdict::PRESSED;
    const double r = interval.r, jacobian = interval.m.jacobian, grain = interval.grain;
    const auto is_far = [&](const FlightRecord& flight) {
        return flight.contact == FREE || flight.duration.value > horizon;
    };
    const bool last = is_far(a) && is_far(m) && is_far(b);
    const auto later = flights.rates(&FlightRecord::duration);
    const double steepest = std::max(std::max(std::fabs(later[0]), std::fabs(later[2])), std::fabs(later[1]));
    if (!last) {
        // Where one of them only leaves the time searched, halves will show it.
        if (a.contact != b.contact)
            return (a.contact == FREE || b.contact == FREE) && r * jacobian > 1e-5 ? Verdict::LATE : Verdict::JUMP;
        if (a.contact != m.contact || a.contact == FREE) return Verdict::DIFFERENT;
        // The same stop, but one flight goes on past the impact that ends the other.
        const double apart = std::fabs(b.duration.value - a.duration.value);
        if (r * jacobian < 1e-4 && apart > 20.0 * r * steepest + 1e-9) return Verdict::JUMP;
        if (k <= impacts[MIDDLE] && !flights.have_next()) return Verdict::ENDED;
    }
    if (onward && !last && k == search.most) return Verdict::ENDLESS;
    // -- the tube about the flight of the middle
    const double window = std::min(m.duration.value, horizon);
    const Variation variation = variation_of(system, flights, window);
    if (k == 0 && r * jacobian > 0.1) return Verdict::COARSE;
    if (!variation.even) return Verdict::UNEVEN;
    // -- no turning point reaches a stop
    find_clearance(system, m, search.longest);
    if (m.clearance.value <= variation.gap) {
        if (m.second <= variation.gap) return Verdict::TOUCHES;
        find_clearance(system, a, search.longest);
        find_clearance(system, b, search.longest);
        if (!flights.stays_positive(&FlightRecord::clearance, touch_distance(system, m))) return Verdict::TOUCHES;
    }
    // -- the impact is a transversal one, and its arrival is known over the interval
    if (!last) {
        if (!flights.stays_positive(&FlightRecord::speed, 0.0)) return Verdict::SLOW;
        if (m.acceleration > 0.0 && m.speed.value * m.speed.value <= 2.0 * m.acceleration * variation.gap)
            return Verdict::SKIMS;
        const double expected = (later[0] + 4.0 * later[1] + later[2]) * r / 3.0;
        const double off = std::fabs(b.duration.value - a.duration.value - expected);
        const double rounding = SLACK * (1.0 + search.longest) + 8.0 * grain / jacobian * steepest;
        if (off > 0.1 * r * steepest + rounding) return Verdict::UNEVEN;
        if (onward && flights.have_next() && !arrives_evenly(system, flights)) return Verdict::UNEVEN;
    }
    // -- orbits
    const double blur = TUBE_MARGIN * r * std::fabs(m.duration.rate * jacobian);
    const double reach = last ? horizon : std::min(window + blur, horizon);
    // motions without any impact are modes, known in closed form
    const bool with_impacts = k > 0 || search.starts.contact >= 0;
    for (const FarEnd kind : {ORIGIN, REST}) {
        if (!with_impacts || k > impacts[kind] || times[kind] <= earliest) continue;
        const double width = kind == ORIGIN ? variation.displacement : variation.velocity;
        const Tube tube{{m.begin.z, variation.along}, m.time.value, r, width};
        if (!Approaches(system, kind, tube, std::min(reach, times[kind] - earliest), found).run())
            return kind == ORIGIN ? Verdict::NEAR_ORIGIN : Verdict::NEAR_REST;
    }
    if (!last && k <= impacts[STOP] && times[STOP] > earliest + window - blur) {
        const auto rates = flights.rates(&FlightRecord::residual);
        const double change = TUBE_MARGIN * deviation(rates[0], rates[1], rates[2]);
        if (std::fabs(m.residual.value) <= TUBE_MARGIN * r * (std::fabs(rates[1]) + change)) {
            if (std::fabs(rates[1]) <= change) return Verdict::NEAR_STOP;
            found.time[STOP][found.count[STOP]++] = m.duration.value;
        }
    }
    return Verdict::CLOSED;
}

}  // namespace saltus
