/// The matrix B of linear flight z' = B z in blocks, and exp(B t) of one block: equations (2) and (23).
#pragma once

#include <cmath>
#include <limits>

#include "array.hpp"
#include "functions.hpp"
#include "jet.hpp"

namespace saltus {

inline constexpr double EPSILON = std::numeric_limits<double>::epsilon();
inline constexpr double INFINITE = std::numeric_limits<double>::infinity();
inline constexpr double NOT_A_NUMBER = std::numeric_limits<double>::quiet_NaN();

/// Sixteen rounding errors.
inline constexpr double ROUNDING = 16.0 * EPSILON;

/// |delta t^2| below which the Taylor series (seven terms, truncation below 1e-19) replaces the closed form.
inline constexpr double SERIES_LIMIT = 0.03;

/// delta t^2 above which the two rates of an overdamped pair are taken apart.
inline constexpr double APART_LIMIT = 1.0;

/// A block of B: one index, a pair of indices, or a range of three and more.
struct Block {
    int first;       // index i
    int second;      // index j of a pair; -1: a single index; -s: the s >= 3 indices from i on
    double mean;     // half the trace of a pair; the rate of a single index
    double delta;    // of a pair B = mean + D with D^2 = delta, in 1/time^2
    double b11 = 0.0, b12 = 0.0, b21 = 0.0, b22 = 0.0;  // entries of a pair
    double root = std::sqrt(std::fabs(delta));

    bool is_pair() const { return second >= 0; }
    bool is_single() const { return second == -1; }
    int size() const { return second >= 0 ? 2 : -second; }
    double determinant() const { return b11 * b22 - b12 * b21; }
    bool is_steady() const { return is_pair() && mean == 0.0 && delta <= 0.0; }  // neither damps nor grows
};

/// The four entries of the exponential of a pair.
template <class T>
struct Square2 {
    T e11, e12, e21, e22;
};

/// The rates mean +- sqrt(delta) of a pair; the slow one is the determinant over the fast one, so that nothing cancels.
struct RealRates {
    double fast, slow;
    RealRates(double mean, double delta, double determinant)
        : fast(mean + (mean > 0.0 ? std::sqrt(delta) : -std::sqrt(delta))), slow(determinant / fast) {}
    explicit RealRates(const Block& block) : RealRates(block.mean, block.delta, block.determinant()) {}
};

/// C = cosh(sqrt(delta) t) and S = sinh(sqrt(delta) t)/sqrt(delta) of equation (23), continued through delta <= 0. root: sqrt(|delta|).
template <class T>
inline void circular(double delta, double root, const T& t, T& c, T& s) {
    const T x = delta * t * t;
    if (std::fabs(value(x)) < SERIES_LIMIT) {
        c = 1.0 + x / 2.0 * (1.0 + x / 12.0 * (1.0 + x / 30.0 * (1.0 + x / 56.0 * (1.0 + x / 90.0 * (1.0 + x / 132.0)))));
        s = t * (1.0 + x / 6.0 * (1.0 + x / 20.0 * (1.0 + x / 42.0 * (1.0 + x / 72.0 * (1.0 + x / 110.0 * (1.0 + x / 156.0))))));
    } else if (delta < 0.0) {
        sincos(root * t, s, c);
        s = s / root;
    } else {
        c = cosh(root * t);
        s = sinh(root * t) / root;
    }
}

template <class T>
inline void circular(double delta, const T& t, T& c, T& s) {
    circular(delta, std::sqrt(std::fabs(delta)), t, c, s);
}

/// exp(mean t) C and exp(mean t) S of a pair whose rates have the given product; equation (23) with two real rates taken apart.
template <class T>
inline void damped(double mean, double delta, double determinant, const T& t, T& c, T& s) {
    if (mean != 0.0 && delta * value(t) * value(t) > APART_LIMIT) {
        const RealRates rates(mean, delta, determinant);
        const T far = exp(rates.fast * t), near = exp(rates.slow * t);
        c = 0.5 * (far + near);
        s = (far - near) / (rates.fast - rates.slow);
        return;
    }
    circular(delta, t, c, s);
    if (mean == 0.0) return;
    const T decay = exp(mean * t);
    c = c * decay;
    s = s * decay;
}

/// exp(B t) of a pair, equation (23).
///
/// If it oscillates, b21 is replaced by the value that belongs to the rounded frequency. Rounding errors of the determinant, and
/// so of the energy, then have either sign and do not accumulate over many flights.
template <class T>
inline Square2<T> flow_pair(const Block& b, const T& t) {
    T c, s;
    if (b.delta < 0.0) {
        const double w = b.root, half = 0.5 * (b.b11 - b.b22);
        circular(-1.0, 1.0, w * t, c, s);
        s = s / w;
        if (b.mean != 0.0) {
            const T decay = exp(b.mean * t);
            c = c * decay;
            s = s * decay;
        }
        return {c + half * s, b.b12 * s, -(w * (w * s) + half * (half * s)) / b.b12, c - half * s};
    }
    if (b.mean != 0.0 && b.delta * value(t) * value(t) > APART_LIMIT) {
        // What is left of the slow motion has its own rounding, however small it is beside the fast one.
        const RealRates rates(b);
        const T far = exp(rates.fast * t) / (rates.fast - rates.slow), near = exp(rates.slow * t) / (rates.fast - rates.slow);
        return {far * (b.b11 - rates.slow) + near * (b.b22 - rates.slow), (far - near) * b.b12, (far - near) * b.b21,
                far * (b.b22 - rates.slow) + near * (b.b11 - rates.slow)};
    }
    damped(b.mean, b.delta, b.determinant(), t, c, s);
    return {c + s * (b.b11 - b.mean), s * b.b12, s * b.b21, c + s * (b.b22 - b.mean)};
}

/// exp(B t) into out (s, s) for the s rows and columns of a matrix from `start` on: Taylor's series, scaled and squared.
/// Entries are doubles or of the type of t.
template <class M, class T>
void flow_large(Matrix<const M> matrix, int start, int size, const T& t, Matrix<T> out);

/// Bounds of a functional and of its second and third derivative over a flight.
struct Bounds {
    double level = 0.0, second = 0.0, third = 0.0;
    void add(double a, double b, double c) { level += a, second += b, third += c; }
};

/// Add the bounds of row . exp(B t) z for one block over 0 <= t <= horizon, equation (24).
void add_bounds(Matrix<const double> matrix, const Block& block, Values row, Values z, double horizon, Bounds& bounds);

/// A bound of the growth rate of a block: |exp(B t)| <= exp(this t), times a constant for a pair.
double growth_of(Matrix<const double> matrix, const Block& block);

/// A rate that bounds how fast the terms of the series of exp(B t) can grow.
double fastest_of(Matrix<const double> matrix, const Block& block);

template <class M, class T>
void flow_large(Matrix<const M> matrix, int start, int size, const T& t, Matrix<T> out) {
    constexpr int TERMS = 18;  // truncation below 1e-22 at a norm of 1/2
    double norm = 0.0;
    for (int r = 0; r < size; ++r) {
        double row = 0.0;
        for (int c = 0; c < size; ++c) row += std::fabs(value(matrix(start + r, start + c)));
        norm = std::fmax(norm, row);
    }
    norm *= std::fabs(value(t));
    int halvings = 0;
    for (; norm > 0.5 && halvings < 1024; ++halvings) norm *= 0.5;
    const T step = t * std::ldexp(1.0, -halvings);
    LocalSquare<T> total(size), product(size);
    for (int r = 0; r < size; ++r)
        for (int c = 0; c < size; ++c) total(r, c) = T(r == c ? 1.0 : 0.0);
    // Horner's scheme for the series of exp(B step). A load's own entries stay exact, and no part of the block overflows.
    for (int k = TERMS; k > 0; --k) {
        for (int r = 0; r < size; ++r)
            for (int c = 0; c < size; ++c) {
                T entry(0.0);
                for (int q = 0; q < size; ++q) entry += matrix(start + r, start + q) * total(q, c);
                product(r, c) = entry * step / double(k) + (r == c ? 1.0 : 0.0);
            }
        std::swap_ranges(&total(0, 0), &total(0, 0) + size * size, &product(0, 0));
    }
    for (; halvings > 0; --halvings) {  // exp(2 X) = exp(X)^2
        for (int r = 0; r < size; ++r)
            for (int c = 0; c < size; ++c) {
                T entry(0.0);
                for (int q = 0; q < size; ++q) entry += total(r, q) * total(q, c);
                product(r, c) = entry;
            }
        std::swap_ranges(&total(0, 0), &total(0, 0) + size * size, &product(0, 0));
    }
    for (int r = 0; r < size; ++r)
        for (int c = 0; c < size; ++c) out(r, c) = total(r, c);
}

}  // namespace saltus
