// Sums and products without error, and numbers of about 32 digits: sums of two doubles. Section 22 of docs/theory.md.
#pragma once

#include <cmath>
#include <compare>

namespace saltus {

/// A number of 106 bits: the sum of two doubles, of which the second is at most half a unit in the last place of the
/// first.
///
/// Sums, products, quotients and roots are right to 2^-102. A number that is not finite becomes nan.
/// Products are exact while the factors and the result lie between 2^-960 and 2^990.
struct DoubleDouble {
    double high, low;

    constexpr DoubleDouble() = default;
    constexpr DoubleDouble(double high, double low = 0.0) : high(high), low(low) {}
    explicit constexpr operator double() const { return high; }
};

/// a + b without error, for |a| >= |b| or a = 0.
constexpr DoubleDouble quick_two_sum(double a, double b) {
    const double sum = a + b;
    return {sum, b - (sum - a)};
}

/// a + b without error (Knuth, The Art of Computer Programming, volume 2, section 4.2.2).
constexpr DoubleDouble two_sum(double a, double b) {
    const double sum = a + b, other = sum - a;
    return {sum, (a - (sum - other)) + (b - other)};
}

/// a b without error (Dekker 1971). It needs no fused multiplication, so that every processor does the same.
constexpr DoubleDouble two_product(double a, double b) {
    constexpr double split = 0x1p27 + 1.0;
    const double p = split * a, q = split * b, product = a * b;
    const double a1 = p - (p - a), a2 = a - a1, b1 = q - (q - b), b2 = b - b1;
    return {product, a2 * b2 - (((product - a1 * b1) - a2 * b1) - a1 * b2)};
}

constexpr DoubleDouble operator-(DoubleDouble a) { return {-a.high, -a.low}; }

constexpr DoubleDouble operator+(DoubleDouble a, double b) {
    const DoubleDouble s = two_sum(a.high, b);
    return quick_two_sum(s.high, s.low + a.low);
}

constexpr DoubleDouble operator+(DoubleDouble a, DoubleDouble b) {
    const DoubleDouble s = two_sum(a.high, b.high), t = two_sum(a.low, b.low);
    const DoubleDouble r = quick_two_sum(s.high, s.low + t.high);
    return quick_two_sum(r.high, r.low + t.low);
}

constexpr DoubleDouble operator*(DoubleDouble a, double b) {
    const DoubleDouble p = two_product(a.high, b);
    return quick_two_sum(p.high, p.low + a.low * b);
}

constexpr DoubleDouble operator*(DoubleDouble a, DoubleDouble b) {
    const DoubleDouble p = two_product(a.high, b.high);
    return quick_two_sum(p.high, p.low + (a.high * b.low + a.low * b.high));
}

constexpr DoubleDouble operator+(double a, DoubleDouble b) { return b + a; }
constexpr DoubleDouble operator-(DoubleDouble a, double b) { return a + -b; }
constexpr DoubleDouble operator-(double a, DoubleDouble b) { return -b + a; }
constexpr DoubleDouble operator-(DoubleDouble a, DoubleDouble b) { return a + -b; }
constexpr DoubleDouble operator*(double a, DoubleDouble b) { return b * a; }

constexpr DoubleDouble operator/(DoubleDouble a, DoubleDouble b) {
    const double first = a.high / b.high;
    const DoubleDouble p = two_product(first, b.high);
    const double rest = ((a.high - p.high) - p.low) + (a.low - first * b.low);
    return quick_two_sum(first, rest / b.high);
}

constexpr DoubleDouble operator/(DoubleDouble a, double b) { return a / DoubleDouble(b); }
constexpr DoubleDouble operator/(double a, DoubleDouble b) { return DoubleDouble(a) / b; }

constexpr DoubleDouble& operator+=(DoubleDouble& a, DoubleDouble b) { return a = a + b; }
constexpr DoubleDouble& operator-=(DoubleDouble& a, DoubleDouble b) { return a = a - b; }
constexpr DoubleDouble& operator*=(DoubleDouble& a, DoubleDouble b) { return a = a * b; }
constexpr DoubleDouble& operator/=(DoubleDouble& a, DoubleDouble b) { return a = a / b; }

constexpr bool operator==(DoubleDouble a, DoubleDouble b) { return a.high == b.high && a.low == b.low; }
constexpr auto operator<=>(DoubleDouble a, DoubleDouble b) {
    const auto order = a.high <=> b.high;
    return order == 0 ? a.low <=> b.low : order;
}

inline double value(DoubleDouble x) { return x.high; }
inline DoubleDouble fabs(DoubleDouble a) { return std::signbit(a.high) ? -a : a; }

inline DoubleDouble sqrt(DoubleDouble a) {
    const double root = std::sqrt(a.high);
    if (!(a.high > 0.0)) return root;
    const DoubleDouble rest = a - two_product(root, root);
    return quick_two_sum(root, rest.high / (2.0 * root));
}

/// a 2^power without error, unless it leaves the range of doubles.
inline DoubleDouble ldexp(DoubleDouble a, int power) { return {std::ldexp(a.high, power), std::ldexp(a.low, power)}; }

// Elementary functions, right to 2^-100 relative to their own size; pow to 2^-94, and far from 0 sines and cosines to
// 2^-100 of 1.
void sincos(DoubleDouble x, DoubleDouble& s, DoubleDouble& c);
DoubleDouble sin(DoubleDouble x);
DoubleDouble cos(DoubleDouble x);
DoubleDouble tan(DoubleDouble x);
DoubleDouble exp(DoubleDouble x);
DoubleDouble expm1(DoubleDouble x);
DoubleDouble log(DoubleDouble x);
DoubleDouble log1p(DoubleDouble x);
DoubleDouble pow(DoubleDouble x, DoubleDouble y);
void sinhcosh(DoubleDouble x, DoubleDouble& s, DoubleDouble& c);
DoubleDouble sinh(DoubleDouble x);
DoubleDouble cosh(DoubleDouble x);
DoubleDouble tanh(DoubleDouble x);
DoubleDouble asinh(DoubleDouble x);
DoubleDouble hypot(DoubleDouble x, DoubleDouble y);
DoubleDouble atan2(DoubleDouble y, DoubleDouble x);
DoubleDouble asin(DoubleDouble x);
DoubleDouble acos(DoubleDouble x);
DoubleDouble atan(DoubleDouble x);

}  // namespace saltus
