/// Multipoint problems behind one interface, whatever their equations and the kind of their flights: for Python.
#pragma once

#include "derivatives.hpp"
#include "family.hpp"
#include "work_pool.hpp"

namespace saltus {

/// A family of orbits: how its test functions are watched, how many are computed (1: the fold alone, and nothing is
/// observed), and most iterations of a correction.
struct FamilySettings {
    WatchedTests watched;
    FamilyLimits limits;
    int computed, maximum;
};

/// Energy and quarter period of an orbit, or parameter and period; the change of the first one along a tangent, and the
/// tangent's length in the metric.
struct Course {
    double energy, alpha, change, length;
};

/// A multipoint problem. Arrays have the sizes of `Landing`; their sizes are checked by who calls.
class AnyProblem {
public:
    virtual ~AnyProblem() = default;
    virtual int unknowns() const = 0;
    virtual int inner() const = 0;
    virtual int size() const = 0;
    /// Entries of a position.
    virtual int coordinates() const = 0;
    virtual void residual(Values y, Vector<double> out) = 0;
    virtual void jacobian(Values y, Matrix<double> out) = 0;
    /// F''(y)[a, b], equation (38).
    virtual void bend(Values y, Values a, Values b, Vector<double> out) = 0;
    /// F'''(y)[a, b, c].
    virtual void twist(Values y, Values a, Values b, Values c, Vector<double> out) = 0;
    virtual void scales(Values y, Vector<double> out) = 0;
    /// See `Metric`: position and direction of the family at y along a tangent (u,); and the row (u,) of a direction.
    virtual Course course(Values y, Values tangent, Vector<double> position, Vector<double> direction) = 0;
    virtual void constraint_row(Values y, Values direction, Vector<double> out) = 0;
    virtual bool step(Values y, Values tangent, double ds, int maximum, bool full, const Landing& landing,
                      Point& point) = 0;
    virtual bool correct(Values y, Values row, double target, int maximum, const Landing& landing, Point& point) = 0;
    virtual void observe(Values y, Values ends, Point& point) = 0;
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

/// A problem with its test functions. `Base` is `AnyProblem` with more functions. `Tests` is made of the problem, what is
/// watched, and Newton's method, which has computed the flights of an orbit just before.
template <class Base, class Kind, class Tests, class Watch>
class ProblemOf : public Base {
public:
    using Problem = Kind;
    struct Work {
        Work(const Problem& problem, const Watch& watch) : stepper(problem), tests(problem, watch, stepper.newton) {}
        Stepper<Problem> stepper;
        Tests tests;
    };

    ProblemOf(Problem problem, Watch watch) : problem_(std::move(problem)), watch_(std::move(watch)) {}

    int unknowns() const override { return problem_.unknowns(); }
    int inner() const override { return problem_.inner(); }
    int size() const override { return problem_.size(); }
    int coordinates() const override { return problem_.coordinates(); }

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

    void bend(Values y, Values a, Values b, Vector<double> out) override { second_derivative(problem_, y, a, b, out); }

    void twist(Values y, Values a, Values b, Values c, Vector<double> out) override {
        third_derivative(problem_, y, a, b, c, out);
    }

    void scales(Values y, Vector<double> out) override {
        with_work([&](Work& work) {
            auto& newton = work.stepper.newton;
            newton.evaluate(y);
            newton.set_scale(y);
            copy(newton.scale, out);
        });
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

    bool step(Values y, Values tangent, double ds, int maximum, bool full, const Landing& landing,
              Point& point) override {
        return with_work([&](Work& work) {
            if (!work.stepper.step(y, tangent, ds, maximum, landing, point)) return false;
            if (full) work.tests.observe(landing.y, landing.ends, point);
            return true;
        });
    }

    bool correct(Values y, Values row, double target, int maximum, const Landing& landing, Point& point) override {
        return with_work([&](Work& work) { return work.stepper.correct(y, row, target, maximum, landing, point); });
    }

    void observe(Values y, Values ends, Point& point) override {
        with_work([&](Work& work) {
            work.tests.prepare(y);
            work.tests.observe(y, ends, point);
        });
    }

    int tests(int targets) const override { return Tests::count(problem_, targets, watch_); }

    void test_values(const FamilySettings& family, Values y, Values ends, const Point& point,
                     Vector<double> out) override {
        with_family(family, [&](Work& work, auto&) {
            work.tests.prepare(y);
            work.tests.fill(y, ends, point, out);
        });
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

protected:
    /// Call use(work) with a work space of its own.
    template <class Use>
    auto with_work(Use&& use) {
        return pool_.with([&] { return std::make_unique<Work>(problem_, watch_); }, use);
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

private:
    const Watch watch_;
    WorkPool<Work> pool_;
};

}  // namespace saltus
