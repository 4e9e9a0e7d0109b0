/// Orbits with smooth forces, of any number of states.
#include "orbit.hpp"
#include "smooth_flight.hpp"

namespace saltus {

template <>
std::unique_ptr<AnyOrbitProblem> make_orbit_problem(SmoothFlight<> flight, Contacts contacts, Closure closure,
                                                    std::vector<int> contact, Watch watch) {
    using Problem = OrbitProblem<SmoothFlight<>>;
    return std::make_unique<OrbitProblemOf<SmoothFlight<>>>(
        Problem(std::move(flight), std::move(contacts), std::move(closure), std::move(contact)), std::move(watch));
}

}  // namespace saltus
