/// A multipoint problem as Python holds it.
#pragma once

#include <nanobind/stl/array.h>
#include <nanobind/stl/string.h>

#include "bindings.hpp"
#include "orbit.hpp"
#include "smooth_flight.hpp"

namespace saltus {

/// Refuse a number of iterations that would not end.
inline void require_iterations(int most) {
    if (most < 0 || most > 1000) throw nb::value_error("the most iterations are from 0 to 1000");
}

/// What Python can do with any multipoint problem.
class BoundAny {
public:
    AnyProblem* any = nullptr;  // owned by the kind of problem
    size_t unknowns() const { return any->unknowns(); }
};

/// A multipoint problem with flights of any kind, compiled for a number of states or for any.
class BoundProblem : public BoundAny {
public:
    template <class Flight>
    BoundProblem(const Flight& flight, const Contacts& contacts, std::vector<int> contact, Closure closure, Watch watch) {
        const int size = flight.size(), inner = int(contact.size()) - 2;
        if (inner < 0)
            throw nb::value_error("the contacts of a problem are those of its inner nodes, its far end and its start");
        for (int c : contact)
            if (c < -1 || c >= contacts.count())
                throw nb::value_error("a node has a contact that the system does not have");
        for (int i = 0; i < inner && !Flight::is_series(); ++i)
            if (contact[i] < 0) throw nb::value_error("linear flights have no cuts");
        require_size("a contact's row", contacts.gap.columns(), size);
        require_size("rows of the start", closure.start_map.rows(), size);
        require_size("the start's offset", closure.start_offset.size(), size);
        if (closure.periodic() != (closure.finish == End::PERIODIC))
            throw nb::value_error("an orbit is periodic at both ends, or at none");
        if (closure.quarters != 1 && closure.quarters != 2 && closure.quarters != 4)
            throw nb::value_error("flights last one, two or four quarter periods");
        if (closure.start_map.columns() < 1) throw nb::value_error("a start has a parameter at least");
        if (size % 2 != 0) throw nb::value_error("a state has as many velocities as displacements");
        if (closure.periodic()) {
            require_size("start parameters", closure.start_map.columns(), size);
            if (contact[inner] < 0 && !Flight::is_series())
                throw nb::value_error("a periodic orbit of linear flights begins at an impact");
        } else {
            require_size("the end's rows", closure.end_map.columns(), size);
            require_size("the end's offsets", closure.end_offset.size(), closure.end_map.rows());
            require_size("equations of both ends", closure.start_map.columns(), closure.end_map.rows());
        }
        if ((closure.start == End::STOP && contact[inner + 1] < 0) ||
            (closure.finish == End::STOP && contact[inner] < 0))
            throw nb::value_error("an end at a stop needs a contact");
        require_size("observed rows", watch.observed.rows.columns(), size);
        require_size("upper bounds", watch.observed.upper.size(), watch.observed.lower.size());
        const int rows = watch.observed.rows.rows(), stops = watch.observed.stops();
        if (rows != 4 * stops && rows != 4 * (stops + 2))
            throw nb::value_error("four rows for each gap, and for two velocities or none");
        require_size("held motions", watch.held.columns(), size / 2);
        require_size("free motions", watch.free.columns(), size / 2);
        require_size("motions", watch.held.rows() + watch.free.rows(), size / 2);
        if (watch.held.rows() < 1 || (size == 4 && watch.held.rows() != 2)) throw nb::value_error("too few motions are held");
        problem = make(flight, contacts, std::move(closure), std::move(contact), std::move(watch));
        any = problem.get();
    }

    std::unique_ptr<AnyOrbitProblem> problem;

private:
    static std::unique_ptr<AnyOrbitProblem> make(const LinearFlight<>& flight, const Contacts& contacts,
                                                 Closure closure, std::vector<int> contact, Watch watch) {
        const auto with = [&]<class Flight>(Flight sized) {
            return make_orbit_problem<Flight>(std::move(sized), contacts, std::move(closure), std::move(contact),
                                              std::move(watch));
        };
        if (flight.size() == 4 && !watch.general) return with(LinearFlight<4>(flight));
        if (flight.size() == 6 && !watch.general) return with(LinearFlight<6>(flight));
        return with(flight);
    }
    static std::unique_ptr<AnyOrbitProblem> make(const SmoothFlight<>& flight, const Contacts& contacts,
                                                 Closure closure, std::vector<int> contact, Watch watch) {
        return make_orbit_problem<SmoothFlight<>>(flight, contacts, std::move(closure), std::move(contact),
                                                  std::move(watch));
    }
};

}  // namespace saltus
