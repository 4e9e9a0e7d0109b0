/// Conservative orbits of one problem for Python, whatever the kind of their flights.
#pragma once

#include "any_problem.hpp"
#include "test_functions.hpp"

namespace saltus {

/// A multipoint problem with any flight.
class AnyOrbitProblem : public AnyProblem {
public:
    virtual int parameters() const = 0;
    /// The largest factor by which perturbations grow along a flight.
    virtual double growth(Values y) = 0;
    /// The nodes of the full period.
    virtual void unfold(Values y, Period& out) = 0;
    virtual void end_states(Values y, Vector<double> out) = 0;
    /// States after the inner nodes, (k, N), from the start state by exact flight over the times of which the first k
    /// count.
    virtual void nodes(Values start, Values times, Vector<double> out) = 0;
    virtual std::tuple<int, double, double> solve(Vector<double> y, double energy, double quarter_period,
                                                  const Landing& landing, Point& point) = 0;
    virtual bool meet_position(Values position, double near, int most, Values y, Values tangent,
                               const Landing& landing) = 0;
};

template <class Flight>
std::unique_ptr<AnyOrbitProblem> make_orbit_problem(Flight flight, Contacts contacts, Closure closure,
                                                    std::vector<int> contact, Watch watch);

/// See `AnyOrbitProblem`.
template <class Flight>
class OrbitProblemOf final
    : public ProblemOf<AnyOrbitProblem, OrbitProblem<Flight>, ConservativeTests<OrbitProblem<Flight>>, Watch> {
public:
    using Base = ProblemOf<AnyOrbitProblem, OrbitProblem<Flight>, ConservativeTests<OrbitProblem<Flight>>, Watch>;
    using typename Base::Problem, typename Base::Work;

    OrbitProblemOf(Problem problem, Watch watch) : Base(std::move(problem), std::move(watch)) {
        // Those of an orbit, and of its mirror image.
        if constexpr (Flight::is_series()) problem_.flight().keep(2 * (problem_.inner() + 1));
    }

    int parameters() const override { return problem_.parameters(); }

    double growth(Values y) override {
        return this->with_work([&](Work& work) {
            auto& newton = work.stepper.newton;
            newton.evaluate(y);
            return problem_.growth(newton.flown, newton.set_scale(y));
        });
    }

    void unfold(Values y, Period& out) override {
        Array<> ends(problem_.inner() + 1, problem_.size());
        end_states(y, {ends.data(), size_t(ends.rows()) * ends.columns()});
        out.unfold(problem_, y, ends);
    }

    void end_states(Values y, Vector<double> out) override {
        const int n = problem_.size();
        problem_.each_flight(y, [&](int i, auto z, double t) { problem_.flight().end(z, t, out.subspan(i * n, n)); });
    }

    void nodes(Values start, Values times, Vector<double> out) override {
        const int n = problem_.size();
        for (int i = 0; i < problem_.inner(); ++i) {
            const Values z = i == 0 ? start : Values(out.subspan((i - 1) * n, n));
            problem_.flight().end(z, times[i], out.subspan(i * n, n));
            problem_.land(i, out.subspan(i * n, n), &out[i * n]);
        }
    }

    std::tuple<int, double, double> solve(Vector<double> y, double energy, double quarter_period,
                                          const Landing& landing, Point& point) override {
        return this->with_work([&](Work& work) {
            const auto found = work.stepper.solve(y, energy, quarter_period, landing, point);
            if (found.outcome == Stepper<Problem>::SOLVED) work.tests.observe(landing.y, landing.ends, point);
            return std::make_tuple(int(found.outcome), found.change, found.previous);
        });
    }

    bool meet_position(Values position, double near, int most, Values y, Values tangent,
                       const Landing& landing) override {
        return this->with_work([&](Work& work) {
            return work.stepper.meet_position(position, near, most, {y.begin(), y.end()}, tangent, landing);
        });
    }

private:
    using Base::problem_;
};

}  // namespace saltus
