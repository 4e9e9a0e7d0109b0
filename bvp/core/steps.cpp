/// Impacts found in steps of fixed length, equation (11).
#include "steps.hpp"

#include <algorithm>

#include "path.hpp"

namespace saltus {

namespace {

/// Rounding errors of w, as a part of the sizes that make it up: far more than the contact tolerance.
constexpr double NOISE = 1e-12;

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
                if (table.is_split()) break;  // no copy
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
    const Sample begin{seen.w, seen.v, part_of(stop.acceleration, state_, size)};
    const Sample end{seen.next_w, seen.next_v, part_of(stop.acceleration, next, size)};
    const double part = zero_in_step(begin, end, h, up ? stop.upper : stop.lower);
    hit_ = {up ? stop.high : stop.low, t_, t_ + h, t_ + part * h, seen.curvature, seen.third};
    return HIT;
}

}  // namespace saltus
