/// Newton's corrections of a multipoint problem, and the sizes of its unknowns.
#pragma once

#include "problem.hpp"

namespace saltus {

/// Scaled residual that is nothing but rounding: 9 eps, for states at the ends of flights of size 1.
inline constexpr double RESIDUAL_ROUNDING = 2e-15;

/// Scaled residual up to which a solution that cannot be improved is accepted.
inline constexpr double LARGEST_RESIDUAL = 1e-12;

/// Newton's update, in units of the unknowns' sizes, below which the next one is beyond double precision: its square.
inline constexpr double SHORT_UPDATE = 1e-6;

/// The same, below which new derivatives shorten the next update more than those of the iterate before.
inline constexpr double NEAR_UPDATE = 1e-2;

/// What Newton's corrections of an orbit came to.
struct Correction {
    bool converged = false;
    int iterations = 0;
    double contraction = 0.0;           // worst ratio of successive updates
    double residual = INFINITE;         // scaled
    double sign = 0.0, smallest = 0.0;  // of `BlockElimination::Pivots` at the solution
};

/// Newton's method for one problem, with its work space. Threads can share a problem, each with its own of these.
template <class Problem>
class Newton {
public:
    explicit Newton(const Problem& problem)
        : elimination(problem.elimination()), flown(problem), scale(problem.unknowns(), 1.0), null(problem.unknowns()),
          residual(problem.unknowns() - 1), problem_(problem), update_(problem.unknowns()), least_(problem.closers()) {}

    BlockElimination<Problem::ROWS> elimination;  // of the scaled Jacobian at the last solution
    typename Problem::Flown flown;                // the flights at the y of the last evaluation
    std::vector<double> scale, null,
        residual;  // (u,) sizes of the unknowns; (u,) null vector at the last solution; (u - 1,)

    /// Fill `flown` and `residual`.
    void evaluate(Values y) { problem_.evaluate(y, flown, residual); }

    /// Fill `scale` after an evaluation at y.
    Sizes set_scale(Values y) { return problem_.sizes(y, flown, scale); }

    /// Write the Jacobian at the last evaluation, at y, into the elimination, for the present scale.
    void linearise(Values y) { problem_.linearise(y, flown, scale, elimination); }

    /// Correct y in place, and factorise the Jacobian at the solution.
    ///
    /// y stays on row . y = target. With a row of zeros the corrections are of least norm. A factorisation is used
    /// again as long as each update is a tenth of the one before. Where flights are series, it is renewed after each
    /// update below `NEAR_UPDATE`. The iteration ends when
    ///     the update no longer shrinks, and it or the residual is at rounding level (the update from a residual that
    ///         is rounding is rounding, however badly the equations are conditioned), or the change of the residual that
    ///         it can make;
    ///     the residual is at rounding level, and by the last ratio the next update would be far below it;
    ///     the same after a short update by derivatives of its own iterate: what is left of the residual is rounding;
    ///     the updates grow, or `maximum` is reached. With maximum = 0, y is only evaluated.
    Correction correct(Vector<double> y, Values row, double target, int maximum, double rounding) {
        Correction found;
        Sizes sizes;
        Progress progress;
        bool constrained = false;
        for (double entry : row) constrained = constrained || entry != 0.0;
        while (true) {
            evaluate(y);
            if (found.iterations > 0) {
                judge(y, progress, found, sizes, rounding);
                if (found.iterations == maximum && !progress.ended) {
                    found.converged = found.residual < LARGEST_RESIDUAL && (progress.length < 1e-9 || progress.noise);
                    progress.ended = true;
                }
                if (progress.ended && !found.converged) return found;
            }
            if (progress.fresh || progress.ended || maximum == 0) sizes = set_scale(y);
            if (maximum == 0) {
                found.residual = problem_.scaled_residual(y, flown, residual, sizes);
                found.converged = found.residual < LARGEST_RESIDUAL;
                progress.ended = true;
            }
            if (progress.fresh || progress.ended) factorise(y, sizes, found);
            if (progress.ended) return found;
            for (double& entry : residual) entry = -entry;
            elimination.solve(residual, update_);
            for (size_t j = 0; j < y.size(); ++j) update_[j] *= scale[j];
            if (constrained && !hold(y, row, target)) return found;
            ++found.iterations;
            if (!advance(y, progress)) {
                found.residual = INFINITE;
                --found.iterations;
                return found;
            }
        }
    }

    /// Size of the smallest singular value of the last factorised Jacobian; overwrites `residual`.
    double conditioning() { return elimination.conditioning(residual); }

private:
    /// How the corrections of an orbit go on.
    struct Progress {
        double length = INFINITE,
               previous = INFINITE;  // of the last update and the one before, in units of the unknowns' sizes
        bool fresh = true;           // whether the Jacobian is to be computed anew
        bool noise = false;          // whether the residual was rounding before the last update
        bool ended = false;
    };

    /// Whether the corrections have ended after an update, by the rules of `correct`.
    void judge(Values y, Progress& progress, Correction& found, const Sizes& sizes, double rounding) {
        constexpr bool SERIES = Problem::FlightType::is_series();
        const double length = progress.length, ratio = length / progress.previous;
        progress.noise = found.residual <= RESIDUAL_ROUNDING && length < SHORT_UPDATE;
        const double worst = found.residual = problem_.scaled_residual(y, flown, residual, sizes);
        const double level = problem_.residual_level();
        progress.fresh = SERIES && length < NEAR_UPDATE;
        progress.previous = length;
        if (length <= rounding) {
            found.converged = progress.ended = true;
        } else if (SERIES && length < SHORT_UPDATE && worst <= level) {
            found.contraction = std::max(found.contraction, ratio);
            found.converged = progress.ended = true;
        } else if (found.iterations > 1) {
            if (ratio > 0.5 && (length < 1e-9 || progress.noise || is_rounding(length))) {
                found.converged = worst < LARGEST_RESIDUAL;
                progress.ended = true;
                return;
            }
            if (length > 1e-12 && !progress.noise) found.contraction = std::max(found.contraction, ratio);
            if (worst <= level && ratio <= 0.1 && ratio * length <= 0.1 * rounding)
                found.converged = progress.ended = true;
            else if (ratio > 2.0 && length > 1e-3) progress.ended = true;
            progress.fresh = progress.fresh || ratio > 0.1;
        }
    }

    /// Whether an update is so short that residuals change by no more than their rounding along the direction in which
    /// the equations hardly decide: it is then a multiple of the rounding, whatever the residual before it was.
    bool is_rounding(double length) {
        return length < SHORT_UPDATE && length * elimination.conditioning(update_) <= RESIDUAL_ROUNDING;
    }

    /// Factorise the Jacobian at y, where the problem was evaluated last.
    void factorise(Values y, const Sizes& sizes, Correction& found) {
        problem_.least_lengths(sizes, least_);
        linearise(y);
        const auto pivots = elimination.factorise(least_);
        found.sign = pivots.sign;
        found.smallest = pivots.smallest;
        elimination.null_vector(null);
        for (size_t j = 0; j < null.size(); ++j) null[j] *= scale[j];
    }

    /// A multiple of the null vector takes the update to the plane row . y = target. Returns whether they meet.
    bool hold(Values y, Values row, double target) {
        double along = -target, slope = 0.0;
        for (size_t j = 0; j < y.size(); ++j) {
            along += row[j] * (y[j] + update_[j]);
            slope += row[j] * null[j];
        }
        if (slope == 0.0) return false;
        const double back = along / slope;
        for (size_t j = 0; j < y.size(); ++j) update_[j] -= back * null[j];
        return true;
    }

    /// y += the update; returns whether all is finite.
    bool advance(Vector<double> y, Progress& progress) {
        bool finite = true;
        progress.length = 0.0;
        for (size_t j = 0; j < y.size(); ++j) {
            y[j] += update_[j];
            progress.length = std::max(progress.length, std::fabs(update_[j]) / scale[j]);
            finite = finite && std::isfinite(y[j]);
        }
        return finite;
    }

    const Problem& problem_;
    std::vector<double> update_, least_;
};

}  // namespace saltus
