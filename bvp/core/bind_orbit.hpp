/// A multipoint problem as Python holds it.
#pragma once

#include <nanobind/stl/array.h>
#include <nanobind/stl/string.h>

#include "bindings.hpp"
#include "orbit.hpp"

namespace saltus {

/// What Python can do with any multipoint problem.
class BoundAny {
public:
    AnyProblem* any = nullptr;  // owned by the kind of problem
    size_t unknowns() const { return any->unknowns(); }
};

/// A multipoint problem of conservative orbits, and the number of states for which it is compiled: 4, 6, or any.
class BoundProblem : public BoundAny {
public:
    BoundProblem(const LinearFlight<>& flight, const Contacts& contacts, std::vector<int> contact, Closure closure,
                 Watch watch, bool general) {
        const int size = flight.size(), inner = int(contact.size()) - 2;
        if (inner < 0)
            throw nb::value_error("the contacts of a problem are those of its inner nodes, its far end and its start");
        for (int c : contact)
            if (c < -1 || c >= contacts.count())
                throw nb::value_error("a node has a contact that the system does not have");
        require_size("a contact's row", contacts.gap.columns(), size);
        require_size("rows of the start", closure.start_map.rows(), size);
        require_size("the start's offset", closure.start_offset.size(), size);
        if (closure.periodic() != (closure.finish == End::PERIODIC))
            throw nb::value_error("an orbit is periodic at both ends, or at none");
        if (closure.periodic()) {
            require_size("start parameters", closure.start_map.columns(), size);
            if (contact[inner] < 0) throw nb::value_error("a periodic orbit begins at an impact");
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
        if (size == 4 && !general)
            problem = make_with<4>(flight, contacts, std::move(closure), std::move(contact), std::move(watch));
        else if (size == 6 && !general)
            problem = make_with<6>(flight, contacts, std::move(closure), std::move(contact), std::move(watch));
        else
            problem = make_orbit_problem<LinearFlight<>>(flight, contacts, std::move(closure), std::move(contact),
                                                         std::move(watch));
        any = problem.get();
    }

    std::unique_ptr<AnyOrbitProblem> problem;

private:
    template <int N>
    static std::unique_ptr<AnyOrbitProblem> make_with(const LinearFlight<>& flight, const Contacts& contacts,
                                                      Closure closure, std::vector<int> contact, Watch watch) {
        return make_orbit_problem<LinearFlight<N>>(LinearFlight<N>(flight), contacts, std::move(closure), std::move(contact),
                                                   std::move(watch));
    }
};

}  // namespace saltus
