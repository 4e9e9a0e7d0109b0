// Complex numbers over any type of number. Products and quotients are the plain formulas, the same on every machine.
#pragma once

#include "jet.hpp"

namespace saltus {

template <class T = double>
struct Complex {
    T real, imag;

    constexpr Complex() = default;
    constexpr Complex(const T& real, const T& imag = T(0.0)) : real(real), imag(imag) {}
    constexpr Complex(double real)
        requires(!std::same_as<T, double>)
        : Complex(T(real)) {}
};

namespace detail {

/// A power of two next to |x|, or 0 where squares stay well within the range of doubles.
inline int scale_of(double x) {
    int power = 0;
    if (!(fabs(x) > 0x1p-450 && fabs(x) < 0x1p450) && fabs(x) < infinity) std::frexp(x, &power);
    return power;
}

/// z 2^power without error for a moderate z, unless it leaves the range of doubles.
template <class T>
inline Complex<T> scaled(const Complex<T>& z, int power) {
    if (power == 0) return z;
    const int most = power > 1500 ? 1500 : power < -1500 ? -1500 : power;
    const double first = power_of_two(most / 2), second = power_of_two(most - most / 2);
    return {z.real * first * second, z.imag * first * second};
}

template <class T>
inline int scale_of(const Complex<T>& z) {
    const double a = fabs(value(z.real)), b = fabs(value(z.imag));
    return scale_of(a > b ? a : b);
}

}  // namespace detail

template <class T>
inline Complex<T> operator-(const Complex<T>& a) {
    return {-a.real, -a.imag};
}
template <class T>
inline Complex<T> conj(const Complex<T>& a) {
    return {a.real, -a.imag};
}

template <class T>
inline Complex<T> operator+(const Complex<T>& a, const Complex<T>& b) {
    return {a.real + b.real, a.imag + b.imag};
}
template <class T>
inline Complex<T> operator-(const Complex<T>& a, const Complex<T>& b) {
    return {a.real - b.real, a.imag - b.imag};
}
template <class T>
inline Complex<T> operator*(const Complex<T>& a, const Complex<T>& b) {
    return {a.real * b.real - a.imag * b.imag, a.real * b.imag + a.imag * b.real};
}

/// a/b, where both are scaled so that no product overflows or vanishes.
template <class T>
inline Complex<T> operator/(const Complex<T>& a, const Complex<T>& b) {
    const int up = detail::scale_of(a), down = detail::scale_of(b);
    const Complex<T> p = detail::scaled(a, -up), q = detail::scaled(b, -down);
    const T square = q.real * q.real + q.imag * q.imag;
    const Complex<T> product = p * conj(q);
    return detail::scaled(Complex<T>(product.real / square, product.imag / square), up - down);
}

template <class T, Constant<T> S>
inline Complex<T> operator+(const Complex<T>& a, const S& b) {
    return {a.real + b, a.imag};
}
template <class T, Constant<T> S>
inline Complex<T> operator+(const S& a, const Complex<T>& b) {
    return {a + b.real, b.imag};
}
template <class T, Constant<T> S>
inline Complex<T> operator-(const Complex<T>& a, const S& b) {
    return {a.real - b, a.imag};
}
template <class T, Constant<T> S>
inline Complex<T> operator-(const S& a, const Complex<T>& b) {
    return {a - b.real, -b.imag};
}
template <class T, Constant<T> S>
inline Complex<T> operator*(const Complex<T>& a, const S& b) {
    return {a.real * b, a.imag * b};
}
template <class T, Constant<T> S>
inline Complex<T> operator*(const S& a, const Complex<T>& b) {
    return {a * b.real, a * b.imag};
}
template <class T, Constant<T> S>
inline Complex<T> operator/(const Complex<T>& a, const S& b) {
    return {a.real / b, a.imag / b};
}
template <class T, Constant<T> S>
inline Complex<T> operator/(const S& a, const Complex<T>& b) {
    return Complex<T>(T(a)) / b;
}

template <class T, class S>
inline Complex<T>& operator+=(Complex<T>& a, const S& b) {
    return a = a + b;
}
template <class T, class S>
inline Complex<T>& operator-=(Complex<T>& a, const S& b) {
    return a = a - b;
}
template <class T, class S>
inline Complex<T>& operator*=(Complex<T>& a, const S& b) {
    return a = a * b;
}
template <class T, class S>
inline Complex<T>& operator/=(Complex<T>& a, const S& b) {
    return a = a / b;
}

template <class T>
inline bool operator==(const Complex<T>& a, const Complex<T>& b) {
    return a.real == b.real && a.imag == b.imag;
}

/// |z|^2.
template <class T>
inline T norm(const Complex<T>& z) {
    return z.real * z.real + z.imag * z.imag;
}

/// |z|.
template <class T>
inline T abs(const Complex<T>& z) {
    return hypot(z.real, z.imag);
}

/// The angle of z, from -pi to pi.
template <class T>
inline T arg(const Complex<T>& z) {
    return atan2(z.imag, z.real);
}

/// The root with a real part of 0 or more.
template <class T>
inline Complex<T> sqrt(const Complex<T>& z) {
    int power = detail::scale_of(z);
    power += power & 1;
    const Complex<T> w = detail::scaled(z, -power);
    const double real = value(w.real), imag = value(w.imag);
    if (real == 0.0 && imag == 0.0) return {sqrt(w.real), w.imag};
    // The larger part first; the other one follows from their product, which is half the imaginary part of z.
    const T large = sqrt(0.5 * (abs(w) + fabs(w.real))), small = w.imag / (2.0 * large);
    if (real >= 0.0) return detail::scaled(Complex<T>(large, small), power / 2);
    const bool below = std::signbit(imag);
    return detail::scaled(Complex<T>(below ? -small : small, below ? -large : large), power / 2);
}

template <class T>
inline Complex<T> exp(const Complex<T>& z) {
    T s, c;
    sincos(z.imag, s, c);
    const T e = exp(z.real);
    return {e * c, e * s};
}

}  // namespace saltus
