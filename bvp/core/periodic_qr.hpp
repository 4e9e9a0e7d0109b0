/// Eigenvalues of a product of matrices and inverses of matrices, by the periodic QR iteration with implicit double
/// shifts.
///
/// The product is never formed. Rotations keep each factor triangular but the last one, which is a Hessenberg matrix,
/// and turn the coordinates between two factors. What results is exact for factors that differ by rounding from the
/// given ones, so small eigenvalues keep their digits beside large ones (Bojanczyk, Golub and Van Dooren, Proc. SPIE
/// 1770 (1992) 31; Kressner, BIT 46 (2006) 135). Shifts part eigenvalues of equal or nearly equal size.
#pragma once

#include "dense.hpp"

namespace saltus {

/// A chain of square matrices of M rows, the first one applied first; an inverse is taken of some, but not of the last
/// one.
template <int M = DYNAMIC>
class ProductChain {
public:
    explicit ProductChain(int size = M) : size_(size), corner_(size), real_(size), imaginary_(size) {}

    constexpr int size() const {
        if constexpr (M != DYNAMIC) return M;
        return size_;
    }
    /// Begin a chain of so many factors, none an inverse; `factor` has their entries to be set.
    void begin(int count) {
        if (int(factors_.size()) < count) factors_.resize(count, Dense<M>(size()));
        count_ = count;
        inverse_.assign(count, 0);
    }
    Dense<M>& factor(int k) { return factors_[k]; }
    void set_inverse(int k) { inverse_[k] = 1; }

    /// Find the eigenvalues; the factors are overwritten. product: the product in some orthonormal frame, for its size;
    /// small entries are lost. Returns the number of steps; 0 where they do not converge, -1 where an inverse does not
    /// exist.
    template <class Product>
    int eigenvalues(Product&& product);

    Values real() const { return real_; }
    Values imaginary() const { return imaginary_; }

private:
    using Factor = Dense<M>;
    Factor& last() { return factors_[count_ - 1]; }

    /// Rows i, i + 1 from column `first` to `last`.
    static void turn_rows(Factor& matrix, int i, Rotation rotation, int first, int last) {
        for (int k = first; k <= last; ++k) rotation.turn(matrix(i, k), matrix(i + 1, k));
    }
    static void turn_columns(Factor& matrix, int i, Rotation rotation, int first, int last) {
        for (int k = first; k <= last; ++k) rotation.turn(matrix(k, i), matrix(k, i + 1));
    }

    /// A rotation of the coordinates i, i + 1 before the first factor, through all triangular ones to the columns of
    /// the last one, whose rows end at `bottom`.
    void pass_on(int i, Rotation rotation, int low, int high, int bottom) {
        for (int k = 0; k < count_ - 1; ++k) {
            Factor& matrix = factors_[k];
            if (!inverse_[k]) {
                turn_columns(matrix, i, rotation, low, i + 1);
                rotation = Rotation::of(matrix(i, i), matrix(i + 1, i));
                turn_rows(matrix, i, rotation, i, high);
            } else {
                turn_rows(matrix, i, rotation, i, high);
                rotation = Rotation::of(matrix(i + 1, i + 1), -matrix(i + 1, i));
                turn_columns(matrix, i, rotation, low, i + 1);
            }
            matrix(i + 1, i) = 0.0;
        }
        turn_columns(last(), i, rotation, low, bottom);
    }

    /// Make factor k triangular by rotations of the coordinates behind it, which turn the next factor too.
    void make_triangular(int k) {
        const int after = k + 1 < count_ ? k + 1 : 0;
        Factor &matrix = factors_[k], &other = factors_[after];
        for (int j = 0; j < size() - 1; ++j)
            for (int r = size() - 2; r >= j; --r) {
                const int i = inverse_[k] ? size() - 2 - r : r;
                Rotation rotation;
                if (inverse_[k]) {  // from the last row upwards
                    const int row = size() - 1 - j;
                    rotation = Rotation::of(matrix(row, i + 1), -matrix(row, i));
                    turn_columns(matrix, i, rotation, 0, row);
                    matrix(row, i) = 0.0;
                } else {
                    rotation = Rotation::of(matrix(i, j), matrix(i + 1, j));
                    turn_rows(matrix, i, rotation, j, size() - 1);
                    matrix(i + 1, j) = 0.0;
                }
                if (inverse_[after]) turn_rows(other, i, rotation, 0, size() - 1);
                else turn_columns(other, i, rotation, 0, size() - 1);
            }
    }

    /// The diagonal block of `count` rows from `first` of the product of all factors but the last, times 2^-exponent,
    /// which is returned.
    template <class Out>
    int diagonal_block(int first, int count, Out& out);

    void one_eigenvalue(int at) {
        const int exponent = diagonal_block(at, 1, corner_);
        real_[at] = std::ldexp(last()(at, at) * corner_(0, 0), exponent);
        imaginary_[at] = 0.0;
    }
    void two_eigenvalues(int at);
    void step(int low, int high, bool exceptional);

    int size_, count_ = 0;
    std::vector<Factor> factors_;
    std::vector<char> inverse_;
    Dense<M> corner_;
    std::vector<double> real_, imaginary_;
};

template <int M>
template <class Out>
int ProductChain<M>::diagonal_block(int first, int count, Out& out) {
    int exponent = 0;
    for (int r = 0; r < count; ++r)
        for (int c = 0; c < count; ++c) out(r, c) = r == c ? 1.0 : 0.0;
    for (int k = 0; k < count_ - 1; ++k) {
        const Factor& matrix = factors_[k];
        double largest = 0.0;
        for (int c = 0; c < count; ++c)
            for (int step = 0; step <= c; ++step) {
                const int r = inverse_[k] ? c - step : step;
                double total;
                if (inverse_[k]) {
                    total = out(r, c);
                    for (int j = r + 1; j <= c; ++j) total -= matrix(first + r, first + j) * out(j, c);
                    total /= matrix(first + r, first + r);
                } else {
                    total = 0.0;
                    for (int j = r; j <= c; ++j) total += matrix(first + r, first + j) * out(j, c);
                }
                out(r, c) = total;
                largest = larger(largest, std::fabs(total));
            }
        if (largest < INFINITE && (largest > 1e100 || (0.0 < largest && largest < 1e-100))) {
            const int shift = binary_exponent(largest);
            exponent += shift;
            for (int r = 0; r < count; ++r)
                for (int c = r; c < count; ++c) out(r, c) = std::ldexp(out(r, c), -shift);
        }
    }
    return exponent;
}

/// Eigenvalues of the diagonal block of two rows. The smaller real one is determinant / larger, which avoids
/// cancellation.
template <int M>
void ProductChain<M>::two_eigenvalues(int at) {
    const Factor& h = last();
    const int exponent = diagonal_block(at, 2, corner_);
    const double p = corner_(0, 0), q = corner_(0, 1), r = corner_(1, 1);
    const double a = h(at, at) * p, b = h(at, at) * q + h(at, at + 1) * r, c = h(at + 1, at) * p,
                 d = h(at + 1, at) * q + h(at + 1, at + 1) * r;
    const double middle = 0.5 * (a + d), difference = 0.5 * (a - d), square = difference * difference + b * c;
    if (square < 0.0) {
        real_[at] = real_[at + 1] = std::ldexp(middle, exponent);
        imaginary_[at + 1] = std::ldexp(std::sqrt(-square), exponent);
        imaginary_[at] = -imaginary_[at + 1];
        return;
    }
    const double larger = middle + std::copysign(std::sqrt(square), middle);
    const double determinant = (h(at, at) * h(at + 1, at + 1) - h(at, at + 1) * h(at + 1, at)) * p;
    real_[at] = std::ldexp(larger, exponent);
    real_[at + 1] = larger != 0.0 ? std::ldexp(determinant / larger * r, exponent) : 0.0;
    imaginary_[at] = imaginary_[at + 1] = 0.0;
}

/// A double-shift step on the coordinates low .. high.
template <int M>
void ProductChain<M>::step(int low, int high, bool exceptional) {
    Factor &h = last(), &p = corner_;
    const int exponent = diagonal_block(high - 2, 3, p);
    // The last two rows and columns of the product.
    double a = h(high - 1, high - 2) * p(0, 1) + h(high - 1, high - 1) * p(1, 1);
    double b = h(high - 1, high - 2) * p(0, 2) + h(high - 1, high - 1) * p(1, 2) + h(high - 1, high) * p(2, 2);
    double c = h(high, high - 1) * p(1, 1), d = h(high, high - 1) * p(1, 2) + h(high, high) * p(2, 2);
    double trace = a + d, product = a * d - b * c;
    if (exceptional) {
        const double side = std::fabs(c) + std::fabs(h(high - 1, high - 2) * p(0, 0));
        trace = 1.5 * side, product = side * side;
    }
    const int shift = exponent - diagonal_block(low, 3, p);
    trace = std::ldexp(trace, shift);
    product = std::ldexp(product, 2 * shift);
    // The first column of (product - one shift) (product - other shift).
    a = h(low, low) * p(0, 0), b = h(low + 1, low) * p(0, 0);
    c = h(low, low) * p(0, 1) + h(low, low + 1) * p(1, 1),
    d = h(low + 1, low) * p(0, 1) + h(low + 1, low + 1) * p(1, 1);
    double x = a * (a - trace) + product + b * c, y = b * (a + d - trace), z = b * h(low + 2, low + 1) * p(1, 1);
    const double largest = larger(larger(std::fabs(x), std::fabs(y)), std::fabs(z));
    if (0.0 < largest && largest < INFINITE) x /= largest, y /= largest, z /= largest;
    else x = y = z = 1.0;
    const auto turn = [&](int i, Rotation rotation, int column, int bottom) {
        turn_rows(h, i, rotation, column, high);
        pass_on(i, rotation, low, high, bottom < high ? bottom : high);
    };
    for (int k = low - 1; k < high - 1; ++k) {
        // A rotation of the last two of three rows, then one of the first two.
        const int column = k > low ? k : low;
        if (k + 3 <= high) {
            turn(k + 2, Rotation::of(y, z), column, k + 5);
            if (k >= low) h(k + 3, k) = 0.0, y = h(k + 2, k);
            else y = hypot(y, z);
        }
        if (k >= low) x = h(k + 1, k);
        turn(k + 1, Rotation::of(x, y), column, k + 4);
        if (k >= low) h(k + 2, k) = 0.0;
        if (k + 3 <= high) y = h(k + 3, k + 1), z = k + 4 <= high ? h(k + 4, k + 1) : 0.0;  // of the next column
    }
}

template <int M>
template <class Product>
int ProductChain<M>::eigenvalues(Product&& product) {
    // Twice round: the first round sorts the coordinates by growth.
    for (int k = 0; k < count_; ++k) make_triangular(k);
    for (int k = 0; k < count_ - 1; ++k) {
        make_triangular(k);
        for (int r = 0; inverse_[k] && r < size(); ++r)
            if (factors_[k](r, r) == 0.0) return -1;
    }
    Factor& h = last();
    for (int j = 0; j < size() - 2; ++j)
        for (int i = size() - 2; i > j; --i) {
            const Rotation rotation = Rotation::of(h(i, j), h(i + 1, j));
            turn_rows(h, i, rotation, j, size() - 1);
            h(i + 1, j) = 0.0;
            pass_on(i, rotation, 0, size() - 1, size() - 1);
        }
    const int exponent = diagonal_block(0, size(), product);
    for (int c = 0; c < size(); ++c) {
        for (int r = 0; r <= c; ++r) real_[r] = std::ldexp(product(r, c), exponent);
        for (int r = 0; r < size(); ++r) {
            product(r, c) = 0.0;
            for (int j = r > 0 ? r - 1 : 0; j <= c; ++j) product(r, c) += h(r, j) * real_[j];
        }
    }
    int total = 1;
    for (int high = size() - 1, steps = 0; high >= 0;) {
        int low = high;
        for (; low > 0; --low) {
            const double around = std::fabs(h(low, low)) + std::fabs(h(low - 1, low - 1));
            if (std::fabs(h(low, low - 1)) <= EPSILON * around || !(around < INFINITE)) break;
        }
        if (low == high) {
            one_eigenvalue(high);
            high -= 1, steps = 0;
        } else if (low == high - 1) {
            two_eigenvalues(low);
            high -= 2, steps = 0;
        } else if (steps == MOST_QR_STEPS) {
            return 0;
        } else {
            if (low > 0) h(low, low - 1) = 0.0;
            ++steps, ++total;
            step(low, high, steps % 10 == 0);
        }
    }
    return total;
}

}  // namespace saltus
