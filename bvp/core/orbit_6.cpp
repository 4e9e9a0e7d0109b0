/// Orbits with linear flights of three degrees of freedom.
#include "orbit.hpp"

namespace saltus {

template <>
std::unique_ptr<AnyOrbitProblem> make_orbit_problem(LinearFlight<6> flight, Contacts contacts, Closure closure,
                                                    std::vector<int> contact, Watch watch) {
    using Problem = OrbitProblem<LinearFlight<6>>;
    return std::make_unique<OrbitProblemOf<LinearFlight<6>>>(
        Problem(std::move(flight), std::move(contacts), std::move(closure), std::move(contact)), std::move(watch));
}

}  // namespace saltus
