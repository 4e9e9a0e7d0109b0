/// The test functions of families of orbits under loads.
#pragma once

#include "family.hpp"
#include "forced_metric.hpp"
#include "observe_forced.hpp"
#include "stroboscopic.hpp"

namespace saltus {

/// Test functions of every forced family, before those of values that are asked for.
inline constexpr int FORCED_TESTS = 9;

/// Larger clearances and speeds, in units of arclength, are replaced by this value.
inline constexpr double FAR = 1e3;

/// Impact speed, over the largest velocity, below which an impact grazes: a located grazing has one of rounding, about 1e-12.
inline constexpr double GRAZING = 1e-11;

/// The test functions of the orbits of one problem; the flights of an orbit are those that Newton's method computed last.
template <class Problem>
class ForcedTests {
public:
    ForcedTests(const Problem& problem, const ForcedWatch& watch, Newton<Problem>& newton)
        : stroboscopic(problem), problem_(problem), watch_(watch), newton_(newton) {}

    Stroboscopic<Problem> stroboscopic;
    typename Problem::template Setting<double> place;  // at the parameters of a single flight
    const ForcedWatch& watch() const { return watch_; }

    static int count(const Problem&, int targets, const ForcedWatch&) { return FORCED_TESTS + targets; }

    const FamilyLimits* limits = nullptr;

    void prepare(Values y) { newton_.evaluate(y); }

    /// Free orbits are left to the problem of the system at their parameters.
    void observe(Values y, Values, Point& point) {
        point.gave_up = 0.0;
        if (!problem_.is_free()) ForcedObservation(problem_, watch_, y, newton_.flown, point).run();
    }

    /// Observe an orbit, and fill its test functions; false where it is no orbit.
    bool operator()(Values y, Values ends, Point& point, Vector<double> out) {
        if (limits != nullptr) observe(y, ends, point);
        if (!(point.residual < ACCURATE) || point.gave_up == 1.0) return false;
        if (limits == nullptr) out[0] = point.slope;
        else fill(y, ends, point, out);
        return true;
    }

    /// Fold, branch point, grazing in its three ways, the bounds of the parameter, det(M + 1) and the product of 1 - mu_i
    /// mu_j for the stroboscopic map M, and the distances of the parameter from the targets.
    void fill(Values y, Values, const Point& point, Vector<double> out) {
        const double value = point.energy;
        out[0] = point.slope;
        out[1] = point.branching;
        out[2] = std::min(point.clearance / problem_.units()[0], FAR);
        out[3] = std::min(point.speed / problem_.units()[problem_.size() / 2], FAR);
        out[4] = point.flight / point.quarter_period;
        out[5] = limits->low > -INFINITE ? value - limits->low : 1.0;
        out[6] = limits->high < INFINITE ? limits->high - value : 1.0;
        out[7] = out[8] = NOT_A_NUMBER;
        if (!problem_.is_free()) std::tie(out[7], out[8]) = stroboscopic.tests(y, newton_.flown);
        if (limits->neutral) out[8] = NOT_A_NUMBER;
        for (size_t k = 0; k < limits->targets.size(); ++k) out[FORCED_TESTS + k] = value - limits->targets[k];
    }

private:
    const Problem& problem_;
    const ForcedWatch& watch_;
    Newton<Problem>& newton_;
};

}  // namespace saltus
