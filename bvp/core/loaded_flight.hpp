/// Exact linear flight under periodic loads, equation (38): blocks beside oscillators.
///
/// The loads are f(t) = sum_h C_h cos(k_h w t) + S_h sin(k_h w t); a constant one has k = 0. The oscillators o = (cos,
/// sin)(k_h w t) drive each block, q' = B q + G o. Off resonance the particular solution X o is taken off the block:
///     q(t) = exp(B t) (q - X o(0)) + X o(t),    X (cos, sin) = Re[(i nu - B)^-1 (C - i S) exp(i nu t)],  nu = k_h w
/// Near resonance X is large, and its two terms cancel. There the block and the oscillator fly as one block.
#pragma once

#include <algorithm>

#include "complex.hpp"
#include "dense.hpp"
#include "linear_flight.hpp"
#include "modes.hpp"

namespace saltus {

/// Size of a particular solution, beside that far from resonance, above which the load joins the block.
inline constexpr double NEAR_RESONANCE = 30.0;

/// Sizes of masses, and of all entries, that can be computed with: as in `bvp.checks`.
inline constexpr double SMALLEST_MASS = 1e-25, LARGEST_ENTRY = 1e25;

/// Angle that a pair turns by in a flight that counts as short.
inline constexpr double SHORT = 0.5;

/// The loads in the coordinates of one flight, at values of the parameters they depend on. H harmonics.
template <class T>
struct Drive {
    T base;           // w
    Array<T> modal;   // (2 H, N) G: rates by cos and by sin of each harmonic
    Array<T> steady;  // (2 H, N) X by cos and by sin; 0 where a load has joined the block
    Array<T> change;  // (N, N) S: derivatives alone of the rates B, where masses, dampers or springs vary; else empty
    Array<T> felt;    // (2 H, N) G + S X there: what the coordinates feel beside S q
    struct Join {
        int block, harmonic;
    };
    std::vector<Join> joined;
};

/// Flight of N coordinates, which are a linear map of the states.
template <int N = DYNAMIC>
class LoadedFlight {
public:
    static constexpr int SIZE = N;
    template <class T>
    using DriveOf = Drive<T>;

    /// enter, leave (N, N): the coordinates of a state, and the state of coordinates. push (N, n): their rates by unit
    /// forces.
    LoadedFlight(LinearFlight<N> free, Array<> enter, Array<> leave, Array<> push, std::vector<double> harmonics)
        : free_(std::move(free)), enter_(std::move(enter)), leave_(std::move(leave)), push_(std::move(push)),
          harmonics_(std::move(harmonics)), balance_(free_.size(), 1.0) {
        for (const Block& block : free_.blocks())
            if (block.is_pair() && block.b12 * block.b21 != 0.0) balance_[block.second] = std::sqrt(std::fabs(block.b21 / block.b12));
    }

    template <int M>
        requires(M != N)
    explicit LoadedFlight(const LoadedFlight<M>& other)
        : LoadedFlight(LinearFlight<N>(other.free_), other.enter_, other.leave_, other.push_, other.harmonics_) {}

    constexpr int size() const { return free_.size(); }
    int harmonics() const { return int(harmonics_.size()); }
    double harmonic(int h) const { return harmonics_[h]; }
    const LinearFlight<N>& free() const { return free_; }
    Matrix<const double> enter() const { return enter_; }
    Matrix<const double> leave() const { return leave_; }
    int coordinates() const { return push_.columns(); }
    static constexpr bool is_series() { return false; }

    /// Write the loads for the base frequency w and forces (2 H, n), by cos and by sin of each harmonic.
    template <class T>
    void set(const T& base, Matrix<const T> forces, Drive<T>& out) const {
        set_modal(base, forces, Matrix<const double>(push_), out);
        set_steady(out.modal, out);
    }

    /// The same where rates (N, n) by unit forces vary, and those of the coordinates by derivatives S (N, N).
    ///
    /// X fulfils (B + S) X + G = X nu: each step of this iteration adds one order of the derivatives.
    template <class T>
    void set(const T& base, Matrix<const T> forces, Matrix<const T> push, Matrix<const T> change, Drive<T>& out) const {
        set_modal(base, forces, push, out);
        set_steady(out.modal, out);
        out.change = Array<T>(size(), size());
        std::copy_n(change.data(), size() * size(), out.change.data());
        out.felt = out.modal;
        for (int order = 0; order < JET_DEPTH<T>; ++order) {
            for (int row = 0; row < 2 * harmonics(); ++row)
                for (int r = 0; r < size(); ++r) {
                    T total = out.modal(row, r);
                    for (int c = 0; c < size(); ++c) total += change(r, c) * out.steady(row, c);
                    out.felt(row, r) = total;
                }
            set_steady(out.felt, out);
        }
    }

    /// The free flights of a system without dampers with the given M, C = 0 and K (3 n n,), under the same loads.
    LoadedFlight undamped(Values entries) const {
        const int n = size() / 2;
        const Matrix<const double> mass(entries.data(), n, n), stiffness(entries.data() + 2 * n * n, n, n);
        UndampedModes modes;
        bool can_be = true;
        for (int r = 0; r < n; ++r) {
            can_be = can_be && mass(r, r) > SMALLEST_MASS;
            for (int c = 0; c < n; ++c)
                can_be = can_be && std::fabs(mass(r, c)) < LARGEST_ENTRY && std::fabs(stiffness(r, c)) < LARGEST_ENTRY;
        }
        if (!can_be || modes.find(mass, stiffness) != UndampedModes::FOUND) return unknown();
        Array<> matrix(2 * n, 2 * n), enter(2 * n, 2 * n), leave(2 * n, 2 * n), push(2 * n, n);
        std::vector<Block> blocks;
        for (int k = 0; k < n; ++k) {
            const double square = modes.squares[k];
            matrix(k, n + k) = 1.0, matrix(n + k, k) = -square;
            blocks.push_back({k, n + k, 0.0, -square, 0.0, 1.0, -square, 0.0});
            for (int r = 0; r < n; ++r) {
                leave(r, k) = leave(n + r, n + k) = modes.shapes(r, k);
                push(n + k, r) = modes.shapes(r, k);
                for (int c = 0; c < n; ++c) enter(k, r) += modes.shapes(c, k) * mass(c, r);
                enter(n + k, n + r) = enter(k, r);
            }
        }
        return LoadedFlight(LinearFlight<N>(std::move(blocks), std::move(matrix), std::vector<double>(2 * n, 1.0), false),
                            std::move(enter), std::move(leave), std::move(push), harmonics_);
    }

    /// Flights that have no end, in place of those of a system that cannot be.
    LoadedFlight unknown() const {
        LoadedFlight out(*this);
        std::fill_n(out.enter_.data(), size() * size(), NOT_A_NUMBER);
        return out;
    }

    /// out = the state a time t after the state z. begin, finish (2 H,): the oscillators then.
    template <class T, class Z, class O, class Out>
    void end(const Drive<T>& drive, const Z& z, const T& t, const O& begin, const O& finish, Out&& out) const {
        Local<T, N> q(size());
        multiply(enter_, z, q);
        add_steady(drive, -1.0, begin, q);
        if (drive.change.rows() > 0) {
            fly_changed(drive, t, begin, q);
        } else {
            free_.end(q, t, q);
            for (const auto& join : drive.joined) add_joined(drive, join, t, begin, q);
        }
        add_steady(drive, 1.0, finish, q);
        multiply(leave_, Vector<const T>(q), out);
    }

    /// out = z' at oscillators o.
    template <class T, class Z, class O, class Out>
    void rate(const Drive<T>& drive, const Z& z, const O& o, Out&& out) const {
        Local<T, N> q(size()), moved(size());
        multiply(enter_, z, q);
        modal_rate(drive, q, o, moved);
        multiply(leave_, Vector<const T>(moved), out);
    }

    /// What of the end depends on parameter j alone, and by how much the flight becomes longer with it.
    struct Slope {
        const Drive<Jet<double, 1>>* drive;
        double duration;
    };

    /// The same for doubles, with the derivatives `map` (N, N) by the state. columns (2 + P, N): by the instants of
    /// begin and end, and by the parameters of the slopes while the oscillators stay.
    ///
    /// These are closed forms: a begin that is perturbed along its path stays on it, and a parameter moves X and t alone.
    /// With them a step takes 2.9 us with one impact and one degree of freedom, 4 with two and two, and 30 with eight and
    /// five. By jets of all columns it took 4.1, 10.7 and 150.
    void end(const Drive<double>& drive, Vector<const Slope> slopes, Values z, double t, Values begin, Values finish,
             Vector<double> out, Matrix<double> map, Matrix<double> columns) const {
        Local<double, N> q(size()), moved(size()), part(size());
        LocalSquare<double, N> flow(size());
        free_.map(t, flow);
        multiply(enter_, z, q);
        // By the begin: -leave exp(B t) (B q + G o).
        modal_rate(drive, q, begin, part);
        free_.carry(flow, part, moved);
        multiply(leave_, Values(moved), columns[0]);
        for (double& entry : columns[0]) entry = -entry;
        add_steady(drive, -1.0, begin, q);
        free_.carry(flow, q, moved);
        for (int j = 0; j < int(slopes.size()); ++j)
            parameter_column(slopes[j], flow, q, moved, t, begin, finish, columns[2 + j]);
        add_steady(drive, 1.0, finish, moved);
        for (const auto& join : drive.joined) add_joined(drive, join, t, begin, moved);
        modal_rate(drive, moved, finish, part);
        multiply(leave_, Values(part), columns[1]);
        multiply(leave_, Values(moved), out);
        compose(flow, map);
    }

private:
    template <int>
    friend class LoadedFlight;
    using First = Jet<double, 1>;

    /// out = B q + G o.
    template <class T, class Q, class O, class Out>
    void modal_rate(const Drive<T>& drive, const Q& q, const O& o, Out&& out) const {
        free_.rate(q, out);
        for (int row = 0; row < 2 * harmonics(); ++row)
            for (int r = 0; r < size(); ++r) out[r] += drive.modal(row, r) * o[row];
    }

    /// q += sign X o.
    template <class T, class O, class Q>
    void add_steady(const Drive<T>& drive, double sign, const O& o, Q&& q) const {
        for (int row = 0; row < 2 * harmonics(); ++row)
            for (int r = 0; r < size(); ++r) q[r] += drive.steady(row, r) * (sign * o[row]);
    }

    /// start (N,): q - X o; moved (N,): exp(B t) start.
    template <class Flow, class Q>
    void parameter_column(const Slope& slope, Flow& flow, const Q& start, const Q& moved, double t, Values begin,
                          Values finish, Vector<double> out) const {
        Local<double, N> change(size()), part(size());
        const Drive<First>& by = *slope.drive;
        for (int r = 0; r < size(); ++r) change[r] = 0.0;
        for (int row = 0; row < 2 * harmonics(); ++row)
            for (int r = 0; r < size(); ++r) change[r] -= by.steady(row, r).slopes[0] * begin[row];
        free_.carry(flow, change, part);
        free_.rate(moved, change);
        for (int r = 0; r < size(); ++r) part[r] += change[r] * slope.duration;
        for (int row = 0; row < 2 * harmonics(); ++row)
            for (int r = 0; r < size(); ++r) part[r] += by.steady(row, r).slopes[0] * finish[row];
        if (by.change.rows() > 0) add_change(by.change, flow, start, moved, t, part);
        if (!by.joined.empty()) {
            Local<First, N> all(size());
            for (int r = 0; r < size(); ++r) all[r] = First(0.0);
            First time(t);
            time.slopes[0] = slope.duration;
            if (by.change.rows() > 0) fly_changed(by, time, begin, all);
            else
                for (const auto& join : by.joined) add_joined(by, join, time, begin, all);
            for (int r = 0; r < size(); ++r) part[r] += all[r].slopes[0];
        }
        multiply(leave_, Values(part), out);
    }

    /// out = leave flow enter; half of `leave` is often zero.
    template <class Flow>
    void compose(Flow& flow, Matrix<double> out) const {
        LocalSquare<double, N> inner(size());
        for (const Block& block : free_.blocks()) {
            const int i = block.first, j = block.second;
            for (int r = 0; r < block.size(); ++r) {
                const int row = r == 1 && j >= 0 ? j : i + r;
                for (int c = 0; c < size(); ++c) {
                    double total = 0.0;
                    for (int q = 0; q < block.size(); ++q) {
                        const int from = q == 1 && j >= 0 ? j : i + q;
                        total += flow(row, from) * enter_(from, c);
                    }
                    inner(row, c) = total;
                }
            }
        }
        for (int r = 0; r < size(); ++r) {
            double* row = &out(r, 0);
            for (int c = 0; c < size(); ++c) row[c] = 0.0;
            for (int q = 0; q < size(); ++q)
                if (const double factor = leave_(r, q); factor != 0.0)
                    for (int c = 0; c < size(); ++c) row[c] += factor * inner(q, c);
        }
    }

    /// The base frequency, and G for rates (N, n) by unit forces.
    template <class T, class P>
    void set_modal(const T& base, Matrix<const T> forces, Matrix<const P> push, Drive<T>& out) const {
        out.base = base;
        if (out.modal.rows() != 2 * harmonics() || out.modal.columns() != size())
            out.modal = out.steady = Array<T>(2 * harmonics(), size());
        for (int row = 0; row < 2 * harmonics(); ++row)
            for (int r = 0; r < size(); ++r) {
                T total(0.0);
                for (int c = 0; c < push.columns(); ++c)
                    if (!is_zero(push(r, c))) total += push(r, c) * forces(row, c);
                out.modal(row, r) = total;
            }
    }

    /// X for loads (2 H, N), and which of them join a block.
    template <class T>
    void set_steady(const Array<T>& loads, Drive<T>& out) const {
        out.joined.clear();
        for (int k = 0; k < int(free_.blocks().size()); ++k)
            for (int h = 0; h < harmonics(); ++h) set_steady(k, h, loads, out);
    }

    /// X of block k and harmonic h; or the load joins the block, where X is large, and where the block is no pair.
    template <class T>
    void set_steady(int k, int h, const Array<T>& loads, Drive<T>& out) const {
        const Block& block = free_.blocks()[k];
        const int i = block.first, j = block.second, one = 2 * h, two = 2 * h + 1;
        bool acts = false;
        for (int r = 0; r < block.size(); ++r) {
            const int row = r == 1 && j >= 0 ? j : i + r;
            acts = acts || !is_zero(loads(one, row)) || !is_zero(loads(two, row));
            out.steady(one, row) = out.steady(two, row) = T(0.0);
        }
        const T nu = harmonics_[h] * out.base;
        const double product = block.is_pair() ? block.determinant() : block.mean * block.mean;
        if (!may_part(block, product, value(nu), value(out.base))) {
            if (acts) out.joined.push_back({k, h});
            return;
        }
        // (i nu - B)^-1 = (i nu + B - 2 m)/((i nu - m)^2 - delta); the denominator does not cancel in this form.
        const Complex<T> b(loads(one, i), -loads(two, i));
        if (!block.is_pair()) {
            const T square = nu * nu + product;
            const T real = -block.mean * b.real + nu * b.imag, imaginary = -block.mean * b.imag - nu * b.real;
            put_steady(Complex<T>(real / square, imaginary / square), one, i, out);
            return;
        }
        const Complex<T> other(loads(one, j), -loads(two, j));
        const T real = product - nu * nu, imaginary = -2.0 * block.mean * nu;
        const T square = real * real + imaginary * imaginary;
        const Complex<T> inverse(real / square, -imaginary / square);
        const Complex<T> first(-block.b22 * b.real - nu * b.imag + block.b12 * other.real,
                               -block.b22 * b.imag + nu * b.real + block.b12 * other.imag);
        const Complex<T> second(block.b21 * b.real - block.b11 * other.real - nu * other.imag,
                                block.b21 * b.imag - block.b11 * other.imag + nu * other.real);
        put_steady(inverse * first, one, i, out);
        put_steady(inverse * second, one, j, out);
    }

    template <class T>
    static void put_steady(const Complex<T>& x, int row, int r, Drive<T>& out) {
        out.steady(row, r) = x.real;
        out.steady(row + 1, r) = -x.imag;
    }

    /// Whether X of a block is of moderate size. A harmonic load is far from real rates; so is a constant one, beside a
    /// fast rate.
    bool may_part(const Block& block, double product, double nu, double base) const {
        if (!block.is_pair() && !block.is_single()) return false;
        const double real = product - nu * nu, imaginary = 2.0 * block.mean * nu;
        const double delta = block.is_pair() ? block.delta : 0.0;
        const bool fast = product > 0.0 && -block.mean > NEAR_RESONANCE * base;
        if (block.is_pair() && delta > 0.0 && (nu > 0.0 || fast)) return true;
        const double size = nu * nu + block.mean * block.mean + std::fabs(delta);
        return NEAR_RESONANCE * std::sqrt(real * real + imaginary * imaginary) > size;
    }

    /// q = the end of what is left of it beside X o, where B varies: from the exponential of B + S and the oscillators
    /// that have joined a block.
    template <class T, class O, class Q>
    void fly_changed(const Drive<T>& drive, const T& t, const O& begin, Q&& q) const {
        std::vector<int> driving;
        for (const auto& join : drive.joined)
            if (std::find(driving.begin(), driving.end(), join.harmonic) == driving.end()) driving.push_back(join.harmonic);
        const int all = size() + 2 * int(driving.size());
        std::vector<double> unit(all, 1.0);
        for (int r = 0; r < size(); ++r) unit[r] = balance_[r];
        LocalSquare<T> matrix(all), flow(all);
        Local<T> state(all);
        for (int r = 0; r < all; ++r)
            for (int c = 0; c < all; ++c) matrix(r, c) = T(0.0);
        for (int r = 0; r < size(); ++r)
            for (int c = 0; c < size(); ++c)
                matrix(r, c) = (free_.matrix()(r, c) + drive.change(r, c)) * (unit[c] / unit[r]);
        for (const auto& join : drive.joined) {
            const Block& block = free_.blocks()[join.block];
            const int a = int(std::find(driving.begin(), driving.end(), join.harmonic) - driving.begin());
            for (int r = 0; r < block.size(); ++r) {
                const int row = block.is_pair() && r == 1 ? block.second : block.first + r;
                for (int part = 0; part < 2; ++part)
                    matrix(row, size() + 2 * a + part) = drive.felt(2 * join.harmonic + part, row) * (1.0 / unit[row]);
            }
        }
        for (int a = 0; a < int(driving.size()); ++a) {
            const int one = size() + 2 * a;
            const T nu = harmonics_[driving[a]] * drive.base;
            double strength = 0.0;
            for (int r = 0; r < size(); ++r)
                strength = std::max(strength, std::fabs(value(matrix(r, one))) + std::fabs(value(matrix(r, one + 1))));
            const double pace = std::max(free_.fastest(), std::fabs(value(nu)));
            if (strength > 0.0 && pace > 0.0) unit[one] = unit[one + 1] = pace / strength;
            for (int r = 0; r < size(); ++r)
                for (int part = 0; part < 2; ++part) matrix(r, one + part) = matrix(r, one + part) * unit[one];
            matrix(one, one + 1) = -nu, matrix(one + 1, one) = nu;
            for (int part = 0; part < 2; ++part) state[one + part] = begin[2 * driving[a] + part] * (1.0 / unit[one]);
        }
        for (int r = 0; r < size(); ++r) state[r] = q[r] * (1.0 / unit[r]);
        flow_large<T, T>(matrix, 0, all, t, flow);
        for (int r = 0; r < size(); ++r) {
            T total(0.0);
            for (int c = 0; c < all; ++c) total += flow(r, c) * state[c];
            q[r] = total * unit[r];
        }
    }

    /// out += the integral of exp(B (t - s)) S exp(B s) start ds over the flight, block by block:
    ///     exp(B_a t) X - X exp(B_b t) with B_a X - X B_b = S,   or, near resonance,   a part of exp([B_a S; 0 B_b] t)
    template <class Flow, class Q>
    void add_change(const Array<First>& change, const Flow& flow, const Q& start, const Q& moved, double t,
                    Vector<double> out) const {
        const Matrix<const double> b = free_.matrix();
        for (const Block& to : free_.blocks())
            for (const Block& from : free_.blocks()) {
                const int m = to.size(), k = from.size();
                const auto row = [&](int r) { return r == 1 && to.is_pair() ? to.second : to.first + r; };
                const auto column = [&](int c) { return c == 1 && from.is_pair() ? from.second : from.first + c; };
                double strength = 0.0, pace = 0.0;
                for (int r = 0; r < m; ++r)
                    for (int c = 0; c < k; ++c)
                        strength = std::max(strength, std::fabs(change(row(r), column(c)).slopes[0]) * (balance_[column(c)] / balance_[row(r)]));
                if (strength == 0.0) continue;
                if (&to == &from && to.is_pair() && (to.delta < 0.0 || to.delta * t * t < APART_LIMIT)) {
                    add_own_change(to, change, start, t, out);
                    continue;
                }
                LocalSquare<double> matrix(m + k), ends(m + k);
                for (int r = 0; r < m; ++r) {
                    for (int c = 0; c < m; ++c) matrix(r, c) = b(row(r), row(c)) * (balance_[row(c)] / balance_[row(r)]);
                    for (int c = 0; c < k; ++c) {
                        matrix(r, m + c) = change(row(r), column(c)).slopes[0] * (balance_[column(c)] / balance_[row(r)]);
                        matrix(m + c, r) = 0.0;
                    }
                }
                for (int r = 0; r < k; ++r)
                    for (int c = 0; c < k; ++c)
                        matrix(m + r, m + c) = b(column(r), column(c)) * (balance_[column(c)] / balance_[column(r)]);
                for (int r = 0; r < m + k; ++r)
                    for (int c = 0; c < m + k; ++c)
                        if ((r < m) == (c < m)) pace = std::max(pace, std::fabs(matrix(r, c)));
                Local<double> x(m * k);
                if (pace * std::fabs(t) > SHORT && solve_apart(matrix, m, x)) {
                    for (int r = 0; r < m; ++r)
                        for (int c = 0; c < k; ++c) {
                            const double entry = x[r * k + c] * balance_[row(r)] / balance_[column(c)];
                            for (int q = 0; q < m; ++q) out[row(q)] += flow(row(q), row(r)) * (entry * start[column(c)]);
                            out[row(r)] -= entry * moved[column(c)];
                        }
                    continue;
                }
                const double unit = pace > 0.0 ? strength / pace : strength;
                for (int r = 0; r < m; ++r)
                    for (int c = 0; c < k; ++c) matrix(r, m + c) /= unit;
                flow_large<double, double>(matrix, 0, m + k, t, ends);
                for (int r = 0; r < m; ++r)
                    for (int c = 0; c < k; ++c)
                        out[row(r)] += ends(r, m + c) * (unit * balance_[row(r)] / balance_[column(c)]) * start[column(c)];
            }
    }

    /// The same of a pair alone: the derivative of exp(m t) (C + S D), equation (23), by m, by delta = D^2 and by D.
    template <class Q>
    static void add_own_change(const Block& block, const Array<First>& change, const Q& start, double t, Vector<double> out) {
        const int i = block.first, j = block.second;
        const double n11 = change(i, i).slopes[0], n12 = change(i, j).slopes[0], n21 = change(j, i).slopes[0],
                     n22 = change(j, j).slopes[0];
        const double mean = 0.5 * (n11 + n22), d = 0.5 * (n11 - n22), half = 0.5 * (block.b11 - block.b22);
        const double delta = 2.0 * half * d + block.b12 * n21 + n12 * block.b21, x = block.delta * t * t;
        double c, s, by_delta;  // of S: (t C - S)/(2 delta)
        circular(block.delta, block.root, t, c, s);
        if (std::fabs(x) < 1.0) {
            // The series t^3/2 sum of x^(k - 1) 2 k/(2 k + 1)!, which does not cancel; truncation below 1e-20.
            double total = 0.0;
            for (int k = 10; k > 0; --k) total = (1.0 + x * total / (2.0 * k)) / (2.0 * k + 1.0);
            by_delta = 0.5 * t * t * t * total;
        } else {
            by_delta = (t * c - s) / (2.0 * block.delta);
        }
        const double decay = block.mean != 0.0 ? exp(block.mean * t) : 1.0;
        const double one = mean * t * c + 0.5 * t * s * delta, turn = mean * t * s + by_delta * delta;
        out[i] += decay * ((one + turn * half + s * d) * start[i] + (turn * block.b12 + s * n12) * start[j]);
        out[j] += decay * ((turn * block.b21 + s * n21) * start[i] + (one - turn * half - s * d) * start[j]);
    }

    /// Solve A x - x B = S of a matrix [A S; 0 B], A (m, m); false where x is large.
    template <class M, class X>
    static bool solve_apart(const M& matrix, int m, X& x) {
        const int k = matrix.size() - m, count = m * k;
        Dense<DYNAMIC> equations(count);
        Local<int> order(count);
        double strength = 0.0, pace = 0.0, size = 0.0;
        for (int r = 0; r < m; ++r)
            for (int c = 0; c < k; ++c) {
                const int e = r * k + c;
                for (int q = 0; q < count; ++q) equations(e, q) = 0.0;
                for (int q = 0; q < m; ++q) equations(e, q * k + c) += matrix(r, q);
                for (int q = 0; q < k; ++q) equations(e, r * k + q) -= matrix(m + q, m + c);
                x[e] = matrix(r, m + c);
                strength = std::max(strength, std::fabs(x[e]));
                for (int q = 0; q < count; ++q) pace = std::max(pace, std::fabs(equations(e, q)));
            }
        if (!(factorise(equations, order).least > 0.0)) return false;
        substitute(equations, order, x);
        for (int e = 0; e < count; ++e) size = std::max(size, std::fabs(x[e]));
        return size * pace <= NEAR_RESONANCE * strength;
    }

    /// q += what a load that has joined a block gives from rest: a part of the exponential of both. The second entry of
    /// a pair, and the oscillator, are scaled to balance the matrix.
    template <class T, class O, class Q>
    void add_joined(const Drive<T>& drive, const typename Drive<T>::Join& join, const T& t, const O& begin,
                    Q&& q) const {
        const Block& block = free_.blocks()[join.block];
        if (block.is_pair() && block.delta < 0.0 && std::sqrt(-block.delta) * std::fabs(value(t)) > SHORT)
            return add_resonant(drive, join, t, begin, q);
        const Matrix<const double> b = free_.matrix();
        const int size = block.size(), one = 2 * join.harmonic;
        const auto row_of = [&](int r) { return r == 1 && block.is_pair() ? block.second : block.first + r; };
        const T nu = harmonics_[join.harmonic] * drive.base;
        const bool turns = block.is_pair() && block.b12 * block.b21 != 0.0;
        const double balance = turns ? std::sqrt(std::fabs(block.b21 / block.b12)) : 1.0;
        const auto unit = [&](int r) { return r == 1 && block.is_pair() ? balance : 1.0; };
        double strength = 0.0, pace = std::fabs(value(nu));
        for (int r = 0; r < size; ++r) {
            const int row = row_of(r);
            const double along = std::fabs(value(drive.modal(one, row))), across = std::fabs(value(drive.modal(one + 1, row)));
            strength = std::max(strength, (along + across) / unit(r));
            for (int c = 0; c < size; ++c) pace = std::max(pace, std::fabs(b(row, row_of(c))) * unit(c) / unit(r));
        }
        strength = pace > 0.0 ? strength / pace : strength;
        if (strength == 0.0) strength = 1.0;
        LocalSquare<T> matrix(size + 2), flow(size + 2);
        for (int r = 0; r < size + 2; ++r)
            for (int c = 0; c < size + 2; ++c) matrix(r, c) = T(0.0);
        for (int r = 0; r < size; ++r) {
            const int row = row_of(r);
            for (int c = 0; c < size; ++c) matrix(r, c) = T(b(row, row_of(c)) * (unit(c) / unit(r)));
            for (int part = 0; part < 2; ++part)
                matrix(r, size + part) = drive.modal(one + part, row) / (unit(r) * strength);
        }
        matrix(size, size + 1) = -nu;
        matrix(size + 1, size) = nu;
        flow_large<T, T>(matrix, 0, size + 2, t, flow);
        for (int r = 0; r < size; ++r)
            q[row_of(r)] += (flow(r, size) * begin[one] + flow(r, size + 1) * begin[one + 1]) * (unit(r) * strength);
    }

    /// The same for a pair that oscillates with the rates m +- i w, which takes a tenth of the time. With the integrals
    ///     E = integral of exp(r (t - s)) exp(i nu s) ds = t exp(r t) phi((i nu - r) t),   phi(z) = (exp(z) - 1)/z,
    /// of both rates r it is (E+ + E-)/2 + (E+ - E-)/(2 i w) (B - m), times G.
    template <class T, class O, class Q>
    void add_resonant(const Drive<T>& drive, const typename Drive<T>::Join& join, const T& t, const O& begin,
                      Q&& q) const {
        const Block& block = free_.blocks()[join.block];
        const int one = 2 * join.harmonic, i = block.first, j = block.second;
        const double w = std::sqrt(-block.delta);
        const T nu = harmonics_[join.harmonic] * drive.base, decay = t * exp(block.mean * t), x = -block.mean * t;
        T sine, cosine;
        sincos(w * t, sine, cosine);
        const Complex<T> up = Complex<T>(decay * cosine, decay * sine) * phi(Complex<T>(x, (nu - w) * t));
        const Complex<T> down = Complex<T>(decay * cosine, -decay * sine) * phi(Complex<T>(x, (nu + w) * t));
        const Complex<T> a(0.5 * (up.real + down.real), 0.5 * (up.imag + down.imag));
        const Complex<T> c((up.imag - down.imag) / (2.0 * w), (down.real - up.real) / (2.0 * w));
        const auto load = [&](int row) {
            const T &along = drive.modal(one, row), &across = drive.modal(one + 1, row);
            return Complex<T>(along * begin[one] + across * begin[one + 1], along * begin[one + 1] - across * begin[one]);
        };
        const Complex<T> first = load(i), second = load(j);
        const auto real = [](const Complex<T>& p, const Complex<T>& r) { return p.real * r.real - p.imag * r.imag; };
        const double d11 = block.b11 - block.mean, d22 = block.b22 - block.mean;
        q[i] += real(a, first) + d11 * real(c, first) + block.b12 * real(c, second);
        q[j] += real(a, second) + block.b21 * real(c, first) + d22 * real(c, second);
    }

    /// (exp(z) - 1)/z; its Taylor series where it would cancel.
    template <class T>
    static Complex<T> phi(const Complex<T>& z) {
        constexpr int TERMS = 18;  // truncation below 1e-21
        const double size = std::fabs(value(z.real)) + std::fabs(value(z.imag));
        if (size < 1.0) {
            Complex<T> total(T(1.0), T(0.0));
            for (int k = TERMS; k > 1; --k) {
                const Complex<T> product = total * z;
                total = {1.0 + product.real / double(k), product.imag / double(k)};
            }
            return total;
        }
        T sine, cosine;
        sincos(z.imag, sine, cosine);
        const T growth = exp(z.real), square = z.real * z.real + z.imag * z.imag;
        const T real = growth * cosine - 1.0, imaginary = growth * sine;
        return {(real * z.real + imaginary * z.imag) / square, (imaginary * z.real - real * z.imag) / square};
    }

    LinearFlight<N> free_;
    Array<> enter_, leave_, push_;
    std::vector<double> harmonics_;
    std::vector<double> balance_;  // (N,) what coordinates are divided by to balance the matrix
};

}  // namespace saltus
