/// Impacts found in steps of fixed length, equation (11).
#include "steps.hpp"

#include <algorithm>

namespace saltus {

namespace {

/// Rounding errors of w, as a part of the sizes that make it up: far more than the contact tolerance.
constexpr double NOISE = 1e-12;

/// A functional and two derivatives by the part of a step, at one of its ends.
struct End {
    double value, slope, bend;
};

/// The part of a step at which a functional passes a bound, by the polynomial of fifth order through both ends: a cubic
/// and what the second derivatives add. It is nearer than the cubic by two orders, which saves most of the work on the
/// exact flight.
double zero_in_step(const End& begin, const End& end, double bound) {
    const double rise = end.value - begin.value, second = 3.0 * rise - 2.0 * begin.slope - end.slope;
    const double third = begin.slope + end.slope - 2.0 * rise, more = 0.5 * begin.bend - second;
    const double change = 0.5 * end.bend - second - 3.0 * third - more;
    double s = (bound - begin.value) / rise;
    for (int count = 0; count < 2; ++count) {
        const double rest = 1.0 - s, window = s * rest, extra = more + change * s;
        const double value = begin.value + s * (begin.slope + s * (second + s * third)) +
            window * window * extra - bound;
        const double slope = begin.slope + s * (2.0 * second + 3.0 * s * third) +
            window * (2.0 * (rest - s) * extra + window * change);
        if (slope != 0.0) s = std::min(std::max(s - value / slope, 0.0), 1.0);
    }
    return s;
}

}  // namespace

StepStops::StepStops(const StepTable& table, const Contacts& contacts) : table_(table), contacts_(contacts) {
    const int count = table.count();
    fit_ = count <= MOST_PAIRS;
    rows_.resize(size_t(8) * contacts.count() * count);
    double* rows = rows_.data();
    for (int c = 0; c < contacts.count() && fit_; ++c) {
        const Values gap = contacts.gap[c];
        if (c == 0 || !std::equal(gap.begin(), gap.end(), contacts.gap[c - 1].begin())) {
            fit_ = count_ < MOST;
            if (!fit_) return;
            Stop& stop = stops_[count_];
            stop.value = gap.data(), stop.rate = contacts.rate[c].data();
            stop.acceleration = contacts.acceleration[c].data();
            stop.reaches = rows, stop.sizes = rows + count;
            table.reaches(gap, rows), table.sizes(gap, rows + count);
            rows += 2 * count;
            for (const double** row : {&stop.value, &stop.rate, &stop.acceleration}) {
                table.split({*row, gap.size()}, rows);
                *row = rows;
                rows += 2 * count;
            }
            for (int k = 0; k < count; ++k)
                stop.plain = stop.plain && stop.value[count + k] == 0.0 && stop.rate[k] == 0.0;
            ++count_;
        }
        Stop& stop = stops_[count_ - 1];
        const bool high = contacts.side[c] > 0.0;
        fit_ = (high ? stop.high : stop.low) < 0;
        (high ? stop.high : stop.low) = c;
        (high ? stop.upper : stop.lower) = contacts.bound[c];
    }
}

bool StepWalk::start(Values z, int leaving) {
    const int size = 2 * table_.count();
    double* state = state_;
    table_.split(z, state);
    table_.radii(z, radii_);
    fresh_ = leaving >= 0;
    for (size_t s = 0; s < stops_.size(); ++s) {
        const StepStops::Stop& stop = stops_[s];
        Seen& seen = seen_[s];
        const bool leaves = fresh_ && stop.has(leaving);
        if (seen.far) continue;
        const StepTable::Amplitudes found = table_.amplitudes(contacts_.gap[stop.contact()], stop.reaches, z, radii_,
                                                              std::max(horizon_ - t_, 0.0));
        seen.curvature = found.second, seen.third = found.third, seen.fourth = found.fourth;
        seen.noise = NOISE * (part_of(stop.sizes, radii_, size / 2) + std::min(std::fabs(stop.lower), std::fabs(stop.upper)));
        seen.far = !leaves && found.level + seen.noise < std::min(stop.upper, -stop.lower);
        seen.w = part_of(stop.value, state, size);
        seen.v = part_of(stop.rate, state, size);
        seen.side = leaves ? contacts_.side[leaving] : 0.0;
        double below = stop.lower + seen.noise, above = stop.upper - seen.noise;
        if (leaves) {
            if (contacts_.restitution[leaving] == 0.0 || -seen.side * seen.v <= 0.0) return false;
            seen.w = seen.side > 0.0 ? stop.upper : stop.lower;
            (seen.side > 0.0 ? above : below) = seen.side * INFINITE;
            const Values acceleration = contacts_.acceleration[leaving];
            Local<double, DYNAMIC, 64> rate(int(z.size()));
            seen.bend = part_of(acceleration.data(), z.data(), int(z.size()));
            table_.rate(z, rate.data());
            seen.jerk = part_of(acceleration.data(), rate.data(), int(z.size()));
        }
        if (!(below < seen.w && seen.w < above)) return false;
    }
    return true;
}

StepWalk::Reason StepWalk::reach(int s, double h, const double* next) {
    const StepStops::Stop& stop = stops_[s];
    const Seen& seen = seen_[s];
    const int size = 2 * table_.count();
    const bool up = seen.v > 0.0;
    const End begin{seen.w, h * seen.v, h * h * part_of(stop.acceleration, state_, size)};
    const End end{seen.next_w, h * seen.next_v, h * h * part_of(stop.acceleration, next, size)};
    const double part = zero_in_step(begin, end, up ? stop.upper : stop.lower);
    hit_ = {up ? stop.high : stop.low, t_, t_ + h, t_ + part * h, seen.curvature, seen.third};
    return HIT;
}

}  // namespace saltus
