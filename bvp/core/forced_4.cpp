/// Orbits under loads with two degrees of freedom, in one parameter.
#include "forced_orbit.hpp"

namespace saltus {

template <>
std::unique_ptr<AnyForcedProblem> make_forced_problem<LoadedFlight<4>, 1>(ForcedParts parts) {
    return std::make_unique<ForcedProblemOf<LoadedFlight<4>, 1>>(std::move(parts));
}

}  // namespace saltus
