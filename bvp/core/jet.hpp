// Values with derivatives: equations written once for any type of number give all their derivatives. Equation (53) of
// docs/theory.md.
#pragma once

#include <array>
#include <concepts>
#include <type_traits>

#include "functions.hpp"

namespace saltus {

/// A value and its first derivatives in N directions. T is double, another jet for higher derivatives, DoubleDouble
/// or Complex.
///
/// Numbers that do not depend on the directions enter as T or double, which costs no derivatives.
template <class T, int N>
struct Jet {
    T value;
    std::array<T, N> slopes;

    constexpr Jet() = default;
    constexpr Jet(const T& value) : value(value) { slopes.fill(T(0.0)); }
    constexpr Jet(double number)
        requires(!std::same_as<T, double>)
        : Jet(T(number)) {}

    /// The variable of a direction.
    static constexpr Jet variable(const T& value, int direction) {
        Jet out(value);
        out.slopes[direction] = T(1.0);
        return out;
    }
};

/// The double that a number stands for, without derivatives and further digits.
inline double value(double x) { return x; }
template <class T, int N>
inline double value(const Jet<T, N>& x) {
    return value(x.value);
}

/// How many products of small parts of a number can be other than zero.
template <class T>
inline constexpr int JET_DEPTH = 0;
template <class T, int N>
inline constexpr int JET_DEPTH<Jet<T, N>> = JET_DEPTH<T> + 1;

/// Whether a number is 0, and all its derivatives.
template <class T>
bool is_zero(const T& x) {
    if constexpr (JET_DEPTH<T> == 0) {
        return x == 0.0;
    } else {
        for (const auto& slope : x.slopes)
            if (!is_zero(slope)) return false;
        return is_zero(x.value);
    }
}

/// A number that is constant beside a jet over T.
template <class S, class T>
concept Constant = std::convertible_to<S, T>;

/// a(value) with derivatives slope a.slopes: the chain rule.
template <class T, int N>
inline Jet<T, N> chain(const T& value, const T& slope, const Jet<T, N>& a) {
    Jet<T, N> out;
    out.value = value;
    for (int i = 0; i < N; ++i) out.slopes[i] = slope * a.slopes[i];
    return out;
}

template <class T, int N>
inline Jet<T, N> operator-(const Jet<T, N>& a) {
    Jet<T, N> out;
    out.value = -a.value;
    for (int i = 0; i < N; ++i) out.slopes[i] = -a.slopes[i];
    return out;
}

template <class T, int N>
inline Jet<T, N> operator+(const Jet<T, N>& a, const Jet<T, N>& b) {
    Jet<T, N> out;
    out.value = a.value + b.value;
    for (int i = 0; i < N; ++i) out.slopes[i] = a.slopes[i] + b.slopes[i];
    return out;
}

template <class T, int N>
inline Jet<T, N> operator-(const Jet<T, N>& a, const Jet<T, N>& b) {
    Jet<T, N> out;
    out.value = a.value - b.value;
    for (int i = 0; i < N; ++i) out.slopes[i] = a.slopes[i] - b.slopes[i];
    return out;
}

template <class T, int N>
inline Jet<T, N> operator*(const Jet<T, N>& a, const Jet<T, N>& b) {
    Jet<T, N> out;
    out.value = a.value * b.value;
    for (int i = 0; i < N; ++i) out.slopes[i] = a.value * b.slopes[i] + b.value * a.slopes[i];
    return out;
}

template <class T, int N>
inline Jet<T, N> operator/(const Jet<T, N>& a, const Jet<T, N>& b) {
    Jet<T, N> out;
    const T inverse = 1.0 / b.value;
    out.value = a.value / b.value;
    for (int i = 0; i < N; ++i) out.slopes[i] = (a.slopes[i] - out.value * b.slopes[i]) * inverse;
    return out;
}

template <class T, int N, Constant<T> S>
inline Jet<T, N> operator+(const Jet<T, N>& a, const S& b) {
    Jet<T, N> out = a;
    out.value = a.value + b;
    return out;
}

template <class T, int N, Constant<T> S>
inline Jet<T, N> operator+(const S& a, const Jet<T, N>& b) {
    return b + a;
}

template <class T, int N, Constant<T> S>
inline Jet<T, N> operator-(const Jet<T, N>& a, const S& b) {
    Jet<T, N> out = a;
    out.value = a.value - b;
    return out;
}

template <class T, int N, Constant<T> S>
inline Jet<T, N> operator-(const S& a, const Jet<T, N>& b) {
    Jet<T, N> out;
    out.value = a - b.value;
    for (int i = 0; i < N; ++i) out.slopes[i] = -b.slopes[i];
    return out;
}

template <class T, int N, Constant<T> S>
inline Jet<T, N> operator*(const Jet<T, N>& a, const S& b) {
    Jet<T, N> out;
    out.value = a.value * b;
    for (int i = 0; i < N; ++i) out.slopes[i] = a.slopes[i] * b;
    return out;
}

template <class T, int N, Constant<T> S>
inline Jet<T, N> operator*(const S& a, const Jet<T, N>& b) {
    return b * a;
}

template <class T, int N, Constant<T> S>
inline Jet<T, N> operator/(const Jet<T, N>& a, const S& b) {
    Jet<T, N> out;
    out.value = a.value / b;
    for (int i = 0; i < N; ++i) out.slopes[i] = a.slopes[i] / b;
    return out;
}

template <class T, int N, Constant<T> S>
inline Jet<T, N> operator/(const S& a, const Jet<T, N>& b) {
    const T quotient = a / b.value;
    return chain(quotient, T(-quotient / b.value), b);
}

template <class T, int N, class S>
inline Jet<T, N>& operator+=(Jet<T, N>& a, const S& b) {
    return a = a + b;
}
template <class T, int N, class S>
inline Jet<T, N>& operator-=(Jet<T, N>& a, const S& b) {
    return a = a - b;
}
template <class T, int N, class S>
inline Jet<T, N>& operator*=(Jet<T, N>& a, const S& b) {
    return a = a * b;
}
template <class T, int N, class S>
inline Jet<T, N>& operator/=(Jet<T, N>& a, const S& b) {
    return a = a / b;
}

/// Jets are compared by their values.
template <class T, int N>
inline auto operator<=>(const Jet<T, N>& a, const Jet<T, N>& b) {
    return value(a) <=> value(b);
}
template <class T, int N>
inline bool operator==(const Jet<T, N>& a, const Jet<T, N>& b) {
    return value(a) == value(b);
}
template <class T, int N>
inline auto operator<=>(const Jet<T, N>& a, double b) {
    return value(a) <=> b;
}
template <class T, int N>
inline bool operator==(const Jet<T, N>& a, double b) {
    return value(a) == b;
}

template <class T, int N>
inline Jet<T, N> fabs(const Jet<T, N>& a) {
    return value(a) < 0.0 ? -a : a;
}

template <class T, int N>
inline Jet<T, N> sqrt(const Jet<T, N>& a) {
    const T root = sqrt(a.value);
    return chain(root, T(0.5 / root), a);
}

template <class T, int N>
inline void sincos(const Jet<T, N>& a, Jet<T, N>& s, Jet<T, N>& c) {
    T sine, cosine;
    sincos(a.value, sine, cosine);
    s = chain(sine, cosine, a);
    c = chain(cosine, T(-sine), a);
}

template <class T, int N>
inline Jet<T, N> sin(const Jet<T, N>& a) {
    T s, c;
    sincos(a.value, s, c);
    return chain(s, c, a);
}

template <class T, int N>
inline Jet<T, N> cos(const Jet<T, N>& a) {
    T s, c;
    sincos(a.value, s, c);
    return chain(c, T(-s), a);
}

template <class T, int N>
inline Jet<T, N> tan(const Jet<T, N>& a) {
    const T tangent = tan(a.value);
    return chain(tangent, T(1.0 + tangent * tangent), a);
}

template <class T, int N>
inline Jet<T, N> exp(const Jet<T, N>& a) {
    const T e = exp(a.value);
    return chain(e, e, a);
}

template <class T, int N>
inline Jet<T, N> expm1(const Jet<T, N>& a) {
    const T e = expm1(a.value);
    return chain(e, T(1.0 + e), a);
}

template <class T, int N>
inline Jet<T, N> log(const Jet<T, N>& a) {
    return chain(T(log(a.value)), T(1.0 / a.value), a);
}

template <class T, int N>
inline Jet<T, N> log1p(const Jet<T, N>& a) {
    return chain(T(log1p(a.value)), T(1.0 / (1.0 + a.value)), a);
}

/// a^exponent for a constant exponent.
template <class T, int N>
inline Jet<T, N> pow(const Jet<T, N>& a, double exponent) {
    if (exponent == 0.0) return T(1.0);
    const T whole = pow(a.value, exponent);
    // One power serves for all derivatives, but for those at 0.
    return chain(whole, T(exponent * (value(a) == 0.0 ? pow(a.value, exponent - 1.0) : whole / a.value)), a);
}

/// a^b for a > 0, and for a = 0 with b >= 0, where it does not change with b.
template <class T, int N>
inline Jet<T, N> pow(const Jet<T, N>& a, const Jet<T, N>& b) {
    const T whole = pow(a.value, b.value);
    T across(0.0), along(0.0);
    if (value(a) != 0.0 || value(b) < 0.0) {
        across = whole * log(a.value);
        along = b.value * (whole / a.value);
    } else if (value(b) > 0.0) {
        along = b.value * pow(a.value, T(b.value - 1.0));
    }
    Jet<T, N> out;
    out.value = whole;
    for (int i = 0; i < N; ++i) out.slopes[i] = along * a.slopes[i] + across * b.slopes[i];
    return out;
}

template <class T, int N>
inline void sinhcosh(const Jet<T, N>& a, Jet<T, N>& s, Jet<T, N>& c) {
    T sine, cosine;
    sinhcosh(a.value, sine, cosine);
    s = chain(sine, cosine, a);
    c = chain(cosine, sine, a);
}

template <class T, int N>
inline Jet<T, N> sinh(const Jet<T, N>& a) {
    T s, c;
    sinhcosh(a.value, s, c);
    return chain(s, c, a);
}

template <class T, int N>
inline Jet<T, N> cosh(const Jet<T, N>& a) {
    T s, c;
    sinhcosh(a.value, s, c);
    return chain(c, s, a);
}

template <class T, int N>
inline Jet<T, N> tanh(const Jet<T, N>& a) {
    const T t = tanh(a.value);
    return chain(t, T(1.0 - t * t), a);
}

template <class T, int N>
inline Jet<T, N> asinh(const Jet<T, N>& a) {
    return chain(T(asinh(a.value)), T(1.0 / sqrt(1.0 + a.value * a.value)), a);
}

template <class T, int N>
inline Jet<T, N> asin(const Jet<T, N>& a) {
    return chain(T(asin(a.value)), T(1.0 / sqrt((1.0 - a.value) * (1.0 + a.value))), a);
}

template <class T, int N>
inline Jet<T, N> acos(const Jet<T, N>& a) {
    return chain(T(acos(a.value)), T(-1.0 / sqrt((1.0 - a.value) * (1.0 + a.value))), a);
}

template <class T, int N>
inline Jet<T, N> atan(const Jet<T, N>& a) {
    return chain(T(atan(a.value)), T(1.0 / (1.0 + a.value * a.value)), a);
}

template <class T, int N>
inline Jet<T, N> atan2(const Jet<T, N>& y, const Jet<T, N>& x) {
    const T inverse = 1.0 / (x.value * x.value + y.value * y.value), p = x.value * inverse, q = y.value * inverse;
    Jet<T, N> out;
    out.value = atan2(y.value, x.value);
    for (int i = 0; i < N; ++i) out.slopes[i] = p * y.slopes[i] - q * x.slopes[i];
    return out;
}

template <class T, int N>
inline Jet<T, N> hypot(const Jet<T, N>& x, const Jet<T, N>& y) {
    const T length = hypot(x.value, y.value), p = x.value / length, q = y.value / length;
    Jet<T, N> out;
    out.value = length;
    for (int i = 0; i < N; ++i) out.slopes[i] = p * x.slopes[i] + q * y.slopes[i];
    return out;
}

}  // namespace saltus
