/// The largest displacements along a flight, from cubics with an error bound.
///
/// The cubic with the values and slopes of f at both ends of a step lies within its four Bezier coefficients, and differs from f by at most
/// W h^4/384 with |f''''| <= W, equation (11). A step whose coefficients stay below the largest |f| so far holds no larger one. Any other
/// step is divided until f' keeps its sign, or f'' does and Newton's method finds the one turning point.
#pragma once

#include "impact.hpp"

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
        const double inner = std::max(std::fabs(f0 + h * g0 * (1.0 / 3.0)), std::fabs(f1 - h * g1 * (1.0 / 3.0)));
        return std::max(inner, std::max(std::fabs(f0), std::fabs(f1)));
    }

    /// Raise the peak to the largest |f| from a time on, over a length in which the bounds of |f'''| and |f''''| hold. False: it gave up.
    bool climb(double begin, double length, double third, double fourth) {
        const Sample first = at(begin), last = at(begin + length);
        peaks_.raise(i_, first.value, begin);
        return climb(begin, length, third, fourth, first, last);
    }
    /// The same, where both ends are known.
    bool climb(double begin, double length, double third, double fourth, const Sample& first, const Sample& last) {
        constexpr int MOST = 100'000;
        Sample left = first;
        double t = 0.0, size = length;
        for (int count = 0; count < MOST; ++count) {
            size = std::min(size, length - t);
            const Sample right = size < length - t ? at(begin + t + size) : last;
            const double ends = std::max(std::fabs(left.value), std::fabs(right.value)), square = size * size / 8.0;
            const double most = hull(left.value, left.slope, right.value, right.slope, size) + fourth * square * square / 6.0;
            if (most > peaks_.size[i_]) {
                const bool convex = keeps_sign(left.bend, right.bend, fourth * square);
                const bool monotone = left.slope * right.slope >= 0.0 && (convex || keeps_sign(left.slope, right.slope, third * square));
                if (convex && left.slope * right.slope < 0.0) turn(begin + t, size, left, right, third);
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
    static bool keeps_sign(double a, double b, double change) { return a * b > 0.0 && std::min(std::fabs(a), std::fabs(b)) > change; }

    Sample at(double t) {
        path_.state(t, state_);
        path_.rate(Values(state_), rate_);
        return {dot(value_, Values(state_)), dot(velocity_, Values(state_)), dot(velocity_, Values(rate_))};
    }

    /// Newton's method for the one turning point in a step, kept between its ends.
    void turn(double begin, double size, const Sample& left, const Sample& right, double third) {
        double low = 0.0, high = size, s = size * left.slope / (left.slope - right.slope);
        {  // where the cubic through the rates and their slopes at both ends is 0
            const double x = s / size, rise = right.slope - left.slope, a = size * left.bend, b = size * right.bend;
            const double square = 3.0 * rise - 2.0 * a - b, cube = a + b - 2.0 * rise;
            const double slope = a + x * (2.0 * square + 3.0 * x * cube);
            const double better = x - (left.slope + x * (a + x * (square + x * cube))) / slope;
            if (0.0 < better && better < 1.0) s = size * better;
        }
        for (int count = 0; count < 50; ++count) {
            const Sample now = at(begin + s);
            peaks_.raise(i_, now.value, begin + s);
            (now.slope * left.slope > 0.0 ? low : high) = s;
            const double middle = 0.5 * (low + high);
            double better = now.bend != 0.0 ? s - now.slope / now.bend : middle;
            const bool inside = low <= better && better <= high;
            if (!inside) better = middle;
            const double change = std::fabs(better - s);
            if (std::fabs(now.bend) * change * change <= 1e-15 * std::fabs(now.value)) return;
            if (inside && third * change * change * change <= 1e-15 * std::fabs(now.value)) {
                peaks_.raise(i_, now.value + 0.5 * (now.slope * (better - s)), begin + better);
                return;
            }
            s = better;
        }
    }

    const Path& path_;
    Values value_, velocity_;
    int i_;
    const Peaks& peaks_;
    Local<double, Path::SIZE> state_, rate_;
};

/// Displacements, velocities and accelerations as walks in steps of fixed length see them.
class PeakRows {
public:
    PeakRows(const StepTable& table, const Displacements& rows)
        : table_(table), rows_(rows), width_(7 * table.count()), numbers_(size_t(rows.count()) * width_) {
        std::vector<double> acceleration(rows.velocity.columns());
        for (int i = 0; i < rows.count(); ++i) {
            double* numbers = numbers_.data() + size_t(i) * width_;
            table.split(rows.value[i].data(), numbers);
            table.split(rows.velocity[i].data(), numbers + 2 * table.count());
            table.rate_row(rows.velocity[i], acceleration);
            table.split(acceleration.data(), numbers + 4 * table.count());
            table.reaches(rows.value[i], numbers + 6 * table.count());
        }
    }
    const StepTable& table() const { return table_; }
    const Displacements& rows() const { return rows_; }
    const double* value(int i) const { return numbers_.data() + size_t(i) * width_; }
    const double* velocity(int i) const { return value(i) + 2 * table_.count(); }
    const double* acceleration(int i) const { return value(i) + 4 * table_.count(); }
    const double* reaches(int i) const { return value(i) + 6 * table_.count(); }

private:
    const StepTable& table_;
    Displacements rows_;
    int width_;
    std::vector<double> numbers_;
};

/// What a walk in steps of fixed length shows of all displacements: only the steps that could hold a larger one than the
/// peaks are searched, and nothing is looked at while no displacement can become larger.
template <class Path>
class PeakObserver {
public:
    PeakObserver(const Path& path, const PeakRows& rows, const Peaks& peaks)
        : path_(path), rows_(rows), peaks_(peaks), watched_(rows.rows().count()) {}

    bool is_idle() const { return count_ == 0; }
    bool gave_up() const { return gave_up_; }

    /// Watch the displacements that can become larger from here on. z: the state at the walk's time.
    void begin(const StepWalk<Path::PAIRS>& walk, const double* z) {
        const int size = entries();
        count_ = 0;
        t_ = walk.time();
        for (int i = 0; i < rows_.rows().count(); ++i) {
            const StepTable::Amplitudes found = rows_.table().template amplitudes<Path::PAIRS>(
                rows_.rows().value[i], rows_.reaches(i), z, walk.radii(), std::max(walk.horizon() - t_, 0.0));
            if (found.level <= peaks_.size[i]) continue;
            const double f = part_of(rows_.value(i), walk.state(), size), g = part_of(rows_.velocity(i), walk.state(), size);
            peaks_.raise(i, f, t_);
            watched_[count_++] = {i, f, g, found.third, found.fourth};
        }
    }
    /// A step of h from t between two states that the walk knows; `left` of it counts.
    void pass(double t, double h, double left, const double* now, const double* next) {
        const int size = entries();
        for (int w = 0; w < count_; ++w) {
            Watched& watched = watched_[w];
            const int i = watched.i;
            const Sample from{watched.f, watched.g, 0.0};
            const double f = part_of(rows_.value(i), next, size), g = part_of(rows_.velocity(i), next, size);
            if (!look(watched, t, h, left, f, g)) continue;
            PeakSearch<Path> search(path_, rows_.rows(), i, peaks_);
            const double* row = rows_.acceleration(i);
            const bool done = h <= left ? search.climb(t, h, watched.third, watched.fourth, {from.value, from.slope, part_of(row, now, size)},
                                                       {f, g, part_of(row, next, size)})
                : search.climb(t, left, watched.third, watched.fourth);
            if (!done) gave_up_ = true;
        }
        t_ = t + h;
    }
    /// The end of the flight, within a step or at the end of one.
    void finish(double duration, Values end) {
        const double length = duration - t_;
        for (int w = 0; w < count_ && length > 0.0; ++w) {
            const int i = watched_[w].i;
            Watched& watched = watched_[w];
            if (!look(watched, t_, length, length, dot(rows_.rows().value[i], end), dot(rows_.rows().velocity[i], end))) continue;
            if (!PeakSearch<Path>(path_, rows_.rows(), i, peaks_).climb(t_, length, watched.third, watched.fourth)) gave_up_ = true;
        }
    }

private:
    struct Watched {
        int i;
        double f, g, third, fourth;
    };

    int entries() const { return 2 * (Path::PAIRS == DYNAMIC ? rows_.table().count() : Path::PAIRS); }

    /// Whether a step may hold a larger value than at its ends.
    bool look(Watched& watched, double t, double h, double left, double f, double g) {
        const double f0 = watched.f, g0 = watched.g;
        const double most = PeakSearch<Path>::hull(f0, g0, f, g, h) + watched.fourth * (h * h * h * h * (1.0 / 384.0));
        watched.f = f, watched.g = g;
        if (most <= peaks_.size[watched.i]) return false;
        // From rest a value rises so slowly that only the end of the step is seen to be larger than the rest.
        if (h <= left) peaks_.raise(watched.i, f, t + h);
        // Where the rate keeps its sign over the step, the larger end is the largest.
        const bool steadily = g0 * g > 0.0 && std::min(std::fabs(g0), std::fabs(g)) > watched.third * (h * h * 0.125);
        return !(steadily && h <= left);
    }

    const Path& path_;
    const PeakRows& rows_;
    Peaks peaks_;
    Local<Watched, DYNAMIC, 16> watched_;
    int count_ = 0;
    double t_ = 0.0;  // up to which the flight was seen
    bool gave_up_ = false;
};

/// Raise the peaks to the largest |u| over a path that ends with the state `end` after `duration`. False if the search gave up.
template <class Path>
bool raise_peaks(const Path& path, const Displacements& rows, double duration, Values end, const Peaks& peaks) {
    constexpr double RENEWED = 8.0;  // radians of the fastest motion after which bounds are taken anew
    for (int i = 0; i < rows.count(); ++i) {
        if (!(std::fabs(dot(rows.value[i], end)) < INFINITE)) return false;
        peaks.raise(i, dot(rows.value[i], path.begin()), 0.0);
    }
    if (const StepTable* table = path.steps(); table && table->count() <= StepStops::MOST_PAIRS) {
        static const Contacts no_contacts{};
        const StepStops no_stops(*table, no_contacts);
        const PeakRows watched(*table, rows);
        PeakObserver<Path> observer(path, watched, peaks);
        NextImpact found;
        step_to_impact(path, no_stops, -1, duration, found, observer);
        observer.finish(duration, end);
        if (observer.gave_up()) return false;
    } else {
        Local<double, Path::SIZE> state(path.size());
        const double longest = 1.0 / std::max(path.growth(), path.fastest() / RENEWED);
        for (int i = 0; i < rows.count(); ++i) {
            const double at_end = std::fabs(dot(rows.value[i], end));
            for (double t = 0.0, window = 0.0; t < duration; t += window) {
                path.state(t, state);
                window = path.window(t, std::min(duration - t, longest));
                if (!(window > 0.0)) return false;  // the flight has no end
                const double reached = std::max(peaks.size[i], at_end);
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
