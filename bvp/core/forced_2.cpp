/// Orbits under loads with one degree of freedom, in one parameter.
#include "forced_orbit.hpp"

namespace saltus {

template <>
std::unique_ptr<AnyForcedProblem> make_forced_problem<LoadedFlight<2>, 1>(ForcedParts parts) {
    return std::make_unique<ForcedProblemOf<LoadedFlight<2>, 1>>(std::move(parts));
}

}  // namespace saltus
