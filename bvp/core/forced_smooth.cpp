/// Orbits with smooth forces under loads.
#include "forced_orbit.hpp"

namespace saltus {

template <>
std::unique_ptr<AnyForcedProblem> make_forced_problem<SmoothLoadedFlight, DYNAMIC>(ForcedParts parts) {
    return std::make_unique<ForcedProblemOf<SmoothLoadedFlight, DYNAMIC>>(std::move(parts));
}

}  // namespace saltus
