/// Python's view of multipoint problems.
#include <nanobind/stl/string.h>

#include "bind_orbit.hpp"

namespace saltus {

namespace {

using Released = nb::call_guard<nb::gil_scoped_release>;

/// The arrays that a step fills, with their sizes checked.
Landing landing_of(const BoundAny& self, OutVector& y, OutVector& tangent, OutVector& position, OutMatrix& ends,
                   OutVector& result) {
    const size_t u = self.unknowns(), n = self.any->size(), flights = self.any->inner() + 1;
    require_size("unknowns", y.shape(0), u);
    if (tangent.shape(0) != 2 * u && tangent.shape(0) != 3 * u) require_size("a tangent", tangent.shape(0), 2 * u);
    require_size("a position", position.shape(0), self.any->coordinates());
    require_size("flights", ends.shape(0), flights);
    require_size("a state", ends.shape(1), n);
    require_size("a point", result.shape(0), POINT_SIZE);
    return {view(y), view(tangent), view(position), Vector<double>(ends.data(), flights * n)};
}

bool bound_step(BoundAny& self, InVector y, InVector tangent, double ds, int maximum, bool full, OutVector out_y,
                OutVector out_tangent, OutVector out_position, OutMatrix out_ends, OutVector out_point) {
    require_size("unknowns", y.shape(0), self.unknowns());
    if (tangent.shape(0) < 2 * self.unknowns()) require_size("a tangent", tangent.shape(0), 2 * self.unknowns());
    require_iterations(maximum);
    const Landing landing = landing_of(self, out_y, out_tangent, out_position, out_ends, out_point);
    Point point;
    const bool found = self.any->step(view(y), view(tangent), ds, maximum, full, landing, point);
    point.write(out_point.data());
    return found;
}

bool bound_correct(BoundAny& self, InVector y, InVector row, double target, int maximum, OutVector out_y,
                   OutVector out_tangent, OutVector out_position, OutMatrix out_ends, OutVector out_point) {
    require_size("unknowns", y.shape(0), self.unknowns());
    require_size("a row", row.shape(0), self.unknowns());
    require_iterations(maximum);
    const Landing landing = landing_of(self, out_y, out_tangent, out_position, out_ends, out_point);
    Point point;
    const bool found = self.any->correct(view(y), view(row), target, maximum, landing, point);
    point.write(out_point.data());
    return found;
}

std::tuple<int, double, double> bound_solve(BoundProblem& self, InVector y, double energy, double quarter_period,
                                            OutVector out_y, OutVector out_tangent, OutVector out_position,
                                            OutMatrix out_ends, OutVector out_point) {
    require_size("unknowns", y.shape(0), self.unknowns());
    const Landing landing = landing_of(self, out_y, out_tangent, out_position, out_ends, out_point);
    Point point;
    std::vector<double> at = own(y);
    const auto found = self.problem->solve(at, energy, quarter_period, landing, point);
    point.write(out_point.data());
    return found;
}

nb::tuple bound_unfold(BoundProblem& self, InVector y) {
    require_size("unknowns", y.shape(0), self.unknowns());
    Period period;
    self.problem->unfold(view(y), period);
    const Nodes nodes = period.nodes();
    std::vector<int> node(period.node().begin(), period.node().end());
    return nb::make_tuple(numpy_matrix(nodes.before), numpy_matrix(nodes.after), numpy_of(nodes.duration), node, period.lead());
}

nb::tuple bound_course(BoundAny& self, InVector y, InVector tangent) {
    require_size("unknowns", y.shape(0), self.unknowns());
    require_size("a tangent", tangent.shape(0), self.unknowns());
    const int size = self.any->coordinates();
    NewVector position = new_vector(size), direction = new_vector(size);
    const Course found = self.any->course(view(y), view(tangent), {position.data(), size_t(size)},
                                              {direction.data(), size_t(size)});
    return nb::make_tuple(position, direction, found.energy, found.alpha, found.change, found.length);
}

bool bound_meet(BoundProblem& self, InVector position, double near, int most, InVector y, InVector tangent,
                OutVector out_y, OutVector out_tangent, OutVector out_position, OutMatrix out_ends,
                OutVector out_point) {
    require_size("unknowns", y.shape(0), self.unknowns());
    if (tangent.shape(0) < self.unknowns()) require_size("a tangent", tangent.shape(0), self.unknowns());
    require_size("a position", position.shape(0), self.problem->size() + 2);
    require_iterations(most);
    const Landing landing = landing_of(self, out_y, out_tangent, out_position, out_ends, out_point);
    return self.problem->meet_position(view(position), near, most, view(y), view(tangent).first(self.unknowns()),
                                       landing);
}

/// Directions of a derivative, one in a row.
NewVector bound_derivative(BoundAny& self, InVector y, InMatrix directions) {
    const size_t u = self.unknowns();
    require_size("unknowns", y.shape(0), u);
    require_size("a direction", directions.shape(1), u);
    NewVector out = new_vector(int(u) - 1);
    const Matrix<const double> a = view(directions);
    Vector<double> values(out.data(), u - 1);
    if (a.rows() == 2) self.any->bend(view(y), a[0], a[1], values);
    else if (a.rows() == 3) self.any->twist(view(y), a[0], a[1], a[2], values);
    else throw nb::value_error("a second derivative has two directions, a third one three");
    return out;
}

/// The constructor for one kind of flight.
template <class Flight, class Class>
void define_constructor(Class& bound) {
    bound.def(
        "__init__",
        [](BoundProblem* self, const Flight& flight, const Contacts& contacts, InIndices contact,
           std::pair<int, int> ends, int quarters, int pace, InMatrix start_map, InVector start_offset,
           InMatrix end_map, InVector end_offset, InMatrix observed, InVector lower, InVector upper, InMatrix held,
           InMatrix free, bool general) {
            for (int end : {ends.first, ends.second})
                if (end < 0 || end > int(End::PERIODIC)) throw nb::value_error("unknown kind of end");
            Closure closure{End(ends.first), End(ends.second), quarters,          pace,
                            own(start_map),  own(end_map),     own(start_offset), own(end_offset)};
            new (self) BoundProblem(flight, contacts, {contact.data(), contact.data() + contact.shape(0)},
                                    std::move(closure),
                                    Watch{{own(observed), own(lower), own(upper)}, own(held), own(free), general});
        },
        nb::arg("flight"), nb::arg("contacts"), nb::arg("contact"), nb::arg("ends"), nb::arg("quarters"),
        nb::arg("pace"), nb::arg("start_map"), nb::arg("start_offset"), nb::arg("end_map"), nb::arg("end_offset"),
        nb::arg("observed"), nb::arg("lower"), nb::arg("upper"), nb::arg("held"), nb::arg("free"),
        nb::arg("general") = false,
        "general: take what is compiled for any number of states, and holds for it, also where there are four.");
}

}  // namespace

void bind_orbit(nb::module_& m) {
    m.attr("POINT_NAMES") = nb::cast(std::vector<std::string>(POINT_NAMES.begin(), POINT_NAMES.end()));
    nb::class_<BoundAny>(m, "AnyProblem", "A multipoint problem.")
        .def_prop_ro("unknowns", &BoundAny::unknowns)
        .def(
            "residual",
            [](BoundAny& self, InVector y) {
                require_size("unknowns", y.shape(0), self.unknowns());
                NewVector out = new_vector(int(self.unknowns()) - 1);
                self.any->residual(view(y), {out.data(), self.unknowns() - 1});
                return out;
            },
            nb::arg("y"), "F(y).")
        .def(
            "jacobian",
            [](BoundAny& self, InVector y) {
                const int u = int(self.unknowns());
                require_size("unknowns", y.shape(0), u);
                NewMatrix out = new_matrix(u - 1, u);
                self.any->jacobian(view(y), Matrix<double>(out.data(), u - 1, u));
                return out;
            },
            nb::arg("y"), "F'(y), dense.")
        .def("derivative", &bound_derivative, nb::arg("y"), nb::arg("directions"),
             "The second derivative along two directions, or the third along three: the rows of `directions`.")
        .def(
            "scales",
            [](BoundAny& self, InVector y) {
                require_size("unknowns", y.shape(0), self.unknowns());
                NewVector out = new_vector(int(self.unknowns()));
                self.any->scales(view(y), {out.data(), self.unknowns()});
                return out;
            },
            nb::arg("y"), "Typical size of each unknown.")
        .def(
            "observe",
            [](BoundAny& self, InVector y, InMatrix ends, OutVector out_point) {
                require_size("unknowns", y.shape(0), self.unknowns());
                require_size("states", ends.size(), (self.any->inner() + 1) * self.any->size());
                require_size("a point", out_point.shape(0), POINT_SIZE);
                Point point = Point::read(out_point.data());
                self.any->observe(view(y), {ends.data(), ends.size()}, point);
                point.write(out_point.data());
            },
            nb::arg("y"), nb::arg("ends"), nb::arg("point"),
            "Fill what is seen along an orbit's flights, and its multipliers.")
        .def("course", &bound_course, nb::arg("y"), nb::arg("tangent"),
             "(position, direction along a tangent, energy, quarter period, change of the energy, length of the direction).")
        .def(
            "constraint_row",
            [](BoundAny& self, InVector y, InVector direction) {
                require_size("unknowns", y.shape(0), self.unknowns());
                require_size("a direction", direction.shape(0), self.any->coordinates());
                NewVector out = new_vector(int(self.unknowns()));
                self.any->constraint_row(view(y), view(direction), {out.data(), self.unknowns()});
                return out;
            },
            nb::arg("y"), nb::arg("direction"), "The row r with r . dy = <direction, change of the position along dy>.")
        .def("step", &bound_step, Released(), "Step by ds along the family from y with its tangent; fills the arrays.")
        .def("correct", &bound_correct, Released(), "Correct y on the plane row . y = target; fills the arrays.");
    nb::class_<BoundProblem, BoundAny> bound(m, "OrbitProblem", "The multipoint problem of an impacting orbit, equation (30).");
    define_constructor<LinearFlight<>>(bound);
    define_constructor<SmoothFlight<>>(bound);
    bound
        .def(
            "growth",
            [](BoundProblem& self, InVector y) {
                require_size("unknowns", y.shape(0), self.unknowns());
                return self.problem->growth(view(y));
            },
            nb::arg("y"), "The largest factor by which perturbations grow along a flight.")
        .def("unfold", &bound_unfold, nb::arg("y"),
             "The nodes of the full period: states before and after them, the durations of the flights that follow, the node of the "
             "problem that each is an image of, and the time to the first one.")
        .def(
            "end_states",
            [](BoundProblem& self, InVector y) {
                require_size("unknowns", y.shape(0), self.unknowns());
                const int flights = self.problem->inner() + 1, n = self.problem->size();
                NewMatrix out = new_matrix(flights, n);
                self.problem->end_states(view(y), {out.data(), size_t(flights) * n});
                return out;
            },
            nb::arg("y"), "State at the end of each flight.")
        .def(
            "nodes",
            [](BoundProblem& self, InVector start, InVector times) {
                const int k = self.problem->inner(), n = self.problem->size();
                require_size("a state", start.shape(0), n);
                if (int(times.shape(0)) < k) require_size("times", times.shape(0), k);
                NewMatrix out = new_matrix(k, n);
                self.problem->nodes(view(start), view(times), {out.data(), size_t(k) * n});
                return out;
            },
            nb::arg("start"), nb::arg("times"), "States after the inner nodes, by exact flight.")
        .def("solve", &bound_solve, Released(), "Solve near y at an energy or a quarter period; fills the arrays.")
        .def("meet_position", &bound_meet, Released(), "Find the family's orbit at a position; fills the arrays.");
}

}  // namespace saltus
