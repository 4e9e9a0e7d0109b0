/// Python's view of single flights: their states at many times, their derivatives, and what happens along them.
#include <nanobind/stl/unique_ptr.h>

#include "bindings.hpp"
#include "extrema.hpp"
#include "slowest.hpp"
#include "smooth_flight.hpp"

namespace saltus {

namespace {

/// Whether a flight has an end. What is asked next finds its steps, which are kept.
template <class Flight>
bool has_end(const Flight& flight, Values z, double duration) {
    Local<double> end(flight.size());
    LocalSquare<double> map(flight.size());
    flight.end(z, duration, end, Matrix<double>(map));
    return end[0] == end[0];
}

/// The path of a flight of any kind.
class AnyPath {
public:
    virtual ~AnyPath() = default;
    virtual int size() const = 0;
    virtual void state(double t, Vector<double> out) const = 0;
    virtual void rate(Values state, Vector<double> out) const = 0;
    virtual int crossings(const Functional& rows, Vector<double> times) const = 0;
    virtual SignChanges rises(const Functional& rows, int sign, Vector<double> times) const = 0;
};

template <class Flight>
class PathOf final : public AnyPath {
public:
    PathOf(const Flight& flight, std::vector<double> begin, double duration)
        : begin_(std::move(begin)), path_(path_of(flight, begin_, duration)), duration_(duration),
          has_end_(has_end(flight, begin_, duration)) {}
    int size() const override { return int(begin_.size()); }
    void state(double t, Vector<double> out) const override {
        if (has_end_) path_.state(t, out);
        else std::fill(out.begin(), out.end(), NOT_A_NUMBER);
    }
    void rate(Values state, Vector<double> out) const override { path_.rate(state, out); }
    int crossings(const Functional& rows, Vector<double> times) const override {
        return crossing_times(path_, rows, duration_, times);
    }
    SignChanges rises(const Functional& rows, int sign, Vector<double> times) const override {
        return saltus::rises(path_, rows, duration_, sign, times);
    }

private:
    std::vector<double> begin_;  // the path keeps a view of it
    decltype(path_of(std::declval<const Flight&>(), Values(), 0.0)) path_;
    double duration_;
    bool has_end_;
};

Functional functional(const AnyPath& path, const InMatrix& rows) {
    require_size("a row", rows.shape(1), path.size());
    if (rows.shape(0) < 3) throw nb::value_error("a functional needs rows of its derivatives");
    const Matrix<const double> m = view(rows);
    return {m[0], m[1], m[2]};
}

/// Call find(times), which returns how many there are, with room for all; None where it gave up.
template <class Find>
nb::object all_times(Find&& find) {
    std::vector<double> times(4096);
    int count = find(times);
    if (count > int(times.size())) {
        times.resize(count);
        count = find(times);
    }
    if (count < 0) return nb::none();
    return nb::cast(numpy_of({times.data(), size_t(count)}));
}

/// States at times (m,), ascending within each flight, of flights that begin at times (P,), ascending, with states
/// (P, N). What has too many steps for one flight is computed in halves.
template <class Flight>
void sample(const Flight& flight, Values z, double duration, Values times, Matrix<double> out, int halvings = 0) {
    constexpr int MOST_HALVINGS = 9;
    const bool known = has_end(flight, z, duration);
    if (known || halvings == MOST_HALVINGS) {  // what lies before the point that is not reached is known
        const auto path = path_of(flight, z, duration);
        for (size_t i = 0; i < times.size(); ++i) path.state(times[i], out[int(i)]);
        return;
    }
    const double half = 0.5 * duration;
    size_t count = 0;
    while (count < times.size() && times[count] <= half) ++count;
    std::vector<double> sooner(times.begin(), times.begin() + count), later(times.begin() + count, times.end());
    sooner.push_back(half);
    for (double& t : later) t -= half;
    Array<> states(int(count) + 1, flight.size());
    sample(flight, z, half, sooner, Matrix<double>(states), halvings + 1);
    std::copy(states.data(), states.data() + count * flight.size(), out.data());
    sample(flight, Values(states[int(count)]), duration - half, later, out.rows(int(count), int(later.size())), halvings + 1);
}

template <class Flight>
void define(nb::module_& m) {
    m.def(
        "path",
        [](const Flight& flight, InVector z, double duration) -> std::unique_ptr<AnyPath> {
            require_size("the state", z.shape(0), flight.size());
            return std::make_unique<PathOf<Flight>>(flight, own(z), duration);
        },
        nb::keep_alive<0, 1>(), nb::arg("flight"), nb::arg("z"), nb::arg("duration"), "The path of a flight.");
    m.def(
        "sample",
        [](const Flight& flight, InVector z, InVector times) {
            require_size("the state", z.shape(0), flight.size());
            const bool finite = std::all_of(times.data(), times.data() + times.shape(0), [](double t) { return std::isfinite(t); });
            if (!finite || !std::is_sorted(times.data(), times.data() + times.shape(0)))
                throw nb::value_error("times are finite, and ascend");
            NewMatrix out = new_matrix(int(times.shape(0)), flight.size());
            const double last = times.shape(0) > 0 ? times.data()[times.shape(0) - 1] : 0.0;
            sample(flight, view(z), last, view(times), {out.data(), int(times.shape(0)), flight.size()});
            return out;
        },
        nb::arg("flight"), nb::arg("z"), nb::arg("times"), "States at ascending times of a flight; NaN where it is not known.");
    m.def(
        "linearise",
        [](const Flight& flight, InMatrix after, InVector duration, InMatrix before) {
            const int size = flight.size(), nodes = int(after.shape(0)), flights = int(duration.shape(0));
            for (const InMatrix* states : {&after, &before}) {
                require_size("a state", states->shape(1), size);
                require_size("states", states->shape(0), nodes);
            }
            if (flights > nodes) require_size("flights", flights, nodes);
            const size_t square = size_t(size) * size;
            std::vector<double> maps(square * flights);
            NewMatrix coming = new_matrix(nodes, size), leaving = new_matrix(nodes, size);
            Local<double> end(size);
            for (int i = 0; i < flights; ++i)
                flight.end(view(after)[i], duration.data()[i], end, Matrix<double>(&maps[i * square], size, size));
            for (int i = 0; i < nodes; ++i) {
                flight.rate(view(before)[i], Vector<double>(coming.data() + size_t(i) * size, size));
                flight.rate(view(after)[i], Vector<double>(leaving.data() + size_t(i) * size, size));
            }
            return nb::make_tuple(new_cube(maps, flights, size, size), coming, leaving);
        },
        nb::arg("flight"), nb::arg("after"), nb::arg("duration"), nb::arg("before"),
        "Derivatives (F, N, N) of the flights from the first nodes, and rates (P, N) before and after each node.");
}

}  // namespace

void bind_paths(nb::module_& m) {
    nb::class_<AnyPath>(m, "Path", "One flight, for its states at many times.")
        .def(
            "state",
            [](const AnyPath& self, double t) {
                NewVector out = new_vector(self.size());
                self.state(t, {out.data(), size_t(self.size())});
                return out;
            },
            nb::arg("t"), "The state at a time.")
        .def(
            "motion",
            [](const AnyPath& self, double t) {
                const size_t size = self.size();
                NewVector state = new_vector(int(size)), rate = new_vector(int(size));
                self.state(t, {state.data(), size});
                self.rate({state.data(), size}, {rate.data(), size});
                return nb::make_tuple(state, rate);
            },
            nb::arg("t"), "(state, its rate) at a time.")
        .def(
            "crossings",
            [](const AnyPath& self, InMatrix rows) {
                const Functional f = functional(self, rows);
                return all_times([&](Vector<double> times) { return self.crossings(f, times); });
            },
            nb::arg("rows"),
            "Times at which rows[0] . z changes its sign; None: the search gave up. rows[1] and [2]: its derivatives in "
            "flight without smooth forces.")
        .def(
            "rises",
            [](const AnyPath& self, InMatrix rows, int sign) {
                const Functional f = functional(self, rows);
                SignChanges found{0, sign};
                nb::object times = all_times([&](Vector<double> room) {
                    found = self.rises(f, sign, room);
                    return found.changes;
                });
                return nb::make_tuple(times, found.sign);
            },
            nb::arg("rows"), nb::arg("sign"), "(times at which rows[0] . z rises through zero, last sign).");
    define<LinearFlight<>>(m);
    define<SmoothFlight<>>(m);
    m.def(
        "slowest_instants",
        [](const SmoothFlight<>& flight, InVector z, double duration, bool of_distance, int parts) -> nb::object {
            require_size("the state", z.shape(0), 4);
            require_size("the flight's state", flight.size(), 4);
            if (!(duration >= 0.0) || parts < 1 || parts > 1'000'000)
                throw nb::value_error("a flight has a duration from 0 on, and its steps have from 1 to a million parts");
            const auto path = flight.fly(view(z), duration, false);
            if (!path->complete) return nb::none();
            const std::vector<Slowest> found = slowest_instants(*path, of_distance, parts);
            NewVector times = new_vector(int(found.size())), values = new_vector(int(found.size()));
            for (size_t k = 0; k < found.size(); ++k) times.data()[k] = found[k].time, values.data()[k] = found[k].value;
            return nb::make_tuple(times, values, numpy_of(Values(path->end)));
        },
        nb::arg("flight"), nb::arg("z"), nb::arg("duration"), nb::arg("of_distance"), nb::arg("parts"),
        "Where a flight is slowest, or nearest to the origin: (times, what changes its sign at an orbit, state at the "
        "end); None where it has no end.");
}

}  // namespace saltus
