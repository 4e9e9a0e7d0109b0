/// Orbits with linear flights of two degrees of freedom.
#include "orbit.hpp"

namespace saltus {

template <>
std::unique_ptr<AnyOrbitProblem> make_orbit_problem(LinearFlight<4> flight, Contacts contacts, Closure closure,
                                                    std::vector<int> contact, Watch watch) {
    using Problem = OrbitProblem<LinearFlight<4>>;
    return std::make_unique<OrbitProblemOf<LinearFlight<4>>>(
        Problem(std::move(flight), std::move(contacts), std::move(closure), std::move(contact)), std::move(watch));
}

}  // namespace saltus
