/// Orbits of one problem for Python, whatever the kind of its flights: data and work spaces behind one interface.
#pragma once

#include <memory>
#include <mutex>

#include "test_functions.hpp"

namespace saltus {

/// Work spaces of one kind: a call borrows one, so that threads can share a problem.
template <class Work>
class WorkPool {
public:
    template <class Make>
    std::unique_ptr<Work> borrow(Make&& make) {
        {
            const std::lock_guard lock(mutex_);
            if (!idle_.empty()) {
                std::unique_ptr<Work> work = std::move(idle_.back());
                idle_.pop_back();
                return work;
            }
        }
        return make();
    }
    void give_back(std::unique_ptr<Work> work) {
        const std::lock_guard lock(mutex_);
        idle_.push_back(std::move(work));
    }

private:
    std::mutex mutex_;
    std::vector<std::unique_ptr<Work>> idle_;
};

/// What is observed of a problem's orbits: functionals along the flights; the displacements that stops and springs
/// hold, (m + 1, n), and those that nothing resists, (f, n); whether two degrees of freedom are looked at as any number.
struct Watch {
    Observed observed;
    Array<> held, free;
    bool general;
};

/// A family of orbits: how its test functions are watched, how many are computed (1: the fold alone, and nothing is
/// observed), and most iterations of a correction.
struct FamilySettings {
    WatchedTests watched;
    FamilyLimits limits;
    int computed, maximum;
};

/// Energy and quarter period of an orbit; the change of the energy along a tangent, and the tangent's length in the metric.
struct Course {
    double energy, alpha, change, length;
};

/// A multipoint problem with any flight. Arrays have the sizes of `Landing`; their sizes are checked by who calls.
class AnyOrbitProblem {
public:
    virtual ~AnyOrbitProblem() = default;
    virtual int unknowns() const = 0;
    virtual int parameters() const = 0;
    virtual int inner() const = 0;
    virtual int size() const = 0;
    virtual void residual(Values y, Vector<double> out) = 0;
    virtual void jacobian(Values y, Matrix<double> out) = 0;
    /// F''(y)[a, b], equation (38).
    virtual void bend(Values y, Values a, Values b, Vector<double> out) = 0;
    /// F'''(y)[a, b, c].
    virtual void twist(Values y, Values a, Values b, Values c, Vector<double> out) = 0;
    virtual void scales(Values y, Vector<double> out) = 0;
    /// The largest factor by which perturbations grow along a flight.
    virtual double growth(Values y) = 0;
    /// The nodes of the full period.
    virtual void unfold(Values y, Period& out) = 0;
    /// See `Metric`: position and direction (N + 2,) of the family at y along a tangent (u,); and the row (u,) of a direction.
    virtual Course course(Values y, Values tangent, Vector<double> position, Vector<double> direction) = 0;
    virtual void constraint_row(Values y, Values direction, Vector<double> out) = 0;
    virtual void end_states(Values y, Vector<double> out) = 0;
    /// States after the inner nodes, (k, N), from the start state by exact flight over the times of which the first k
    /// count.
    virtual void nodes(Values start, Values times, Vector<double> out) = 0;
    virtual bool step(Values y, Values tangent, double ds, int maximum, bool full, const Landing& landing,
                      Point& point) = 0;
    virtual bool correct(Values y, Values row, double target, int maximum, const Landing& landing, Point& point) = 0;
    virtual void observe(Values y, Values ends, Point& point) = 0;
    virtual std::tuple<int, double, double> solve(Vector<double> y, double energy, double quarter_period,
                                                  const Landing& landing, Point& point) = 0;
    virtual bool meet_position(Values position, double near, int most, Values y, Values tangent,
                               const Landing& landing) = 0;
    /// How many test functions there are, with so many targets.
    virtual int tests(int targets) const = 0;
    /// The test functions at an observed orbit.
    virtual void test_values(const FamilySettings& family, Values y, Values ends, const Point& point,
                             Vector<double> out) = 0;
    /// See `FamilyStepper`; land fills the first row of a block.
    virtual bool land(const FamilySettings& family, Values y, Values tangent, double ds, const StepRows& block) = 0;
    virtual Advanced advance(const FamilySettings& family, const Beginning& begin, const Goal& goal, double ds,
                             const Control& control, const StepRows& block) = 0;
    virtual std::pair<int, Inside> narrow(const FamilySettings& family, Values y, Values tangent, const KnownStep& low,
                                          const KnownStep& high, const Sought& sought, const Samples& samples,
                                          const StepRows& block) = 0;
};

template <class Flight>
std::unique_ptr<AnyOrbitProblem> make_orbit_problem(Flight flight, Contacts contacts, Closure closure,
                                                    std::vector<int> contact, Watch watch);

/// See `AnyOrbitProblem`.
template <class Flight>
class OrbitProblemOf final : public AnyOrbitProblem {
public:
    using Problem = OrbitProblem<Flight>;
    struct Work {
        Work(const Problem& problem, const Watch& watch)
            : stepper(problem), tests(problem, watch.observed, watch.held, watch.free, watch.general) {}
        Stepper<Problem> stepper;
        ConservativeTests<Problem> tests;
    };

    OrbitProblemOf(Problem problem, Watch watch) : problem_(std::move(problem)), watch_(std::move(watch)) {
        // Those of an orbit, and of its mirror image.
        if constexpr (Flight::is_series()) problem_.flight().keep(2 * (problem_.inner() + 1));
    }

    int unknowns() const override { return problem_.unknowns(); }
    int parameters() const override { return problem_.parameters(); }
    int inner() const override { return problem_.inner(); }
    int size() const override { return problem_.size(); }

    void residual(Values y, Vector<double> out) override { problem_.residual(y, out); }

    void jacobian(Values y, Matrix<double> out) override {
        with_work([&](Work& work) {
            auto& newton = work.stepper.newton;
            newton.evaluate(y);
            std::fill(newton.scale.begin(), newton.scale.end(), 1.0);
            newton.linearise(y);
            newton.elimination.dense(out);
        });
    }

    void bend(Values y, Values a, Values b, Vector<double> out) override {
        using Inner = Jet<double, 1>;
        using Outer = Jet<Inner, 1>;
        std::vector<Outer> at(y.size()), value(out.size());
        for (size_t j = 0; j < y.size(); ++j) {
            at[j] = Outer(Inner(y[j]));
            at[j].value.slopes[0] = a[j];
            at[j].slopes[0] = Inner(b[j]);
        }
        problem_.residual(at, value);
        for (size_t j = 0; j < out.size(); ++j) out[j] = value[j].slopes[0].slopes[0];
    }

    void twist(Values y, Values a, Values b, Values c, Vector<double> out) override {
        using First = Jet<double, 1>;
        using Second = Jet<First, 1>;
        using Third = Jet<Second, 1>;
        std::vector<Third> at(y.size()), value(out.size());
        for (size_t j = 0; j < y.size(); ++j) {
            at[j] = Third(Second(First(y[j])));
            at[j].value.value.slopes[0] = a[j];
            at[j].value.slopes[0] = First(b[j]);
            at[j].slopes[0] = Second(First(c[j]));
        }
        problem_.residual(at, value);
        for (size_t j = 0; j < out.size(); ++j) out[j] = value[j].slopes[0].slopes[0].slopes[0];
    }

    void scales(Values y, Vector<double> out) override {
        with_work([&](Work& work) {
            auto& newton = work.stepper.newton;
            newton.evaluate(y);
            newton.set_scale(y);
            copy(newton.scale, out);
        });
    }

    double growth(Values y) override {
        return with_work([&](Work& work) {
            auto& newton = work.stepper.newton;
            newton.evaluate(y);
            return newton.growth(newton.set_scale(y));
        });
    }

    void unfold(Values y, Period& out) override {
        Array<> ends(problem_.inner() + 1, problem_.size());
        end_states(y, {ends.data(), size_t(ends.rows()) * ends.columns()});
        out.unfold(problem_, y, ends);
    }

    Course course(Values y, Values tangent, Vector<double> position, Vector<double> direction) override {
        Metric<Problem> metric(problem_);
        metric.locate(y);
        const double length = metric.direct(tangent);
        copy(metric.position, position);
        copy(metric.direction, direction);
        return {metric.energy, metric.alpha, metric.change, length};
    }

    void constraint_row(Values y, Values direction, Vector<double> out) override {
        Metric<Problem> metric(problem_);
        metric.locate(y);
        copy(direction, metric.direction);
        metric.constraint_row(out);
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

    bool step(Values y, Values tangent, double ds, int maximum, bool full, const Landing& landing,
              Point& point) override {
        return with_work([&](Work& work) {
            if (!work.stepper.step(y, tangent, ds, maximum, landing, point)) return false;
            if (full) work.tests.observe(landing.y, landing.ends, point);
            return true;
        });
    }

    void observe(Values y, Values ends, Point& point) override {
        with_work([&](Work& work) { work.tests.observe(y, ends, point); });
    }

    bool correct(Values y, Values row, double target, int maximum, const Landing& landing, Point& point) override {
        return with_work([&](Work& work) { return work.stepper.correct(y, row, target, maximum, landing, point); });
    }

    std::tuple<int, double, double> solve(Vector<double> y, double energy, double quarter_period,
                                          const Landing& landing, Point& point) override {
        return with_work([&](Work& work) {
            const auto found = work.stepper.solve(y, energy, quarter_period, landing, point);
            if (found.outcome == Stepper<Problem>::SOLVED) work.tests.observe(landing.y, landing.ends, point);
            return std::make_tuple(int(found.outcome), found.change, found.previous);
        });
    }

    bool meet_position(Values position, double near, int most, Values y, Values tangent,
                       const Landing& landing) override {
        return with_work([&](Work& work) {
            return work.stepper.meet_position(position, near, most, {y.begin(), y.end()}, tangent, landing);
        });
    }

    int tests(int targets) const override { return ConservativeTests<Problem>::count(problem_, targets, watch_.general); }

    void test_values(const FamilySettings& family, Values y, Values ends, const Point& point,
                     Vector<double> out) override {
        with_family(family, [&](Work& work, auto&) { work.tests.fill(y, ends, point, out); });
    }

    bool land(const FamilySettings& family, Values y, Values tangent, double ds, const StepRows& block) override {
        Point point;
        return with_family(family, [&](Work&, auto& stepper) { return stepper.land(y, tangent, ds, block, 0, point); });
    }

    Advanced advance(const FamilySettings& family, const Beginning& begin, const Goal& goal, double ds,
                     const Control& control, const StepRows& block) override {
        return with_family(family,
                           [&](Work&, auto& stepper) { return stepper.advance(begin, goal, ds, control, block); });
    }

    std::pair<int, Inside> narrow(const FamilySettings& family, Values y, Values tangent, const KnownStep& low,
                                  const KnownStep& high, const Sought& sought, const Samples& samples,
                                  const StepRows& block) override {
        return with_family(family, [&](Work&, auto& stepper) {
            return stepper.narrow(y, tangent, low, high, sought, samples, block);
        });
    }

private:
    /// Call use(work) with a work space of its own.
    template <class Use>
    auto with_work(Use&& use) {
        std::unique_ptr<Work> work = pool_.borrow([&] { return std::make_unique<Work>(problem_, watch_); });
        struct Return {
            WorkPool<Work>& pool;
            std::unique_ptr<Work>& work;
            ~Return() { pool.give_back(std::move(work)); }
        } back{pool_, work};
        return use(*work);
    }

    /// The same with what takes steps along a family.
    template <class Use>
    auto with_family(const FamilySettings& family, Use&& use) {
        return with_work([&](Work& work) {
            work.tests.limits = family.computed == 1 ? nullptr : &family.limits;
            FamilyStepper stepper(work.stepper, work.tests, family.watched, family.maximum);
            return use(work, stepper);
        });
    }

    const Problem problem_;
    const Watch watch_;
    WorkPool<Work> pool_;
};

}  // namespace saltus
