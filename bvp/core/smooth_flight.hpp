/// Flights with smooth forces: a kind of flight (see `linear_flight.hpp`) whose steps are Taylor series.
///
/// A flight is a light handle: its copies share the equations and the flights that were computed last, from any number
/// of threads. The end, the derivative and the path of one state and duration are computed once. No result depends on
/// what is kept.
#pragma once

#include <algorithm>
#include <tuple>

#include "path.hpp"
#include "taylor.hpp"

namespace saltus {

/// Flight of N states; N may be DYNAMIC.
template <int N = DYNAMIC>
class SmoothFlight {
public:
    static constexpr int SIZE = N;
    template <class T>
    using State = Local<T, N>;

    explicit SmoothFlight(SmoothEquations equations, int keep = 16)
        : flights_(std::make_shared<TaylorFlights>(std::move(equations), keep)) {}
    explicit SmoothFlight(std::shared_ptr<const TaylorFlights> flights) : flights_(std::move(flights)) {}
    /// The same flights, with a size that the compiler knows.
    template <int M>
    explicit SmoothFlight(const SmoothFlight<M>& other) : flights_(other.shared()) {}

    constexpr int size() const {
        if constexpr (N != DYNAMIC) return N;
        return flights_->equations().size();
    }
    static constexpr bool is_series() { return true; }
    const SmoothEquations& equations() const { return flights_->equations(); }
    const std::shared_ptr<const TaylorFlights>& shared() const { return flights_; }
    /// Keep the last flights, so many at least: those of an orbit.
    void keep(int count) const { flights_->keep(count); }

    /// The steps of the flight of time t from z.
    std::shared_ptr<const TaylorPath> fly(Values z, double t, bool with_map = true) const {
        return flights_->fly(z, t, with_map);
    }

    /// out = the state after a time, in any number type; NaN where the flight has no end. The steps are those of the
    /// values.
    template <class T, class Z, class Out>
    void end(const Z& z, const T& t, Out&& out) const {
        State<double> begin(size());
        for (int r = 0; r < size(); ++r) begin[r] = value(z[r]);
        const auto path = fly(begin, value(t));
        if (!path->complete || (equations().called && !std::is_same_v<T, double>)) {
            for (int r = 0; r < size(); ++r) out[r] = NOT_A_NUMBER * z[r];  // with its derivatives
        } else if constexpr (std::is_same_v<T, double>) {
            copy(path->end, out);
        } else {
            follow(*path, equations(), z, t, out);
        }
    }
    /// The same, and its derivative by z.
    template <class Out>
    void end(Values z, double t, Out&& out, Matrix<double> map) const {
        const auto path = fly(z, t);
        if (path->complete) {
            copy(path->end, out);
            std::copy(path->map.data(), path->map.data() + size() * size(), map.data());
        } else {
            for (int r = 0; r < size(); ++r) out[r] = NOT_A_NUMBER;
            std::fill(map.data(), map.data() + size() * size(), NOT_A_NUMBER);
        }
    }

    /// out = z'.
    template <class Z, class Out>
    void rate(const Z& z, Out&& out) const {
        using T = std::remove_cvref_t<decltype(z[0])>;
        Local<T> series(equations().program.registers);
        equations().template rate<T>(z, 0.0, column(series), out);
    }
    /// out = map x.
    template <class X, class Out>
    void carry(Matrix<const double> map, const X& x, Out&& out) const { multiply(map, x, out); }

    /// 2 H.
    template <class Z>
    auto twice_energy(const Z& z) const {
        return equations().template twice_energy<std::remove_cvref_t<decltype(z[0])>>(z);
    }
    /// out = grad H: in modal coordinates the part of the displacements is minus the acceleration.
    template <class Z, class Out>
    void energy_slope(const Z& z, Out&& out) const {
        using T = std::remove_cvref_t<decltype(z[0])>;
        const int n = size() / 2;
        State<T> change(size());
        rate(z, change);
        for (int r = 0; r < n; ++r) {
            out[r] = -change[n + r];
            out[n + r] = z[n + r];
        }
    }
    /// Call add(r, c, entry) for the entries of the second derivative of H at z, times a factor: their sums.
    template <class Z, class Add>
    void bend(const Z& z, double factor, Add&& add) const {
        const auto& [program, rows] = std::tie(equations().program, equations().inputs);
        const int n = size() / 2;
        Local<double> series(program.registers);
        State<double> change(size());
        equations().template rate<double>(z, 0.0, column(series), change);
        for (int r = 0; r < size(); ++r) add(r, r, factor * equations().weights[r]);
        for (const auto& slope : program.slopes)
            for (int r = 0; r < n; ++r)
                if (const double part = factor * equations().dense_push(r, slope.force) * series[slope.result]; part != 0.0)
                    for (const auto& entry : rows[slope.input]) add(r, entry.column, -part * entry.value);
    }

    /// The unit of residuals of velocities at an end: a typical velocity; or the change of the velocities there in a
    /// typical duration, where the forces are so large that this is more. A duration is known to a part eps.
    double velocity_unit(Values end, double velocity, double duration) const {
        State<double> change(size());
        rate(end, change);
        for (int r = size() / 2; r < size(); ++r) velocity = std::max(velocity, std::fabs(change[r]) * duration);
        return velocity;
    }

    /// The flight that was asked for last, if it has no end; else nullptr.
    std::shared_ptr<const TaylorPath> failure() const {
        auto latest = flights_->latest();
        return latest && !latest->complete ? latest : nullptr;
    }

private:
    /// Registers as those of one order.
    template <class T>
    static Matrix<T> column(Local<T>& series) { return {series.data(), series.size(), 1}; }

    std::shared_ptr<const TaylorFlights> flights_;
};

/// A functional along a Taylor path: a polynomial in each step. Where there is no path, it is no number.
class SmoothTrack {
public:
    SmoothTrack(const TaylorPath& path, Values row, double duration);

    double duration() const { return duration_; }
    double level() const { return level_; }
    /// Bounds of |f''| and |f'''| in the step at t, and the time up to which they hold.
    Bounds bounds(double t) const { return bounds_[place(t)]; }
    double until(double t) const { return times_[place(t) + 1]; }

    Sample at(double t) const {
        const int s = place(t);
        const double x = t - times_[s];
        Sample out{0.0, 0.0, 0.0};
        for (int k = ORDER; k >= 0; --k) {
            out.bend = out.bend * x + out.slope;
            out.slope = out.slope * x + out.value;
            out.value = out.value * x + coefficients_(s, k);
        }
        out.bend *= 2.0;
        return out;
    }

private:
    int place(double t) const;

    std::vector<double> times_;
    Array<> coefficients_;  // (S, ORDER + 1)
    std::vector<Bounds> bounds_;
    double level_ = 0.0, duration_;
};

/// The path of a flight over a duration >= 0. It shares the steps of the flight.
template <int N>
class SmoothPath {
public:
    static constexpr int SIZE = N, PAIRS = DYNAMIC;
    SmoothPath(const SmoothFlight<N>& flight, Values z, double duration)
        : flight_(flight), path_(flight.fly(z, duration)) {}

    int size() const { return flight_.size(); }
    Values begin() const { return path_->begin; }
    template <class Out>
    void state(double t, Out&& out) const {
        if (path_->complete && t == path_->duration) {
            copy(path_->end, out);
        } else if (path_->steps() == 0 || !(t >= 0.0 && t <= path_->times.back())) {
            for (int r = 0; r < size(); ++r) out[r] = t == 0.0 ? path_->begin[r] : NOT_A_NUMBER;
        } else {
            const int s = path_->step_at(t);
            evaluate_series<double>(path_->step(s), t - path_->times[s], out);
        }
    }
    void rate(Values state, Vector<double> out) const { flight_.rate(state, out); }
    bool is_steady() const { return false; }
    /// Bounds hold in one step each.
    double growth() const { return 1e-300; }
    /// A step is a sixth of where its series converges.
    double fastest() const { return path_->steps() > 0 ? 1.0 / (6.0 * path_->times[1]) : INFINITE; }
    double window(double t, double length) const {
        return path_->steps() > 0 ? std::min(length, path_->times[path_->step_at(t) + 1] - t) : 0.0;
    }
    Bounds bounds(Values row, double t, Values, double) const {
        if (path_->steps() == 0) return {INFINITE, INFINITE, INFINITE};
        return path_->bounds(row, path_->step_at(t));
    }
    const StepTable* steps() const { return nullptr; }
    SmoothTrack track(const Functional& rows, double duration) const { return {*path_, rows.value, duration}; }

private:
    SmoothFlight<N> flight_;
    std::shared_ptr<const TaylorPath> path_;
};

/// The path of the flight of time `duration` from z.
template <int N>
SmoothPath<N> path_of(const SmoothFlight<N>& flight, Values z, double duration) {
    return {flight, z, duration};
}

}  // namespace saltus
