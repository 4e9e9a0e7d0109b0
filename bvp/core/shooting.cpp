/// Motions of many starts through their impacts.
#include "shooting.hpp"

#include <algorithm>

#include "extrema.hpp"
#include "impact.hpp"

namespace saltus {

namespace {

LinearFlight<4> undamped_flight(const std::array<double, 2>& squares) {
    std::vector<Block> blocks;
    Array<> matrix(4, 4);
    for (int k = 0; k < 2; ++k) {
        blocks.push_back({k, k + 2, 0.0, -squares[k], 0.0, 1.0, -squares[k], 0.0});
        matrix(k, k + 2) = 1.0, matrix(k + 2, k) = -squares[k];
    }
    return {std::move(blocks), std::move(matrix), std::vector<double>(4, 1.0)};
}

}  // namespace

PlanarSystem::PlanarSystem(std::array<double, 2> squares, Contacts contacts, double lower, double upper)
    : squares_(squares), contacts_(std::move(contacts)), flight_(undamped_flight(squares)), lower_(lower),
        upper_(upper) {
    if (flight_.steps().is_usable()) stops_ = std::make_unique<StepStops>(flight_.steps(), contacts_);
    for (int k = 0; k < 2; ++k) frequencies_[k] = squares[k] > 0.0 ? std::sqrt(squares[k]) : 0.0;
    const double a = contacts_.gap(0, 0), b = contacts_.gap(0, 1), size = hypot(a, b);
    across_ = {-b / size, a / size};
    rows_[0] = {a, b, 0.0, 0.0};
    for (int order = 1; order < 4; ++order)
        for (int r = 0; r < 2; ++r)
            rows_[order][r] = -squares[r] * rows_[order - 1][r + 2], rows_[order][r + 2] = rows_[order - 1][r];
}

Moving PlanarSystem::fly(const Moving& begin, double t) const {
    Moving out;
    for (int k = 0; k < 2; ++k) {
        double c, s;
        if (squares_[k] > 0.0) {
            sincos(frequencies_[k] * t, s, c);
            s /= frequencies_[k];
        } else {
            circular(-squares_[k], t, c, s);
        }
        const double back = -squares_[k] * s;
        out.z[k] = c * begin.z[k] + s * begin.z[k + 2], out.z[k + 2] = back * begin.z[k] + c * begin.z[k + 2];
        out.dz[k] = c * begin.dz[k] + s * begin.dz[k + 2], out.dz[k + 2] = back * begin.dz[k] + c * begin.dz[k + 2];
    }
    return out;
}

double PlanarSystem::amplitude(int mode, const State4& z, double horizon, int order) const {
    const double square = squares_[mode], q = std::fabs(z[mode]), p = std::fabs(z[mode + 2]);
    if (square > 0.0) {
        const double w = frequencies_[mode], size = std::sqrt(q * q + p * p / square);
        if (order == 0) return std::min(size, q + p * horizon);
        return order == 1 ? w * size : square * size;
    }
    double c, s;
    circular(-square, horizon, c, s);
    if (order == 1) return p * c - square * q * s;
    const double size = q * c + p * s;
    return order == 0 ? size : -square * size;
}

Moving Starts::at(double theta) const {
    Varied first, second;
    if (shape == Curve::TRIGONOMETRIC) {
        double s, c;
        sincos(theta, s, c);
        first = {c, -s}, second = {s, c};
    } else if (shape == Curve::LINEAR) {
        second = {theta, 1.0};
    } else if (shape == Curve::QUADRATIC) {
        first = {theta, 1.0}, second = {theta * theta, 2.0 * theta};
    } else {
        const double c = cosh(theta), s = sinh(theta);
        first = {c, s}, second = {s, c};
    }
    Moving out;
    for (int r = 0; r < 4; ++r) {
        out.z[r] = coefficients[0][r] + first.value * coefficients[1][r] + second.value * coefficients[2][r];
        out.dz[r] = first.rate * coefficients[1][r] + second.rate * coefficients[2][r];
    }
    return out;
}

void follow(const Starts& starts, double theta, double longest, double latest, int most, Followed& out) {
    const PlanarSystem& system = *starts.system;
    const Contacts& contacts = system.contacts();
    const double slack = 0.05 * longest;
    Moving now = starts.at(theta);
    Varied time;
    int leaving = starts.contact;
    out.after = now;
    for (out.count = 0; out.count <= most;) {
        if (out.count == int(out.flights.size())) out.flights.emplace_back();
        FlightRecord& flight = out.flights[out.count++];
        flight = FlightRecord();
        flight.begin = now;
        flight.time = time;
        flight.contact = AHEAD;
        if (time.value > latest + slack) return;
        State4 begin = now.z;  // a touch moves it
        const NextImpact found = next_hit(system.flight(), contacts, system.stops(), leaving, begin,
                                          longest - time.value + 2.0 * slack);
        flight.duration.value = INFINITE;
        flight.contact = found.found == Found::NONE ? FREE : STUCK;
        if (found.found != Found::HIT) return;
        Moving end = system.fly(now, found.time);
        const State4 velocity{end.z[2], end.z[3], -system.squares()[0] * end.z[0], -system.squares()[1] * end.z[1]};
        const int c = found.contact;
        const double side = contacts.side[c];
        flight.contact = c;
        flight.duration = {found.time, arrive(contacts.gap[c], velocity, end.dz)};
        flight.speed = {side * dot(contacts.rate[c], end.z), side * dot(contacts.rate[c], end.dz)};
        flight.acceleration = side * dot(contacts.acceleration[c], end.z);
        const auto& across = system.across();
        flight.residual = {across[0] * end.z[2] + across[1] * end.z[3], across[0] * end.dz[2] + across[1] * end.dz[3]};
        time = {time.value + flight.duration.value, time.rate + flight.duration.rate};
        if (time.value > longest + slack) return;
        apply_impact(contacts.rate[c], contacts.push[c], 1.0 + contacts.restitution[c], end.z, now.z);
        apply_impact(contacts.rate[c], contacts.push[c], 1.0 + contacts.restitution[c], end.dz, now.dz);
        out.after = now;
        leaving = c;
    }
}

void StartScan::follow(const PlanarSystem& system, Values start, const Found& out) const {
    const Contacts& contacts = system.contacts();
    const int order = kind == ORIGIN ? 0 : 1, place = kind == ORIGIN ? 0 : 2, room = out.times.columns();
    Local<double, DYNAMIC, 16> zeros(room);
    State4 z;
    copy(start, z);
    double elapsed = 0.0;
    int leaving = -1;
    const auto record = [&](int k, int c, double time, const State4& state) {
        out.times(k, c) = time;
        out.residuals(k, c) = system.across()[0] * state[place] + system.across()[1] * state[place + 1];
    };
    for (int k = 0; k < int(wanted.size()); ++k) {
        const Moving before{z, {}};
        const NextImpact found = next_hit(system.flight(), contacts, system.stops(), leaving, z, longest - elapsed);
        if (found.found != saltus::Found::HIT && found.found != saltus::Found::NONE) return;
        if (kind != STOP && wanted[k]) {
            const Functional rows{system.gap(order), system.gap(order + 1), system.gap(order + 2)};
            const int count = crossing_times(path_of(system.flight(), before.z, found.time), rows, found.time, zeros);
            if (count < 0) return;
            for (int c = 0; c < std::min(count, room); ++c)
                record(k, c, elapsed + zeros[c], system.fly(before, zeros[c]).z);
        }
        elapsed += found.time;
        if (found.found == saltus::Found::NONE) return;
        const int c = found.contact;
        const State4 end = system.fly(before, found.time).z;
        out.contacts[k] = c;
        if (kind == STOP) record(k, 0, elapsed, end);
        apply_impact(contacts.rate[c], contacts.push[c], 1.0 + contacts.restitution[c], end, z);
        if (k < out.nodes.rows()) {
            out.instants[k] = elapsed;
            copy(z, out.nodes[k]);
        }
        leaving = c;
    }
}

void find_clearance(const PlanarSystem& system, FlightRecord& flight, double longest) {
    if (!std::isnan(flight.clearance.value)) return;
    const double duration = std::min(flight.duration.value, 1.05 * longest - flight.time.value);
    const LinearPath<4> path(system.flight(), flight.begin.z);
    LinearTrack<4> track = path.track({system.gap(1), system.gap(2), system.gap(3)}, duration);
    SignWalk walk(track, 1e-13 * duration, {});
    double best = INFINITE, second = INFINITE, side = 0.0;
    flight.turn = 0.0;
    flight.turning_points = 0;
    while (walk.next()) {
        if (walk.before() == 0) continue;
        const double turn = walk.time(1e-10 * duration), w = dot(system.gap(0), system.fly(flight.begin, turn).z);
        const double distance = walk.before() > 0 ? system.upper() - w : w - system.lower();
        ++flight.turning_points;
        if (distance < best) {
            second = best, best = distance;
            flight.turn = turn;
            side = walk.before() > 0 ? 1.0 : -1.0;
        } else if (distance < second) {
            second = distance;
        }
    }
    if (walk.gave_up()) {  // there are more than were looked for: nothing is known of the rest
        best = second = -INFINITE;
        flight.turning_points = 0;
    }
    flight.clearance = {best, 0.0};
    flight.second = second;
    if (flight.turning_points > 0)
        flight.clearance.rate = -side * dot(system.gap(0), system.fly(flight.begin, flight.turn).dz);
}

}  // namespace saltus
