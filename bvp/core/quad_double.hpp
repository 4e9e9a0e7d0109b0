// Numbers of about 62 digits: sums of four doubles. They decide what rounding hides from doubles and double-doubles.
#pragma once

#include <array>
#include <concepts>

#include "double_double.hpp"

namespace saltus {

/// A number of about 210 bits: the sum of four doubles, each at most one unit in the last place of the one before.
///
/// Sums, products and quotients are right to 2^-205 (Hida, Li and Bailey 2001). A number that is not finite becomes
/// nan. Products are right while the factors and the result lie between 2^-800 and 2^990.
struct QuadDouble {
    std::array<double, 4> part;

    constexpr QuadDouble() = default;
    constexpr QuadDouble(double number) : part{number, 0.0, 0.0, 0.0} {}
    constexpr QuadDouble(DoubleDouble number) : part{number.high, number.low, 0.0, 0.0} {}
    constexpr QuadDouble(double a, double b, double c, double d) : part{a, b, c, d} {}
    explicit constexpr operator double() const { return part[0]; }
};

inline QuadDouble operator-(const QuadDouble& a) { return {-a.part[0], -a.part[1], -a.part[2], -a.part[3]}; }
QuadDouble operator+(const QuadDouble& a, const QuadDouble& b);
QuadDouble operator*(const QuadDouble& a, const QuadDouble& b);
QuadDouble operator/(const QuadDouble& a, const QuadDouble& b);
QuadDouble sqrt(const QuadDouble& a);

inline QuadDouble operator-(const QuadDouble& a, const QuadDouble& b) { return a + -b; }
inline QuadDouble& operator+=(QuadDouble& a, const QuadDouble& b) { return a = a + b; }
inline QuadDouble& operator-=(QuadDouble& a, const QuadDouble& b) { return a = a - b; }
inline QuadDouble& operator*=(QuadDouble& a, const QuadDouble& b) { return a = a * b; }
inline QuadDouble& operator/=(QuadDouble& a, const QuadDouble& b) { return a = a / b; }

inline bool operator==(const QuadDouble& a, const QuadDouble& b) { return a.part == b.part; }
inline std::partial_ordering operator<=>(const QuadDouble& a, const QuadDouble& b) {
    int i = 0;
    while (i < 3 && a.part[i] == b.part[i]) ++i;
    return a.part[i] <=> b.part[i];
}

inline double value(const QuadDouble& x) { return x.part[0]; }
inline QuadDouble fabs(const QuadDouble& a) { return std::signbit(a.part[0]) ? -a : a; }

/// a 2^power without error, unless it leaves the range of doubles.
inline QuadDouble ldexp(const QuadDouble& a, int power) {
    QuadDouble out;
    for (int i = 0; i < 4; ++i) out.part[i] = std::ldexp(a.part[i], power);
    return out;
}

// Elementary functions, right to 2^-196 relative to their own size; pow to 2^-190. Angles are below 2^50, or else nan.
void sincos(const QuadDouble& x, QuadDouble& s, QuadDouble& c);
QuadDouble sin(const QuadDouble& x);
QuadDouble cos(const QuadDouble& x);
QuadDouble tan(const QuadDouble& x);
QuadDouble exp(const QuadDouble& x);
QuadDouble expm1(const QuadDouble& x);
QuadDouble log(const QuadDouble& x);
QuadDouble log1p(const QuadDouble& x);
QuadDouble pow(const QuadDouble& x, const QuadDouble& y);
void sinhcosh(const QuadDouble& x, QuadDouble& s, QuadDouble& c);
QuadDouble sinh(const QuadDouble& x);
QuadDouble cosh(const QuadDouble& x);
QuadDouble tanh(const QuadDouble& x);
QuadDouble asinh(const QuadDouble& x);
QuadDouble hypot(const QuadDouble& x, const QuadDouble& y);
QuadDouble atan2(const QuadDouble& y, const QuadDouble& x);
QuadDouble asin(const QuadDouble& x);
QuadDouble acos(const QuadDouble& x);
QuadDouble atan(const QuadDouble& x);

}  // namespace saltus
