// Elementary functions of numbers wider than a double, written once for DoubleDouble and QuadDouble.
//
// Sines and exponentials are Taylor series of a small part of their argument, doubled a few times. Their inverse
// functions correct the value in double precision by Newton's method.
#include "functions.hpp"
#include "quad_double.hpp"

namespace saltus {
namespace wide {
namespace {

/// What depends on the type of number: its constants, how often arguments are halved, the last terms of the series,
/// and how many corrections of a double give all digits.
template <class T>
struct Digits;

template <>
struct Digits<DoubleDouble> {
    static constexpr DoubleDouble half_pi{0x1.921fb54442d18p+0, 0x1.1a62633145c07p-54};
    static constexpr DoubleDouble half_pi_rest{0x1.b839a252049c1p-104, 0x1.14cf98e804178p-160};
    static constexpr DoubleDouble log_two_rest{0x1.ef35793c7673p-45, 0x1.f97b57a079a19p-103};
    static constexpr int halvings = 5, last = 14, angle_halvings = 3, angle_last = 19, corrections = 1;
};

template <>
struct Digits<QuadDouble> {
    static constexpr QuadDouble half_pi{0x1.921fb54442d18p+0, 0x1.1a62633145c07p-54, -0x1.f1976b7ed8fbcp-110,
                                        0x1.4cf98e804177dp-164};
    static constexpr QuadDouble half_pi_rest{0x1.b839a252049c1p-104, 0x1.14cf98e804178p-160, -0x1.59c4ec64ddaebp-215,
                                             -0x1.7de19c72fec88p-269};
    static constexpr QuadDouble log_two_rest{0x1.ef35793c7673p-45, 0x1.f97b57a079a19p-103, 0x1.9ca62d8b62834p-158,
                                             0x1.75b8baafa2be8p-212};
    static constexpr int halvings = 8, last = 20, angle_halvings = 5, angle_last = 27, corrections = 2;
};

/// 1/n! for n < 28.
template <class T>
const std::array<T, 28>& inverse_factorials() {
    static const std::array<T, 28> table = [] {
        std::array<T, 28> out;
        T factorial(1.0);
        for (int n = 0; n < 28; ++n) {
            if (n > 0) factorial = factorial * T(static_cast<double>(n));
            out[n] = T(1.0) / factorial;
        }
        return out;
    }();
    return table;
}

/// Sum of z^k/(first + step k)! over k, up to 1/last!.
template <class T>
T series(const T& z, int first, int step, int last) {
    const auto& inverse = inverse_factorials<T>();
    T sum = inverse[last];
    for (int n = last - step; n >= first; n -= step) sum = sum * z + inverse[n];
    return sum;
}

/// e^x = 2^power (1 + m) with |m| < 1/2, for |x| < 1000.
template <class T>
struct Growth {
    T m;
    int power;
};

template <class T>
Growth<T> growth(const T& x) {
    using D = Digits<T>;
    const double k = std::floor(value(x) / detail::ln2_high + 0.5);
    const T r = (x - k * detail::ln2_high - D::log_two_rest * k) * detail::power_of_two(-D::halvings);
    T m = r + r * r * series(r, 2, 1, D::last);
    for (int i = 0; i < D::halvings; ++i) m = m * 2.0 + m * m;
    return {m, static_cast<int>(k)};
}

/// x less a multiple of pi/2, and this multiple.
template <class T>
T reduced(const T& x, std::int64_t& quadrant) {
    using D = Digits<T>;
    const double k = std::floor(value(x) / value(D::half_pi) + 0.5);
    if (fabs(value(x)) <= 0x1p20) {
        constexpr double part1 = 0x1.921fb544p+0, part2 = 0x1.0b4611a6p-34, part3 = 0x1.3198a2ep-69;
        quadrant = static_cast<std::int64_t>(k);
        return x - k * part1 - k * part2 - k * part3 - D::half_pi_rest * k;
    }
    if constexpr (std::same_as<T, DoubleDouble>) {
        const detail::Reduction a = detail::reduce_to_turns(x.high), b = detail::reduce_to_turns(x.low);
        const DoubleDouble turns = a.turns + b.turns;
        const double whole = std::floor(turns.high + 0.5);
        quadrant = a.quadrant + b.quadrant + static_cast<std::int64_t>(whole);
        return (turns - whole) * D::half_pi;
    } else {
        quadrant = static_cast<std::int64_t>(k);
        return x - D::half_pi * k;
    }
}

template <class T>
void sincos(const T& x, T& s, T& c) {
    using D = Digits<T>;
    constexpr double largest = std::same_as<T, DoubleDouble> ? infinity : 0x1p50;
    if (!(fabs(value(x)) < largest)) {
        s = c = not_a_number;
        return;
    }
    std::int64_t quadrant;
    const T r = reduced(x, quadrant) * detail::power_of_two(-D::angle_halvings), z = -(r * r);
    T sine = r + r * z * series(z, 3, 2, D::angle_last), versine = -z * series(z, 2, 2, D::angle_last - 1);
    for (int i = 0; i < D::angle_halvings; ++i) {
        const T square = sine * sine;
        sine = sine * (1.0 - versine) * 2.0;
        versine = square * 2.0;
    }
    const T cosine = 1.0 - versine;
    const bool odd = quadrant & 1;
    s = odd ? cosine : sine;
    c = odd ? sine : cosine;
    if (quadrant & 2) s = -s;
    if ((quadrant + 1) & 2) c = -c;
}

template <class T>
T exp(const T& x) {
    if (!(fabs(value(x)) < 746.0)) return saltus::exp(value(x));
    const Growth<T> e = growth(x);
    return ldexp(e.m + 1.0, e.power);
}

template <class T>
T expm1(const T& x) {
    if (!(fabs(value(x)) < 746.0)) return saltus::expm1(value(x));
    const Growth<T> e = growth(x);
    return e.power == 0 ? e.m : ldexp(e.m + 1.0, e.power) - 1.0;
}

template <class T>
T log1p(const T& x) {
    const double start = saltus::log1p(value(x));
    if (!(fabs(start) < infinity)) return start;
    T near = start;
    for (int i = 0; i < Digits<T>::corrections; ++i) {
        // A step of Newton's method, with the next term of the series.
        const T e = expm1(near), rest = (x - e) / (1.0 + e);
        near = near + (rest - 0.5 * rest * rest);
    }
    return near;
}

template <class T>
T log(const T& x) {
    const double start = value(x);
    if (start > 0.7 && start < 1.5) return log1p(x - 1.0);
    if (!(start > 0.0 && start < infinity)) return saltus::log(start);
    int power;
    std::frexp(start, &power);
    const double k = power;
    return T(k * detail::ln2_high) + (Digits<T>::log_two_rest * k + log1p(ldexp(x, -power) - 1.0));
}

template <class T>
T pow(const T& x, const T& y) {
    if (value(x) > 0.0) return exp(y * log(x));
    const double start = saltus::pow(value(x), value(y));  // also for whole exponents
    if (!(value(x) < 0.0) || start != start) return start;
    const T size = pow(T(-x), y);
    return std::signbit(start) ? -size : size;
}

template <class T>
T odd(const T& y, double x) {
    return x < 0.0 ? -y : y;
}

template <class T>
void sinhcosh(const T& x, T& s, T& c) {
    const T size = fabs(x);
    if (value(size) > 100.0) {
        c = exp(T(size - 1.0)) * (0.5 * exp(T(1.0)));  // e^x may leave the range of doubles where its half does not
        s = odd(c, value(x));
        return;
    }
    const T m = expm1(size), decay = 1.0 / (1.0 + m), sine = 0.5 * m * (1.0 + decay);
    s = odd(sine, value(x));
    c = sine + decay;
}

template <class T>
T tanh(const T& x) {
    if (fabs(value(x)) > 100.0) return std::copysign(1.0, value(x));
    const T m = expm1(T(2.0 * fabs(x)));
    return odd(T(m / (m + 2.0)), value(x));
}

template <class T>
T asinh(const T& x) {
    const T a = fabs(x);
    if (!(value(a) < infinity)) return value(x);
    if (value(a) > 0x1p120) return odd(T(log(a) + detail::ln2_high + Digits<T>::log_two_rest), value(x));
    const T square = a * a;
    return odd(T(log1p(T(a + square / (1.0 + sqrt(1.0 + square))))), value(x));
}

/// The power of two above both of two numbers, or no number if they are 0 or not finite.
template <class T>
bool power_above(const T& x, const T& y, int& power) {
    const double a = fabs(value(x)), b = fabs(value(y)), large = a > b ? a : b;
    std::frexp(large, &power);
    return large > 0.0 && a < infinity && b < infinity;
}

template <class T>
T hypot(const T& x, const T& y) {
    int power;
    if (!power_above(x, y, power)) return saltus::hypot(value(x), value(y));
    const T a = ldexp(x, -power), b = ldexp(y, -power);
    return ldexp(sqrt(a * a + b * b), power);
}

template <class T>
T atan2(const T& y, const T& x) {
    const double start = saltus::atan2(value(y), value(x));
    int power;
    if (!power_above(x, y, power) || start == 0.0) return start;
    const T a = ldexp(x, -power), b = ldexp(y, -power);
    T near = start;
    for (int i = 0; i < Digits<T>::corrections; ++i) {
        // Rotate the point back; what is left is the rest of the angle.
        T s, c;
        sincos(near, s, c);
        near = near + (b * c - a * s) / (a * c + b * s);
    }
    return near;
}

template <class T>
T cathetus(const T& x) {
    return sqrt((1.0 - x) * (1.0 + x));
}

}  // namespace
}  // namespace wide

// T: the type of number. A: how it is handed over.
#define SALTUS_WIDE(T, A)                                                  \
    void sincos(A x, T& s, T& c) { wide::sincos<T>(x, s, c); }             \
    T sin(A x) {                                                           \
        T s, c;                                                            \
        sincos(x, s, c);                                                   \
        return s;                                                          \
    }                                                                      \
    T cos(A x) {                                                           \
        T s, c;                                                            \
        sincos(x, s, c);                                                   \
        return c;                                                          \
    }                                                                      \
    T tan(A x) {                                                           \
        T s, c;                                                            \
        sincos(x, s, c);                                                   \
        return s / c;                                                      \
    }                                                                      \
    T exp(A x) { return wide::exp<T>(x); }                                 \
    T expm1(A x) { return wide::expm1<T>(x); }                             \
    T log(A x) { return wide::log<T>(x); }                                 \
    T log1p(A x) { return wide::log1p<T>(x); }                             \
    T pow(A x, A y) { return wide::pow<T>(x, y); }                         \
    void sinhcosh(A x, T& s, T& c) { wide::sinhcosh<T>(x, s, c); }         \
    T sinh(A x) {                                                          \
        T s, c;                                                            \
        sinhcosh(x, s, c);                                                 \
        return s;                                                          \
    }                                                                      \
    T cosh(A x) {                                                          \
        T s, c;                                                            \
        sinhcosh(x, s, c);                                                 \
        return c;                                                          \
    }                                                                      \
    T tanh(A x) { return wide::tanh<T>(x); }                               \
    T asinh(A x) { return wide::asinh<T>(x); }                             \
    T hypot(A x, A y) { return wide::hypot<T>(x, y); }                     \
    T atan2(A y, A x) { return wide::atan2<T>(y, x); }                     \
    T atan(A x) { return wide::atan2<T>(x, 1.0); }                         \
    T asin(A x) { return wide::atan2<T>(x, wide::cathetus<T>(x)); }        \
    T acos(A x) { return wide::atan2<T>(wide::cathetus<T>(x), x); }

SALTUS_WIDE(DoubleDouble, DoubleDouble)
SALTUS_WIDE(QuadDouble, const QuadDouble&)

#undef SALTUS_WIDE

}  // namespace saltus
