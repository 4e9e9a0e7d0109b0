#include "schur.hpp"

#include <stdexcept>

namespace saltus {

SchurForm::SchurForm(Array<> matrix) : t(std::move(matrix)), q(identity(t.rows())) {
    double norm = 0.0;
    for (int r = 0; r < size(); ++r)
        for (int c = 0; c < size(); ++c) norm += std::fabs(t(r, c));
    if (!(norm < INFINITE)) throw std::runtime_error("the entries are no numbers");
    if (norm == 0.0) return;
    const int exponent = std::ilogb(norm);
    scale(-exponent);
    to_hessenberg();
    iterate();
    scale(exponent);
}

/// t <- 2^exponent t: of a size about 1 products of its entries keep their digits.
void SchurForm::scale(int exponent) {
    for (int r = 0; r < size(); ++r)
        for (int c = 0; c < size(); ++c) t(r, c) = std::ldexp(t(r, c), exponent);
}

SchurForm::SchurForm(Array<> form, Array<> basis) : t(std::move(form)), q(std::move(basis)) {
    if (t.columns() != t.rows() || q.rows() != t.rows() || q.columns() != t.rows())
        throw std::invalid_argument("the parts of a Schur form are square and of one size");
}

/// Zeros below the first subdiagonal, by reflections.
void SchurForm::to_hessenberg() {
    std::vector<double> v(size());
    for (int k = 0; k < size() - 2; ++k) {
        double largest = 0.0;
        for (int r = k + 1; r < size(); ++r) largest = larger(largest, std::fabs(t(r, k)));
        for (int r = k + 1; r < size(); ++r) v[r] = largest > 0.0 ? t(r, k) / largest : 0.0;
        const double factor = reflector(v, k + 1, size());
        if (factor == 0.0) continue;
        reflect_from_left(t, v, k + 1, factor);
        reflect_columns(t, v, k + 1, factor);
        reflect_columns(q, v, k + 1, factor);
        for (int r = k + 2; r < size(); ++r) t(r, k) = 0.0;
    }
}

/// Francis's iteration with two shifts. An entry below the diagonal is 0 where it is rounding of its neighbours, or too
/// small for products of it.
void SchurForm::iterate() {
    constexpr double SMALLEST = 1e-290;
    std::vector<double> v(size());
    for (int high = size() - 1, steps = 0; high >= 0;) {
        int low = high;
        for (; low > 0; --low) {
            const double around = std::fabs(t(low, low)) + std::fabs(t(low - 1, low - 1));
            if (std::fabs(t(low, low - 1)) <= larger(EPSILON * (around > 0.0 ? around : 1.0), SMALLEST)) break;
        }
        if (low > 0) t(low, low - 1) = 0.0;
        if (low >= high - 1) {
            if (low == high - 1) standardise(low);
            high = low - 1, steps = 0;
            continue;
        }
        if (steps++ == MOST_QR_STEPS) throw std::runtime_error("the iteration did not converge");
        const double before = t(high - 1, high - 1), last = t(high, high), up = t(high - 1, high), down = t(high, high - 1);
        double trace = before + last, product = before * last - up * down;
        if (steps % 10 == 0) {
            const double side = std::fabs(down) + std::fabs(t(high - 1, high - 2));
            trace = 1.5 * side, product = side * side;
        }
        // The first column of (t - s)(t - s'), but for a factor.
        v[low] = (t(low, low) * (t(low, low) - trace) + product) / t(low + 1, low) + t(low, low + 1);
        v[low + 1] = t(low, low) + t(low + 1, low + 1) - trace;
        v[low + 2] = t(low + 2, low + 1);
        for (int k = low; k < high; ++k) {
            const int end = std::min(k + 3, high + 1);
            if (k > low)
                for (int r = k; r < end; ++r) v[r] = t(r, k - 1);
            double largest = 0.0;
            for (int r = k; r < end; ++r) largest = larger(largest, std::fabs(v[r]));
            if (largest == 0.0) continue;
            for (int r = k; r < end; ++r) v[r] /= largest;
            const double factor = reflector(v, k, end);
            if (factor == 0.0) continue;
            const Values part(v.data(), size_t(end));
            reflect_from_left(t, part, k, factor);
            reflect_columns(t, part, k, factor);
            reflect_columns(q, part, k, factor);
            for (int r = k + 1; k > low && r < end; ++r) t(r, k - 1) = 0.0;
        }
    }
}

/// t <- R t R', q <- q R' with a rotation of the coordinates k and k + 1.
void SchurForm::rotate(int k, const Rotation& rotation) {
    for (int c = 0; c < size(); ++c) rotation.turn(t(k, c), t(k + 1, c));
    for (int r = 0; r < size(); ++r) rotation.turn(t(r, k), t(r, k + 1)), rotation.turn(q(r, k), q(r, k + 1));
}

/// Turn the block [[a, b], [c, d]] at k until c = 0, if its rates are real, or else a = d.
void SchurForm::standardise(int k) {
    const double a = t(k, k), b = t(k, k + 1), c = t(k + 1, k), d = t(k + 1, k + 1);
    if (c == 0.0) return;
    const double half = 0.5 * (a - d), square = half * half + b * c;
    if (square >= 0.0) {
        const double far = half + std::copysign(std::sqrt(square), half);  // the rate far from d, without cancellation
        rotate(k, Rotation::of(far, c));
        t(k, k) = d + far;
        t(k + 1, k + 1) = far != 0.0 ? d - b * c / far : d;
        t(k, k + 1) = b - c;
        t(k + 1, k) = 0.0;
        return;
    }
    // A rotation by half an angle turns (half, (b + c)/2), and leaves b - c.
    const double sum = 0.5 * (b + c), size = hypot(half, sum);
    if (half != 0.0) {
        const Rotation whole = Rotation::of(std::fabs(sum), half);
        const double cosine = std::sqrt(0.5 * (1.0 + whole.c));
        rotate(k, {cosine, -std::copysign(whole.s / (2.0 * cosine), sum * half)});
    }
    const double skew = 0.5 * (b - c), long_side = skew + std::copysign(size, skew), short_side = -square / long_side;
    const bool first = (sum < 0.0) == (skew < 0.0);  // whether b is the longer one
    t(k, k) = t(k + 1, k + 1) = 0.5 * (a + d);
    t(k, k + 1) = first ? long_side : short_side;
    t(k + 1, k) = first ? -short_side : -long_side;
}

/// Exchange the block at k with the next one.
bool SchurForm::exchange(int k) {
    const int p = block(k), s = block(k + p), end = k + p + s;
    Array<> a(p, p), b(s, s), c(p, s), x(p, s);
    for (int i = 0; i < p; ++i)
        for (int j = 0; j < p; ++j) a(i, j) = t(k + i, k + j);
    for (int i = 0; i < s; ++i)
        for (int j = 0; j < s; ++j) b(i, j) = t(k + p + i, k + p + j);
    for (int i = 0; i < p; ++i)
        for (int j = 0; j < s; ++j) c(i, j) = t(k + i, k + p + j);
    if (!solve_sylvester(a, b, c, x)) return false;
    // (-X, 1) spans the motions of the second block: reflections turn it into the first coordinates.
    Array<> spanned(s, end);
    for (int j = 0; j < s; ++j) {
        for (int i = 0; i < p; ++i) spanned(j, k + i) = -x(i, j);
        spanned(j, k + p + j) = 1.0;
    }
    for (int j = 0; j < s; ++j) {
        const double factor = reflector(spanned[j], k + j, end);
        if (factor == 0.0) continue;
        for (int other = j + 1; other < s; ++other) reflect(spanned[j], k + j, end, factor, spanned[other]);
        reflect_from_left(t, spanned[j], k + j, factor);
        reflect_columns(t, spanned[j], k + j, factor);
        reflect_columns(q, spanned[j], k + j, factor);
    }
    for (int r = k + s; r < end; ++r)
        for (int column = k; column < k + s; ++column) t(r, column) = 0.0;
    if (s == 2) standardise(k);
    if (p == 2) standardise(k + s);
    return true;
}

bool SchurForm::move(int from, int to) {
    while (from > to) {
        const int before = from > 1 && t(from - 1, from - 2) != 0.0 ? from - 2 : from - 1;
        if (!exchange(before)) return false;
        from = before;
    }
    return true;
}

bool solve_sylvester(Matrix<const double> a, Matrix<const double> b, Matrix<const double> c, Matrix<double> x) {
    const int m = a.rows(), k = b.rows();
    for (int j = 0, width; j < k; j += width) {
        width = j + 1 < k && b(j + 1, j) != 0.0 ? 2 : 1;
        const int count = m * width;
        Array<> matrix(count, count);
        std::vector<double> right(count);
        for (int w = 0; w < width; ++w)
            for (int r = 0; r < m; ++r) {
                double& entry = right[w * m + r];
                entry = c(r, j + w);
                for (int i = 0; i < j; ++i) entry += x(r, i) * b(i, j + w);
                for (int q = 0; q < m; ++q) matrix(w * m + r, w * m + q) = a(r, q);
                for (int u = 0; u < width; ++u) matrix(w * m + r, u * m + r) -= b(j + u, j + w);
            }
        std::vector<int> row(count);
        if (!(factorise(matrix, row).least > 0.0)) return false;
        substitute(matrix, row, right);
        for (int w = 0; w < width; ++w)
            for (int r = 0; r < m; ++r) x(r, j + w) = right[w * m + r];
    }
    return true;
}

}  // namespace saltus
