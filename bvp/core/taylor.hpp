/// Taylor series of a motion with smooth forces: section 17 of docs/theory.md.
///
/// The state z = (u, v) moves by u' = v, v' = A z + P f(w), where the inputs w = W z of the forces f are linear in z. A
/// step is the polynomial of order `ORDER` of the state about its begin (Jorba & Zou, Experimental Mathematics 14 (2005)
/// 99). Its length follows from the last coefficients. The defect, the difference of the polynomial's acceleration from
/// that of the forces along it, then confirms it: the last coefficients alone miss a force that begins with a high power.
#pragma once

#include <functional>
#include <memory>
#include <mutex>

#include "blocks.hpp"
#include "program.hpp"

namespace saltus {

/// How many doubles a number has, and these: the value first.
template <class T>
inline constexpr int LEAVES = 1;
template <class T, int N>
inline constexpr int LEAVES<Jet<T, N>> = LEAVES<T> * (N + 1);
inline void leaves(double x, double* out) { *out = x; }
template <class T, int N>
void leaves(const Jet<T, N>& x, double* out) {
    leaves(x.value, out);
    for (int i = 0; i < N; ++i) leaves(x.slopes[i], out + (i + 1) * LEAVES<T>);
}

/// Order of the polynomials. The work of a step grows with its square, its length with eps^(-1/ORDER).
inline constexpr int ORDER = 22;

/// Largest last term but one of a column, as a part of its first ones. Shorter steps made derivatives no more exact, where the
/// growth of flights allows ten digits to sixteen. The defect of columns is not looked at.
inline constexpr double COLUMN_TRUNCATION = 1e-15;

/// Part of a step below which derivatives have no shorter ones: they are not smooth there.
inline constexpr double LEAST_PART = 1e-8;

/// Part of a step after which derivatives expand a power of |w| anew that is left out, for w passes 0 in NEAR_PART of the step.
inline constexpr double FIRST_PART = 1e-5, NEAR_PART = 1e-6;

/// Most steps of a flight.
inline constexpr int MOST_TAYLOR_STEPS = 256;

/// A matrix as the entries of its rows that are not zero. Where only the first two columns have any, they are there
/// side by side, too: two coordinates do without loops then.
template <class C>
class SparseRowsOf {
public:
    struct Entry {
        int column;
        C value;
    };
    SparseRowsOf() = default;
    explicit SparseRowsOf(Matrix<const C> matrix) {
        for (int r = 0; r < matrix.rows(); ++r) {
            begins_.push_back(int(entries_.size()));
            for (int c = 0; c < matrix.columns(); ++c)
                if (!is_zero(matrix(r, c))) {
                    entries_.push_back({c, matrix(r, c)});
                    narrow_ = narrow_ && c < 2;
                }
            for (int c = 0; c < 2; ++c) pairs_.push_back(c < matrix.columns() ? matrix(r, c) : C(0.0));
        }
        begins_.push_back(int(entries_.size()));
    }

    int rows() const { return int(begins_.size()) - 1; }
    /// Whether only the first two columns have entries.
    bool is_narrow() const { return narrow_; }
    Vector<const Entry> operator[](int r) const {
        return {entries_.data() + begins_[r], size_t(begins_[r + 1] - begins_[r])};
    }
    /// total += row r times z, by add(total, factor, column). NARROW: it has two columns.
    template <bool NARROW, class Add>
    void each(int r, Add&& add) const {
        if constexpr (NARROW) {
            add(pairs_[2 * r], 0);
            add(pairs_[2 * r + 1], 1);
        } else {
            for (const Entry& entry : (*this)[r]) add(entry.value, entry.column);
        }
    }
    /// Row r times z.
    template <bool NARROW = false, class T>
    T times(int r, const T* z) const {
        T total(0.0);
        each<NARROW>(r, [&](const C& factor, int column) { total += factor * z[column]; });
        return total;
    }

private:
    std::vector<Entry> entries_;
    std::vector<C> pairs_;  // (R, 2) the first two columns
    bool narrow_ = true;
    std::vector<int> begins_;  // of each row, and the end of the last one
};

using SparseRows = SparseRowsOf<double>;

/// Forces of which no formula is known.
struct CalledForces {
    /// Write the forces and their derivatives below the inputs in the first `count` columns of (registers, ..).
    std::function<void(Matrix<double> values, int count)> forces;
    std::function<double(Values inputs)> energy;
};

/// What accelerates the derivative of a motion by something that its equations depend on, besides the motion's own derivatives.
struct MotionSource {
    SparseRows linear;  // (n, N) by the state
    Array<> push;       // (n, F) by the forces
    struct Change {
        int force, result;  // the register of a force's derivative by a number
        double weight;
    };
    std::vector<Change> changes;  // of the forces themselves
};

/// The equations of a motion with smooth forces, n coordinates, I inputs and F forces; and its energy. Their numbers are
/// doubles, or jets by what they depend on.
template <class C>
struct SmoothEquationsOf {
    SparseRowsOf<C> linear;       // A (n, N)
    SparseRows inputs;            // W (I, N)
    Array<C> dense_push;          // P (n, F): accelerations of unit forces
    SparseRowsOf<C> push;
    ForceProgram program;
    std::vector<C> numbers;       // of the program
    Formulas potential;           // the energy of the forces, of the inputs
    int most_steps = MOST_TAYLOR_STEPS;          // of a flight
    std::shared_ptr<const CalledForces> called;  // in place of the program's operations and of the potential
    std::vector<MotionSource> sources;           // of derivatives that flights with such forces carry along
    std::vector<double> weights;  // (N,): H = sum(weights z^2)/2 + potential

    int size() const { return int(weights.size()); }
    /// Whether two coordinates move by forces that depend on displacements alone: all loops have a known length then.
    bool is_narrow() const { return size() == 4 && linear.is_narrow() && inputs.is_narrow(); }

    /// out = z'. series (registers, 1): receives the forces and their derivatives. least: see `ForceProgram::extend`.
    template <class T, class Z, class Out>
    void rate(const Z& z, double least, Matrix<T> series, Out&& out) const {
        const int n = size() / 2;
        for (int i = 0; i < inputs.rows(); ++i) series(i, 0) = inputs.times(i, &z[0]);
        if (!called) program.extend(series, 0, least, numbers);
        else if constexpr (std::is_same_v<T, double>) called->forces(series, 1);
        else
            for (int r = inputs.rows(); r < series.rows(); ++r) series(r, 0) = T(NOT_A_NUMBER);
        for (int r = 0; r < n; ++r) {
            out[r] = z[n + r];
            out[n + r] = acceleration(r, &z[0], series, 0);
        }
    }

    /// The coefficients `states` (ORDER + 1, N) of the state about states[0], and those of the forces (registers, ORDER + 1).
    template <class T>
    void expand(double least, Matrix<T> states, Matrix<T> series) const {
        if (is_narrow()) expand_as<true>(least, states, series);
        else expand_as<false>(least, states, series);
    }

    /// 2 H.
    template <class T, class Z>
    T twice_energy(const Z& z) const {
        T total = weights[0] * z[0] * z[0];
        for (int r = 1; r < size(); ++r) total += weights[r] * z[r] * z[r];
        Local<T> parts(inputs.rows());
        T stored(0.0);
        for (int i = 0; i < inputs.rows(); ++i) parts[i] = inputs.times(i, &z[0]);
        if (!called) potential.evaluate<T>(parts, [&](int, const T& entry) { stored = entry; });
        else if constexpr (std::is_same_v<T, double>) stored = called->energy(parts);
        else stored = T(NOT_A_NUMBER);
        return total + 2.0 * stored;
    }

private:
    template <bool NARROW, class T>
    void expand_as(double least, Matrix<T> states, Matrix<T> series) const {
        const int n = NARROW ? 2 : size() / 2, count = inputs.rows();
        for (int k = 0; k < ORDER; ++k) {
            const T* z = states[k].data();
            T* after = states[k + 1].data();
            const double part = 1.0 / (k + 1);
            for (int i = 0; i < count; ++i) series(i, k) = inputs.times<NARROW>(i, z);
            program.extend(series, k, least, numbers);
            for (int r = 0; r < n; ++r) {
                after[r] = part * z[n + r];
                after[n + r] = part * acceleration<NARROW>(r, z, series, k);
            }
        }
    }

    template <bool NARROW = false, class T>
    T acceleration(int r, const T* z, Matrix<T> series, int k) const {
        T total = linear.template times<NARROW>(r, z);
        for (const auto& entry : push[r]) total += entry.value * series(program.forces[entry.column], k);
        return total;
    }
};

using SmoothEquations = SmoothEquationsOf<double>;

/// Call body.operator()<W>(r) for parts of W entries from r on, W = 4, 2, 1: polynomials of several entries at once do not
/// wait for each other.
template <class Body>
void by_parts(int count, Body&& body) {
    int r = 0;
    for (; r + 4 <= count; r += 4) body.template operator()<4>(r);
    if (r + 2 <= count) body.template operator()<2>(r), r += 2;
    if (r < count) body.template operator()<1>(r);
}

/// out = the polynomial (ORDER + 1, N) at t.
template <class C, class T, class Out>
void evaluate_series(Matrix<const C> coefficients, const T& t, Out&& out) {
    by_parts(coefficients.columns(), [&]<int W>(int first) {
        T total[W];
        for (int e = 0; e < W; ++e) total[e] = T(coefficients(ORDER, first + e));
        for (int k = ORDER - 1; k >= 0; --k) {
            const C* row = &coefficients(k, first);
            for (int e = 0; e < W; ++e) total[e] = total[e] * t + row[e];
        }
        for (int e = 0; e < W; ++e) out[first + e] = total[e];
    });
}

/// The steps of one flight. Once computed it does not change, so any number of users share it.
struct TaylorPath {
    std::vector<double> begin;      // (N,)
    double duration = 0.0;          // that was asked for; < 0: back in time
    std::vector<double> times;      // (S + 1,) of the flight at which the steps begin, and the last one ends, by size
    std::vector<double> least;      // (S,) sizes up to which powers of inputs are left out
    std::vector<double> coefficients;  // (S, ORDER + 1, width)
    int width = 0;                  // N; or N + 3 F, where the F forces and their first two derivatives are kept with the state
    std::vector<double> end;        // (N,)
    Array<> map;                    // (N, N) derivative of the end by the begin; empty where it was not asked for
    Array<> along;                  // (N, P) derivatives of the end by the sources
    bool has_map = false;           // the columns of the map take part in the choice of steps
    bool complete = false;          // false: it could not be computed to its end
    bool exhausted = false;         // it would take more steps than it may

    int size() const { return int(begin.size()); }
    int steps() const { return int(least.size()); }
    Matrix<const double> step(int s) const {
        const size_t length = size_t(ORDER + 1) * width;
        return {coefficients.data() + s * length, ORDER + 1, width};
    }
    /// The step that contains a time, by size.
    int step_at(double t) const {
        int s = 0;
        while (s < steps() - 1 && times[s + 1] <= t) ++s;
        return s;
    }
    /// out = the coefficients of f = row . z in a step. Returns bounds of |f|, |f''| and |f'''| there.
    Bounds project(Values row, int s, Vector<double> out) const;
    Bounds bounds(Values row, int s) const {
        double coefficients[ORDER + 1];
        return project(row, s, coefficients);
    }
};

/// The part of a step of some length at which the last term but one of a value and of all its derivatives is small.
template <class T>
double part_of_step(Matrix<const T> states, double length) {
    constexpr int COUNT = LEAVES<T>;
    double first[COUNT] = {}, last[COUNT] = {}, parts[COUNT], power = 1.0;
    const int size = states.columns();
    const auto note = [&](int k, double factor, double* most) {
        for (int r = size / 2; r < size; ++r) {
            leaves(states(k, r), parts);
            for (int e = 0; e < COUNT; ++e) most[e] = std::max(most[e], std::fabs(parts[e]) * factor);
        }
    };
    for (int k = 0; k < 4; ++k, power *= length) note(k, power, first);
    for (int k = 4; k < ORDER - 1; ++k) power *= length;
    note(ORDER - 1, power, last);
    double part = 1.0;
    for (int e = COUNT > 1 ? 0 : 1; e < COUNT; ++e)
        if (last[e] > COLUMN_TRUNCATION * first[e]) part = std::min(part, pow(COLUMN_TRUNCATION * first[e] / last[e], 1.0 / (ORDER - 1)));
    return part;
}

/// out = the end of the flight of time t from z in any number type, by the steps of a path of its values. The numbers of the
/// equations have derivatives, too, or not. Derivatives of higher order, and those by exponents, can need shorter steps, and
/// powers that are too small for the values. Not a number where a force on the way has no such derivatives.
template <class C, class T, class Z, class Out>
void follow(const TaylorPath& path, const SmoothEquationsOf<C>& equations, const Z& z, const T& t, Out&& out) {
    const int size = equations.size();
    Array<T> states(ORDER + 1, size), series(equations.program.registers, ORDER + 1);
    std::vector<double> sides;
    bool rough = false;
    for (int r = 0; r < size; ++r) states(0, r) = z[r];
    const int steps = std::max(path.steps(), 1);  // a flight of no time has derivatives, too
    for (int s = 0; s < steps; ++s) {
        const bool last = s == steps - 1;
        const double direction = path.duration < 0.0 ? -1.0 : 1.0, at = direction * path.times[s];
        const double whole = last ? std::fabs(value(t)) - path.times[s] : path.times[s + 1] - path.times[s];
        for (double done = 0.0; done < 1.0;) {
            equations.template expand<T>(JET_DEPTH<T> > 0 || s >= path.steps() ? 0.0 : path.least[s], states, series);
            const double near = JET_DEPTH<T> > 0 ? equations.program.nearly_zero(Matrix<T>(series), NEAR_PART * whole) : 0.0;
            if (near > 0.0) equations.template expand<T>(near, states, series);
            rough = equations.program.is_rough(Matrix<T>(series), equations.numbers, JET_DEPTH<T>, sides) || rough;
            double part = std::max(part_of_step<T>(states, whole * (1.0 - done)) * (1.0 - done), LEAST_PART);
            if (JET_DEPTH<T> > 0 && equations.program.is_left_out(Matrix<T>(series))) part = std::min(part, FIRST_PART);
            const bool ends = !(done + part < 1.0);
            const T h = !ends ? T(direction * (part * whole)) : last ? T(t - at - direction * (done * whole)) : T(direction * (whole * (1.0 - done)));
            Local<T> next(size);
            evaluate_series<T>(states, h, next);
            for (int r = 0; r < size; ++r) states(0, r) = next[r];
            done = ends ? 1.0 : done + part;
        }
    }
    if constexpr (JET_DEPTH<T> > 1) {
        Array<T> now(equations.program.registers, 1);
        Local<T> rate(size);
        equations.template rate<T>(states[0], 0.0, now, rate);
        rough = equations.program.is_rough(Matrix<T>(now), equations.numbers, JET_DEPTH<T>, sides) || rough;
    }
    for (int r = 0; r < size; ++r) out[r] = rough ? T(NOT_A_NUMBER) * states(0, r) : states(0, r);
}

class TaylorWork;

/// A flight that is computed as far as it is asked for, for searches that may end early. Its path has the forces.
class GrowingFlight {
public:
    GrowingFlight(std::shared_ptr<const class TaylorFlights> flights, Values z, double duration);
    ~GrowingFlight();
    GrowingFlight(const GrowingFlight&) = delete;
    GrowingFlight& operator=(const GrowingFlight&) = delete;

    const TaylorPath& path() const { return path_; }
    /// Compute the step that contains a time. Returns its number; -1: the flight cannot be computed so far.
    int reach(double t);

private:
    std::shared_ptr<const TaylorFlights> flights_;
    std::unique_ptr<TaylorWork> work_;
    TaylorPath path_;
    bool over_ = false;  // it goes no further
};

/// Computes flights with their derivatives, and keeps the last ones. Threads can share it.
class TaylorFlights {
public:
    /// keep: how many flights are kept.
    TaylorFlights(SmoothEquations equations, int keep);
    ~TaylorFlights();

    const SmoothEquations& equations() const { return equations_; }
    /// The flight of time t from z (N,): computed, unless it is kept. What it is does not depend on what is kept.
    std::shared_ptr<const TaylorPath> fly(Values z, double t, bool with_map) const;
    /// Scratch for flights that are computed step by step, and is given back.
    std::unique_ptr<TaylorWork> borrow() const;
    void give_back(std::unique_ptr<TaylorWork> work) const;
    /// Keep so many flights at least.
    void keep(int count) const;
    /// The flight that was asked for last; nullptr: none was.
    std::shared_ptr<const TaylorPath> latest() const;

private:
    SmoothEquations equations_;
    mutable std::mutex mutex_;
    mutable std::vector<std::shared_ptr<const TaylorPath>> kept_;
    mutable std::vector<std::unique_ptr<TaylorWork>> idle_;
    mutable int keep_;
    mutable std::shared_ptr<const TaylorPath> latest_;
    mutable size_t oldest_ = 0;
};

}  // namespace saltus
