/// Python's view of flights with smooth forces.
#include <algorithm>

#include <nanobind/stl/shared_ptr.h>

#include "bind_program.hpp"
#include "smooth_flight.hpp"

namespace saltus {

namespace {

using Flight = SmoothFlight<>;

/// Forces that are Python functions. An error that one raises goes through all that calls it.
std::shared_ptr<const CalledForces> called_forces(nb::object forces, nb::object energy) {
    auto out = std::make_shared<CalledForces>();
    out->forces = [forces = std::move(forces)](Matrix<double> values, int count) {
        const nb::gil_scoped_acquire held;
        NewMatrix shown = new_matrix(values.rows(), values.columns());  // the function may keep it
        double* entries = shown.data();
        const size_t size = shown.size();
        std::copy(values.data(), values.data() + size, entries);
        nb::object array = nb::cast(std::move(shown));
        forces(array, count);
        std::copy(entries, entries + size, values.data());
    };
    out->energy = [energy = std::move(energy)](Values inputs) {
        const nb::gil_scoped_acquire held;
        return nb::cast<double>(energy(numpy_of(inputs)));
    };
    return out;
}

nb::object bound(const std::shared_ptr<const TaylorPath>& path) {
    return path ? nb::cast(std::const_pointer_cast<TaylorPath>(path)) : nb::none();
}

void check(const Flight& self, const InVector& z) { require_size("the state", z.shape(0), self.size()); }

}  // namespace

void bind_smooth(nb::module_& m) {
    m.attr("ORDER") = ORDER;
    m.attr("MOST_TAYLOR_STEPS") = MOST_TAYLOR_STEPS;
    nb::class_<TaylorPath>(m, "TaylorPath", "The Taylor steps of a flight.")
        .def_ro("complete", &TaylorPath::complete, "Whether it could be computed to its end.")
        .def_ro("exhausted", &TaylorPath::exhausted, "Whether it would take more steps than it may.")
        .def_ro("duration", &TaylorPath::duration)
        .def_prop_ro("times", [](const TaylorPath& self) { return numpy_of(self.times); }, nb::rv_policy::move,
                     "Times (S + 1,) at which the steps begin, and the last one ends, by size.")
        .def_prop_ro("coefficients",
                     [](const TaylorPath& self) {
                         return new_cube(self.coefficients, self.steps(), ORDER + 1, self.size());
                     },
                     nb::rv_policy::move,
                     "(S, ORDER + 1, N) of the states in the steps.")
        .def_prop_ro("end", [](const TaylorPath& self) { return numpy_of(self.end); }, nb::rv_policy::move,
                     "(N,); empty where it has none.")
        .def_prop_ro("map",
                     [](const TaylorPath& self) {
                         NewMatrix out = new_matrix(self.map.rows(), self.map.columns());
                         std::copy(self.map.data(), self.map.data() + self.map.rows() * self.map.columns(), out.data());
                         return out;
                     },
                     nb::rv_policy::move, "(N, N) derivative of the end by the begin; empty where it was not asked for.");
    nb::class_<Flight>(m, "SmoothFlight", "Flights z' = B z + P f(W z) with smooth forces, by Taylor series. Threads can share it.")
        .def("__init__",
             [](Flight* self, InMatrix matrix, InMatrix inputs, InMatrix push, InVector weights, InPairs code, InVector numbers,
                InIndices forces, InPairs slopes, int registers, InPairs potential_code, InVector potential_constants,
                InIndices potential_outputs, int keep, nb::object called, nb::object energy, int most_steps) {
                 const size_t size = matrix.shape(0);
                 if (size == 0 || size % 2 || matrix.shape(1) != size)
                     throw nb::value_error("the matrix of a flight is square, of displacements and velocities");
                 require_size("the rows of inputs", inputs.shape(1), size);
                 require_size("the accelerations of forces", push.shape(0), size / 2);
                 require_size("the forces", forces.shape(0), push.shape(1));
                 require_size("weights", weights.shape(0), size);
                 require_size("the potential", potential_outputs.shape(0), 1);
                 require_flights(keep, most_steps);
                 require_registers(registers, int(inputs.shape(0)));
                 if (!called.is_none() && energy.is_none()) throw nb::value_error("forces that are called need an energy");
                 SmoothEquations equations;
                 equations.linear = SparseRows(view(matrix).rows(int(size / 2), int(size / 2)));
                 equations.inputs = SparseRows(view(inputs));
                 equations.dense_push = own(push);
                 equations.push = SparseRows(view(push));
                 equations.weights = own(weights);
                 equations.program = force_program(int(inputs.shape(0)), code, numbers, forces, slopes, registers);
                 equations.numbers = equations.program.numbers;
                 equations.potential = formulas(int(inputs.shape(0)), potential_code, potential_constants, potential_outputs);
                 equations.most_steps = most_steps;
                 if (!called.is_none()) equations.called = called_forces(std::move(called), std::move(energy));
                 new (self) Flight(std::move(equations), keep);
             },
             nb::arg("matrix"), nb::arg("inputs"), nb::arg("push"), nb::arg("weights"), nb::arg("code"), nb::arg("numbers"),
             nb::arg("forces"), nb::arg("slopes"), nb::arg("registers"), nb::arg("potential_code"), nb::arg("potential_constants"),
             nb::arg("potential_outputs"), nb::arg("keep") = 16, nb::arg("called") = nb::none(), nb::arg("energy") = nb::none(),
             nb::arg("most_steps") = MOST_TAYLOR_STEPS,
             "called: a function that writes forces and derivatives below the inputs, in the first columns of an array, as many as its "
             "second argument; energy: that of the inputs. They take the place of the operations and of the potential.")
        .def_prop_ro("is_called", [](const Flight& self) { return bool(self.equations().called); }, "Whether its forces are a function.")
        .def_prop_ro("size", &Flight::size)
        .def("end",
             [](const Flight& self, InVector z, double t) {
                 check(self, z);
                 NewVector out = new_vector(self.size());
                 self.end(view(z), t, Vector<double>(out.data(), self.size()));
                 return out;
             },
             nb::arg("z"), nb::arg("t"), "State after a flight of time t; NaN where it has none.")
        .def("end_with_map",
             [](const Flight& self, InVector z, double t) {
                 check(self, z);
                 NewVector out = new_vector(self.size());
                 NewMatrix map = new_matrix(self.size(), self.size());
                 self.end(view(z), t, Vector<double>(out.data(), self.size()), Matrix<double>(map.data(), self.size(), self.size()));
                 return std::make_pair(out, map);
             },
             nb::arg("z"), nb::arg("t"), "The same, with its derivative by z.")
        .def("end_along",
             [](const Flight& self, InVector z, double t, InVector dz, double dt) {
                 check(self, z), check(self, dz);
                 using Number = Jet<double, 1>;
                 std::vector<Number> begin, end(self.size());
                 for (int r = 0; r < self.size(); ++r) {
                     begin.emplace_back(z.data()[r]);
                     begin.back().slopes[0] = dz.data()[r];
                 }
                 Number time(t);
                 time.slopes[0] = dt;
                 self.end(begin, time, end);
                 NewVector out = new_vector(self.size());
                 for (int r = 0; r < self.size(); ++r) out.data()[r] = end[r].slopes[0];
                 return out;
             },
             nb::arg("z"), nb::arg("t"), nb::arg("dz"), nb::arg("dt"), "The derivative of the end along a direction, by jets.")
        .def("rate",
             [](const Flight& self, InVector z) {
                 check(self, z);
                 NewVector out = new_vector(self.size());
                 self.rate(view(z), Vector<double>(out.data(), self.size()));
                 return out;
             },
             nb::arg("z"), "z'.")
        .def("twice_energy",
             [](const Flight& self, InVector z) {
                 check(self, z);
                 return self.twice_energy(view(z));
             },
             nb::arg("z"), "2 H.")
        .def("energy_slope",
             [](const Flight& self, InVector z) {
                 check(self, z);
                 NewVector out = new_vector(self.size());
                 self.energy_slope(view(z), Vector<double>(out.data(), self.size()));
                 return out;
             },
             nb::arg("z"), "grad H.")
        .def("energy_bend",
             [](const Flight& self, InVector z) {
                 check(self, z);
                 NewMatrix out = new_matrix(self.size(), self.size());
                 Matrix<double> entries(out.data(), self.size(), self.size());
                 std::fill(out.data(), out.data() + self.size() * self.size(), 0.0);
                 self.bend(view(z), 1.0, [&](int r, int c, double entry) { entries(r, c) += entry; });
                 return out;
             },
             nb::arg("z"), "The second derivative of H.")
        .def("path",
             [](const Flight& self, InVector z, double t, bool with_map) {
                 check(self, z);
                 return bound(self.fly(view(z), t, with_map));
             },
             nb::arg("z"), nb::arg("t"), nb::arg("with_map") = false, "The steps of a flight.")
        .def_prop_ro("failure", [](const Flight& self) { return bound(self.failure()); },
                     "The flight that was asked for last, if it has no end; else None.");
}

}  // namespace saltus
