// Elementary functions of doubles. Their errors are below one unit in the last place, and every machine computes the
// same bits.
//
// Each function reduces its argument to a short interval in two doubles. The result is a large part, exact or nearly,
// and a small correction, so that only the last sum rounds noticeably: equation (52) of docs/theory.md.
// `tests/core/coefficients.py` computes the numbers below.
#pragma once

#include <bit>
#include <cmath>
#include <cstdint>
#include <limits>

#include "double_double.hpp"

namespace saltus {

using std::fabs;
using std::sqrt;

inline constexpr double infinity = std::numeric_limits<double>::infinity();
inline constexpr double not_a_number = std::numeric_limits<double>::quiet_NaN();
inline constexpr double pi = 0x1.921fb54442d18p+1;

namespace detail {

inline constexpr double to_integer = 0x1.8p52;  // x + to_integer - to_integer is the integer next to x
inline constexpr double to_short = 0x1.8p27;    // the same for multiples of 2^-25

inline std::int64_t bits(double x) { return std::bit_cast<std::int64_t>(x); }
inline double from_bits(std::int64_t b) { return std::bit_cast<double>(b); }

/// The leading 26 bits of x.
inline double leading(double x) { return from_bits(bits(x) & ~std::int64_t{0x7ffffff}); }

/// 2^power for -1022 <= power <= 1023.
inline double power_of_two(std::int64_t power) { return from_bits((power + 1023) << 52); }

/// x 2^power, rounded once, for -2000 <= power <= 2000 and a moderate x.
inline double scaled(double x, std::int64_t power) {
    const std::int64_t half = power >> 1;
    return x * power_of_two(half) * power_of_two(power - half);
}

/// c[0] + c[1] z + ..., in two interleaved sums of even and odd powers.
template <int N>
inline double polynomial(double z, const double (&c)[N]) {
    const double square = z * z;
    double first = c[N - 1], second = c[N - 2];
    for (int k = N - 3; k >= 0; k -= 2) {
        first = first * square + c[k];
        if (k > 0) second = second * square + c[k - 1];
    }
    return N % 2 ? first + z * second : second + z * first;
}

/// An angle less a multiple of pi/2, as a sum of two doubles of size pi/4 at most, and this multiple modulo 4.
struct Angle {
    double high, low;
    std::int64_t quadrant;
};

/// An angle in quarter turns: |turns| <= 1/2, and whole quarter turns.
struct Reduction {
    DoubleDouble turns;
    std::int64_t quadrant;
};

/// An angle of any size in quarter turns, less a multiple of 4.
Reduction reduce_to_turns(double x);

/// Reduce any angle with the digits of 2/pi that count (Payne and Hanek 1983).
Angle reduce_any(double x);

/// Reduce an angle with pi/2 in three parts, the first two of 33 bits (Cody and Waite 1980).
inline Angle reduce(double x) {
    constexpr double part1 = 0x1.921fb544p+0, part2 = 0x1.0b4611a6p-34, part3 = 0x1.3198a2e037073p-69;
    constexpr double inverse = 0x1.45f306dc9c883p-1;
    if (fabs(x) <= 0x1p20) {
        const double shifted = x * inverse + to_integer, k = shifted - to_integer;
        const double first = x - k * part1, second = k * part2, rest = first - second;
        if (fabs(rest) >= 0x1p-12 || k == 0.0) {
            const double third = k * part3 - ((first - rest) - second), high = rest - third;
            return {high, (rest - high) - third, bits(shifted)};
        }
    }
    return reduce_any(x);
}

/// sin and cos of a reduced angle, each as a large part and a correction.
struct Waves {
    DoubleDouble sine, cosine;
};

inline Waves waves(const Angle& angle) {
    constexpr double sine[] = {0x1.1111111111111p-7,   -0x1.a01a01a019ecep-13, 0x1.71de3a550abe6p-19,
                               -0x1.ae64552f0b66fp-26, 0x1.612255ef727cep-33,  -0x1.ab902d44edd21p-41};
    constexpr double cosine[] = {0x1.5555555555555p-5,  -0x1.6c16c16c16955p-10, 0x1.a01a019f4a826p-16,
                                 -0x1.27e4fa1272706p-22, 0x1.1eeb634b132cdp-29,  -0x1.907999e6897e2p-37};
    constexpr double sixth = -0x1.5555555555555p-3, after_sixth = -0x1.5555555555555p-57;
    const double x = angle.high, y = angle.low, z = x * x, square = z * z;
    // x^2 = g^2 + rest, where g has so few bits that g^2 and 1 - g^2/2 are exact.
    const double g = (x + to_short) - to_short, rest = (x - g) * (x + g), exact = g * g;
    const double tail = square * polynomial(z, sine) + z * after_sixth;
    return {{x, (x * exact) * sixth + (x * (rest * sixth + tail) + y * (1.0 - 0.5 * z))},
            {1.0 - 0.5 * exact, square * polynomial(z, cosine) - (0.5 * rest + x * y)}};
}

/// e^x = 2^power (1 + head + middle + tail): head exact, 1 + head too; middle at most 2^-26.
struct Exponential {
    double head, middle, tail;
    std::int64_t power;

    double sum() const { return (1.0 + head) + (middle + tail); }
    DoubleDouble pair() const { return quick_two_sum(1.0 + head, middle + tail); }
};

/// e^(x + low) for |x| < 1000.
inline Exponential exponential(double x, double low = 0.0) {
    constexpr double inverse = 0x1.71547652b82fep+0, part1 = 0x1.62e42fefa38p-1, part2 = 0x1.ef35793c7673p-45;
    constexpr double rest[] = {0x1.5555555555556p-3, 0x1.5555555555555p-5, 0x1.11111111109a2p-7,
                               0x1.6c16c16c167d8p-10, 0x1.a01a01a7d176dp-13, 0x1.a01a01a482a5bp-16,
                               0x1.71de0d7a972efp-19, 0x1.27e4e1d6ed7e8p-22, 0x1.af3924be99a57p-26,
                               0x1.1f6725cc8f974p-29};
    const double shifted = x * inverse + to_integer, k = shifted - to_integer;
    const double first = x - k * part1, second = k * part2 - low, r = first - second;
    // r = g + d, where g has so few bits that 1 + g + g^2/2 is exact.
    const double g = (r + to_short) - to_short, d = (first - g) - second;
    const double tail = d * (g + 0.5 * d) + (r * r) * (r * polynomial(r, rest));
    return {g + 0.5 * (g * g), d, tail, bits(shifted) - bits(to_integer)};
}

/// log(1 + f) = 2 (s + low) + tail with s = f/(2 + f) to 26 bits.
struct Logarithm {
    double s, low, tail;
};

/// log(1 + f) for sqrt(1/2) - 1 <= f <= sqrt(2) - 1.
inline Logarithm logarithm(double f) {
    constexpr double rest[] = {0x1.5555555555555p-1, 0x1.9999999999a3ap-2, 0x1.249249247670ap-2, 0x1.c71c7201fc0e6p-3,
                               0x1.745cf8c09a9d4p-3, 0x1.3b1c43c68eb6dp-3, 0x1.0fbd140544b63p-3, 0x1.0c135adcf3011p-3};
    const double inverse = 1.0 / (2.0 + f), quotient = f * inverse, z = quotient * quotient;
    const double s = leading(quotient), f1 = leading(f), f2 = f - f1;
    const double low = (((f - 2.0 * s) - s * f1) - s * f2) * inverse;
    return {s, low, z * (quotient * polynomial(z, rest))};
}

inline constexpr double ln2_high = 0x1.62e42fefa38p-1, ln2_low = 0x1.ef35793c7673p-45;

/// x = m 2^power with sqrt(1/2) <= m < sqrt(2), for a positive normal x.
struct Mantissa {
    double m;
    std::int64_t power;
};

inline Mantissa mantissa(double x) {
    std::int64_t less = 0;
    if (x < 0x1p-1022) {
        x *= 0x1p54;
        less = 54;
    }
    const std::int64_t power = (bits(x) - bits(0x1.6a09e667f3bcdp-1)) >> 52;
    return {from_bits(bits(x) - (power << 52)), power - less};
}

}  // namespace detail

/// sin(x) and cos(x).
inline void sincos(double x, double& s, double& c) {
    const detail::Angle angle = detail::reduce(x);
    const detail::Waves w = detail::waves(angle);
    const double sine = angle.high == 0.0 ? angle.high : w.sine.high + w.sine.low;
    const double cosine = w.cosine.high + w.cosine.low;
    const std::int64_t q = angle.quadrant;
    const bool odd = q & 1;
    s = detail::from_bits(detail::bits(odd ? cosine : sine) ^ ((q & 2) << 62));
    c = detail::from_bits(detail::bits(odd ? sine : cosine) ^ (((q + 1) & 2) << 62));
}

inline double sin(double x) {
    double s, c;
    sincos(x, s, c);
    return s;
}

inline double cos(double x) {
    double s, c;
    sincos(x, s, c);
    return c;
}

inline double exp(double x) {
    if (!(fabs(x) < 746.0)) return x > 0.0 ? infinity : x < 0.0 ? 0.0 : x;
    const detail::Exponential e = detail::exponential(x);
    return detail::scaled(e.sum(), e.power);
}

inline double log(double x) {
    if (!(x > 0.0 && x < infinity)) return x == 0.0 ? -infinity : x > 0.0 ? x : not_a_number;
    const auto [m, power] = detail::mantissa(x);
    const auto [s, low, tail] = detail::logarithm(m - 1.0);
    const double k = static_cast<double>(power);
    const DoubleDouble head = quick_two_sum(k * detail::ln2_high, 2.0 * s);
    return head.high + (head.low + (2.0 * low + tail) + k * detail::ln2_low);
}

/// sqrt(x^2 + y^2) without overflow of the squares.
inline double hypot(double x, double y) {
    const double a = fabs(x), b = fabs(y), large = a > b ? a : b, small = a > b ? b : a;
    if (a == infinity || b == infinity) return infinity;
    if (!(small > large * 0x1p-60)) return a + b;  // also nan and zero
    double unit = 1.0;
    if (large > 0x1p480) unit = 0x1p-600;
    if (small < 0x1p-400) unit = 0x1p600;
    const double p = large * unit, q = small * unit, root = std::sqrt(p * p + q * q);
    // The square of the leading bits is exact, and root^2 - p^2 - q^2 too but for a part of 2^-77.
    const double p1 = detail::leading(p), q1 = detail::leading(q), r1 = detail::leading(root);
    const double first = (r1 * r1 - p1 * p1) - q1 * q1;
    const double rest = first + (((root - r1) * (root + r1) - (p - p1) * (p + p1)) - (q - q1) * (q + q1));
    return (root - rest / (2.0 * root)) / unit;
}

double tan(double x);
double expm1(double x);
double log1p(double x);
double pow(double x, double y);
/// sinh(x) and cosh(x).
void sinhcosh(double x, double& s, double& c);
double sinh(double x);
double cosh(double x);
double tanh(double x);
double asinh(double x);
double atan2(double y, double x);
double asin(double x);
double acos(double x);
inline double atan(double x) { return atan2(x, 1.0); }

/// x^n by repeated multiplication, for any type of number.
template <class T>
inline T power(const T& x, int n) {
    T result(1.0), base = x;
    for (unsigned left = n < 0 ? 0u - static_cast<unsigned>(n) : static_cast<unsigned>(n); left; left >>= 1) {
        if (left & 1) result = result * base;
        if (left > 1) base = base * base;
    }
    return n < 0 ? 1.0 / result : result;
}

}  // namespace saltus
