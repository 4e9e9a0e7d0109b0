// Elementary functions of doubles that are long or rarely called.
#include "functions.hpp"

#include <array>

namespace saltus {
namespace detail {

namespace {

/// The binary digits of 2/pi after the point.
constexpr std::array<std::uint32_t, 40> two_over_pi = {
    0xa2f9836e, 0x4e441529, 0xfc2757d1, 0xf534ddc0, 0xdb629599, 0x3c439041, 0xfe5163ab, 0xdebbc561, 0xb7246e3a,
    0x424dd2e0, 0x06492eea, 0x09d1921c, 0xfe1deb1c, 0xb129a73e, 0xe88235f5, 0x2ebb4484, 0xe99c7026, 0xb45f7e41,
    0x3991d639, 0x835339f4, 0x9c845f8b, 0xbdf9283b, 0x1ff897ff, 0xde05980f, 0xef2f118b, 0x5a0a6d1f, 0x6d367ecf,
    0x27cb09b7, 0x4f463f66, 0x9e5fea2d, 0x7527bac7, 0xebe5f17b, 0x3d0739f7, 0x8a5292ea, 0x6bfb5fb1, 0x1f8d5d08,
    0x56033046, 0xfc7b6bab, 0xf0cfbc20, 0x9af4361d};

constexpr int words = 8;

/// An integer of 256 bits, the lowest 32 first.
using Wide = std::array<std::uint32_t, words>;

/// a << count, for 0 <= count < 256.
Wide shifted(const Wide& a, int count) {
    Wide out{};
    const int whole = count / 32, part = count % 32;
    for (int i = words - 1; i >= whole; --i) {
        const std::uint64_t low = i > whole ? a[i - whole - 1] : 0, pair = std::uint64_t{a[i - whole]} << 32 | low;
        out[i] = static_cast<std::uint32_t>(pair << part >> 32);
    }
    return out;
}

/// a m modulo 2^256.
Wide product(const Wide& a, std::uint64_t m) {
    Wide out{};
    for (int shift = 0; shift < 2; ++shift) {
        const std::uint64_t factor = shift ? m >> 32 : m & 0xffffffff;
        std::uint64_t carry = 0;
        for (int i = shift; i < words; ++i) {
            carry += out[i] + factor * a[i - shift];
            out[i] = static_cast<std::uint32_t>(carry);
            carry >>= 32;
        }
    }
    return out;
}

}  // namespace

Reduction reduce_to_turns(double x) {
    if (fabs(x) < 0.5) return {DoubleDouble(0x1.45f306dc9c883p-1, -0x1.6b01ec5417056p-55) * x, 0};
    int exponent;
    const auto m = static_cast<std::uint64_t>(std::ldexp(std::frexp(fabs(x), &exponent), 53));
    exponent -= 53;
    // Bits of 2/pi before `start` only add multiples of 4.
    const int start = exponent > 2 ? exponent - 2 : 0;
    Wide window{};
    for (int i = 0; i < 6; ++i) {
        const int word = start / 32 + i;
        const std::uint64_t pair = std::uint64_t{two_over_pi[word]} << 32 | two_over_pi[word + 1];
        window[5 - i] = static_cast<std::uint32_t>(pair << start % 32 >> 32);
    }
    // The point of the product is below its bit 192 + start - exponent. It moves below bit 254.
    Wide turns = shifted(product(window, m), 62 + exponent - start);
    std::int64_t quadrant = turns[7] >> 30;
    turns = shifted(turns, 2);
    const bool negative = turns[7] >> 31;
    if (negative) {  // round to the next quarter turn
        ++quadrant;
        for (std::uint32_t& word : turns) word = ~word;
    }
    DoubleDouble sum = 0.0;
    for (int i = words - 1; i >= 0; --i) {
        const DoubleDouble s = two_sum(sum.high, std::ldexp(static_cast<double>(turns[i]), 32 * (i - words)));
        sum = {s.high, sum.low + s.low};
    }
    sum = quick_two_sum(sum.high, sum.low);
    return {(x < 0.0) == negative ? sum : -sum, x < 0.0 ? -quadrant : quadrant};
}

Angle reduce_any(double x) {
    if (!(fabs(x) < infinity)) return {x - x, x - x, 0};
    const Reduction r = reduce_to_turns(x);
    const DoubleDouble angle = r.turns * DoubleDouble(0x1.921fb54442d18p+0, 0x1.1a62633145c07p-54);
    return {angle.high, angle.low, r.quadrant};
}

namespace {

/// e^x - 1 for |x| < 50.
DoubleDouble less_one(double x) {
    const Exponential e = exponential(x);
    if (e.power == 0) {
        const DoubleDouble sum = quick_two_sum(e.head, e.middle);
        return quick_two_sum(sum.high, sum.low + e.tail);
    }
    const double unit = power_of_two(e.power);
    const DoubleDouble sum = two_sum((1.0 + e.head) * unit, -1.0);
    return quick_two_sum(sum.high, sum.low + (e.middle + e.tail) * unit);
}

/// log(x + low) for |low| <= 2^-53 x.
DoubleDouble logarithm_of_sum(double x, double low) {
    const auto [m, power] = mantissa(x);
    const auto [s, rest, tail] = logarithm(m - 1.0);
    const double k = static_cast<double>(power);
    const DoubleDouble head = quick_two_sum(k * ln2_high, 2.0 * s);
    return quick_two_sum(head.high, head.low + (2.0 * rest + tail + low / x) + k * ln2_low);
}

/// log(x) to about 2^-68, for a positive finite x.
DoubleDouble long_logarithm(double x) {
    const auto [m, power] = mantissa(x);
    const Logarithm l = logarithm(m - 1.0);
    // 2 q (1 + z (1/3 + z (1/5 + p))) with q = s + low and z = q^2. As s has 26 bits, its square is exact.
    constexpr double rest[] = {1.0 / 7, 1.0 / 9, 1.0 / 11, 1.0 / 13, 1.0 / 15, 1.0 / 17, 1.0 / 19, 1.0 / 21, 1.0 / 23};
    constexpr DoubleDouble third(0x1.5555555555555p-2, 0x1.5555555555555p-56);
    constexpr DoubleDouble fifth(0x1.999999999999ap-3, -0x1.999999999999ap-57);
    const DoubleDouble z(l.s * l.s, (2.0 * l.s + l.low) * l.low);
    const double square = z.high + z.low, p = square * polynomial(square, rest) + fifth.low;
    const DoubleDouble w = two_product(z.high, fifth.high), v = quick_two_sum(third.high, w.high);
    const double v_low = v.low + (third.low + (w.low + (z.high * p + z.low * (fifth.high + p))));
    const DoubleDouble u = two_product(z.high, v.high);
    const double u_low = u.low + (z.high * v_low + z.low * (v.high + v_low)), u1 = leading(u.high);
    const double series = l.s * u.high;
    const double series_low = ((l.s * u1 - series) + l.s * (u.high - u1)) + (l.s * u_low + l.low * (u.high + u_low));
    const double k = static_cast<double>(power);
    const DoubleDouble head = quick_two_sum(k * ln2_high, 2.0 * l.s), sum = two_sum(head.high, 2.0 * series);
    return quick_two_sum(sum.high, sum.low + (head.low + (2.0 * (l.low + series_low) + k * ln2_low)));
}

/// e^x/2 and e^-x/2 for 0 <= x < 40.
struct Halves {
    DoubleDouble growing, decaying;
};

Halves halves(double x) {
    const auto half = [](double y) {
        const Exponential e = exponential(y);
        const DoubleDouble sum = e.pair();
        const double unit = power_of_two(e.power - 1);
        return DoubleDouble(sum.high * unit, sum.low * unit);
    };
    return {half(x), half(-x)};
}

/// e^x/2 for x >= 40.
double half_exponential(double x) {
    if (!(x < 746.0)) return x * infinity;
    const Exponential e = exponential(x);
    return scaled(e.sum(), e.power - 1);
}

double difference(const Halves& h) {
    const DoubleDouble sum = quick_two_sum(h.growing.high, -h.decaying.high);
    return sum.high + (sum.low + (h.growing.low - h.decaying.low));
}

double sum(const Halves& h) {
    const DoubleDouble sum = quick_two_sum(h.growing.high, h.decaying.high);
    return sum.high + (sum.low + (h.growing.low + h.decaying.low));
}

/// sinh(x) for |x| < 1/2.
double small_sinh(double x) {
    constexpr double rest[] = {0x1.5555555555555p-3,  0x1.111111111112p-7,   0x1.a01a01a00ef0fp-13,
                               0x1.71de3a84a10c3p-19, 0x1.ae63a07779c78p-26, 0x1.6267cf434f12cp-33};
    const double z = x * x;
    return x + z * (x * polynomial(z, rest));
}

/// atan(u) for |u| <= sqrt(2) - 1.
DoubleDouble small_arc(DoubleDouble u) {
    constexpr double rest[] = {-0x1.5555555555555p-2, 0x1.9999999999953p-3, -0x1.249249248d768p-3,
                               0x1.c71c71c2fe5d9p-4, -0x1.745d165cb83aap-4, 0x1.3b1392b641b06p-4,
                               -0x1.110e858a72e28p-4, 0x1.e199da4156fd9p-5, -0x1.ac78ec6b8cb98p-5,
                               0x1.74d64aa665b0ap-5, -0x1.1b2058fb5da30p-5, 0x1.0aa87c56e3eb5p-6};
    const double z = u.high * u.high;
    return quick_two_sum(u.high, u.low * (1.0 - z + z * z) + z * (u.high * polynomial(z, rest)));
}

/// The angle of (x, y) for y >= 0 and any x, neither of them huge.
DoubleDouble angle_of(DoubleDouble y, DoubleDouble x) {
    constexpr DoubleDouble eighths[] = {{0.0, 0.0},
                                        {0x1.921fb54442d18p-1, 0x1.1a62633145c07p-55},
                                        {0x1.921fb54442d18p+0, 0x1.1a62633145c07p-54},
                                        {0x1.2d97c7f3321d2p+1, 0x1.a79394c9e8a0ap-54},
                                        {0x1.921fb54442d18p+1, 0x1.1a62633145c07p-53}};
    const DoubleDouble size = fabs(x);
    const bool steep = size < y, fold = steep ? size.high >= 0.4142 * y.high : y.high >= 0.4142 * size.high;
    const DoubleDouble a = steep ? size : y, b = steep ? y : size, arc = small_arc(fold ? (a - b) / (a + b) : a / b);
    // The angle is a number of eighths of a turn, with the arc before or after it.
    int eighth = fold;
    bool before = false;
    if (steep) {
        eighth = 2 - eighth;
        before = !before;
    }
    if (std::signbit(x.high)) {
        eighth = 4 - eighth;
        before = !before;
    }
    const DoubleDouble sum = quick_two_sum(eighths[eighth].high, before ? -arc.high : arc.high);
    return quick_two_sum(sum.high, sum.low + (eighths[eighth].low + (before ? -arc.low : arc.low)));
}

}  // namespace
}  // namespace detail

double tan(double x) {
    if (fabs(x) < 0x1p-28) return x;
    const detail::Angle angle = detail::reduce(x);
    const detail::Waves w = detail::waves(angle);
    const DoubleDouble s = quick_two_sum(w.sine.high, w.sine.low), c = quick_two_sum(w.cosine.high, w.cosine.low);
    return (angle.quadrant & 1 ? -(c / s) : s / c).high;
}

double expm1(double x) {
    if (!(fabs(x) < 50.0)) return x < 0.0 ? -1.0 : exp(x);
    return fabs(x) < 0x1p-54 ? x : detail::less_one(x).high;
}

double log1p(double x) {
    if (fabs(x) < 0x1p-54) return x;
    if (!(x > -1.0 && x < infinity)) return log(1.0 + x);
    if (fabs(x) < 0.25) {
        const detail::Logarithm l = detail::logarithm(x);
        return 2.0 * l.s + (2.0 * l.low + l.tail);
    }
    const DoubleDouble sum = two_sum(1.0, x);
    return detail::logarithm_of_sum(sum.high, sum.low).high;
}

double pow(double x, double y) {
    const double size = fabs(x);
    if (y == 0.0 || x == 1.0) return 1.0;
    if (x != x || y != y) return x + y;
    const bool whole = fabs(y) >= 0x1p53 || y == std::floor(y);
    const double sign = std::signbit(x) && fabs(y) < 0x1p53 && whole && std::fmod(y, 2.0) != 0.0 ? -1.0 : 1.0;
    if (size == 0.0 || size == infinity) return sign * ((size == 0.0) == (y > 0.0) ? 0.0 : infinity);
    if (x < 0.0 && !whole) return not_a_number;
    if (size == 1.0) return sign;
    if (fabs(y) > 0x1p65) return (size > 1.0) == (y > 0.0) ? infinity : 0.0;
    if (fabs(y) < 0x1p-70) return 1.0;
    const DoubleDouble exponent = detail::long_logarithm(size) * y;
    if (!(fabs(exponent.high) < 746.0)) return sign * (exponent.high > 0.0 ? infinity : 0.0);
    const detail::Exponential e = detail::exponential(exponent.high, exponent.low);
    return sign * detail::scaled(e.sum(), e.power);
}

void sinhcosh(double x, double& s, double& c) {
    const double size = fabs(x);
    if (size < 40.0) {
        const detail::Halves h = detail::halves(size);
        s = size < 0.5 ? detail::small_sinh(x) : std::copysign(detail::difference(h), x);
        c = detail::sum(h);
    } else {
        c = detail::half_exponential(size);
        s = std::copysign(c, x);
    }
}

double sinh(double x) {
    if (fabs(x) < 0.5) return detail::small_sinh(x);
    double s, c;
    sinhcosh(x, s, c);
    return s;
}

double cosh(double x) {
    double s, c;
    sinhcosh(x, s, c);
    return c;
}

double tanh(double x) {
    if (fabs(x) < 0x1p-28 || x != x) return x;
    if (fabs(x) > 22.0) return std::copysign(1.0, x);
    const DoubleDouble e = detail::less_one(2.0 * fabs(x));
    return std::copysign((e / (e + 2.0)).high, x);
}

double asinh(double x) {
    const double a = fabs(x);
    if (a < 0x1p-28 || !(a < infinity)) return x;
    if (a > 0x1p60) {
        const DoubleDouble l = detail::logarithm_of_sum(a, 0.0) + DoubleDouble(detail::ln2_high, detail::ln2_low);
        return std::copysign(l.high, x);
    }
    // asinh(a) = log(1 + a + a^2/(1 + sqrt(1 + a^2)))
    const DoubleDouble square = two_product(a, a), rest = square / (sqrt(square + 1.0) + 1.0) + a, sum = rest + 1.0;
    return std::copysign(detail::logarithm_of_sum(sum.high, sum.low).high, x);
}

double atan2(double y, double x) {
    if (x != x || y != y) return x + y;
    double a = fabs(y), b = fabs(x);
    if (a == infinity || b == infinity) {
        a = a == infinity;
        b = b == infinity;
    }
    const double large = a > b ? a : b;
    if (large == 0.0) return std::copysign(std::signbit(x) ? pi : 0.0, y);
    if (a < b * 0x1p-60) return std::copysign(std::signbit(x) ? pi : a / b, y);
    if (b < a * 0x1p-60) return std::copysign(0.5 * pi, y);
    const double unit = large > 0x1p400 ? 0x1p-500 : large < 0x1p-400 ? 0x1p500 : 1.0;
    return std::copysign(detail::angle_of(a * unit, std::copysign(b * unit, x)).high, y);
}

double asin(double x) {
    if (!(fabs(x) <= 1.0)) return not_a_number;
    if (fabs(x) < 0x1p-28) return x;
    return std::copysign(detail::angle_of(fabs(x), sqrt(two_sum(1.0, x) * two_sum(1.0, -x))).high, x);
}

double acos(double x) {
    if (!(fabs(x) <= 1.0)) return not_a_number;
    return detail::angle_of(sqrt(two_sum(1.0, x) * two_sum(1.0, -x)), x).high;
}

}  // namespace saltus
