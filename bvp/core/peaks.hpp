/// The largest displacements along a flight, from cubics with an error bound.
///
/// The cubic with the values and slopes of f at both ends of a step lies within its four Bezier coefficients, and differs from f by at most
/// W h^4/384 with |f''''| <= W, equation (11). A step whose coefficients stay below the largest |f| so far holds no larger one. Any other
/// step is divided until f' keeps its sign, or f'' does and Newton's method finds the one turning point.
#pragma once

#include "path.hpp"

namespace saltus {

/// Largest values of |u| so far, and when they were reached.
struct Peaks {
    Vector<double> size;  // (n,)
    Vector<double> time;  // (n,), or empty

    /// Of values that are equal to rounding the first one counts.
    void raise(int i, double value, double when) const {
        constexpr double EQUAL = 1.0 + 1e-15;
        value = std::fabs(value);
        if (!(value > size[i])) return;
        if (!time.empty() && value > EQUAL * size[i]) time[i] = when;
        size[i] = value;
    }
};

/// Displacements u = rows . z and their velocities, (n, N) each.
struct Displacements {
    Matrix<const double> value, velocity;
    int count() const { return value.rows(); }
};

/// The search of one displacement along one path.
template <class Path>
class PeakSearch {
public:
    PeakSearch(const Path& path, const Displacements& rows, int i, const Peaks& peaks)
        : path_(path), value_(rows.value[i]), velocity_(rows.velocity[i]), i_(i), peaks_(peaks), state_(path.size()), rate_(path.size()) {}

    /// A bound of |f| over the cubic of a step of h, without its error.
    static double hull(double f0, double g0, double f1, double g1, double h) {
        const double inner = std::fmax(std::fabs(f0 + h * g0 * (1.0 / 3.0)), std::fabs(f1 - h * g1 * (1.0 / 3.0)));
        return std::fmax(inner, std::fmax(std::fabs(f0), std::fabs(f1)));
    }

    /// Raise the peak to the largest |f| from a time on, over a length in which the bounds of |f'''| and |f''''| hold. False: it gave up.
    bool climb(double begin, double length, double third, double fourth) {
        constexpr int MOST = 100'000;
        Sample left = at(begin);
        peaks_.raise(i_, left.value, begin);
        double t = 0.0, size = length;
        for (int count = 0; count < MOST; ++count) {
            size = std::fmin(size, length - t);
            const Sample right = at(begin + t + size);
            const double ends = std::fmax(std::fabs(left.value), std::fabs(right.value)), square = size * size / 8.0;
            const double most = hull(left.value, left.slope, right.value, right.slope, size) + fourth * square * square / 6.0;
            if (most > peaks_.size[i_]) {
                const bool convex = keeps_sign(left.bend, right.bend, fourth * square);
                const bool monotone = left.slope * right.slope >= 0.0 && (convex || keeps_sign(left.slope, right.slope, third * square));
                if (convex && left.slope * right.slope < 0.0) turn(begin + t, size, left, right);
                else if (!(monotone || most - ends <= 1e-15 * most || size <= 1e-9 * length)) {
                    size *= 0.5;
                    continue;
                }
                peaks_.raise(i_, right.value, begin + t + size);
            }
            left = right;
            t += size;
            if (t >= length) return true;
            size *= 2.0;
        }
        return false;
    }

private:
    static bool keeps_sign(double a, double b, double change) { return a * b > 0.0 && std::fmin(std::fabs(a), std::fabs(b)) > change; }

    Sample at(double t) {
        path_.state(t, state_);
        path_.rate(Values(state_), rate_);
        return {dot(value_, Values(state_)), dot(velocity_, Values(state_)), dot(velocity_, Values(rate_))};
    }

    /// Newton's method for the one turning point in a step, kept between its ends.
    void turn(double begin, double size, const Sample& left, const Sample& right) {
        double low = 0.0, high = size, s = size * left.slope / (left.slope - right.slope);
        for (int count = 0; count < 50; ++count) {
            const Sample now = at(begin + s);
            peaks_.raise(i_, now.value, begin + s);
            (now.slope * left.slope > 0.0 ? low : high) = s;
            const double middle = 0.5 * (low + high);
            double better = now.bend != 0.0 ? s - now.slope / now.bend : middle;
            if (!(low <= better && better <= high)) better = middle;
            if (std::fabs(now.bend) * (better - s) * (better - s) <= 1e-15 * std::fabs(now.value)) return;
            s = better;
        }
    }

    const Path& path_;
    Values value_, velocity_;
    int i_;
    const Peaks& peaks_;
    Local<double, Path::SIZE> state_, rate_;
};

/// The same for all displacements at once, in steps of fixed length: only the steps that could hold a larger value are searched.
template <class Path>
class PeakWalk {
public:
    PeakWalk(const Path& path, const StepTable& table, const Displacements& rows, const Peaks& peaks)
        : path_(path), table_(table), rows_(rows), peaks_(peaks), watched_(rows.count()), state_(path.size()), next_(path.size()) {}

    bool run(double duration, Values end) {
        constexpr int MOST_STEPS = 1024, RENEW = 16;
        const double h = table_.length(0);
        copy(path_.begin(), state_);
        for (int i = 0; i < rows_.count(); ++i) {
            const double reached = std::fmax(peaks_.size[i], std::fabs(dot(rows_.value[i], end)));
            watched_[count_++] = {i, reached, dot(rows_.value[i], Values(state_)), dot(rows_.velocity[i], Values(state_)), 0.0, 0.0};
        }
        double t = 0.0;
        for (int steps = 0; t < duration; ++steps) {
            if (steps == 0 || (steps % RENEW == 0 && !table_.is_steady())) bound(duration - t);
            if (count_ == 0) return true;
            if (steps > 0 && steps % MOST_STEPS == 0) path_.state(t, state_);  // rounding errors do not accumulate
            table_.step(Values(state_), Vector<double>(next_));
            for (int w = 0; w < count_; ++w)
                if (!pass(watched_[w], t, h, duration - t)) return false;
            copy(Values(next_), state_);
            t += h;
        }
        return true;
    }

private:
    struct Watched {
        int i;
        double reached, f, g, third, fourth;
    };

    /// Drop what cannot become larger any more.
    void bound(double left) {
        int kept = 0;
        for (int w = 0; w < count_; ++w) {
            Watched watched = watched_[w];
            const StepTable::Amplitudes found = table_.amplitudes(rows_.value[watched.i], Values(state_), left);
            if (found.level <= std::fmax(watched.reached, peaks_.size[watched.i])) continue;
            watched.third = found.third, watched.fourth = found.fourth;
            watched_[kept++] = watched;
        }
        count_ = kept;
    }

    bool pass(Watched& watched, double t, double h, double left) {
        const double f = dot(rows_.value[watched.i], Values(next_)), g = dot(rows_.velocity[watched.i], Values(next_));
        const double most = PeakSearch<Path>::hull(watched.f, watched.g, f, g, h) + watched.fourth * (h * h * h * h * (1.0 / 384.0));
        watched.f = f, watched.g = g;
        if (most <= std::fmax(watched.reached, peaks_.size[watched.i])) return true;
        return PeakSearch<Path>(path_, rows_, watched.i, peaks_).climb(t, std::fmin(h, left), watched.third, watched.fourth);
    }

    const Path& path_;
    const StepTable& table_;
    const Displacements& rows_;
    const Peaks& peaks_;
    Local<Watched, DYNAMIC, 16> watched_;
    int count_ = 0;
    Local<double, Path::SIZE> state_, next_;
};

/// Raise the peaks to the largest |u| over a path that ends with the state `end` after `duration`. False if the search gave up.
template <class Path>
bool raise_peaks(const Path& path, const Displacements& rows, double duration, Values end, const Peaks& peaks) {
    constexpr double RENEWED = 8.0;  // radians of the fastest motion after which bounds are taken anew
    for (int i = 0; i < rows.count(); ++i) {
        if (!(std::fabs(dot(rows.value[i], end)) < INFINITE)) return false;
        peaks.raise(i, dot(rows.value[i], path.begin()), 0.0);
    }
    if (const StepTable* table = path.steps()) {
        if (!PeakWalk<Path>(path, *table, rows, peaks).run(duration, end)) return false;
    } else {
        Local<double, Path::SIZE> state(path.size());
        const double longest = 1.0 / std::fmax(path.growth(), path.fastest() / RENEWED);
        for (int i = 0; i < rows.count(); ++i) {
            const double at_end = std::fabs(dot(rows.value[i], end));
            for (double t = 0.0, window = 0.0; t < duration; t += window) {
                path.state(t, state);
                window = path.window(t, std::fmin(duration - t, longest));
                if (!(window > 0.0)) return false;  // the flight has no end
                const double reached = std::fmax(peaks.size[i], at_end);
                const bool covered = path.window(t, duration - t) >= duration - t;
                if (covered && path.bounds(rows.value[i], t, state, duration - t).level <= reached) break;
                if (path.bounds(rows.value[i], t, state, window).level <= reached) continue;
                const Bounds bounds = path.bounds(rows.velocity[i], t, state, window);
                if (!PeakSearch<Path>(path, rows, i, peaks).climb(t, window, bounds.second, bounds.third)) return false;
            }
        }
    }
    for (int i = 0; i < rows.count(); ++i) peaks.raise(i, dot(rows.value[i], end), duration);
    return true;
}

}  // namespace saltus
