/// A few numbers side by side, for the registers of a processor. Each is computed as it would be alone, so the width of
/// the registers does not change a bit.
#pragma once

namespace saltus {

#if defined(__GNUC__)
using Two = double __attribute__((vector_size(16)));
/// The same at any place among doubles. Unlike copied bytes, they are doubles to the compiler: it need not look anew at
/// anything else after each of them.
using TwoDoubles = double __attribute__((vector_size(16), aligned(8)));
inline Two read_two(const double* from) { return *reinterpret_cast<const TwoDoubles*>(from); }
inline void write_two(Two pair, double* to) { *reinterpret_cast<TwoDoubles*>(to) = pair; }
#else
struct Two {
    double first, second;
};
inline Two operator+(Two a, Two b) { return {a.first + b.first, a.second + b.second}; }
inline Two operator*(Two a, Two b) { return {a.first * b.first, a.second * b.second}; }
inline Two read_two(const double* from) { return {from[0], from[1]}; }
inline void write_two(Two pair, double* to) { to[0] = pair.first, to[1] = pair.second; }
#endif

/// L numbers, an even count.
template <int L>
struct Lanes {
    Two pairs[L / 2];

    static Lanes read(const double* from) {
        Lanes out;
        for (int i = 0; i < L / 2; ++i) out.pairs[i] = read_two(from + 2 * i);
        return out;
    }
    void write(double* to) const {
        for (int i = 0; i < L / 2; ++i) write_two(pairs[i], to + 2 * i);
    }
    static Lanes all(double number) {
        Lanes out;
        for (Two& pair : out.pairs) pair = Two{number, number};
        return out;
    }
    Lanes& add(double factor, const Lanes& x) {
        const Two both{factor, factor};
        for (int i = 0; i < L / 2; ++i) pairs[i] = pairs[i] + both * x.pairs[i];
        return *this;
    }
    Lanes times(double factor) const {
        const Two both{factor, factor};
        Lanes out;
        for (int i = 0; i < L / 2; ++i) out.pairs[i] = both * pairs[i];
        return out;
    }
};

}  // namespace saltus
