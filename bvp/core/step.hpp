/// One step along a family of orbits, equation (33): predict, correct, tangent; and corrections onto an energy, a
/// period or a position.
#pragma once

#include "newton.hpp"
#include "point.hpp"

namespace saltus {

/// Length of a step whose third derivative has digits: its rounding eps/length^3, over a step of the longest length
/// 0.025, is 1e-9.
inline constexpr double LONG_ENOUGH = 1e-4;

/// Part of a step by which a prediction may be longer than its projection on the tangent.
inline constexpr double LONGEST_SHIFT = 0.1;

/// Length of an update of Newton's corrections, in units of the unknowns' sizes, that is rounding.
inline constexpr double STEP_ROUNDING = 2e-15;

/// Position and direction of a family in the coordinates (start state / sqrt(2 h), log h, log alpha), in which
/// arclength is measured.
///
/// Displacements are multiplied by the unit of frequency: a power of two, or 1/alpha.
template <class Problem>
class Metric {
public:
    explicit Metric(const Problem& problem)
        : position(problem.size() + 2), direction(problem.size() + 2), problem_(problem),
          frequency_(is_unpaced() ? NOT_A_NUMBER : std::ldexp(1.0, problem.closure().pace)) {}

    std::vector<double> position, direction;  // (N + 2,)
    double energy = 0.0, alpha = 0.0;

    /// The position of the orbit y.
    void locate(Values y) {
        const int n = problem_.size();
        problem_.start_state(y, position);
        energy = 0.5 * problem_.flight().twice_energy(position);
        alpha = problem_.total_time(y) / problem_.closure().quarters;
        speed_ = std::sqrt(2.0 * energy);
        const double unit = frequency();
        for (int r = 0; r < n; ++r) position[r] = position[r] / speed_ * (r < n / 2 ? unit : 1.0);
        position[n] = log(energy);
        position[n + 1] = alpha > 0.0 ? log(alpha) : -INFINITE;
    }

    /// The direction is the change of the position along a tangent of the unknowns, dp/dy tangent of equation (33).
    /// Returns its length.
    double direct(Values tangent) {
        const int n = problem_.size();
        const double unit = frequency();
        typename Problem::template State<> slope(n);
        energy_slope(slope);
        change = 0.0;
        for (int r = 0; r < n; ++r) {
            direction[r] = 0.0;
            for (int j = 0; j < problem_.parameters(); ++j)
                direction[r] += problem_.closure().start_map(r, j) * tangent[j];
            change += slope[r] * direction[r];
        }
        direction[n] = change / energy;
        direction[n + 1] = problem_.total_time(tangent) / problem_.closure().quarters / alpha;
        for (int r = 0; r < n; ++r) {
            direction[r] = direction[r] / speed_ * (r < n / 2 ? unit : 1.0) - position[r] * change / (2.0 * energy);
            if (r < n / 2 && is_unpaced()) direction[r] -= position[r] * direction[n + 1];
        }
        return std::sqrt(dot(direction, direction));
    }

    /// Row r with r . dy = <direction, change of the position along dy>: the pseudo-arclength condition in the
    /// unknowns.
    void constraint_row(Vector<double> row) const {
        const int n = problem_.size();
        const double unit = frequency();
        typename Problem::template State<> slope(n);
        energy_slope(slope);
        double along = 0.0, later = direction[n + 1];
        for (int r = 0; r < n; ++r) along += direction[r] * position[r];
        if (is_unpaced())
            for (int r = 0; r < n / 2; ++r) later -= direction[r] * position[r];
        const double radial = direction[n] / energy - along / (2.0 * energy);
        for (int r = 0; r < n; ++r) slope[r] = direction[r] * (r < n / 2 ? unit : 1.0) / speed_ + slope[r] * radial;
        std::fill(row.begin(), row.end(), 0.0);
        for (int j = 0; j < problem_.parameters(); ++j)
            for (int r = 0; r < n; ++r) row[j] += problem_.closure().start_map(r, j) * slope[r];
        for (int i = 0; i <= problem_.inner(); ++i) row[problem_.time(i)] = later / problem_.closure().quarters / alpha;
    }

    double change = 0.0;  // of the energy along the tangent of `direct`

private:
    bool is_unpaced() const { return problem_.closure().pace == UNPACED; }
    double frequency() const { return is_unpaced() ? 1.0 / alpha : frequency_; }

    /// grad H at the start state.
    template <class Out>
    void energy_slope(Out& out) const {
        const int n = problem_.size();
        typename Problem::template State<> z(n);
        const double unit = frequency();
        for (int r = 0; r < n; ++r) z[r] = position[r] * speed_ / (r < n / 2 ? unit : 1.0);
        problem_.flight().energy_slope(z, out);
    }

    const Problem& problem_;
    double frequency_, speed_ = 1.0;
};

/// Where a step leads: views of what it fills.
struct Landing {
    Vector<double> y, tangent;  // (u,); (2 u,) tangent and curvature, or (3 u,) with the third derivative behind them
    Vector<double> position;    // (N + 2,)
    Vector<double> ends;        // (k + 1, N) flat
};

/// Steps along families of one problem, with their work space.
template <class Problem>
class Stepper {
public:
    explicit Stepper(const Problem& problem)
        : newton(problem), problem_(problem), old_(problem), new_(problem), row_(problem.unknowns()),
          still_(2 * problem.unknowns()) {}

    Newton<Problem> newton;

    /// Step by ds from y along its tangent; with ds = 0, y itself is corrected. Fills the point up to `branching`, and
    /// the landing.
    ///
    /// tangent (2 u,) or (3 u,): with the curvature, and the third derivative. All zero: y itself is corrected, and the
    /// new tangent is turned as it comes.
    bool step(Values y, Values tangent, double ds, int maximum, const Landing& landing, Point& point) {
        std::fill(row_.begin(), row_.end(), 0.0);
        const bool oriented = predict(y, tangent, ds, landing.y);
        if (!oriented) ds = 0.0;
        double target = 0.0;
        if (oriented) {
            old_.locate(y);
            old_.direct(tangent);
        }
        if (ds != 0.0) {
            old_.constraint_row(row_);
            target = ds;
            for (size_t j = 0; j < y.size(); ++j) target += row_[j] * y[j];
            if (is_cubic(tangent)) predict_cubic(y, tangent, ds, landing.y);
        }
        return land(y, tangent, ds, oriented, target, maximum, landing, point);
    }

    /// Correct y on the plane row . y = target.
    bool correct(Values y, Values row, double target, int maximum, const Landing& landing, Point& point) {
        copy(row, row_);
        copy(y, landing.y);
        return land(y, still_, 0.0, false, target, maximum, landing, point);
    }

    /// Outcomes of `solve`: the corrections are not finite; they grow; they do not settle; the last one, along the
    /// family, failed.
    enum Outcome { SOLVED, DIVERGED, GROWN, UNSETTLED, FAILED };

    /// How far the corrections onto an energy or a quarter period came: the last change and the one before.
    struct Approach {
        Outcome outcome;
        double change = INFINITE, previous = INFINITE;
    };

    /// The solution near y, at an energy or a quarter period (NaN: not wanted); else the nearest one of the family.
    Approach solve(Vector<double> y, double energy, double quarter_period, const Landing& landing, Point& point) {
        constexpr int ROUNDS = 30, ITERATIONS = 12;
        Approach found{SOLVED};
        const bool held = energy == energy || quarter_period == quarter_period;
        for (int round = 0; held; ++round) {
            if (round == ROUNDS) return found.outcome = UNSETTLED, found;
            const double target = energy == energy ? energy_row(y, energy) : period_row(y, quarter_period);
            Point trial;
            copy(y, landing.y);
            const bool good = land(y, still_, 0.0, false, target, found.previous > 1e-6 ? 1 : 8, landing, trial);
            found.change = 0.0;
            for (size_t j = 0; j < y.size(); ++j) {
                if (!(std::fabs(landing.y[j]) < INFINITE)) return found.outcome = DIVERGED, found;
                found.change = std::max(found.change, std::fabs(landing.y[j] - y[j]) / newton.scale[j]);
                y[j] = landing.y[j];
            }
            if (found.change < 1e-13 || (good && found.previous < 1e-9 && found.change >= 0.5 * found.previous)) break;
            if (found.change > 10.0 * found.previous && found.change > 1.0) return found.outcome = GROWN, found;
            found.previous = found.change;
        }
        point = Point();
        if (!step(y, still_, 0.0, ITERATIONS, landing, point)) found.outcome = FAILED;
        return found;
    }

    /// Whether the family through y has an orbit at a position of the metric, to a distance `near`, after `most`
    /// corrections: each onto the plane through the position, across the tangent (u,). The landing receives the orbit.
    bool meet_position(Values position, double near, int most, std::vector<double> y, Values tangent,
                       const Landing& landing) {
        constexpr int ITERATIONS = 12;
        const size_t unknowns = y.size();
        std::vector<double> along(2 * unknowns);
        copy(tangent, Vector<double>(along.data(), unknowns));
        Metric<Problem> here(problem_);
        for (int count = 0; count < most; ++count) {
            here.locate(y);
            const double length = here.direct(along);
            if (!(length > 0.0)) return false;
            for (size_t j = 0; j < unknowns; ++j) along[j] /= length;
            double ahead = 0.0;
            for (size_t r = 0; r < position.size(); ++r) ahead += (position[r] - here.position[r]) * here.direction[r];
            Point point;
            if (!step(y, along, ahead / length, ITERATIONS, landing, point)) return false;
            double distance = 0.0;
            for (size_t r = 0; r < position.size(); ++r) {
                const double apart = landing.position[r] - position[r];
                distance += apart * apart;
            }
            if (std::sqrt(distance) <= near) return true;
            copy(landing.y, y);
            copy(landing.tangent, Vector<double>(along.data(), unknowns));
        }
        return false;
    }

private:
    /// The row of log h at the start into `row_`; returns the target at which h is `energy`.
    double energy_row(Values y, double energy) {
        const int n = problem_.size();
        typename Problem::template State<> z(n), slope(n);
        problem_.start_state(y, z);
        problem_.flight().energy_slope(z, slope);
        std::fill(row_.begin(), row_.end(), 0.0);
        for (int j = 0; j < problem_.parameters(); ++j) {
            for (int r = 0; r < n; ++r) row_[j] += problem_.closure().start_map(r, j) * slope[r];
            row_[j] /= energy;
        }
        return target_of(y, 0.5 * problem_.flight().twice_energy(z) / energy - 1.0);
    }

    /// The same for the logarithm of the quarter period.
    double period_row(Values y, double quarter_period) {
        const double length = problem_.closure().quarters * quarter_period;
        std::fill(row_.begin(), row_.end(), 0.0);
        for (int i = 0; i <= problem_.inner(); ++i) row_[problem_.time(i)] = 1.0 / length;
        return target_of(y, problem_.total_time(y) / length - 1.0);
    }

    double target_of(Values y, double residual) const {
        double target = -residual;
        for (size_t j = 0; j < y.size(); ++j) target += row_[j] * y[j];
        return target;
    }

    static bool is_cubic(Values tangent, size_t unknowns) {
        return Problem::FlightType::is_series() && tangent.size() > 2 * unknowns;
    }
    bool is_cubic(Values tangent) const { return is_cubic(tangent, row_.size()); }

    /// out = y + ds (tangent + ds/2 curvature); returns whether there is a tangent.
    static bool predict(Values y, Values tangent, double ds, Vector<double> out) {
        bool oriented = false;
        for (size_t j = 0; j < y.size(); ++j) {
            out[j] = y[j] + ds * (tangent[j] + 0.5 * ds * tangent[y.size() + j]);
            oriented = oriented || tangent[j] != 0.0;
        }
        return oriented;
    }

    /// out = y + s t + s^2/2 y'' + s^3/6 y''' at the s at which it is on the plane row . (out - y) = ds.
    void predict_cubic(Values y, Values tangent, double ds, Vector<double> out) const {
        const size_t u = y.size();
        double first = 0.0, second = 0.0, third = 0.0;
        for (size_t j = 0; j < u; ++j) {
            first += row_[j] * tangent[j];
            second += 0.5 * row_[j] * tangent[u + j];
            third += row_[j] * tangent[2 * u + j] / 6.0;
        }
        double s = ds;
        for (int round = 0; round < 3; ++round)
            s -= (s * (first + s * (second + s * third)) - ds) / (first + s * (2.0 * second + 3.0 * s * third));
        if (std::fabs(s - ds) < LONGEST_SHIFT * std::fabs(ds))
            for (size_t j = 0; j < u; ++j)
                out[j] = y[j] + s * (tangent[j] + s * (0.5 * tangent[u + j] + s * tangent[2 * u + j] / 6.0));
    }

    /// Correct a prediction, and fill the point and the landing. `oriented`: old_ has the direction at y.
    bool land(Values y, Values tangent, double ds, bool oriented, double target, int maximum, const Landing& landing,
              Point& point) {
        const Correction found = newton.correct(landing.y, row_, target, maximum, STEP_ROUNDING);
        point.converged = found.converged ? 1.0 : 0.0;
        point.iterations = found.iterations;
        point.contraction = found.contraction;
        point.residual = found.residual;
        if (!found.converged) return false;
        point.conditioning = newton.conditioning();
        const size_t u = y.size();
        turn_tangent(landing.y, found, oriented, landing.tangent.first(u), point);
        for (size_t j = 0; j < u; ++j)
            landing.tangent[u + j] = ds != 0.0 ? (landing.tangent[j] - tangent[j]) / ds : 0.0;
        if (is_cubic(landing.tangent)) cubic_derivatives(y, tangent, ds, point.turn, landing);
        copy(new_.position, landing.position);
        std::copy_n(newton.flown.before.data(), landing.ends.size(), landing.ends.begin());
        return true;
    }

    /// The tangent at a solution y from the null vector there: of unit length in the metric, and turned like the
    /// direction of old_.
    void turn_tangent(Values y, const Correction& found, bool oriented, Vector<double> tangent, Point& point) {
        new_.locate(y);
        const double length = new_.direct(newton.null);
        double turn = 0.0, sign = found.sign, flip = 1.0 / length;
        bool first = true;
        for (size_t r = 0; r < new_.direction.size(); ++r) {
            new_.direction[r] /= length;
            if (!oriented) continue;
            turn += new_.direction[r] * old_.direction[r];
            first = first && old_.direction[r] == 0.0;
        }
        if (turn < 0.0 && !first) flip = -flip, sign = -sign, turn = -turn;
        for (size_t j = 0; j < tangent.size(); ++j) tangent[j] = newton.null[j] * flip;
        point.energy = new_.energy;
        point.quarter_period = new_.alpha;
        point.slope = new_.change * flip;
        point.turn = first ? 1.0 : turn;
        point.branching = sign * found.smallest;
        point.steepness = 1.0 / length;
    }

    /// Second and third derivative at the end of a step, behind the tangent there: of the cubic with the values and
    /// tangents at both ends of the step, over the arclength between them. After a short step rounding decides the
    /// third: it is zero.
    void cubic_derivatives(Values y, Values along, double ds, double turn, const Landing& landing) const {
        const size_t u = y.size();
        Vector<double> tangent = landing.tangent;
        if (std::fabs(ds) < LONG_ENOUGH) {
            std::fill(tangent.begin() + 2 * u, tangent.end(), 0.0);
            return;
        }
        double chord = 0.0;
        for (size_t r = 0; r < new_.position.size(); ++r) {
            const double apart = new_.position[r] - old_.position[r];
            chord += apart * apart;
        }
        const double half = 0.5 * (1.0 - turn);  // sin(theta/2)^2
        // chord (theta/2)/sin(theta/2)
        const double length = std::copysign(std::sqrt(chord) * (1.0 + half * (1.0 / 6.0 + 0.075 * half)), ds);
        for (size_t j = 0; j < u; ++j) {
            const double mean = (landing.y[j] - y[j]) / length, late = (tangent[j] - mean) / length;
            const double third = (late - (mean - along[j]) / length) / length;
            tangent[u + j] = 2.0 * (late + length * third);
            tangent[2 * u + j] = 6.0 * third;
        }
    }

    const Problem& problem_;
    Metric<Problem> old_, new_;  // at the begin of the step, and where it lands
    std::vector<double> row_, still_;
};

}  // namespace saltus
