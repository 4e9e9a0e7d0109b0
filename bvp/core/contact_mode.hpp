/// What a contact mode takes from masses, dampers and springs that vary: equations (40), (42) and (43).
///
/// The coordinates q of a flight are those at the present values, and stay. In them q' = (B + S) q + G o, where S has the
/// derivatives alone of the rates. With M + m, (K, C) + s, whose m and s have derivatives alone, it is
///     S = enter_v P (M + m)^-1 (-s leave - m leave_v B)
/// P (M + m)^-1 is the inverse mass while the gaps of stops that stick do not change.
#pragma once

#include "loaded_flight.hpp"

namespace saltus {

/// Invert a symmetric positive definite matrix of any number type.
template <class T>
void invert(Array<T>& a) {
    const int n = a.rows();
    for (int k = 0; k < n; ++k) {
        const T pivot = 1.0 / a(k, k);
        a(k, k) = T(1.0);
        for (int c = 0; c < n; ++c) a(k, c) = a(k, c) * pivot;
        for (int r = 0; r < n; ++r) {
            if (r == k) continue;
            const T factor = a(r, k);
            a(r, k) = T(0.0);
            for (int c = 0; c < n; ++c) a(r, c) -= factor * a(k, c);
        }
    }
}

template <class T>
struct ContactMode {
    Array<T> inverse;      // (n, n) P M^-1
    Array<T> drive;        // (N, n) rates of coordinates by unit forces
    Array<T> change;       // (N, N) S
    Array<T> pull, reach;  // (k, N), (k, n): contact forces of unit states, with the other sign, and of unit forces

    /// entries: M, C and K (n, n) come first. gaps (k, n), units (k,): of the stops that stick, and of their forces.
    void set(Vector<const T> entries, Matrix<const double> gaps, Values units) {
        const int n = gaps.columns(), size = 2 * n, count = gaps.rows();
        const Matrix<const T> mass = part(entries, n, 0), damping = part(entries, n, 1), stiffness = part(entries, n, 2);
        inverse = Array<T>(n, n);
        std::copy_n(mass.data(), n * n, inverse.data());
        invert(inverse);
        project(gaps, units);
        pull = Array<T>(count, size);
        for (int k = 0; k < count; ++k)
            for (int c = 0; c < n; ++c)
                for (int r = 0; r < n; ++r) {
                    pull(k, c) += reach(k, r) * stiffness(r, c);
                    pull(k, n + c) += reach(k, r) * damping(r, c);
                }
    }

    /// Set what the coordinates of a flight feel, after `set`.
    template <int N>
    void set_change(const LoadedFlight<N>& flight, Vector<const T> entries) {
        const int size = flight.size(), n = size / 2;
        const Matrix<const T> mass = part(entries, n, 0), damping = part(entries, n, 1), stiffness = part(entries, n, 2);
        const auto small = [](const T& x) { return x - T(value(x)); };
        drive = Array<T>(size, n), change = Array<T>(size, size);
        for (int q = 0; q < size; ++q)
            for (int c = 0; c < n; ++c)
                for (int r = 0; r < n; ++r)
                    if (flight.enter()(q, n + r) != 0.0) drive(q, c) += flight.enter()(q, n + r) * inverse(r, c);
        // leave_v B: the accelerations of unit coordinates. Forces of dampers, which nearly cancel in slow motion, do not
        // enter.
        Array<> moved(n, size);
        for (int r = 0; r < n; ++r)
            for (int q = 0; q < size; ++q)
                for (int c = 0; c < size; ++c) moved(r, c) += flight.leave()(n + r, q) * flight.free().matrix()(q, c);
        Array<T> force(n, size);
        for (int r = 0; r < n; ++r)
            for (int c = 0; c < n; ++c) {
                const T m = small(mass(r, c)), d = small(damping(r, c)), k = small(stiffness(r, c));
                for (int q = 0; q < size; ++q)
                    force(r, q) -= m * moved(c, q) + k * flight.leave()(c, q) + d * flight.leave()(n + c, q);
            }
        for (int q = 0; q < size; ++q)
            for (int r = 0; r < n; ++r)
                for (int c = 0; c < size; ++c) change(q, c) += drive(q, r) * force(r, c);
    }

private:
    /// M, C or K among the entries.
    static Matrix<const T> part(Vector<const T> entries, int n, int which) { return {entries.data() + which * n * n, n, n}; }

    /// Take from the inverse mass what gaps that stick hold: U = M^-1 c' (c M^-1 c')^-1, P = 1 - U c.
    void project(Matrix<const double> gaps, Values units) {
        const int n = gaps.columns(), count = gaps.rows();
        reach = Array<T>(count, n);
        if (count == 0) return;
        Array<T> along(count, n), compliance(count, count);
        for (int k = 0; k < count; ++k)
            for (int r = 0; r < n; ++r) along(k, r) = dot(gaps[k], inverse[r]);
        for (int k = 0; k < count; ++k)
            for (int l = 0; l < count; ++l) compliance(k, l) = dot(gaps[k], along[l]);
        invert(compliance);
        for (int k = 0; k < count; ++k)
            for (int l = 0; l < count; ++l)
                for (int r = 0; r < n; ++r) reach(k, r) += compliance(k, l) * along(l, r);
        for (int r = 0; r < n; ++r)
            for (int c = 0; c < n; ++c)
                for (int k = 0; k < count; ++k) inverse(r, c) -= reach(k, r) * along(k, c);
        for (int k = 0; k < count; ++k)
            for (int r = 0; r < n; ++r) reach(k, r) = units[k] * reach(k, r);
    }
};

}  // namespace saltus
