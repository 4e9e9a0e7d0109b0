/// Orbits under loads with any number of states and parameters.
#include "forced_orbit.hpp"

namespace saltus {

template <>
std::unique_ptr<AnyForcedProblem> make_forced_problem<DYNAMIC, DYNAMIC>(ForcedParts parts) {
    return std::make_unique<ForcedProblemOf<DYNAMIC, DYNAMIC>>(std::move(parts));
}

}  // namespace saltus
