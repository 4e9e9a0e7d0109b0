/// Python's view of the events of a flight.
#include "bindings.hpp"
#include "contact_path.hpp"
#include "extrema.hpp"
#include "impact.hpp"
#include "peaks.hpp"
#include "smooth_flight.hpp"

namespace saltus {

namespace {

/// A row and its derivatives, of which `rows` has at least so many.
template <class Flight>
Functional functional(const Flight& flight, const InMatrix& rows, const InVector& z, int needed) {
    require_size("the state", z.shape(0), flight.size());
    require_size("a row", rows.shape(1), flight.size());
    if (int(rows.shape(0)) < needed) throw nb::value_error("a functional needs rows of its derivatives");
    const Matrix<const double> m = view(rows);
    return {m[0], m[1], m[2]};
}

/// The searches along flights of one kind.
template <class Flight>
void bind_searches(nb::module_& m) {
    m.def("sign_changes",
          [](const Flight& flight, InMatrix rows, InVector z, double duration, int sign, bool begins_at_zero,
             bool ends_at_zero) {
              const Functional f = functional(flight, rows, z, 3);
              const SignChanges found = sign_changes(path_of(flight, view(z), duration), f, duration, sign, begins_at_zero,
                                                     ends_at_zero);
              return std::make_pair(found.changes, found.sign);
          },
          nb::arg("flight"), nb::arg("rows"), nb::arg("z"), nb::arg("duration"), nb::arg("sign") = 0,
              nb::arg("begins_at_zero") = false,
          nb::arg("ends_at_zero") = false,
              "(sign changes of rows[0] . z(t) inside a flight, last sign); rows[1] and [2]: its derivatives.");
    m.def("crossing_times",
          [](const Flight& flight, InMatrix rows, InVector z, double duration, OutVector times) {
              const Functional f = functional(flight, rows, z, 3);
              return crossing_times(path_of(flight, view(z), duration), f, duration, view(times));
          },
          nb::arg("flight"), nb::arg("rows"), nb::arg("z"), nb::arg("duration"), nb::arg("times"),
          "Fill in the times at which rows[0] . z(t) changes its sign. Returns their number; -1: it gave up.");
    m.def("rises",
          [](const Flight& flight, InMatrix rows, InVector z, double duration, int sign, OutVector times) {
              const Functional f = functional(flight, rows, z, 3);
              const SignChanges found = rises(path_of(flight, view(z), duration), f, duration, sign, view(times));
              return std::make_pair(found.changes, found.sign);
          },
          nb::arg("flight"), nb::arg("rows"), nb::arg("z"), nb::arg("duration"), nb::arg("sign"), nb::arg("times"),
          "Fill in the times at which rows[0] . z(t) crosses zero upwards. Returns (their number, last sign).");
    m.def("clearance",
          [](const Flight& flight, InMatrix rows, double lower, double upper, InVector z, double duration, double tie,
             double last) {
              const Functional f = functional(flight, rows, z, 4);
              const ObservedGap gap{f.value, f.rate, f.second, view(rows)[3], lower, upper};
              const Clearance found = clearance(path_of(flight, view(z), duration), gap, duration, tie, last);
              return std::make_tuple(found.distance, found.side, found.time);
          },
          nb::arg("flight"), nb::arg("rows"), nb::arg("lower"), nb::arg("upper"), nb::arg("z"), nb::arg("duration"),
              nb::arg("tie") = 0.0,
          nb::arg("last") = INFINITE,
              "(smallest distance of a gap from its bounds at its turning points, side, time). rows (4, N).");
    m.def("raise_peaks",
          [](const Flight& flight, InMatrix displacement, InMatrix velocity, InVector z, double duration,
             OutVector peaks, OutVector times) {
              require_size("the state", z.shape(0), flight.size());
              for (const InMatrix* rows : {&displacement, &velocity}) {
                  require_size("a row", rows->shape(1), flight.size());
                  require_size("rows", rows->shape(0), peaks.shape(0));
              }
              if (times.shape(0) > 0) require_size("times", times.shape(0), peaks.shape(0));
              const auto path = path_of(flight, view(z), duration);
              Local<double> end(flight.size());
              path.state(duration, end);
              return raise_peaks(path, Displacements{view(displacement), view(velocity)}, duration, end,
                                 Peaks{view(peaks), view(times)});
          },
          nb::arg("flight"), nb::arg("displacement"), nb::arg("velocity"), nb::arg("z"), nb::arg("duration"),
              nb::arg("peaks"),
          nb::arg("times"),
              "Raise the peaks to the largest |displacement . z(t)| over a flight. False: the search gave up.");
}

}  // namespace

void bind_events(nb::module_& m) {
    m.attr("CONTACT_TOLERANCE") = CONTACT_TOLERANCE;
    m.def("next_impact",
          [](const LinearFlight<>& flight, const Contacts& contacts, int leaving, bool released, InVector z, double horizon,
             bool certified) {
              require_size("the state", z.shape(0), flight.size());
              require_size("a contact's row", contacts.gap.columns(), flight.size());
              if (leaving < -1 || leaving >= contacts.count()) throw nb::value_error("there is no such contact");
              const auto path = path_of(flight, view(z), horizon);
              const NextImpact found = certified ? next_impact_on(path, contacts, leaving, released, horizon, nullptr)
                                                 : next_impact_on(path, contacts, leaving, released, horizon);
              return std::make_tuple(int(found.found), found.contact, found.time);
          },
          nb::arg("flight"), nb::arg("contacts"), nb::arg("leaving"), nb::arg("released"), nb::arg("z"),
              nb::arg("horizon"),
          nb::arg("certified") = false,
              "The next impact: (what was found, contact, time). certified: without steps of fixed length.");
    m.def("next_impact",
          [](const SmoothFlight<>& flight, const LinearFlight<>& linear, const Contacts& contacts, int leaving, bool released,
             InVector z, double horizon) {
              require_size("the state", z.shape(0), flight.size());
              require_size("a state with its forces", linear.size(), flight.size() + 3 * flight.equations().program.forces.size());
              require_size("a contact's row", contacts.gap.columns(), linear.size());
              if (leaving < -1 || leaving >= contacts.count()) throw nb::value_error("there is no such contact");
              const ContactPath path(flight, linear, view(z), horizon);
              const NextImpact found = next_impact_on(path, contacts, leaving, released, horizon, nullptr);
              return std::make_tuple(int(found.found), found.contact, found.time);
          },
          nb::arg("flight"), nb::arg("linear"), nb::arg("contacts"), nb::arg("leaving"), nb::arg("released"), nb::arg("z"),
          nb::arg("horizon"),
          "The same with smooth forces: linear and contacts are those of the states (z, f, f', f''), of which z is given.");
    m.def("tie_of",
          [](InVector gap, InVector rate, InVector position, InVector velocity, double duration) {
              for (const InVector* each : {&rate, &position, &velocity}) require_size("a row or state", each->shape(0),
                  gap.shape(0));
              return tie_of(view(gap), view(rate), view(position), view(velocity), duration);
          },
          nb::arg("gap"), nb::arg("rate"), nb::arg("position"), nb::arg("velocity"), nb::arg("duration"),
          "Difference of two distances that is a tie in a flight.");
    bind_searches<LinearFlight<>>(m);
    bind_searches<SmoothFlight<>>(m);
}

}  // namespace saltus
