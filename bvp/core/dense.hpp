/// Small dense matrices: elimination, reflections, rotations, determinants with a certificate, eigenvalues.
///
/// Gaussian elimination with partial pivoting; Hessenberg form by elimination and Francis's double-shift QR iteration
/// (Golub and Van Loan, Matrix Computations, 4th ed. 2013, 3.4 and 7.5), after the matrix is balanced by powers of two
/// (Parlett and Reinsch, Numer. Math. 13 (1969) 293). All matrices may have sizes known to the compiler: `Dense<2>`, or
/// only when the program runs: `Matrix<double>`.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "array.hpp"
#include "blocks.hpp"
#include "complex.hpp"

namespace saltus {

/// A matrix that owns its entries, of R rows and C columns; either may be DYNAMIC.
template <int R = DYNAMIC, int C = R>
class Dense {
    static constexpr bool FIXED = R != DYNAMIC && C != DYNAMIC;

public:
    explicit Dense(int rows = R) : Dense(rows, rows) {}
    Dense(int rows, int columns) : rows_(rows), columns_(columns) {
        if constexpr (!FIXED) entries_.assign(size_t(rows) * columns, 0.0);
    }
    constexpr int rows() const {
        if constexpr (R != DYNAMIC) return R;
        return rows_;
    }
    constexpr int columns() const {
        if constexpr (C != DYNAMIC) return C;
        return columns_;
    }
    double& operator()(int r, int c) { return entries_[size_t(r) * columns() + c]; }
    const double& operator()(int r, int c) const { return entries_[size_t(r) * columns() + c]; }
    Vector<double> operator[](int r) { return {entries_.data() + size_t(r) * columns(), size_t(columns())}; }
    Values operator[](int r) const { return {entries_.data() + size_t(r) * columns(), size_t(columns())}; }
    operator Matrix<double>() { return {entries_.data(), rows(), columns()}; }
    operator Matrix<const double>() const { return {entries_.data(), rows(), columns()}; }
    double* data() { return entries_.data(); }
    void set(double value) { std::fill(entries_.begin(), entries_.end(), value); }
    /// The first size^2 entries as a square matrix.
    Matrix<double> square(int size) { return {entries_.data(), size, size}; }

private:
    std::conditional_t<FIXED, std::array<double, FIXED ? size_t(R) * C : 1>, std::vector<double>> entries_{};
    int rows_, columns_;
};

/// The larger and the smaller of two numbers; a, where b is none.
inline double larger(double a, double b) { return b > a ? b : a; }
inline double smaller(double a, double b) { return b < a ? b : a; }

/// Call visit(width, first column) for four columns at a time, so that their sums stay in registers, then for those
/// that are left.
template <class Visit>
void in_groups(int first, int columns, Visit&& visit) {
    for (; first + 4 <= columns; first += 4) visit(std::integral_constant<int, 4>(), first);
    for (; first + 2 <= columns; first += 2) visit(std::integral_constant<int, 2>(), first);
    for (; first < columns; ++first) visit(std::integral_constant<int, 1>(), first);
}

/// Sum of the squares of all entries: of each column modulo four, so that no sum waits for another.
template <class M>
double sum_of_squares(const M& matrix) {
    double total[4] = {};
    for (int r = 0; r < matrix.rows(); ++r) {
        int c = 0;
        for (; c + 4 <= matrix.columns(); c += 4)
            for (int k = 0; k < 4; ++k) total[k] += matrix(r, c + k) * matrix(r, c + k);
        for (int k = 0; c + k < matrix.columns(); ++k) total[k] += matrix(r, c + k) * matrix(r, c + k);
    }
    return (total[0] + total[1]) + (total[2] + total[3]);
}

/// Exponent e of the binary digits of x > 0: 2^e <= x < 2^(e + 1).
inline int binary_exponent(double x) {
    int exponent;
    std::frexp(x, &exponent);
    return exponent - 1;
}

// -- elimination --------------------------------------------------------------------------------------------------

template <class M>
void swap_rows(M& matrix, int i, int j) {
    for (int c = 0; c < matrix.columns(); ++c) std::swap(matrix(i, c), matrix(j, c));
}

inline double size_of(double x) { return std::fabs(x); }
inline double size_of(const Complex<double>& x) { return abs(x); }

/// What elimination found: the sign that exchanged rows give the determinant, and the smallest modulus of a pivot.
struct Pivots {
    double sign = 1.0, least = INFINITE;
};

/// Replace a square matrix, real or complex, by its triangular factors, the lower one with a unit diagonal. row(k): the
/// row that row k was exchanged with.
template <class M, class Rows>
Pivots factorise(M&& matrix, Rows&& row) {
    Pivots found;
    const int size = matrix.rows();
    for (int k = 0; k < size; ++k) {
        int pivot = k;
        double largest = size_of(matrix(k, k));
        for (int r = k + 1; r < size; ++r)
            if (const double candidate = size_of(matrix(r, k)); candidate > largest) largest = candidate, pivot = r;
        row[k] = pivot;
        found.least = smaller(found.least, largest);
        if (pivot != k) swap_rows(matrix, k, pivot), found.sign = -found.sign;
        if (largest == 0.0) continue;
        for (int r = k + 1; r < size; ++r) {
            const auto factor = matrix(r, k) / matrix(k, k);
            matrix(r, k) = factor;
            auto *__restrict to = &matrix(r, 0), *__restrict from = &matrix(k, 0);
            for (int c = k + 1; c < size; ++c) to[c] = to[c] - factor * from[c];
        }
    }
    return found;
}

/// Solve the equations with the right side x, in place.
template <class M, class Rows, class X>
void substitute(const M& factors, const Rows& row, X&& x) {
    const int size = factors.rows();
    for (int k = 0; k < size; ++k) std::swap(x[k], x[row[k]]);
    for (int r = 1; r < size; ++r)
        for (int c = 0; c < r; ++c) x[r] = x[r] - factors(r, c) * x[c];
    for (int r = size - 1; r >= 0; --r) {
        for (int c = r + 1; c < size; ++c) x[r] = x[r] - factors(r, c) * x[c];
        x[r] = x[r] / factors(r, r);
    }
}

/// The determinant of a square matrix, which is replaced by its triangular factors.
template <class M>
double determinant(M&& matrix) {
    Local<int> row(matrix.rows());
    double product = factorise(matrix, row).sign;
    for (int k = 0; k < matrix.rows(); ++k) product *= matrix(k, k);
    return product;
}

/// Lower bound, sharp to a factor sqrt(m), of the smallest singular value of the matrix with these triangular factors:
/// 1 over the Frobenius norm of its inverse.
template <class M>
double least_singular(const M& factors) {
    const int size = factors.rows();
    for (int k = 0; k < size; ++k)
        if (factors(k, k) == 0.0) return 0.0;
    // Exchanged rows of a matrix exchange columns of its inverse, which leaves the norm.
    LocalSquare<double> inverse(size);
    double total = 0.0;
    for (int r = 0; r < size; ++r) {
        for (int c = 0; c < size; ++c) inverse(r, c) = r == c ? 1.0 : 0.0;
        for (int k = 0; k < r; ++k)
            for (int c = 0; c < size; ++c) inverse(r, c) -= factors(r, k) * inverse(k, c);
    }
    for (int r = size - 1; r >= 0; --r) {
        for (int k = r + 1; k < size; ++k)
            for (int c = 0; c < size; ++c) inverse(r, c) -= factors(r, k) * inverse(k, c);
        for (int c = 0; c < size; ++c) {
            inverse(r, c) /= factors(r, r);
            total += inverse(r, c) * inverse(r, c);
        }
    }
    return 1.0 / std::sqrt(total);
}

/// The determinant of a square matrix, which is overwritten; NaN unless its smallest singular value is above the noise
/// of its entries.
///
/// |det| is the smallest singular value times the product of the others, whose mean of squares is at most the sum of
/// all over m - 1. Where this does not decide, `least_singular` does.
template <class M>
double certain_determinant(M&& matrix, double noise) {
    const double square = sum_of_squares(matrix), others = matrix.rows() - 1.0;
    const double value = determinant(matrix);
    double bound = std::fabs(value);
    for (int k = 1; k < matrix.rows(); ++k) bound *= std::sqrt(others / square);
    return bound > noise || least_singular(matrix) > noise ? value : NOT_A_NUMBER;
}

// -- reflections and rotations ------------------------------------------------------------------------------------

/// Turn v[first ..] into Householder's reflector of a vector, with the sign that does not cancel. Returns 2/(v . v); 0:
/// no reflection.
template <class V>
double reflector(V&& v, int first, int size) {
    double total = 0.0;
    for (int r = first + 1; r < size; ++r) total += v[r] * v[r];
    if (total == 0.0) return 0.0;
    const double head = v[first], norm = std::sqrt(head * head + total);
    v[first] = head > 0.0 ? head + norm : head - norm;
    return 2.0 / (v[first] * v[first] + total);
}

/// x <- (1 - factor v v') x for entries from `first` on.
template <class V, class X>
void reflect(const V& v, int first, int size, double factor, X&& x) {
    double total = 0.0;
    for (int r = first; r < size; ++r) total += v[r] * x[r];
    total *= factor;
    for (int r = first; r < size; ++r) x[r] -= total * v[r];
}

/// Rows of `out`: an orthonormal basis of the complement of the first `count` rows of `vectors`, which are overwritten.
template <class V, class Out>
void complement(V& vectors, int count, Out& out) {
    const int size = vectors.columns();
    Local<double> factor(count);
    for (int c = 0; c < count; ++c) {
        factor[c] = reflector(vectors[c], c, size);
        if (factor[c] == 0.0) continue;
        for (int other = c + 1; other < count; ++other) reflect(vectors[c], c, size, factor[c], vectors[other]);
    }
    // It is the image of the other axes.
    for (int b = 0; b < size - count; ++b) {
        for (int r = 0; r < size; ++r) out(b, r) = r == count + b ? 1.0 : 0.0;
        for (int c = count - 1; c >= 0; --c)
            if (factor[c] != 0.0) reflect(vectors[c], c, size, factor[c], out[b]);
    }
}

/// A rotation of two coordinates: (x, y) becomes (c x + s y, c y - s x).
struct Rotation {
    double c = 1.0, s = 0.0;
    /// The one that turns (a, b) into (r, 0).
    static Rotation of(double a, double b) {
        if (b == 0.0) return {};
        double square = a * a + b * b;
        if (!(square > 1e-280 && square < 1e280)) {  // the length of what has lost digits below the normal numbers has none
            if (!(std::fabs(a) < INFINITE && std::fabs(b) < INFINITE)) return {NOT_A_NUMBER, NOT_A_NUMBER};
            const int exponent = std::ilogb(std::max(std::fabs(a), std::fabs(b)));
            a = std::ldexp(a, -exponent), b = std::ldexp(b, -exponent);
            square = a * a + b * b;
        }
        const double r = std::sqrt(square);
        return {a / r, b / r};
    }
    void turn(double& x, double& y) const {
        const double a = x, b = y;
        x = c * a + s * b;
        y = c * b - s * a;
    }
};

// -- eigenvalues --------------------------------------------------------------------------------------------------

/// Eigenvalues of [[a, b], [c, d]], a complex pair with the positive imaginary part first. The real one next to d
/// follows from the product of the distances from it, so that no difference cancels.
inline void two_eigenvalues(double a, double b, double c, double d, double* real, double* imaginary) {
    const double half = 0.5 * (a - d), square = half * half + b * c, root = std::sqrt(std::fabs(square));
    if (square >= 0.0) {
        const double far = half + std::copysign(root, half);
        real[0] = d + far;
        real[1] = far != 0.0 ? d - b * c / far : d;
        imaginary[0] = imaginary[1] = 0.0;
    } else {
        real[0] = real[1] = d + half;
        imaginary[0] = root;
        imaginary[1] = -root;
    }
}

namespace dense_detail {

/// Scale by powers of two until the sums of each row and of its column are of like size. No rounding.
template <class M>
void balance(M& matrix) {
    const int size = matrix.rows();
    for (bool done = false; !done;) {
        done = true;
        for (int i = 0; i < size; ++i) {
            double row = 0.0, column = 0.0;
            for (int j = 0; j < size; ++j)
                if (j != i) row += std::fabs(matrix(i, j)), column += std::fabs(matrix(j, i));
            if (row == 0.0 || column == 0.0 || !(row + column < INFINITE)) continue;
            if (0.25 * column < row && row < 4.0 * column) continue;
            const double factor = std::ldexp(1.0, (binary_exponent(row) - binary_exponent(column)) / 2);
            if (row / factor + column * factor >= 0.95 * (row + column)) continue;
            done = false;
            for (int j = 0; j < size; ++j) matrix(i, j) /= factor;
            for (int j = 0; j < size; ++j) matrix(j, i) *= factor;
        }
    }
}

/// Similar matrix with zeros below the first subdiagonal, by elimination with partial pivoting.
template <class M>
void hessenberg(M& matrix) {
    const int size = matrix.rows();
    Local<double> factor(size);
    for (int k = 1; k < size - 1; ++k) {
        int pivot = k;
        for (int r = k + 1; r < size; ++r)
            if (std::fabs(matrix(r, k - 1)) > std::fabs(matrix(pivot, k - 1))) pivot = r;
        if (matrix(pivot, k - 1) == 0.0) continue;
        if (pivot != k) {
            swap_rows(matrix, k, pivot);
            for (int r = 0; r < size; ++r) std::swap(matrix(r, k), matrix(r, pivot));
        }
        for (int r = k + 1; r < size; ++r) {
            factor[r] = matrix(r, k - 1) / matrix(k, k - 1);
            matrix(r, k - 1) = 0.0;
            double *__restrict to = &matrix(r, 0), *__restrict from = &matrix(k, 0);
            for (int c = k; c < size; ++c) to[c] -= factor[r] * from[c];
        }
        for (int c = 0; c < size; ++c) {
            double total = matrix(c, k);
            for (int r = k + 1; r < size; ++r) total += factor[r] * matrix(c, r);
            matrix(c, k) = total;
        }
    }
}

/// Householder's reflection 1 - u v' of three neighbouring coordinates with u = (p, q, r) and v = (1, y, z): of entries
/// of three rows.
inline void reflect_rows(double* __restrict a, double* __restrict b, double* __restrict c, int count, double p,
                         double q, double r, double y, double z) {
    for (int k = 0; k < count; ++k) {
        const double total = a[k] + y * b[k] + z * c[k];
        a[k] -= total * p;
        b[k] -= total * q;
        c[k] -= total * r;
    }
}

/// A double-shift step on the rows and columns low .. high; trace, product: of the two shifts. none (m,): zeros.
template <class M>
void francis(M& matrix, int low, int high, double trace, double product, double* none) {
    double x = (matrix(low, low) * (matrix(low, low) - trace) + product) / matrix(low + 1, low) + matrix(low, low + 1);
    double y = matrix(low, low) + matrix(low + 1, low + 1) - trace, z = matrix(low + 2, low + 1);
    for (int k = low; k < high; ++k) {
        const bool three = k < high - 1;
        if (k > low) x = matrix(k, k - 1), y = matrix(k + 1, k - 1), z = three ? matrix(k + 2, k - 1) : 0.0;
        const double largest = std::fabs(x) + std::fabs(y) + std::fabs(z);
        if (largest == 0.0) continue;
        const double unit = 1.0 / largest;
        if (!(unit < INFINITE)) x /= largest, y /= largest, z /= largest;
        else x *= unit, y *= unit, z *= unit;
        const double norm = std::copysign(std::sqrt(x * x + y * y + z * z), x);
        if (k > low) {
            matrix(k, k - 1) = -norm * largest;
            matrix(k + 1, k - 1) = 0.0;
            if (three) matrix(k + 2, k - 1) = 0.0;
        }
        const double head = x + norm, of_norm = 1.0 / norm, of_head = 1.0 / head, p = head * of_norm, q = y * of_norm,
                     r = z * of_norm;
        y *= of_head, z *= of_head;
        reflect_rows(&matrix(k, k), &matrix(k + 1, k), three ? &matrix(k + 2, k) : none, high + 1 - k, p, q, r, y, z);
        const int last = k + 3 < high ? k + 3 : high, third = three ? 2 : 1;  // of two coordinates r and z are 0
        for (int c = low; c <= last; ++c) {
            double* at = &matrix(c, k);
            const double total = p * at[0] + q * at[1] + r * at[third];
            at[third] -= total * z;
            at[1] -= total * y;
            at[0] -= total;
        }
    }
}

}  // namespace dense_detail

/// Most steps of a QR iteration for one eigenvalue, which takes two or three; 66 where pairs on the unit circle hardly
/// differ.
inline constexpr int MOST_QR_STEPS = 300;

/// Eigenvalues of a square matrix, which is overwritten, a complex pair side by side. Returns whether the iteration
/// converged.
template <class M>
bool eigenvalues(M&& matrix, double* real, double* imaginary) {
    const int size = matrix.rows();
    dense_detail::balance(matrix);
    dense_detail::hessenberg(matrix);
    double norm = 0.0;
    for (int r = 0; r < size; ++r)
        for (int c = 0; c < size; ++c) norm += std::fabs(matrix(r, c));
    if (!(norm < INFINITE)) return false;
    Local<double> none(size);
    for (double& entry : none) entry = 0.0;
    for (int high = size - 1, steps = 0; high >= 0;) {
        int low = high;
        for (; low > 0; --low) {
            const double around = std::fabs(matrix(low, low)) + std::fabs(matrix(low - 1, low - 1));
            if (std::fabs(matrix(low, low - 1)) <= EPSILON * (around > 0.0 ? around : norm)) break;
        }
        const double last = matrix(high, high);
        if (low == high) {
            real[high] = last;
            imaginary[high] = 0.0;
            high -= 1, steps = 0;
            continue;
        }
        const double before = matrix(high - 1, high - 1), up = matrix(high - 1, high), down = matrix(high, high - 1);
        if (low == high - 1) {
            two_eigenvalues(before, up, down, last, real + low, imaginary + low);
            high -= 2, steps = 0;
            continue;
        }
        if (low > 0) matrix(low, low - 1) = 0.0;
        if (steps++ == MOST_QR_STEPS) return false;
        double trace = before + last, product = before * last - up * down;
        if (steps % 10 == 0) {
            // A step with other shifts, where these go in circles.
            const double side = std::fabs(down) + std::fabs(matrix(high - 1, high - 2));
            trace = 1.5 * side, product = side * side;
        }
        dense_detail::francis(matrix, low, high, trace, product, none.data());
    }
    return true;
}

/// Eigenvalues (on the diagonal) and orthonormal eigenvectors (rows of `vectors`) of a symmetric matrix, by cyclic
/// Jacobi rotations. Returns whether they converged.
///
/// An entry is left alone where it is below the rounding of the geometric mean of its two diagonal entries, so graded
/// matrices keep the relative accuracy of their small eigenvalues.
template <class M, class V>
bool symmetric_eigenvalues(M&& a, V&& vectors) {
    constexpr int SWEEPS = 60;  // ten are many
    const int size = a.rows();
    for (int r = 0; r < size; ++r)
        for (int c = 0; c < size; ++c) vectors(r, c) = r == c ? 1.0 : 0.0;
    for (int sweep = 0; sweep < SWEEPS; ++sweep) {
        bool quiet = true;
        for (int i = 0; i < size - 1; ++i)
            for (int j = i + 1; j < size; ++j) {
                const double coupling = a(i, j), level = std::sqrt(std::fabs(a(i, i))) * std::sqrt(std::fabs(a(j, j)));
                if (std::fabs(coupling) <= larger(std::numeric_limits<double>::min(), 0.5 * EPSILON * level)) continue;
                quiet = false;
                const double theta = (a(j, j) - a(i, i)) / 2.0 / coupling;
                const double tangent = std::copysign(1.0 / (std::fabs(theta) + hypot(1.0, theta)), theta);
                const double cosine = 1.0 / hypot(1.0, tangent);
                const Rotation rotation{cosine, -tangent * cosine};
                const double low = a(i, i) - tangent * coupling, high = a(j, j) + tangent * coupling;
                for (int c = 0; c < size; ++c) {
                    rotation.turn(a(i, c), a(j, c));
                    rotation.turn(vectors(i, c), vectors(j, c));
                }
                for (int c = 0; c < size; ++c) a(c, i) = a(i, c), a(c, j) = a(j, c);
                a(i, i) = low, a(j, j) = high, a(i, j) = a(j, i) = 0.0;
            }
        if (quiet) return true;
    }
    return false;
}

/// Singular values of a matrix, which is overwritten, by one-sided Jacobi rotations of its rows, until these are orthogonal
/// to the rounding of their products; turn(i, j, rotation) is called for each. Small ones keep their digits if large rows
/// make large ones. A row whose square is at most `least` stays as it is. Returns whether they converged.
template <class M, class Out, class Turn>
bool singular_values(M&& a, Out&& out, double least, Turn&& turn) {
    constexpr int SWEEPS = 60;  // ten are many
    const double rounding = EPSILON * std::max(1, a.columns());
    for (int sweep = 0; sweep < SWEEPS; ++sweep) {
        bool quiet = true;
        for (int i = 0; i < a.rows() - 1; ++i)
            for (int j = i + 1; j < a.rows(); ++j) {
                const double first = dot(a[i], a[i]), second = dot(a[j], a[j]), across = dot(a[i], a[j]);
                if (!(std::fabs(across) > rounding * std::sqrt(first) * std::sqrt(second)) || smaller(first, second) <= least) continue;
                quiet = false;
                const double theta = (second - first) / 2.0 / across;
                const double tangent = std::copysign(1.0 / (std::fabs(theta) + hypot(1.0, theta)), theta);
                const double cosine = 1.0 / hypot(1.0, tangent);
                const Rotation rotation{cosine, -tangent * cosine};
                for (int c = 0; c < a.columns(); ++c) rotation.turn(a(i, c), a(j, c));
                turn(i, j, rotation);
            }
        if (!quiet) continue;
        for (int r = 0; r < a.rows(); ++r) out[r] = std::sqrt(dot(a[r], a[r]));
        return true;
    }
    return false;
}
template <class M, class Out>
bool singular_values(M&& a, Out&& out) {
    return singular_values(a, out, 0.0, [](int, int, const Rotation&) {});
}

/// Unit eigenvectors of a square matrix with known eigenvalues, the columns of `vectors`, by inverse iteration; the
/// inverse of this matrix of vectors has rows of the lengths `condition`: the condition numbers of the eigenvalues,
/// infinite where there are too few vectors.
template <class M, class V>
void eigenvectors(const M& matrix, Values real, Values imaginary, V&& vectors, Vector<double> condition) {
    const int size = matrix.rows();
    const double unit = EPSILON * larger(std::sqrt(sum_of_squares(matrix)), std::numeric_limits<double>::min());
    Array<Complex<double>> factors(size, size, Complex<double>(0.0));
    Local<Complex<double>> x(size);
    Local<int> row(size);
    const auto mend = [&] {  // a pivot that is zero becomes rounding
        for (int k = 0; k < size; ++k)
            if (size_of(factors(k, k)) < unit) factors(k, k) = Complex<double>(unit);
    };
    for (int j = 0; j < size; ++j) {
        for (int r = 0; r < size; ++r) {
            for (int c = 0; c < size; ++c) factors(r, c) = Complex<double>(matrix(r, c));
            factors(r, r) = factors(r, r) - Complex<double>(real[j], imaginary[j]);
            x[r] = Complex<double>(1.0 / (1.0 + (r + size - j) % size));
        }
        factorise(factors, row);
        mend();
        for (int step = 0; step < 3; ++step) {
            substitute(factors, row, x);
            double most = 0.0, total = 0.0;
            for (int r = 0; r < size; ++r) most = larger(most, size_of(x[r]));
            for (int r = 0; r < size; ++r) x[r] = x[r] / Complex<double>(most), total += norm(x[r]);
            for (int r = 0; r < size; ++r) x[r] = x[r] / Complex<double>(std::sqrt(total));
        }
        for (int r = 0; r < size; ++r) vectors(r, j) = x[r];
    }
    for (int r = 0; r < size; ++r)
        for (int c = 0; c < size; ++c) factors(r, c) = vectors(r, c);
    const bool regular = factorise(factors, row).least > 0.0;
    for (int r = 0; r < size; ++r) condition[r] = regular ? 0.0 : INFINITE;
    for (int c = 0; regular && c < size; ++c) {
        for (int r = 0; r < size; ++r) x[r] = Complex<double>(r == c ? 1.0 : 0.0);
        substitute(factors, row, x);
        for (int r = 0; r < size; ++r) condition[r] += norm(x[r]);
    }
    for (int r = 0; r < size; ++r) condition[r] = std::sqrt(condition[r]);
}

}  // namespace saltus
