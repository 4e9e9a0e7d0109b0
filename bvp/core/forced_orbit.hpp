/// Orbits under periodic loads for Python, whatever their numbers of states and parameters.
#pragma once

#include "any_problem.hpp"
#include "forced_tests.hpp"

namespace saltus {

/// A forced problem of any size.
class AnyForcedProblem : public AnyProblem {
public:
    /// The multipliers (N,) of an orbit by modulus descending; of half a period those of x -> -x over it. False where they
    /// are not found.
    virtual bool multipliers(Values y, Vector<double> real, Vector<double> imaginary) = 0;
};

/// What a forced problem consists of.
struct ForcedParts {
    std::vector<LoadedFlight<>> modes;
    Parameters parameters;
    ForcedEvents events;
    ForcedClosure closure;
    std::vector<double> units;
    ForcedWatch watch;
};

template <int N, int P>
std::unique_ptr<AnyForcedProblem> make_forced_problem(ForcedParts parts);

template <int N, int P>
class ForcedProblemOf final
    : public ProblemOf<AnyForcedProblem, ForcedProblem<N, P>, ForcedTests<ForcedProblem<N, P>>, ForcedWatch> {
public:
    using Base = ProblemOf<AnyForcedProblem, ForcedProblem<N, P>, ForcedTests<ForcedProblem<N, P>>, ForcedWatch>;
    using typename Base::Work;

    explicit ForcedProblemOf(ForcedParts parts)
        : Base({{parts.modes.begin(), parts.modes.end()}, std::move(parts.parameters), std::move(parts.events),
                parts.closure, std::move(parts.units)},
               std::move(parts.watch)) {}

    bool multipliers(Values y, Vector<double> real, Vector<double> imaginary) override {
        return this->with_work([&](Work& work) {
            if (this->problem_.is_free()) return false;
            work.tests.prepare(y);
            auto& stroboscopic = work.tests.stroboscopic;
            if (!stroboscopic.find(y, work.stepper.newton.flown, false)) return false;
            copy(stroboscopic.found.real, real);
            copy(stroboscopic.found.imaginary, imaginary);
            return true;
        });
    }
};

}  // namespace saltus
