/// Orbits under loads with any number of states and parameters.
#include "forced_orbit.hpp"

namespace saltus {

template <>
std::unique_ptr<AnyForcedProblem> make_forced_problem<LoadedFlight<>, DYNAMIC>(ForcedParts parts) {
    return std::make_unique<ForcedProblemOf<LoadedFlight<>, DYNAMIC>>(std::move(parts));
}

}  // namespace saltus
