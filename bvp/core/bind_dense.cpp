/// Python's view of dense algebra for what is prepared once: products, elimination, factors of Cholesky, Schur forms.
#include <algorithm>

#include "bindings.hpp"
#include "modes.hpp"
#include "schur.hpp"

namespace saltus {

namespace {

NewMatrix bound_product(InMatrix left, InMatrix right) {
    require_size("rows", right.shape(0), left.shape(1));
    return numpy_matrix(product(view(left), view(right)));
}

/// X of matrix X = right.
NewMatrix bound_solve(InMatrix given, InMatrix right) {
    require_square(given);
    require_size("rows", right.shape(0), given.shape(0));
    Array<> out = own(right);
    if (!solve_matrix(own(given), out)) throw std::runtime_error("the matrix is singular");
    return numpy_matrix(out);
}

/// The lower triangular L of matrix = L L'.
NewMatrix bound_cholesky(InMatrix given) {
    require_square(given);
    Array<> lower;
    if (!cholesky(view(given), lower)) throw std::runtime_error("the matrix is not positive definite");
    return numpy_matrix(lower);
}

nb::tuple undamped_modes(InMatrix mass, InMatrix stiffness) {
    require_square(mass);
    require_square(stiffness);
    require_size("coordinates", stiffness.shape(0), mass.shape(0));
    UndampedModes found;
    const auto outcome = found.find(view(mass), view(stiffness));
    if (outcome == UndampedModes::INDEFINITE) throw nb::value_error("the mass matrix is not positive definite");
    if (outcome == UndampedModes::UNSETTLED)
        throw std::runtime_error(("Jacobi's method did not diagonalise a matrix of size " + std::to_string(mass.shape(0))).c_str());
    return nb::make_tuple(numpy_of(found.squares), numpy_matrix(found.shapes));
}

/// The orthogonal Q of matrix = Q R by reflections, which change the sign of a diagonal entry of R where there is more than it.
NewMatrix orthonormal(InMatrix given) {
    Array<> matrix = own(given), q = identity(matrix.rows());
    std::vector<double> v(matrix.rows());
    for (int k = 0; k < std::min(matrix.rows(), matrix.columns()); ++k) {
        for (int r = 0; r < matrix.rows(); ++r) v[r] = matrix(r, k);
        if (v[k] == 0.0) v[k] = std::numeric_limits<double>::min();  // a reflection as of a positive entry
        const double factor = reflector(v, k, matrix.rows());
        if (factor == 0.0) continue;
        reflect_from_left(matrix, v, k, factor);
        reflect_columns(q, v, k, factor);
    }
    return numpy_matrix(q);
}

nb::tuple singular_directions(InMatrix given) {
    const Matrix<const double> matrix = view(given);
    const int size = matrix.columns();
    Array<> turned(size, matrix.rows()), directions = identity(size);
    for (int r = 0; r < matrix.rows(); ++r)
        for (int c = 0; c < size; ++c) turned(c, r) = matrix(r, c);
    std::vector<double> values(size, 0.0);
    const auto turn = [&](int i, int j, const Rotation& rotation) {
        for (int c = 0; c < size; ++c) rotation.turn(directions(i, c), directions(j, c));
    };
    const double rounding = EPSILON * EPSILON * sum_of_squares(matrix);  // what is left of rows beyond the rank
    if (matrix.rows() > 0 && !singular_values(turned, values, rounding, turn)) throw std::runtime_error("singular values did not converge");
    std::vector<int> order(size);
    for (int k = 0; k < size; ++k) order[k] = k;
    std::stable_sort(order.begin(), order.end(), [&](int i, int j) { return values[i] > values[j]; });
    NewVector sorted = new_vector(size);
    NewMatrix out = new_matrix(size, size);
    for (int k = 0; k < size; ++k) {
        sorted.data()[k] = values[order[k]];
        std::copy(directions[order[k]].begin(), directions[order[k]].end(), out.data() + size_t(k) * size);
    }
    return nb::make_tuple(sorted, out);
}

nb::object sylvester(InMatrix a, InMatrix b, InMatrix c) {
    require_square(a);
    require_square(b);
    require_size("rows", c.shape(0), a.shape(0));
    require_size("columns", c.shape(1), b.shape(0));
    Array<> x(int(c.shape(0)), int(c.shape(1)));
    if (!solve_sylvester(view(a), view(b), view(c), x)) return nb::none();
    return nb::cast(numpy_matrix(x));
}

}  // namespace

void bind_dense(nb::module_& m) {
    m.def("product", bound_product, nb::arg("left"), nb::arg("right"), "left right; each entry is summed in the order of the columns.");
    m.def("solve", bound_solve, nb::arg("matrix"), nb::arg("right"), "X of matrix X = right. RuntimeError for a singular matrix.");
    m.def("cholesky", bound_cholesky, nb::arg("matrix"),
          "The lower triangular L of matrix = L L'. RuntimeError for a matrix that is not positive definite.");
    m.def("undamped_modes", undamped_modes, nb::arg("mass"), nb::arg("stiffness"),
          "Squared frequencies (n,), ascending, and shapes (n, n) as columns. ValueError for masses that are not positive definite.");
    m.def("orthonormal", orthonormal, nb::arg("matrix"), "The orthogonal Q (n, n) of matrix = Q R.");
    m.def("singular_directions", singular_directions, nb::arg("matrix"),
          "Singular values (k,) of a matrix (m, k), descending, and orthonormal rows (k, k) in whose direction it has them.");
    m.def(
        "schur",
        [](InMatrix matrix) {
            require_square(matrix);
            const SchurForm found(own(matrix));
            return nb::make_tuple(numpy_matrix(found.t), numpy_matrix(found.q));
        },
        nb::arg("matrix"), "(t, q), matrix = q t q': t is real, with blocks of one real rate or of a complex pair.");
    m.def(
        "move_block",
        [](InMatrix t, InMatrix q, int from, int to) {
            SchurForm form(own(t), own(q));
            if (!(0 <= to && to <= from && from < form.size())) throw nb::value_error("a block moves up, inside the matrix");
            for (int k : {from, to})
                if (k > 0 && form.t(k, k - 1) != 0.0) throw nb::value_error("a block begins elsewhere");
            if (!form.move(from, to)) throw std::domain_error("two blocks have equal rates");
            return nb::make_tuple(numpy_matrix(form.t), numpy_matrix(form.q));
        },
        nb::arg("t"), nb::arg("q"), nb::arg("from_"), nb::arg("to"),
        "The Schur form (t, q) whose block at `from_` is at `to`. ValueError where the block cannot be exchanged with one between.");
    m.def("sylvester", sylvester, nb::arg("a"), nb::arg("b"), nb::arg("c"),
          "X of a X - X b = c for b in Schur form; None where a and b share a rate.");
}

}  // namespace saltus
