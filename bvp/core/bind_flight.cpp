/// Python's view of linear flights and contacts.
#include "bindings.hpp"
#include "contact.hpp"
#include "linear_flight.hpp"

namespace saltus {

namespace {

/// The blocks of `bvp.modes.Modes`: pairs (P, 2), mean (P,), delta (P,), matrix (N, N).
template <int N>
LinearFlight<N> make_flight(InPairs pairs, InVector mean, InVector delta, InMatrix matrix, InVector weights) {
    const Matrix<const double> b = view(matrix);
    const int count = int(pairs.shape(0)), size = b.rows();
    require_size("mean", mean.shape(0), count);
    require_size("delta", delta.shape(0), count);
    require_size("weights", weights.shape(0), size);
    if (b.columns() != size || size < 1 || (N != DYNAMIC && size != N))
        throw nb::value_error("the matrix of a flight is square");
    if (pairs.shape(1) != 2) throw nb::value_error("a block has two indices");
    std::vector<Block> blocks;
    std::vector<int> blocks_of(size, 0);
    for (int k = 0; k < count; ++k) {
        const int64_t first = pairs.data()[2 * k], second = pairs.data()[2 * k + 1];
        if (first < 0 || first >= size || second >= size || second < -size || (second < 0 && first - second > size))
            throw nb::value_error("a block is outside the matrix");
        const int i = int(first), j = int(second);
        for (int r = i; r < (j < 0 ? i - j : i + 1); ++r) ++blocks_of[r];
        if (j >= 0) ++blocks_of[j];
        Block block{i, j, mean.data()[k], delta.data()[k]};
        if (j >= 0) block.b11 = b(i, i), block.b12 = b(i, j), block.b21 = b(j, i), block.b22 = b(j, j);
        blocks.push_back(block);
    }
    for (int number : blocks_of)
        if (number != 1) throw nb::value_error("each entry of a state is in one block");
    return LinearFlight<N>(std::move(blocks), own(matrix), own(weights));
}

}  // namespace

void bind_flight(nb::module_& m) {
    using Flight = LinearFlight<>;
    nb::class_<Flight>(m, "LinearFlight", "Exact flight z' = B z, with B in blocks.")
        .def("__init__",
             [](Flight* self, InPairs pairs, InVector mean, InVector delta, InMatrix matrix, InVector weights) {
                 new (self) Flight(make_flight<DYNAMIC>(pairs, mean, delta, matrix, weights));
             },
             nb::arg("pairs"), nb::arg("mean"), nb::arg("delta"), nb::arg("matrix"), nb::arg("weights"))
        .def_prop_ro("size", &Flight::size)
        .def("end",
             [](const Flight& self, InVector z, double t) {
                 require_size("the state", z.shape(0), self.size());
                 NewVector out = new_vector(self.size());
                 self.end(view(z), t, Vector<double>(out.data(), self.size()));
                 return out;
             },
             nb::arg("z"), nb::arg("t"), "State after a flight of time t.")
        .def("map",
             [](const Flight& self, double t) {
                 NewMatrix out = new_matrix(self.size(), self.size());
                 self.map(t, Matrix<double>(out.data(), self.size(), self.size()));
                 return out;
             },
             nb::arg("t"), "exp(B t).")
        .def_prop_ro("fastest", &Flight::fastest, "A bound of the rates of all blocks.")
        .def("rate",
             [](const Flight& self, InVector z) {
                 require_size("the state", z.shape(0), self.size());
                 NewVector out = new_vector(self.size());
                 self.rate(view(z), Vector<double>(out.data(), self.size()));
                 return out;
             },
             nb::arg("z"), "z' = B z.")
        .def("bounds",
             [](const Flight& self, InVector row, InVector z, double horizon) {
                 require_size("the row", row.shape(0), self.size());
                 require_size("the state", z.shape(0), self.size());
                 const Bounds found = self.bounds(view(row), view(z), horizon);
                 return std::make_tuple(found.level, found.second, found.third);
             },
             nb::arg("row"), nb::arg("z"), nb::arg("horizon"), "Bounds of |f|, |f''| and |f'''| for f = row . z(t).");
    nb::class_<Contacts>(m, "Contacts", "Rows and bounds of the contacts, of N entries a row.")
        .def("__init__",
             [](Contacts* self, InMatrix gap, InMatrix rate, InMatrix acceleration, InVector side, InVector bound, InMatrix push,
                InVector restitution) {
                 for (const InMatrix* rows : {&rate, &acceleration, &push})
                     if (rows->shape(0) != gap.shape(0) || rows->shape(1) != gap.shape(1))
                         throw nb::value_error("the rows of contacts have different shapes");
                 for (const InVector* values : {&side, &bound, &restitution})
                     require_size("a property of contacts", values->shape(0), gap.shape(0));
                 new (self) Contacts{own(gap), own(rate), own(acceleration), own(push), own(side), own(bound), own(restitution)};
             },
             nb::arg("gap"), nb::arg("rate"), nb::arg("acceleration"), nb::arg("side"), nb::arg("bound"), nb::arg("push"),
             nb::arg("restitution"));
}

}  // namespace saltus
