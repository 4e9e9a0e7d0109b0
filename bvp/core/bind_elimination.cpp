/// Python's view of the block elimination alone, for its tests.
#include "bindings.hpp"
#include "elimination.hpp"

namespace saltus {

void bind_elimination(nb::module_& m) {
    using Elimination = BlockElimination<>;
    nb::class_<Elimination>(m, "BlockElimination",
                            "Orthogonal elimination of a block-bidiagonal Jacobian, equation (32).")
        .def(
            "__init__",
            [](Elimination* self, int blocks, int block_size, int start, int closers, bool couples) {
                for (int each : {blocks, block_size, start, closers}) require_index("a size", each, 300);
                if (block_size < 1 || start < 1 || closers < 1 || start > closers + 1)
                    throw nb::value_error("a block has equations and unknowns");
                new (self) Elimination(blocks, block_size, start, closers, couples);
            },
            nb::arg("blocks"), nb::arg("block_size"), nb::arg("start"), nb::arg("closers"), nb::arg("couples"))
        .def(
            "factorise",
            [](Elimination& self, InMatrix jacobian, InVector least) {
                const Matrix<const double> entries = view(jacobian);
                const int blocks = self.blocks(), block_size = self.block_size();
                require_size("unknowns", entries.columns(), self.unknowns());
                require_size("equations", entries.rows(), self.unknowns() - 1);
                require_size("lengths", least.shape(0), entries.rows() - blocks * block_size);
                self.clear();
                for (int row = 0; row < entries.rows(); ++row)
                    for (int c = 0; c < entries.columns(); ++c) {
                        const int i = row / block_size, e = row % block_size;
                        if (entries(row, c) == 0.0) continue;
                        if (i < blocks && !self.has(i, c))
                            throw nb::value_error("a matrix has an entry outside the pattern");
                        if (i >= blocks) self.closing(c)[row - blocks * block_size] = entries(row, c);
                        else self.entries(i, c)[e] = entries(row, c);
                    }
                const auto found = self.factorise(view(least));
                return std::make_tuple(found.sign, found.smallest);
            },
            "Factorise a dense matrix with the pattern: sign of the determinant with the null vector, smallest pivot.")
        .def(
            "solve",
            [](Elimination& self, InVector right) {
                require_size("equations", right.shape(0), self.unknowns() - 1);
                std::vector<double> values = own(right);
                NewVector out = new_vector(self.unknowns());
                self.solve(values, {out.data(), size_t(self.unknowns())});
                return out;
            },
            "The least-norm solution.")
        .def("null_vector",
             [](Elimination& self) {
                 NewVector out = new_vector(self.unknowns());
                 self.null_vector({out.data(), size_t(self.unknowns())});
                 return out;
             })
        .def("conditioning", [](Elimination& self) {
            std::vector<double> scratch(self.unknowns() - 1);
            return self.conditioning(scratch);
        });
}

}  // namespace saltus
