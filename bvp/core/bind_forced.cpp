/// Python's view of flights and orbits under periodic loads.
#include <nanobind/stl/array.h>
#include <nanobind/stl/shared_ptr.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include "bind_orbit.hpp"
#include "bind_program.hpp"
#include "forced_orbit.hpp"

namespace saltus {

namespace {

using Flight = LoadedFlight<>;

std::vector<int> indices(InIndices a) { return {a.data(), a.data() + a.shape(0)}; }

Jet<double, 1> along(double value, double slope) {
    Jet<double, 1> out(value);
    out.slopes[0] = slope;
    return out;
}

/// A forced problem as Python holds it, compiled for linear flights of one and two degrees of freedom in one parameter, for
/// any, and for smooth forces.
class BoundForced : public BoundAny {
public:
    BoundForced(ForcedParts parts, bool general) {
        const int size = parts.modes.empty() ? 0 : parts.modes[0].size();
        released = int(parts.parameters.released.size()), forces = parts.events.pull.rows();
        if (!parts.smooth.empty()) problem = make_forced_problem<SmoothLoadedFlight, DYNAMIC>(std::move(parts));
        else if (size == 2 && released == 1 && !general) problem = make_forced_problem<LoadedFlight<2>, 1>(std::move(parts));
        else if (size == 4 && released == 1 && !general) problem = make_forced_problem<LoadedFlight<4>, 1>(std::move(parts));
        else problem = make_forced_problem<Flight, DYNAMIC>(std::move(parts));
        any = problem.get();
    }
    std::unique_ptr<AnyForcedProblem> problem;
    int released, forces;

    void check_place(const InVector& parameters, int flight, const InVector& place, int row) const {
        require_size("released parameters", parameters.shape(0), released);
        require_index("a flight", flight, problem->inner() + 1);
        require_size("a place", place.shape(0), problem->size() + 1);
        if (row != -1) require_index("a contact force", row, forces);
    }
};

/// Forces that are Python functions. An error that one raises goes through all that calls it.
std::shared_ptr<LoadedCalls> loaded_calls(nb::object forces, nb::object energies, std::vector<std::array<int, 3>> changes, int count,
                                          int parameters, int registers) {
    for (const auto& [force, number, result] : changes)
        if (force < 0 || force >= count || number < 0 || number >= parameters || result < 0 || result >= registers)
            throw nb::value_error("there is no such derivative of a force");
    auto out = std::make_shared<LoadedCalls>();
    out->changes = std::move(changes);
    out->forces = [forces = std::move(forces)](Matrix<double> values, int columns, Values numbers) {
        const nb::gil_scoped_acquire held;
        NewMatrix shown = new_matrix(values.rows(), values.columns());  // the function may keep it
        double* entries = shown.data();
        const size_t size = shown.size();
        std::copy(values.data(), values.data() + size, entries);
        nb::object array = nb::cast(std::move(shown));
        forces(array, columns, numpy_of(numbers));
        std::copy(entries, entries + size, values.data());
    };
    out->energies = [energies = std::move(energies)](Values inputs, Values numbers) {
        const nb::gil_scoped_acquire held;
        return nb::cast<std::vector<double>>(energies(numpy_of(inputs), numpy_of(numbers)));
    };
    return out;
}

nb::object bound_path(const std::shared_ptr<const TaylorPath>& path) {
    return path ? nb::cast(std::const_pointer_cast<TaylorPath>(path)) : nb::none();
}

/// The contact modes of a problem that a function of Python finds, checked.
auto modes_of(nb::object function, int count, const Flight& like) {
    return [function = std::move(function), count, size = like.size(), harmonics = like.harmonics()](Values parameters, Values entries) {
        const nb::gil_scoped_acquire held;
        auto found = nb::cast<std::vector<Flight>>(function(numpy_of(parameters), numpy_of(entries)));
        if (!found.empty()) require_size("contact modes", found.size(), count);
        for (const Flight& flight : found) {
            require_size("a flight's states", flight.size(), size);
            require_size("harmonics", flight.harmonics(), harmonics);
        }
        return found;
    };
}

void require_indices(const char* name, const std::vector<int>& values, int least, int end) {
    for (int index : values)
        if (index < least || index >= end) throw nb::value_error((std::string("there is no such ") + name).c_str());
}

using InDomains = std::tuple<std::vector<int>, std::vector<double>, std::vector<double>>;
std::vector<Parameters::Domain> domains(const char* name, const InDomains& given, int end) {
    const auto& [places, low, high] = given;
    require_indices(name, places, 0, end);
    for (const auto& ends : {low, high}) require_size("ends of domains", ends.size(), places.size());
    std::vector<Parameters::Domain> out;
    for (size_t k = 0; k < places.size(); ++k) out.push_back({places[k], low[k], high[k]});
    return out;
}

/// The flights of the contact modes.
template <bool SMOOTH>
const auto& modes_in(const ForcedParts& parts) {
    if constexpr (SMOOTH) return parts.smooth;
    else return parts.modes;
}

/// The constructor of a problem for one kind of flights.
template <class Modes, class Class>
void define_constructor(Class& bound) {
    bound.def(
            "__init__",
            [](BoundForced* self, const Modes& flights, InIndices mode, InIndices release, InIndices bound,
               InIndices restitution, InVector side, InMatrix gap, InMatrix rate, InMatrix push, InMatrix pull,
               InMatrix reach, InMatrix closed, InVector unit, InIndices force_mode, InIndices kept_mode, InIndices summed,
               std::tuple<double, double, double> closure,
               std::tuple<bool, bool, int, int, int> free, InMatrix ends, InVector values, InIndices released,
               InVector entries, InIndices rows, InIndices places, std::tuple<InPairs, InVector, InIndices> program,
               std::tuple<InPairs, InVector, InIndices> kept, InVector units,
               std::tuple<InMatrix, InIndices, InIndices, InIndices, InPairs, InIndices> watched, bool varies, bool undamped, nb::object modes_at,
               InDomains unseen, InDomains located, bool general) {
                constexpr bool SMOOTH = std::is_same_v<Modes, SmoothLoadedFlight>;
                ForcedParts parts;
                if constexpr (SMOOTH) parts.smooth.push_back(flights);
                else parts.modes = flights;
                const auto& modes = modes_in<SMOOTH>(parts);
                if (modes.empty()) throw nb::value_error("a forced problem has a flight");
                const int size = modes[0].size(), count = int(mode.shape(0)), n = size / 2, all = int(entries.shape(0));
                for (const auto& flight : modes) {
                    require_size("a flight's states", flight.size(), size);
                    require_size("harmonics", flight.harmonics(), modes[0].harmonics());
                }
                if (count < 1) throw nb::value_error("an orbit has a flight");
                const auto [is_free, unfolds, quarters, start, finish] = free;
                for (int end : {start, finish})
                    if (end < 0 || end > int(End::PERIODIC)) throw nb::value_error("unknown kind of end");
                if (quarters != 1 && quarters != 2 && quarters != 4)
                    throw nb::value_error("flights last one, two or four quarter periods");
                const bool has_ends = ends.shape(0) > 0;
                require_size("conditions of ends", ends.shape(0), has_ends ? size : 0);
                require_size("a condition", ends.shape(1), size);
                if (has_ends != (End(start) != End::PERIODIC) || has_ends != (End(finish) != End::PERIODIC))
                    throw nb::value_error("an orbit is periodic at both ends, or at none");
                if ((unfolds || has_ends) != is_free || (unfolds && has_ends))
                    throw nb::value_error("a free orbit closes with a kick, or has two ends");
                if (is_free && (std::get<1>(closure) != 0.0 || modes.size() > 1))
                    throw nb::value_error("a free orbit has no clock, and no stop that sticks");
                const int nodes = count + has_ends;
                require_size("nodes", release.shape(0), count);
                for (const InIndices* part : {&bound, &restitution}) require_size("nodes", part->shape(0), nodes);
                require_size("nodes", side.shape(0), nodes);
                for (const InMatrix* part : {&gap, &rate, &push}) {
                    require_size("nodes", part->shape(0), nodes);
                    require_size("a row", part->shape(1), size);
                }
                require_size("a force's row", pull.shape(1), size);
                require_size("a force's loads", reach.shape(1), n);
                require_size("forces", reach.shape(0), pull.shape(0));
                ForcedEvents events{indices(mode), indices(release), indices(bound), indices(restitution), own(side),
                                    own(gap), own(rate), own(push), own(pull), own(reach), own(closed), own(unit),
                                    indices(force_mode), indices(summed), indices(kept_mode)};
                for (size_t rows : {closed.shape(0), unit.shape(0), force_mode.shape(0)}) require_size("forces", rows, pull.shape(0));
                require_size("a gap", closed.shape(1), n);
                require_size("nodes", kept_mode.shape(0), nodes);
                require_size("nodes", summed.shape(0), count);
                bool sums = false;
                for (int i = 0; i < count; ++i) {
                    if (events.summed[i] != 1) continue;
                    sums = true;
                    if (SMOOTH || events.side[i] == 0.0 || restitution.data()[i] < 0 || std::get<1>(closure) == 0.0)
                        throw nb::value_error("a chatter is of impacts that rebound, in linear flights with a clock");
                }
                require_indices("flight", events.force_mode, 0, int(modes.size()));
                require_indices("flight", events.kept, 0, int(modes.size()));
                if (!std::is_sorted(events.force_mode.begin(), events.force_mode.end()))
                    throw nb::value_error("the forces of a contact mode follow each other");
                require_indices("flight", events.mode, 0, int(modes.size()));
                require_indices("contact force", events.release, -1, int(pull.shape(0)));
                require_indices("bound", events.bound, -1, all);
                require_indices("restitution", events.restitution, -1, all);
                for (int i = 0; i < nodes; ++i) {
                    const bool at_stop = has_ends && i + 2 >= nodes && End(i + 1 == nodes ? start : finish) == End::STOP;
                    if ((at_stop || events.side[i] != 0.0) && events.bound[i] < 0) throw nb::value_error("an impact needs a bound");
                }
                require_size("places of loads", places.shape(0), 4);
                const int harmonics = modes[0].harmonics(), harmonic = harmonics - (harmonics > 0 && modes[0].harmonic(0) == 0.0);
                const int64_t* at = places.data();
                if (at[0] < 0 || at[0] + n > all || at[1] < 0 || at[1] + harmonic * n > all || at[2] < 0 ||
                    at[2] + harmonic * n > all || at[3] < 0 || at[3] >= all)
                    throw nb::value_error("the loads are outside the entries");
                const int names = int(values.shape(0));
                const auto make = [](auto& parts, int known) {
                    return formulas(known, std::get<0>(parts), std::get<1>(parts), std::get<2>(parts));
                };
                Parameters parameters{make(program, names), indices(rows), own(values), indices(released), own(entries),
                                      int(at[0]), int(at[1]), int(at[2]), int(at[3]), make(kept, is_free ? names + 2 : names), {}, varies, undamped,
                                      {}, {}};
                if (is_free || varies || SMOOTH) require_size("matrices", std::min(3 * n * n, all), 3 * n * n);
                if ((sums || (!SMOOTH && !modes_at.is_none())) && !varies)
                    throw nb::value_error("chatter and contact modes that vary are computed from the masses");
                if (undamped && (SMOOTH || sums || modes.size() != 1 || !varies || !modes_at.is_none()))
                    throw nb::value_error("undamped modes are those of one free flight");
                if constexpr (SMOOTH) require_size("parameters of the forces", modes[0].parameters(), released.shape(0));
                else if (!modes_at.is_none()) parameters.modes = modes_of(std::move(modes_at), int(modes.size()), modes[0]);
                require_size("rows of the program", parameters.rows.size(), parameters.program.outputs.size());
                require_indices("entry", parameters.rows, 0, all);
                require_indices("parameter", parameters.released, 0, names);
                require_size("kept equations", parameters.kept.outputs.size() + !is_free, parameters.released.size());
                require_size("units", units.shape(0), size + 1 + released.shape(0));
                auto& [gaps, lower, upper, stop, force, opens] = watched;
                ForcedWatch watch{own(gaps), indices(lower), indices(upper), indices(stop), {}, indices(opens)};
                const int stops = watch.stops();
                require_size("a gap", gaps.shape(1), size);
                require_size("bounds", watch.lower.size(), stops);
                require_size("bounds", watch.upper.size(), stops);
                require_size("nodes", watch.stop.size(), count);
                require_size("nodes", watch.opens.size(), count);
                require_size("flights", force.shape(0), modes.size());
                require_size("stops", force.shape(1), stops);
                watch.force = Array<int>(int(modes.size()), stops, 0);
                for (size_t k = 0; k < force.size(); ++k) watch.force.data()[k] = int(force.data()[k]);
                require_indices("bound", watch.lower, 0, all);
                require_indices("bound", watch.upper, 0, all);
                require_indices("stop", watch.stop, -1, stops);
                require_indices("flight", watch.opens, -1, int(modes.size()));
                require_indices("contact force", {watch.force.data(), watch.force.data() + force.size()}, -1, int(pull.shape(0)));
                parameters.unseen = domains("entry", unseen, all);
                parameters.located = domains("released parameter", located, int(parameters.released.size()));
                parts.parameters = std::move(parameters);
                parts.events = std::move(events);
                parts.closure = {std::get<0>(closure), std::get<1>(closure), std::get<2>(closure), is_free, unfolds, quarters,
                                 End(start), End(finish), own(ends)};
                parts.units = own(units);
                parts.watch = std::move(watch);
                new (self) BoundForced(std::move(parts), general);
            },
            nb::arg("modes"), nb::arg("mode"), nb::arg("release"), nb::arg("bound"), nb::arg("restitution"),
            nb::arg("side"), nb::arg("gap"), nb::arg("rate"), nb::arg("push"), nb::arg("pull"), nb::arg("reach"),
            nb::arg("closed"), nb::arg("unit"), nb::arg("force_mode"), nb::arg("kept_mode"), nb::arg("summed"), nb::arg("closure"), nb::arg("free"),
            nb::arg("ends"), nb::arg("values"), nb::arg("released"), nb::arg("entries"), nb::arg("rows"),
            nb::arg("places"), nb::arg("program"), nb::arg("kept"), nb::arg("units"), nb::arg("watched"), nb::arg("varies"),
            nb::arg("undamped"), nb::arg("modes_at") = nb::none(),
            nb::arg("unseen") = InDomains(), nb::arg("located") = InDomains(), nb::arg("general") = false,
            "varies: whether masses, dampers or springs vary, or have to be known for a chatter; modes_at: where they vary, of linear "
            "flights, a function of all parameters and entries that gives the flights of the contact modes; none where the system cannot have "
            "them. unseen: entries that are no numbers beyond their domains (places, lower and upper ends), while the released parameters that "
            "are `located` are in theirs. general: take what is compiled for any number of states and parameters.");
}

}  // namespace

void bind_forced(nb::module_& m) {
    nb::class_<Flight>(m, "LoadedFlight", "Exact flight under periodic loads, equation (38).")
        .def(
            "__init__",
            [](Flight* self, const LinearFlight<>& free, InMatrix enter, InMatrix leave, InMatrix push, InVector harmonics) {
                for (const InMatrix* square : {&enter, &leave})
                    if (int(square->shape(0)) != free.size() || int(square->shape(1)) != free.size())
                        throw nb::value_error("the coordinates of a flight are as many as its states");
                require_size("rates by forces", push.shape(0), free.size());
                require_size("forces", push.shape(1), free.size() / 2);
                new (self) Flight(free, own(enter), own(leave), own(push), own(harmonics));
            },
            nb::arg("free"), nb::arg("enter"), nb::arg("leave"), nb::arg("push"), nb::arg("harmonics"))
        .def(
            "end",
            [](const Flight& self, InVector z, double t, InVector begin, InVector finish, InVector base, InMatrix forces,
               InVector durations) {
                const int n = self.size(), rows = 2 * self.harmonics(), m = int(base.shape(0)) - 1;
                require_size("a state", z.shape(0), n);
                require_size("oscillators", begin.shape(0), rows);
                require_size("oscillators", finish.shape(0), rows);
                require_size("changes of the duration", durations.shape(0), m);
                require_size("forces", forces.shape(0), (m + 1) * rows);
                require_size("forces", forces.shape(1), n / 2);
                const Matrix<const double> f = view(forces);
                Drive<double> drive;
                self.set(base.data()[0], f.rows(0, rows), drive);
                std::vector<Drive<Jet<double, 1>>> drives(m);
                std::vector<Flight::Slope> slopes;
                for (int j = 0; j < m; ++j) {
                    Array<Jet<double, 1>> moved(rows, n / 2);
                    for (int r = 0; r < rows; ++r)
                        for (int c = 0; c < n / 2; ++c) moved(r, c) = along(f(r, c), f((j + 1) * rows + r, c));
                    const Jet<double, 1> w = along(base.data()[0], base.data()[1 + j]);
                    self.set(w, Matrix<const Jet<double, 1>>(moved), drives[j]);
                    slopes.push_back({&drives[j], durations.data()[j]});
                }
                NewVector out = new_vector(n);
                NewMatrix map = new_matrix(n, n), columns = new_matrix(2 + m, n);
                self.end(drive, slopes, view(z), t, view(begin), view(finish), {out.data(), size_t(n)},
                         Matrix<double>(map.data(), n, n), Matrix<double>(columns.data(), 2 + m, n));
                return std::make_tuple(out, map, columns);
            },
            nb::arg("z"), nb::arg("t"), nb::arg("begin"), nb::arg("finish"), nb::arg("base"), nb::arg("forces"),
            nb::arg("durations"),
            "State at the end, its derivatives (N, N) by the begin, and rows of those by the instants of begin and end and "
            "by m parameters. base (1 + m,), forces ((1 + m) 2 H, n): frequency and forces, then their derivatives.");
    nb::class_<SmoothLoadedFlight>(m, "SmoothLoadedFlight", "Flights with smooth forces under periodic loads.")
        .def(
            "__init__",
            [](SmoothLoadedFlight* self, InMatrix inputs, InMatrix directions, InPairs code, InVector numbers,
               InIndices forces, InPairs slopes, int registers, int parameters, std::tuple<InPairs, InVector, InIndices> varied,
               std::tuple<InPairs, InVector, InIndices> potential, InVector harmonics, int most_steps, int keep,
               nb::object called, nb::object energies, std::vector<std::array<int, 3>> changes) {
                const int count = int(inputs.shape(0));
                if (inputs.shape(1) == 0 || inputs.shape(1) % 2) throw nb::value_error("a state has as many velocities as displacements");
                require_size("a direction", directions.shape(1), inputs.shape(1) / 2);
                require_size("the forces", forces.shape(0), directions.shape(0));
                require_flights(keep, most_steps);
                require_registers(registers, count);
                if (parameters < 0 || parameters > 1000) throw nb::value_error("there are from 0 to 1000 parameters");
                ForceProgram program = force_program(count, code, numbers, forces, slopes, registers);
                Formulas of_numbers = formulas(parameters, std::get<0>(varied), std::get<1>(varied), std::get<2>(varied));
                std::shared_ptr<LoadedCalls> calls;
                if (called.is_none()) require_size("numbers of the forces", of_numbers.outputs.size(), program.numbers.size());
                else
                    calls = loaded_calls(std::move(called), std::move(energies), std::move(changes), int(program.forces.size()), parameters,
                                         registers);
                new (self) SmoothLoadedFlight(own(inputs), own(directions), std::move(program), std::move(of_numbers),
                                              formulas(count + parameters, std::get<0>(potential), std::get<1>(potential),
                                                       std::get<2>(potential)),
                                              own(harmonics), most_steps, keep, std::move(calls));
            },
            nb::arg("inputs"), nb::arg("directions"), nb::arg("code"), nb::arg("numbers"), nb::arg("forces"), nb::arg("slopes"),
            nb::arg("registers"), nb::arg("parameters"), nb::arg("varied"), nb::arg("potential"), nb::arg("harmonics"),
            nb::arg("most_steps"), nb::arg("keep"), nb::arg("called") = nb::none(), nb::arg("energies") = nb::none(),
            nb::arg("changes") = std::vector<std::array<int, 3>>(),
            "varied: the program of its numbers, of the released parameters. called: a function that writes forces and derivatives below the "
            "inputs, in the first columns of an array, as many as its second argument, at values of these parameters; energies: the energy and "
            "its derivatives by inputs and parameters; changes: a force, a parameter and the register of its derivative.");
    m.def(
        "bounded_product",
        [](InVector real, InVector imaginary) {
            require_size("imaginary parts", imaginary.shape(0), real.shape(0));
            std::vector<Complex<double>> factors;
            for (size_t k = 0; k < real.shape(0); ++k) factors.push_back({real.data()[k], imaginary.data()[k]});
            return bounded_product(factors);
        },
        nb::arg("real"), nb::arg("imaginary"), "A number between -1 and 1 with the sign and the zeros of a product of real numbers and pairs.");
    nb::class_<BoundForced, BoundAny> problem(m, "ForcedProblem", "The multipoint problem of an orbit under periodic loads, equation (39).");
    define_constructor<std::vector<Flight>>(problem);
    define_constructor<SmoothLoadedFlight>(problem);
    problem
        .def(
            "flights",
            [](BoundForced& self, InVector y) {
                require_size("unknowns", y.shape(0), self.unknowns());
                const int n = self.problem->size(), flights = self.problem->inner() + 1;
                NewMatrix starts = new_matrix(flights, n + 1), ends = new_matrix(flights, n);
                NewVector durations = new_vector(flights);
                self.problem->flights(view(y), Matrix<double>(starts.data(), flights, n + 1), {durations.data(), size_t(flights)},
                                      Matrix<double>(ends.data(), flights, n));
                return std::make_tuple(starts, durations, ends);
            },
            nb::arg("y"), "The states and times at the begin of flights, behind a chatter; durations; the states before the events.")
        .def(
            "observe_flights",
            [](BoundForced& self, InVector y, InMatrix starts, InVector durations, InMatrix ends, OutVector point) {
                require_size("unknowns", y.shape(0), self.unknowns());
                const int n = self.problem->size(), flights = self.problem->inner() + 1;
                require_size("flights", starts.shape(0), flights);
                require_size("a begin", starts.shape(1), n + 1);
                require_size("flights", durations.shape(0), flights);
                require_size("flights", ends.shape(0), flights);
                require_size("a state", ends.shape(1), n);
                require_size("a point", point.shape(0), POINT_SIZE);
                Point seen = Point::read(point.data());
                self.problem->observe_flights(view(y), view(starts), view(durations), view(ends), seen);
                seen.write(point.data());
            },
            nb::arg("y"), nb::arg("starts"), nb::arg("durations"), nb::arg("ends"), nb::arg("point"),
            "Fill what is seen of an orbit y along such flights.")
        .def(
            "growth",
            [](BoundForced& self, InVector y) {
                require_size("unknowns", y.shape(0), self.unknowns());
                return self.problem->growth(view(y));
            },
            nb::arg("y"), "The largest factor by which perturbations grow along a flight.")
        .def(
            "fly",
            [](BoundForced& self, InVector parameters, int flight, InVector place, double t, int row, bool with_slopes) {
                const int n = self.problem->size(), all = with_slopes ? 2 + n + int(parameters.shape(0)) : 0;
                self.check_place(parameters, flight, place, row);
                NewVector values = new_vector(n + 2);
                NewMatrix slopes = new_matrix(all > 0 ? n + 2 : 0, all);
                self.problem->fly(view(parameters), flight, view(place), t, row, {values.data(), size_t(n + 2)},
                                  Matrix<double>(slopes.data(), all > 0 ? n + 2 : 0, all));
                return std::make_tuple(values, slopes);
            },
            nb::arg("parameters"), nb::arg("flight"), nb::arg("place"), nb::arg("t"), nb::arg("row") = -1, nb::arg("with_slopes") = false,
            "State, time and contact force of a row a time t after a place (state and time), as in a flight; and their derivatives by t, by "
            "the place and by the released parameters.")
        .def(
            "begin_slopes",
            [](BoundForced& self, InVector y, int flight) {
                require_size("unknowns", y.shape(0), self.unknowns());
                require_index("a flight", flight, self.problem->inner() + 1);
                const int n = self.problem->size(), all = n + 1 + self.released;
                NewMatrix slopes = new_matrix(n + 1, all);
                self.problem->begin_slopes(view(y), flight, Matrix<double>(slopes.data(), n + 1, all));
                return slopes;
            },
            nb::arg("y"), nb::arg("flight"),
            "Derivatives of state and time at the begin of a flight, behind a chatter, by those of its node and by the released parameters.")
        .def(
            "second_along",
            [](BoundForced& self, InVector y, InVector a) {
                const int rows = int(self.unknowns()) - 1, columns = int(y.shape(0));
                if (columns != rows + 2) require_size("unknowns", columns, rows + 1);
                require_size("a direction", a.shape(0), columns);
                NewMatrix out = new_matrix(rows, columns);
                self.problem->second_along(view(y), view(a), Matrix<double>(out.data(), rows, columns));
                return out;
            },
            nb::arg("y"), nb::arg("a"),
            "The derivative of the Jacobian along a direction. The clock at the end can follow the unknowns as one more: the orbit is open.")
        .def(
            "open_derivative",
            [](BoundForced& self, InVector y, InMatrix directions) {
                const size_t u = self.unknowns();
                require_size("unknowns", y.shape(0), u + 1);
                require_size("a direction", directions.shape(1), u + 1);
                if (directions.shape(0) < 1 || directions.shape(0) > 3) throw nb::value_error("a derivative has one, two or three directions");
                NewVector out = new_vector(int(u) - 1);
                self.problem->open_derivative(view(y), view(directions), {out.data(), u - 1});
                return out;
            },
            nb::arg("y"), nb::arg("directions"), "The derivative of an open orbit's equations along one to three directions.")
        .def(
            "measures",
            [](BoundForced& self, InVector y) {
                require_size("unknowns", y.shape(0), self.unknowns());
                const int n = self.problem->size() / 2, count = 2 * n + n * (n + 1) / 2;
                NewVector peaks = new_vector(n), totals = new_vector(count);
                const bool found = self.problem->measures(view(y), {peaks.data(), size_t(n)}, {totals.data(), size_t(count)});
                return std::make_tuple(found, peaks, totals);
            },
            nb::arg("y"),
            "Of linear flights: whether the search for peaks ended, largest displacements, and the integrals of their squares, of the products "
            "of two velocities, and of the powers of the loads.")
        .def(
            "path",
            [](BoundForced& self, InVector parameters, int flight, InVector place, double t) {
                self.check_place(parameters, flight, place, -1);
                return bound_path(self.problem->path(view(parameters), flight, view(place), t));
            },
            nb::arg("parameters"), nb::arg("flight"), nb::arg("place"), nb::arg("t"),
            "The steps of a flight with smooth forces: of displacements and oscillators, then their rates. None for linear flights.")
        .def(
            "failure",
            [](BoundForced& self, InVector y) {
                require_size("unknowns", y.shape(0), self.unknowns());
                const auto found = self.problem->failure(view(y));
                return std::make_tuple(found.first, bound_path(found.second));
            },
            nb::arg("y"), "The first flight that has no end, and its steps; None where all have one.")
        .def(
            "multipliers",
            [](BoundForced& self, InVector y) {
                require_size("unknowns", y.shape(0), self.unknowns());
                const size_t n = self.problem->size();
                NewMatrix out = new_matrix(2, int(n));
                if (!self.problem->multipliers(view(y), {out.data(), n}, {out.data() + n, n}))
                    std::fill(out.data(), out.data() + 2 * n, NOT_A_NUMBER);
                return out;
            },
            nb::arg("y"),
            "Real and imaginary parts of the multipliers by modulus descending, of half a period those of x -> -x over it; NaN "
            "where they are not found.");
}

}  // namespace saltus
