#include "modes.hpp"

#include <algorithm>

#include "dense.hpp"

namespace saltus {

namespace {

/// A square below this has no digits left in products with it; a motion in a period of 1e145 is uniform.
constexpr double SUBNORMAL = std::numeric_limits<double>::min() / EPSILON;

Array<> turned(const Array<>& matrix) {
    Array<> out(matrix.columns(), matrix.rows());
    for (int r = 0; r < out.rows(); ++r)
        for (int c = 0; c < out.columns(); ++c) out(r, c) = matrix(c, r);
    return out;
}

template <class Function>
Array<> each(int n, Function&& function) {
    Array<> out(n, n);
    for (int r = 0; r < n; ++r)
        for (int c = 0; c < n; ++c) out(r, c) = function(r, c);
    return out;
}

Array<> between(const Array<>& shapes, Matrix<const double> form) { return product(product(turned(shapes), form), shapes); }

}  // namespace

Array<> product(Matrix<const double> left, Matrix<const double> right) {
    Array<> out(left.rows(), right.columns());
    for (int r = 0; r < left.rows(); ++r)
        for (int k = 0; k < left.columns(); ++k)
            for (int c = 0; c < right.columns(); ++c) out(r, c) += left(r, k) * right(k, c);
    return out;
}

bool solve_matrix(Array<> matrix, Array<>& right) {
    std::vector<int> row(matrix.rows());
    if (!(factorise(matrix, row).least > 0.0)) return false;
    std::vector<double> x(matrix.rows());
    for (int c = 0; c < right.columns(); ++c) {
        for (int r = 0; r < right.rows(); ++r) x[r] = right(r, c);
        substitute(matrix, row, x);
        for (int r = 0; r < right.rows(); ++r) right(r, c) = x[r];
    }
    return true;
}

bool cholesky(Matrix<const double> matrix, Array<>& lower) {
    lower = Array<>(matrix.rows(), matrix.rows());
    for (int c = 0; c < matrix.rows(); ++c)
        for (int r = c; r < matrix.rows(); ++r) {
            double entry = matrix(r, c);
            for (int k = 0; k < c; ++k) entry -= lower(r, k) * lower(c, k);
            if (r > c) lower(r, c) = entry / lower(c, c);
            else if (entry > 0.0) lower(c, c) = std::sqrt(entry);
            else return false;
        }
    return true;
}

UndampedModes::Outcome UndampedModes::find(Matrix<const double> mass, Matrix<const double> stiffness) {
    const int n = mass.rows();
    std::vector<double> root(n), scale(n);
    for (int r = 0; r < n; ++r) root[r] = std::sqrt(mass(r, r)), scale[r] = 1.0 / root[r];
    Array<> lower;
    if (!cholesky(each(n, [&](int r, int c) { return scale[r] * mass(r, c) * scale[c]; }), lower)) return INDEFINITE;
    Array<> half = each(n, [&](int r, int c) { return scale[r] * stiffness(r, c) * scale[c]; });
    solve_matrix(lower, half);
    Array<> reduced = turned(half);
    solve_matrix(lower, reduced);
    reduced = each(n, [&](int r, int c) { return 0.5 * (reduced(r, c) + reduced(c, r)); });
    Array<> vectors(n, n);
    if (!symmetric_eigenvalues(reduced, vectors)) return UNSETTLED;
    Array<> upward = turned(vectors);
    solve_matrix(turned(lower), upward);
    shapes = each(n, [&](int r, int c) { return scale[r] * upward(r, c); });
    const Array<> mass_size = each(n, [&](int r, int c) { return std::fabs(mass(r, c)); });
    const Array<> stiffness_size = each(n, [&](int r, int c) { return std::fabs(stiffness(r, c)); });
    squares.resize(n);
    for (int step = 0; step < 2; ++step) {
        const Array<> gram = between(shapes, mass), energy = between(shapes, stiffness);
        const Array<> size = each(n, [&](int r, int c) { return std::fabs(shapes(r, c)); });
        const Array<> of_mass = between(size, mass_size), of_stiffness = between(size, stiffness_size);
        for (int k = 0; k < n; ++k) squares[k] = energy(k, k) / gram(k, k);
        const Array<> correction = each(n, [&](int r, int c) {
            const double defect = (r == c ? 1.0 : 0.0) - gram(r, c);
            const double coupling = energy(r, c) + squares[c] * defect, strength = std::fabs(coupling);
            const double noise = of_stiffness(r, c) + std::fabs(squares[c]) * of_mass(r, c), gap = squares[c] - squares[r];
            // Where a coupling is rounding noise, only orthogonality is restored.
            return strength > 4.0 * n * EPSILON * noise && strength < 1e-3 * std::fabs(gap) ? coupling / gap : 0.5 * defect;
        });
        const Array<> change = product(shapes, correction);
        shapes = each(n, [&](int r, int c) { return shapes(r, c) + change(r, c); });
    }
    const Array<> gram = between(shapes, mass);
    shapes = each(n, [&](int r, int c) { return shapes(r, c) / std::sqrt(gram(c, c)); });
    const Array<> energy = between(shapes, stiffness);
    Array<> size = each(n, [&](int r, int c) { return std::fabs(shapes(r, c)); });
    const Array<> terms = between(size, stiffness_size);
    for (int k = 0; k < n; ++k) {
        squares[k] = energy(k, k);
        if (std::fabs(squares[k]) <= larger(4.0 * n * EPSILON * terms(k, k), SUBNORMAL)) squares[k] = 0.0;
    }
    // In a free translation (square 0), an entry at rounding level in kinetic energy and in displacement is set to 0. A
    // translation can cover any distance, so rounding would move bodies that do not take part in it.
    for (int k = 0; k < n; ++k) {
        if (squares[k] != 0.0) continue;
        double heaviest = 0.0, largest = 0.0;
        for (int r = 0; r < n; ++r) heaviest = larger(heaviest, size(r, k) * root[r]), largest = larger(largest, size(r, k));
        for (int r = 0; r < n; ++r)
            if (size(r, k) * root[r] <= 8.0 * n * EPSILON * heaviest && size(r, k) <= std::sqrt(EPSILON) * largest) shapes(r, k) = 0.0;
    }
    std::vector<int> order(n);
    for (int k = 0; k < n; ++k) order[k] = k;
    std::stable_sort(order.begin(), order.end(), [&](int i, int j) { return squares[i] < squares[j]; });
    const std::vector<double> found = squares;
    const Array<> unsorted = shapes;
    for (int k = 0; k < n; ++k) {
        squares[k] = found[order[k]];
        double heaviest = 0.0;
        for (int r = 0; r < n; ++r) heaviest = larger(heaviest, std::fabs(unsorted(r, order[k])) * root[r]);
        int leading = 0;
        while (std::fabs(unsorted(leading, order[k])) * root[leading] < (1.0 - 1e-6) * heaviest) ++leading;
        const double sign = unsorted(leading, order[k]) < 0.0 ? -1.0 : 1.0;
        for (int r = 0; r < n; ++r) shapes(r, k) = sign * unsorted(r, order[k]);
    }
    return FOUND;
}

}  // namespace saltus
