/// Multipliers in order, and in pairs.
#pragma once

#include "dense.hpp"

namespace saltus {

/// Largest ratio of the moduli of eigenvalues that are taken from one formed matrix.
inline constexpr double GRADE = 30.0;

/// Eigenvalues of a map of M rows; of a conservative system they come in pairs lambda, 1/lambda.
template <int M = DYNAMIC>
struct Spectrum {
    std::vector<double> real, imaginary;  // by modulus descending, then by angle ascending from -pi
    std::vector<Complex<double>> trace;   // lambda + 1/lambda of each pair
    double pairing = INFINITE;            // largest |product - 1| of a pair
    Dense<M> matrix;                      // the map, in some orthonormal frame
    bool is_known = false;

    explicit Spectrum(int count = M) : real(count), imaginary(count), matrix(count), keys_(count) {
        trace.reserve(count);
    }

    int count() const { return int(real.size()); }
    Complex<double> value(int k) const { return {real[k], imaginary[k]}; }
    double modulus(int k) const { return hypot(real[k], imaginary[k]); }

    /// Sort, and find the pairs where there are any.
    void order(bool paired) {
        sort(real, imaginary, count());
        pairing = 0.0;
        if (paired) find_pairs();
    }

    /// Sort the first `size` of some numbers by modulus descending, then by angle ascending from -pi. Moduli are equal
    /// whose logarithms agree to 1e-9.
    void sort(std::vector<double>& x, std::vector<double>& y, int size) {
        for (int i = 0; i < size; ++i) {
            const double a = x[i], b = y[i];
            const Key key = key_of(a, b);
            int at = i;
            for (; at > 0 && key.is_before(keys_[at - 1]); --at)
                x[at] = x[at - 1], y[at] = y[at - 1], keys_[at] = keys_[at - 1];
            x[at] = a, y[at] = b, keys_[at] = key;
        }
    }

    /// The multipliers of the map applied twice.
    void square() {
        for (int k = 0; k < count(); ++k) {
            const Complex<double> twice = value(k) * value(k);
            real[k] = twice.real, imaginary[k] = twice.imag;
        }
        order(true);
    }

private:
    struct Key {
        double size, angle;
        bool is_before(const Key& other) const {
            return size > other.size || (size == other.size && angle < other.angle);
        }
    };
    /// The angle is that of a diamond instead of a circle.
    static Key key_of(double x, double y) {
        const double modulus = hypot(x, y);
        if (!(0.0 < modulus && modulus < INFINITE)) return {-INFINITE, 0.0};
        const double part = x / (std::fabs(x) + std::fabs(y));
        return {std::floor(1e9 * log(modulus) + 0.5), y < 0.0 ? part - 1.0 : 1.0 - part};
    }

    /// Each, from the first on, with the one whose product with it is nearest to 1.
    void find_pairs() {
        Local<char> taken(count());
        for (int i = 0; i < count(); ++i) taken[i] = 0;
        trace.clear();
        for (int i = 0; i < count(); ++i) {
            if (taken[i]) continue;
            double nearest = INFINITE;
            int partner = -1;
            for (int j = i + 1; j < count(); ++j) {
                if (taken[j]) continue;
                const double distance = abs(value(i) * value(j) - Complex<double>(1.0));
                if (distance < nearest) nearest = distance, partner = j;
            }
            if (partner < 0) {
                pairing = INFINITE;
                return;
            }
            taken[partner] = 1;
            trace.push_back(value(i) + value(partner));
            pairing = larger(pairing, nearest);
        }
    }

    std::vector<Key> keys_;
};

}  // namespace saltus
