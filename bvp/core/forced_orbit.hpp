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
    /// States and times (k + 1, N + 1) at the begin of flights, behind a chatter.
    virtual void starts(Values y, Matrix<double> out) = 0;
};

/// What a forced problem consists of.
struct ForcedParts {
    std::vector<LoadedFlight<>> modes;
    std::vector<SmoothLoadedFlight> smooth;  // or one flight with smooth forces
    Parameters parameters;
    ForcedEvents events;
    ForcedClosure closure;
    std::vector<double> units;
    ForcedWatch watch;
};

template <class Flight, int P>
std::unique_ptr<AnyForcedProblem> make_forced_problem(ForcedParts parts);

template <class Flight, int P>
class ForcedProblemOf final
    : public ProblemOf<AnyForcedProblem, ForcedProblem<Flight, P>, ForcedTests<ForcedProblem<Flight, P>>, ForcedWatch> {
public:
    using Base = ProblemOf<AnyForcedProblem, ForcedProblem<Flight, P>, ForcedTests<ForcedProblem<Flight, P>>, ForcedWatch>;
    using typename Base::Work;

    explicit ForcedProblemOf(ForcedParts parts)
        : Base({flights(parts), std::move(parts.parameters), std::move(parts.events),
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

    void starts(Values y, Matrix<double> out) override {
        this->with_work([&](Work& work) {
            work.tests.prepare(y);
            const auto& flown = work.stepper.newton.flown;
            for (int i = 0; i < out.rows(); ++i) {
                copy(flown.starts[i], out[i].first(this->size()));
                out(i, this->size()) = this->problem_.clock(y, i) + flown.lasted[i];
            }
        });
    }

private:
    static std::vector<Flight> flights(const ForcedParts& parts) {
        if constexpr (Flight::is_series()) return parts.smooth;
        else return {parts.modes.begin(), parts.modes.end()};
    }
};

}  // namespace saltus
