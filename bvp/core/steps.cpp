/// Impacts found in steps of fixed length, equation (11).
#include "steps.hpp"

#include <algorithm>

#include "path.hpp"

namespace saltus {

namespace {

/// Rounding errors of w, as a part of the sizes that make it up: far more than the contact tolerance.
constexpr double NOISE = 1e-12;

/// Whether a distance that is 0 stays positive over a step of h, by its three derivatives at the begin and a bound of
/// the fourth: the Bezier coefficients of the distance over the time, a cubic, are positive.
bool moves_away(double slope, double bend, double jerk, double fourth, double h) {
    return slope > 0.0 && slope + bend * h / 6.0 > 0.0 && slope + bend * h / 3.0 + jerk * h * h / 18.0 > 0.0 &&
           slope + bend * h / 2.0 + jerk * h * h / 6.0 - fourth * h * h * h / 24.0 > 0.0;
}

double sum(const double* row, const double* state, int size) {
    double total = 0.0;
    for (int r = 0; r < size; ++r) total += row[r] * state[r];
    return total;
}

}  // namespace

StepStops::StepStops(const StepTable& table, const Contacts& contacts)
    : table_(table), contacts_(contacts), rows_(table.is_split() ? 0 : 6 * contacts.count() * table.count()) {
    const int count = table.count();
    fit_ = count <= MOST_PAIRS;
    for (int c = 0; c < contacts.count() && fit_; ++c) {
        const Values gap = contacts.gap[c];
        if (c == 0 || !std::equal(gap.begin(), gap.end(), contacts.gap[c - 1].begin())) {
            fit_ = count_ < MOST;
            if (!fit_) return;
            Stop& stop = stops_[count_] = {gap.data(), contacts.rate[c].data(), contacts.acceleration[c].data()};
            if (!table.is_split()) {
                double* rows = rows_.data() + 6 * count_ * count;
                for (const double** row : {&stop.value, &stop.rate, &stop.acceleration}) {
                    table.split({*row, gap.size()}, rows);
                    *row = rows;
                    rows += 2 * count;
                }
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
    double* state = state_[0];
    table_.split(z, state);
    fresh_ = leaving >= 0;
    for (size_t s = 0; s < stops_.size(); ++s) {
        const StepStops::Stop& stop = stops_[s];
        Watch& watch = watches_[s];
        const bool leaves = fresh_ && stop.has(leaving);
        if (watch.far) continue;
        const StepTable::Amplitudes found =
            table_.amplitudes(contacts_.gap[stop.contact()], z, std::max(horizon_ - t_, 0.0));
        watch.curvature = found.second, watch.third = found.third, watch.fourth = found.fourth;
        watch.noise = NOISE * (found.size + std::min(std::fabs(stop.lower), std::fabs(stop.upper)));
        watch.far = !leaves && found.level + watch.noise < std::min(stop.upper, -stop.lower);
        watch.w = sum(stop.value, state, size);
        watch.v = sum(stop.rate, state, size);
        watch.side = leaves ? contacts_.side[leaving] : 0.0;
        double below = stop.lower + watch.noise, above = stop.upper - watch.noise;
        if (leaves) {
            if (contacts_.restitution[leaving] == 0.0 || -watch.side * watch.v <= 0.0) return false;
            watch.w = watch.side > 0.0 ? stop.upper : stop.lower;
            (watch.side > 0.0 ? above : below) = watch.side * INFINITE;
            const Values acceleration = contacts_.acceleration[leaving];
            Local<double, DYNAMIC, 64> rate(int(z.size()));
            watch.bend = sum(acceleration.data(), z.data(), int(z.size()));
            table_.rate(z, rate.data());
            watch.jerk = sum(acceleration.data(), rate.data(), int(z.size()));
        }
        if (!(below < watch.w && watch.w < above)) return false;
    }
    return true;
}

inline StepWalk::Verdict StepWalk::judge(int s, double h, bool fresh) const {
    const StepStops::Stop& stop = stops_[s];
    const Watch& watch = watches_[s];
    // Equation (11): the inner Bezier coefficients, and the error of the cubic.
    const double w = watch.w, v = watch.v, wn = watch.next_w, vn = watch.next_v;
    const double first = w + h * v * (1.0 / 3.0), second = wn - h * vn * (1.0 / 3.0);
    const double error = watch.fourth * (h * h * h * h * (1.0 / 384.0)) + watch.noise;
    bool above = std::max(std::max(first, second), std::max(w, wn)) + error < stop.upper;
    bool below = std::min(std::min(first, second), std::min(w, wn)) - error > stop.lower;
    if (fresh && watch.side != 0.0) {
        const double away = -watch.side;
        if (!moves_away(away * v, away * watch.bend, away * watch.jerk, watch.fourth, h)) return UNDECIDED;
        (watch.side > 0.0 ? above : below) = true;
    }
    if (above && below) return CLEAR;
    const bool passes = (wn > stop.upper + watch.noise && v > 0.0) || (wn < stop.lower - watch.noise && v < 0.0);
    const bool steadily = v * vn > 0.0 && std::min(std::fabs(v), std::fabs(vn)) > watch.third * (h * h * 0.125);
    return passes && steadily ? CROSSED : UNDECIDED;
}

template <int P>
StepWalk::Reason StepWalk::go_on() {
    // rounding errors do not accumulate; bounds of a decaying motion become less
    const int most = table_.is_steady() ? 1024 : 16;
    const int count = P == DYNAMIC ? table_.count() : P;
    double *state = state_[0], *next = state_[1];
    int level = 0;
    bool fresh = fresh_;
    for (int steps = 0; t_ < horizon_;) {
        if (steps == most) return UNFINISHED;
        const double* __restrict e = table_.entries(level);
        const double h = table_.length(level);
        double* __restrict out = next;
        for (int k = 0; k < count; ++k) {
            out[k] = e[k] * state[k] + e[count + k] * state[count + k];
            out[count + k] = e[2 * count + k] * state[k] + e[3 * count + k] * state[count + k];
        }
        bool undecided = false;
        int ahead = -1;
        for (int s = 0; s < int(stops_.size()) && !undecided; ++s) {
            const StepStops::Stop& stop = stops_[s];
            Watch& watch = watches_[s];
            if (watch.far) continue;
            watch.next_w = sum(stop.value, out, count);
            watch.next_v = sum(stop.rate + count, out + count, count);
            if (!stop.plain) {
                watch.next_w += sum(stop.value + count, out + count, count);
                watch.next_v += sum(stop.rate, out, count);
            }
            const Verdict verdict = judge(s, h, fresh);
            undecided = verdict == UNDECIDED || (verdict == CROSSED && ahead >= 0);
            if (verdict == CROSSED) ahead = s;
        }
        if (undecided) {
            if (++level == StepTable::LEVELS) return DECLINED;
            continue;
        }
        if (ahead >= 0) {
            const StepStops::Stop& stop = stops_[ahead];
            const Watch& watch = watches_[ahead];
            const bool up = watch.v > 0.0;
            const Sample begin{watch.w, watch.v, sum(stop.acceleration, state, 2 * count)};
            const Sample end{watch.next_w, watch.next_v, sum(stop.acceleration, out, 2 * count)};
            const double part = zero_in_step(begin, end, h, up ? stop.upper : stop.lower);
            hit_ = {up ? stop.high : stop.low, t_, t_ + h, t_ + part * h, watch.curvature, watch.third};
            return HIT;
        }
        for (size_t s = 0; s < stops_.size(); ++s)
            watches_[s].w = watches_[s].next_w, watches_[s].v = watches_[s].next_v;
        std::swap(state, next);
        fresh = false;
        t_ += h;
        if (level > 0) --level;
        ++steps;
    }
    return NONE;
}

StepWalk::Reason StepWalk::go() {
    bool all_far = true;
    for (size_t s = 0; s < stops_.size(); ++s) all_far = all_far && watches_[s].far;
    if (all_far) return NONE;
    switch (table_.count()) {
        case 1: return go_on<1>();
        case 2: return go_on<2>();
        case 3: return go_on<3>();
        case 4: return go_on<4>();
        case 5: return go_on<5>();
        case 6: return go_on<6>();
        default: return go_on<DYNAMIC>();
    }
}

}  // namespace saltus
