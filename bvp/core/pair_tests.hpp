/// Test functions of families from the pairs of multipliers of their orbits, equation (35).
///
/// A pair has the trace 2 + 4 nu, and of an orbit between two ends nu are the eigenvalues of b'c. So det(4 b'c + 2 -
/// target) is the product of the distances of all pairs from a target: its zeros need no pair to be followed. A
/// determinant is affine in each linearised impact, a rank-one term over the impact's speed, so it is smooth at a
/// grazing times the product of the speeds, and times its square for b'c.
#pragma once

#include "half_map.hpp"

namespace saltus {

/// Part of the half map's largest entry below which an entry is rounding: a conserved momentum makes one vanish all
/// along a family, and its noise is no event.
inline constexpr double NOISE = 2e-13;

/// Noise of the half map's entries, as a part of the largest one, times the smallest pivot: near a branch point an
/// orbit is uncertain by rounding over the pivot, in the direction of the other family.
inline constexpr double PIVOT_NOISE = 5e-14;

/// Noise of the entries of 4 b'c up to which its eigenvalues between -4 and 0 are told apart.
inline constexpr double RESOLVED = 1e-3;

/// Part of the largest coordinate up to which two states are mirror images of each other.
inline constexpr double MIRRORED = 1e-9;

/// What is known of an orbit.
struct TestedOrbit {
    double speeds;   // product of the speeds of all impacts, over sqrt(2 H) each
    double pivot;    // smallest pivot of its equations
    Values targets;  // traces whose distance is a test function
};

/// The second function of equation (35), which is real. It changes its sign where two nu meet and leave the real line.
/// The denominators keep it at most 1 where all nu are real, also where one of them grows without bound at a grazing.
/// Those of complex nu are conjugate, so their product is positive.
template <class Nu>
double discriminant(int count, Nu&& nu) {
    Complex<double> found(1.0);
    for (int i = 0; i < count; ++i)
        for (int j = 0; j < i; ++j) {
            const Complex<double> a = nu(i), b = nu(j), one(1.0);
            found = found * ((a - b) / (one + a * a)) * ((a - b) / (one + b * b));
        }
    return found.real;
}

namespace pair_detail {

/// One of the four blocks of a half map; returns its largest entry.
template <class Phi>
double block(const Phi& phi, int row, int column, LocalSquare<double>& out) {
    const int size = out.size();
    Local<double> largest(size);
    for (int r = 0; r < size; ++r) {
        const double* from = &phi(row * size + r, column * size);
        for (int c = 0; c < size; ++c) {
            out(r, c) = from[c];
            largest[c] = r > 0 ? larger(largest[c], std::fabs(from[c])) : std::fabs(from[c]);
        }
    }
    double found = 0.0;
    for (double entry : largest) found = larger(found, entry);
    return found;
}

/// The formed product b'c, and the noise of its entries and of its factors'.
struct Product {
    LocalSquare<double> entries;
    double noise, factor_noise;  // of 4 b'c, and of b and c in a unit in which both are of one size
    double unit;                 // this one
};

/// Determinant of 4 b'c + shift; NaN where it is not certain. Where rounding of the formed product can be seen, it is
/// 4^m times that of [[shift/4, -b'/unit], [unit c, 1]], in which b and c are not multiplied.
template <class Phi>
double shifted_determinant(const Phi& phi, Product& product, double shift) {
    const int m = product.entries.size();
    LocalSquare<double> small(m);
    for (int r = 0; r < m; ++r)
        for (int c = 0; c < m; ++c) small(r, c) = 4.0 * product.entries(r, c) + (r == c ? shift : 0.0);
    if (m == 1) return small(0, 0);
    if (const double found = certain_determinant(Matrix<double>(small), product.noise); found == found) return found;
    LocalSquare<double> large(2 * m);
    for (int r = 0; r < m; ++r)
        for (int c = 0; c < m; ++c) {
            large(r, c) = r == c ? 0.25 * shift : 0.0;
            large(r, m + c) = -phi(c, m + r) / product.unit;
            large(m + r, c) = phi(m + r, c) * product.unit;
            large(m + r, m + c) = r == c ? 1.0 : 0.0;
        }
    return std::ldexp(certain_determinant(Matrix<double>(large), product.factor_noise), 2 * m);
}

/// The discriminant of b'c: from the formed product, or where its rounding can be seen from its two factors.
template <class Phi>
double discriminant_of(const Phi& phi, Product& product) {
    const int m = product.entries.size();
    if (product.noise < RESOLVED) {
        Local<double> real(m), imaginary(m);
        if (!eigenvalues(Matrix<double>(product.entries), real.data(), imaginary.data())) return NOT_A_NUMBER;
        return discriminant(m, [&](int k) { return Complex<double>(real[k], imaginary[k]); });
    }
    if (!(4.0 * product.factor_noise < RESOLVED)) return NOT_A_NUMBER;
    ProductChain<> chain(m);
    chain.begin(2);
    for (int r = 0; r < m; ++r)
        for (int c = 0; c < m; ++c) chain.factor(0)(r, c) = phi(m + r, c), chain.factor(1)(r, c) = phi(c, m + r);
    if (chain.eigenvalues(Matrix<double>(product.entries)) < 1) return NOT_A_NUMBER;
    return discriminant(m, [&](int k) { return Complex<double>(chain.real()[k], chain.imaginary()[k]); });
}

}  // namespace pair_detail

/// Test functions of an orbit between two ends from its half map phi (2 m, 2 m): determinants of b, a and d; of a
/// quarter that of 2 + 4 b'c; the discriminant of b'c (collides); the distances from the targets. rate: velocities over
/// displacements in the unit of time of the arclength. A determinant is NaN where the smallest singular value is below
/// the noise of the entries.
template <class Phi>
void half_map_tests(const Phi& phi, bool start_keeps_velocity, bool finish_keeps_velocity, double rate, int quarters,
                    bool collides, const TestedOrbit& orbit, Vector<double> out) {
    using namespace pair_detail;
    const int m = phi.rows() / 2;
    std::fill(out.begin(), out.end(), NOT_A_NUMBER);
    for (int r = 0; r < 2 * m; ++r)
        for (int c = 0; c < 2 * m; ++c)
            if (!(std::fabs(phi(r, c)) < INFINITE)) return;
    if (m == 0) return;
    // In the arclength's unit of time all are displacements. The origin keeps a velocity, any other end a displacement.
    const double of_a = start_keeps_velocity == finish_keeps_velocity ? 1.0 : start_keeps_velocity ? rate : 1.0 / rate;
    const double of_b = start_keeps_velocity != finish_keeps_velocity ? 1.0 : start_keeps_velocity ? 1.0 / rate : rate;
    LocalSquare<double> a(m), b(m), c(m), d(m);
    const double size_a = block(phi, 0, 0, a), size_b = block(phi, 0, 1, b), size_c = block(phi, 1, 0, c),
                 size_d = block(phi, 1, 1, d);
    const double largest = larger(larger(size_a * of_a, size_b * of_b), larger(size_c / of_b, size_d / of_a));
    const double pivot = std::fabs(orbit.pivot), noise = pivot > 0.0 ? NOISE + PIVOT_NOISE / pivot : INFINITE,
                 speeds = orbit.speeds;
    Product product{LocalSquare<double>(m), noise * 4.0 * m * size_b * size_c, noise * std::sqrt(size_b * size_c),
                    size_b > 0.0 && size_c > 0.0 ? std::sqrt(size_b / size_c) : 1.0};
    for (int r = 0; r < m; ++r) {
        double *__restrict row = &product.entries(r, 0), *__restrict from = &c(0, 0);
        for (int k = 0; k < m; ++k) row[k] = 0.0;
        for (int i = 0; i < m; ++i, from += m)
            for (int k = 0; k < m; ++k) row[k] += b(i, r) * from[k];
    }
    out[0] = speeds * certain_determinant(Matrix<double>(b), noise * largest / of_b);
    out[1] = speeds * certain_determinant(Matrix<double>(a), noise * largest / of_a);
    out[2] = speeds * certain_determinant(Matrix<double>(d), noise * largest * of_a);
    int at = 3;
    if (quarters == 1) out[at++] = speeds * speeds * shifted_determinant(phi, product, 2.0);
    const int place = at;
    if (collides) ++at;
    for (double target : orbit.targets) out[at++] = speeds * speeds * shifted_determinant(phi, product, 2.0 - target);
    if (collides) out[place] = discriminant_of(phi, product);  // the last one: it overwrites the product
}

/// The same for closed orbits: the products of 2 + trace over all pairs, the discriminant, and the products of trace -
/// target.
///
/// Each pair has the trace lambda + 1/lambda, a sum of two eigenvalues of the formed product, which is smooth where
/// they meet at 1 or -1. Where half a period is followed by its mirror image, its map has the traces s, and 2 + trace =
/// s^2 touches zero: s is in its place. Nothing is defined where rounding times the norm of that product can be seen
/// beside several pairs.
template <class Problem, class Ends>
void closed_orbit_tests(const Problem& problem, Values y, const Ends& ends, OrbitStability<Problem>& work,
                        const TestedOrbit& orbit, Vector<double> out) {
    std::fill(out.begin(), out.end(), NOT_A_NUMBER);
    const int m = work.floquet().count() / 2;
    if (m == 0) return;
    work.period().unfold(problem, y, ends);
    const Nodes all = work.period().nodes();
    const auto is_mirrored = [&] {
        const int half = all.count() / 2, size = problem.size();
        double largest = 0.0, apart = 0.0;
        for (int i = 0; i < half; ++i)
            for (int r = 0; r < size; ++r) {
                largest = larger(largest, std::fabs(all.after(i, r)));
                apart = larger(apart, std::fabs(all.after(i, r) + all.after(half + i, r)));
            }
        return all.count() % 2 == 0 && apart <= MIRRORED * largest;
    };
    const bool turned = is_mirrored();
    const Spectrum<OrbitStability<Problem>::M>& found =
        work.form(problem, work.period().nodes(turned ? all.count() / 2 : all.count()));
    const double pivot = std::fabs(orbit.pivot);
    if (!found.is_known) return;
    if (m > 1 && !((NOISE * pivot + PIVOT_NOISE) * work.floquet().norm() < RESOLVED * pivot)) return;
    const auto trace = [&](int k) {
        const Complex<double> s = found.trace[k];
        return turned ? s * s - Complex<double>(2.0) : s;
    };
    Complex<double> doubled(orbit.speeds);
    for (int k = 0; k < m; ++k) doubled = doubled * (turned ? found.trace[k] : found.trace[k] + Complex<double>(2.0));
    out[0] = doubled.real;
    out[1] = discriminant(m, [&](int k) { return (trace(k) - Complex<double>(2.0)) / Complex<double>(4.0); });
    int at = 2;
    for (double target : orbit.targets) {
        Complex<double> product(orbit.speeds);
        for (int k = 0; k < m; ++k) product = product * (trace(k) - Complex<double>(target));
        out[at++] = product.real;
    }
}

}  // namespace saltus
