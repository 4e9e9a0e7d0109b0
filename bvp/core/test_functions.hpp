/// The test functions of families of conservative orbits, equation (35): their zeros are the bifurcations and the ends
/// of a family.
#pragma once

#include "family.hpp"
#include "observe.hpp"
#include "pair_tests.hpp"

namespace saltus {

/// Test functions that every family has, whatever its degrees of freedom.
inline constexpr int COMMON_TESTS = 11;

/// Larger clearances are replaced by this value.
inline constexpr double CLEAR = 1e3;

/// Noise of the slope, as a part of the energy, times the square of the smallest pivot over the steepness: the
/// direction of the tangent is uncertain by as much. For smooth flights measured: 2e-16 as a rule, at most 2.4e-14,
/// beside a branch point of closed orbits.
inline constexpr double TANGENT_NOISE = 2e-13, SMOOTH_TANGENT_NOISE = 6e-14;

/// Noise of the slope, as a part of the energy, times the square of the conditioning over the steepness, at most.
inline constexpr double CONDITION_NOISE = 5e-17;

/// Part of the energy up to which the noise of a slope does not count here: it is measured where a zero is located.
inline constexpr double CLEAR_SLOPE = 0.05;

/// The first `COMMON_TESTS` entries of `out`: fold, branch point, grazing in its three ways, the bounds of the energy's
/// logarithm and of the quarter period's, impulsive orbits, and a number that identifies the label.
inline void common_tests(const Point& point, const FamilyLimits& limits, Vector<double> out) {
    const double level = log(point.energy), slope = std::fabs(point.slope),
                 square = point.conditioning * point.conditioning;
    const double unit = point.steepness * point.energy, error = CONDITION_NOISE * unit;
    const bool certain = slope * point.branching * point.branching > limits.tangent_noise * unit &&
                         (error < CLEAR_SLOPE * point.energy * square || slope * square > error);
    out[0] = certain ? point.slope : NOT_A_NUMBER;
    out[1] = point.branching;
    out[2] = point.clearance < CLEAR ? point.clearance : CLEAR;
    out[3] = point.speed;
    out[4] = point.flight;
    out[5] = limits.low > -INFINITE ? level - limits.low : 1.0;
    out[6] = limits.high < INFINITE ? limits.high - level : 1.0;
    out[7] = limits.longest < INFINITE ? limits.longest - log(point.quarter_period) : 1.0;
    out[8] = point.absorber_start;
    out[9] = point.absorber_end;
    const double waves = point.waves_absorber * 4096.0 + point.waves_primary;
    out[10] = (waves * 4096.0 + point.first_quarter) * 8192.0 + point.second_quarter * 4.0 + point.in_phase;
}

/// What is observed of a problem's orbits: functionals along the flights; the displacements that stops and springs
/// hold, (m + 1, n), and those that nothing resists, (f, n); whether two degrees of freedom are looked at as any number.
struct Watch {
    Observed observed;
    Array<> held, free;
    bool general;
};

/// The test functions of the orbits of one problem, with what they are computed from.
template <class Problem>
class ConservativeTests {
    static constexpr int SIZE = Problem::SIZE;

public:
    template <class Newton>
    ConservativeTests(const Problem& problem, const Watch& watch, const Newton&)
        : stability(problem, watch.held, watch.free), problem_(problem), observed_(watch.observed),
          is_pair_(problem.size() == 4 && !watch.general) {}

    /// Nothing is to be computed before an orbit is observed.
    void prepare(Values) {}

    OrbitStability<Problem> stability;

    /// Number of the test functions.
    static int count(const Problem& problem, int targets, const Watch& watch) {
        if (problem.periodic()) return COMMON_TESTS + 2 + targets;
        return COMMON_TESTS + 3 + (problem.closure().quarters == 1) + (problem.size() != 4 || watch.general) + targets;
    }

    /// What is seen along the orbit, and of two degrees of freedom the half map and the multipliers, into the point.
    void observe(Values y, Values ends, Point& point) {
        const Matrix<const double> states(ends.data(), problem_.inner() + 1, problem_.size());
        Observation(problem_, observed_, y, states, point).run();
        if (is_pair()) {
            const PairStability found = stability.pair(problem_, y, states);
            point.a = found.a, point.b = found.b, point.c = found.c, point.d = found.d;
            point.magnified = found.magnified, point.singular = found.is_singular;
            point.trace = found.trace, point.determinant = found.determinant, point.trivial = found.trivial;
            point.larger_real = found.larger.real, point.larger_imaginary = found.larger.imag;
            point.smaller_real = found.smaller.real, point.smaller_imaginary = found.smaller.imag;
        }
    }

    /// Observe an orbit, and fill its test functions; false where it is no orbit. Without limits the fold is the only
    /// one, and nothing is observed.
    bool operator()(Values y, Values ends, Point& point, Vector<double> out) {
        if (limits != nullptr) observe(y, ends, point);
        if (!(point.residual < ACCURATE) || point.gave_up == 1.0) return false;
        if (limits == nullptr) out[0] = point.slope;
        else fill(y, ends, point, out);
        return true;
    }

    const FamilyLimits* limits = nullptr;

    /// The test functions at an observed orbit.
    void fill(Values y, Values ends, const Point& point, Vector<double> out) {
        common_tests(point, *limits, out);
        const Vector<double> after = out.subspan(COMMON_TESTS);
        const TestedOrbit orbit{point.speeds, point.branching, limits->targets};
        const Matrix<const double> states(ends.data(), problem_.inner() + 1, problem_.size());
        const Closure& closure = problem_.closure();
        if (problem_.periodic()) return closed_orbit_tests(problem_, y, states, stability, orbit, after);
        if (is_pair()) stability.set_half_map(point.a, point.b, point.c, point.d);
        else stability.find_half_map(problem_, y, states);
        const double rate = closure.pace == UNPACED ? 1.0 / point.quarter_period : std::ldexp(1.0, closure.pace);
        half_map_tests(stability.phi(), closure.start == End::ORIGIN, closure.finish == End::ORIGIN, rate,
                       closure.quarters, !is_pair(), orbit, after);
    }

private:
    /// Whether there is one pair of multipliers.
    bool is_pair() const {
        if constexpr (SIZE != DYNAMIC && SIZE != 4) return false;
        return is_pair_;
    }

    const Problem& problem_;
    const Observed& observed_;
    bool is_pair_;
};

}  // namespace saltus
