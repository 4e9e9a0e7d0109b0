/// Python's view of families of orbits, and of step control.
#include "bind_orbit.hpp"

namespace saltus {

namespace {

using Released = nb::call_guard<nb::gil_scoped_release>;
using NumbersOfControl = std::array<double, 8>;

Control control_of(const NumbersOfControl& c) { return {c[0], c[1], c[2], c[3], c[4], c[5], c[6], c[7]}; }

/// The arrays of `StepRows`, with their sizes checked: y, tangent, position, ends, point, tests, lengths.
class Rows {
public:
    Rows(const BoundAny& problem, const FamilySettings& family, OutMatrix& y, OutMatrix& tangent,
         OutMatrix& position, OutCube& ends, OutMatrix& point, OutMatrix& tests, OutMatrix& lengths)
        : rows{view(y),        view(tangent),
               view(position), Matrix<double>(ends.data(), int(ends.shape(0)), int(ends.shape(1) * ends.shape(2))),
               view(point),    view(tests),
               view(lengths)} {
        const AnyProblem& any = *problem.any;
        const int u = any.unknowns(), count = rows.y.rows();
        const auto check = [count](const char* name, const Matrix<double>& array, int columns) {
            require_size("steps", array.rows(), count);
            require_size(name, array.columns(), columns);
        };
        check("unknowns", rows.y, u);
        check("a tangent", rows.tangent, rows.tangent.columns() == 3 * u ? 3 * u : 2 * u);
        check("a position", rows.position, any.coordinates());
        check("the ends of flights", rows.ends, (any.inner() + 1) * any.size());
        check("a point", rows.point, POINT_SIZE);
        check("test functions", rows.tests, family.computed);
        check("lengths", rows.lengths, 2);
        if (count < 1) throw nb::value_error("there is no row for a step");
    }
    StepRows rows;
};

class BoundFamily {
public:
    BoundFamily(BoundAny& bound, FamilySettings chosen) : problem(bound), settings(std::move(chosen)) {}
    BoundAny& problem;
    FamilySettings settings;

    void check(const InVector& y, const InVector& tangent, size_t most = 2) const {
        require_size("unknowns", y.shape(0), problem.unknowns());
        if (tangent.shape(0) < most * problem.unknowns())
            require_size("a tangent", tangent.shape(0), most * problem.unknowns());
    }
};

bool bound_land(BoundFamily& self, InVector y, InVector tangent, double ds, OutMatrix out_y, OutMatrix out_tangent,
                OutMatrix out_position, OutCube out_ends, OutMatrix out_point, OutMatrix out_tests,
                OutMatrix out_lengths) {
    self.check(y, tangent);
    const Rows block(self.problem, self.settings, out_y, out_tangent, out_position, out_ends, out_point, out_tests,
                     out_lengths);
    return self.problem.any->land(self.settings, view(y), view(tangent), ds, block.rows);
}

void bound_values(BoundFamily& self, InVector y, InMatrix ends, InVector point, OutVector out) {
    require_size("unknowns", y.shape(0), self.problem.unknowns());
    require_size("states", ends.size(), (self.problem.any->inner() + 1) * self.problem.any->size());
    require_size("a point", point.shape(0), POINT_SIZE);
    require_size("test functions", out.shape(0), self.settings.computed);
    if (self.settings.computed == 1) throw nb::value_error("this family has no test function but the fold");
    self.problem.any->test_values(self.settings, view(y), {ends.data(), ends.size()}, Point::read(point.data()),
                                      view(out));
}

std::tuple<int, bool, double> bound_advance(BoundFamily& self, InVector y, InVector tangent, InVector position,
                                            InVector tests, InVector older, InVector oldest, double before,
                                            double first, InVector goal, InVector direction, double ds,
                                            NumbersOfControl control, OutMatrix out_y, OutMatrix out_tangent,
                                            OutMatrix out_position, OutCube out_ends, OutMatrix out_point,
                                            OutMatrix out_tests, OutMatrix out_lengths) {
    self.check(y, tangent);
    const size_t coordinates = self.problem.any->coordinates(), watched = self.settings.watched.kinds.size();
    for (const InVector* array : {&position, &goal, &direction})
        require_size("a position", array->shape(0), coordinates);
    for (const InVector* array : {&tests, &older, &oldest})
        if (array->shape(0) < watched) require_size("test functions", array->shape(0), watched);
    const Rows block(self.problem, self.settings, out_y, out_tangent, out_position, out_ends, out_point, out_tests,
                     out_lengths);
    const Beginning begin{view(y),     view(tangent), view(position), view(tests),
                          view(older), view(oldest),  before,         first};
    const Advanced found = self.problem.any->advance(self.settings, begin, {view(goal), view(direction)}, ds,
                                                         control_of(control), block.rows);
    return {found.count, found.tried, found.ds};
}

std::tuple<int, int> bound_narrow(BoundFamily& self, InVector y, InVector tangent, double low, InVector low_y,
                                  InVector low_slope, double high, InVector high_y, InVector high_slope, double length,
                                  int test, double tolerance, double least_turn, std::vector<double> places,
                                  std::vector<double> values, int at, OutMatrix out_y, OutMatrix out_tangent,
                                  OutMatrix out_position, OutCube out_ends, OutMatrix out_point, OutMatrix out_tests,
                                  OutMatrix out_lengths) {
    self.check(y, tangent, 1);
    self.check(low_y, low_slope, 1);
    self.check(high_y, high_slope, 1);
    if (test < 0 || test >= self.settings.computed) throw nb::value_error("there is no such test function");
    require_size("values", values.size(), places.size());
    const bool samples = length != length || out_y.shape(0) > 1;
    if (samples && (at < 1 || at >= int(places.size()))) throw nb::value_error("a zero is between two samples");
    const Rows block(self.problem, self.settings, out_y, out_tangent, out_position, out_ends, out_point, out_tests,
                     out_lengths);
    const auto known = [u = self.problem.unknowns()](double s, const InVector& at_y, const InVector& slope) {
        return KnownStep{s, own(at_y), {slope.data(), slope.data() + u}};
    };
    const auto found = self.problem.any->narrow(
        self.settings, view(y), view(tangent).first(self.problem.unknowns()), known(low, low_y, low_slope),
        known(high, high_y, high_slope), {length, test, tolerance, least_turn},
        {std::move(places), std::move(values), at}, block.rows);
    return {found.first, int(found.second)};
}

std::vector<Watched> kinds_of(const std::vector<int>& kinds) {
    std::vector<Watched> out;
    for (int kind : kinds) {
        if (kind < 0 || kind > int(Watched::CHANGE)) throw nb::value_error("unknown kind of test function");
        out.push_back(Watched(kind));
    }
    return out;
}

bool bound_watch(const std::vector<int>& kinds, const std::vector<double>& singular, const std::vector<double>& oldest,
                 const std::vector<double>& older, const std::vector<double>& old, const std::vector<double>& recent,
                 double first, double before, double last, int step) {
    for (const auto* values : {&singular, &oldest, &older, &old, &recent})
        if (values->size() < kinds.size()) require_size("test functions", values->size(), kinds.size());
    if (step < 0 || step > 2) throw nb::value_error("there are three steps between four points");
    return watch(kinds_of(kinds), singular, {{oldest, older, old, recent}, {first, before, last}}, step);
}

}  // namespace

void bind_family(nb::module_& m) {
    nb::class_<BoundFamily>(m, "OrbitFamily", "Steps along a family of orbits, with test functions.")
        .def(
            "__init__",
            [](BoundFamily* self, BoundAny& problem, const std::vector<int>& kinds, std::vector<double> singular,
               double low, double high, double longest, double tangent_noise, std::vector<double> targets, int computed,
               int maximum, bool neutral) {
                require_size("singular", singular.size(), kinds.size());
                if (computed != 1) require_size("test functions", computed, problem.any->tests(int(targets.size())));
                if (int(kinds.size()) > computed) throw nb::value_error("more test functions are watched than computed");
                require_iterations(maximum);
                new (self) BoundFamily(problem, {{kinds_of(kinds), std::move(singular)},
                                                 {low, high, longest, tangent_noise, std::move(targets), neutral},
                                                 computed,
                                                 maximum});
            },
            nb::keep_alive<1, 2>(), nb::arg("problem"), nb::arg("kinds"), nb::arg("singular"), nb::arg("low"),
            nb::arg("high"), nb::arg("longest"), nb::arg("tangent_noise"), nb::arg("targets"), nb::arg("computed"),
            nb::arg("maximum"), nb::arg("neutral") = false)
        .def("step", &bound_land, Released(),
             "Take one step into the first row of a block; whether it leads to an orbit.")
        .def("values", &bound_values, "The test functions at an observed orbit.")
        .def("advance", &bound_advance, Released(),
             "Take steps into a block: (accepted, whether the next row was tried, next length).")
        .def("narrow", &bound_narrow, Released(),
             "Take a step between two, or close in on a zero: (steps, how it ended).");
    m.attr("COMMON_TESTS") = COMMON_TESTS;
    m.attr("TANGENT_NOISE") = TANGENT_NOISE;
    m.attr("SMOOTH_TANGENT_NOISE") = SMOOTH_TANGENT_NOISE;
    m.def(
        "common_tests",
        [](InVector point, double low, double high, double longest, double tangent_noise) {
            require_size("a point", point.shape(0), POINT_SIZE);
            NewVector out = new_vector(COMMON_TESTS);
            common_tests(Point::read(point.data()), {low, high, longest, tangent_noise, {}}, {out.data(), COMMON_TESTS});
            return out;
        },
        nb::arg("point"), nb::arg("low"), nb::arg("high"), nb::arg("longest"), nb::arg("tangent_noise"),
        "The test functions that every family has.");
    m.def("distance", [](const std::vector<double>& a, const std::vector<double>& b) {
        require_size("a position", b.size(), a.size());
        return distance(a, b);
    });
    m.def("height", [](const std::vector<double>& position, const std::vector<double>& goal,
                       const std::vector<double>& direction) {
        require_size("a position", position.size(), goal.size());
        require_size("a direction", direction.size(), goal.size());
        return height(position, goal, direction);
    });
    m.def("arclength_of", &arclength_of);
    m.def("refusal", [](double turn, double contraction, double chord, double ds, NumbersOfControl control) {
        return int(refusal(turn, contraction, chord, ds, control_of(control)));
    });
    m.def("next_step", [](double ds, double turn, double contraction, NumbersOfControl control) {
        return next_step(ds, turn, contraction, control_of(control));
    });
    m.def("may_hide", &may_hide);
    m.def("watch", &bound_watch, nb::arg("kinds"), nb::arg("singular"), nb::arg("oldest"), nb::arg("older"),
          nb::arg("old"), nb::arg("new"), nb::arg("first"), nb::arg("before"), nb::arg("last"), nb::arg("step") = 2);
}

}  // namespace saltus
