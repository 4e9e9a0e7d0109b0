/// Orbits with linear flights of any number of states.
#include "orbit.hpp"

namespace saltus {

template <>
std::unique_ptr<AnyOrbitProblem> make_orbit_problem(LinearFlight<> flight, Contacts contacts, Closure closure,
                                                    std::vector<int> contact, Watch watch) {
    using Problem = OrbitProblem<LinearFlight<>>;
    return std::make_unique<OrbitProblemOf<LinearFlight<>>>(
        Problem(std::move(flight), std::move(contacts), std::move(closure), std::move(contact)), std::move(watch));
}

}  // namespace saltus
