/// A family of orbits: steps with test functions, the advance by many steps in one call, and the steps inside a step.
#pragma once

#include "bracketing.hpp"
#include "control.hpp"
#include "step.hpp"

namespace saltus {

/// Scaled residual below which a solution is an orbit.
inline constexpr double ACCURATE = 1e-12;

/// Bounds of a family, and the traces at which periods multiply: of a quarter those of the half map, else those of the
/// full period. Under loads the bounds are those of the parameter, and its values that are marked take the place of traces.
struct FamilyLimits {
    double low, high,
        longest;  // logarithms of the energies, and of the longest quarter period; infinite where there is none
    double tangent_noise;
    std::vector<double> targets;
    bool neutral = false;  // under loads: pairs of multipliers have the product 1, or one that no orbit changes
};

/// What is found of each step; row after row, the last one for a step that is tried and not plain.
struct StepRows {
    Matrix<double> y, tangent, position;  // (rows, u), (rows, 2 u) or (rows, 3 u), (rows, N + 2)
    Matrix<double> ends, point, tests;    // (rows, (k + 1) N), (rows, POINT_SIZE), (rows, tests)
    Matrix<double> lengths;               // (rows, 2) requested length, arclength
    int rows() const { return y.rows(); }
    Landing landing(int row) const { return {y[row], tangent[row], position[row], ends[row]}; }
};

/// The orbit that steps begin at, and the steps that led there.
struct Beginning {
    Values y, tangent, position;
    Values tests, older, oldest;  // values of the test functions there, one step before, and two
    double before, first;         // length of the last step, and of the one before it
};

/// The plane through a position at right angles to a direction; NaN: that of the first step.
struct Goal {
    Values position, direction;
};

/// How test functions are watched: kind, and size below which a sign is rounding, of each.
struct WatchedTests {
    std::vector<Watched> kinds;
    std::vector<double> singular;
};

/// What an advance returns: accepted steps, whether the row after them holds a step that is not plain, length of the
/// step to take next.
struct Advanced {
    int count;
    bool tried;
    double ds;
};

/// Where a step inside a step leads: to an orbit; to none; to one whose tangent is rotated too far; to one of another
/// family.
enum class Inside { LANDED, REFUSED, TURNED, PASSED_OVER };

/// What is sought inside a step: a step of given length (NaN: the zero of a test function between two samples).
struct Sought {
    double length;
    int test;
    double tolerance, least_turn;  // width of the final bracket; cosine of the largest rotation of a tangent
};

/// Takes steps along a family. `Tests` computes the test functions of a point: tests(y, ends, point, out) writes what is
/// observed of an orbit into the point, and the test functions into `out`. It is false where there is no orbit.
template <class Problem, class Tests>
class FamilyStepper {
public:
    FamilyStepper(Stepper<Problem>& stepper, Tests& tests, const WatchedTests& watched, int maximum)
        : stepper_(stepper), tests_(tests), watched_(watched), maximum_(maximum) {}

    /// Fill a row of a block with the point that a step of length ds leads to. Returns whether it is an orbit; else its
    /// test functions are not set.
    bool land(Values y, Values tangent, double ds, const StepRows& block, int row, Point& point) {
        point = Point();
        const Landing landing = block.landing(row);
        bool good = stepper_.step(y, tangent, ds, maximum_, landing, point);
        if (good) good = tests_(landing.y, landing.ends, point, block.tests[row]);
        point.write(block.point[row].data());
        return good;
    }

    /// Steps from an orbit on: predicts, corrects, judges and measures each, and chooses the next one.
    Advanced advance(const Beginning& begin, const Goal& goal, double ds, const Control& control,
                     const StepRows& block) {
        std::vector<double> way(goal.direction.begin(), goal.direction.end());
        Values y = begin.y, tangent = begin.tangent, position = begin.position;
        Consecutive points{{begin.oldest, begin.older, begin.tests, begin.tests}, {begin.first, begin.before, 0.0}};
        double below = height(position, goal.position, way);
        // At the beginning of a run the first two steps are judged with the third, which gives their test functions a
        // bend.
        const bool young = begin.before == 0.0 && block.rows() > 3;
        int waiting = 0;
        const double initial = ds;
        for (int count = 0; count < block.rows() - 1; ++count) {
            // While steps wait to be judged, the step that is not plain is the first one of the run.
            const Advanced tried = waiting > 0 ? Advanced{0, true, initial} : Advanced{count, true, ds};
            Point point;
            if (!land(y, tangent, ds, block, count, point)) return tried;
            const Values place = block.position[count];
            const double chord = distance(position, place);
            if (refusal(point.turn, point.contraction, chord, ds, control) != Verdict::ACCEPTED) return tried;
            double above = height(place, goal.position, way);
            if (below < 0.0 && above >= 0.0 && distance(place, goal.position) <= NEAR_GOAL * chord) return tried;
            const double length = arclength_of(chord, point.turn);
            points.values[3] = block.tests[count];
            points.lengths[2] = length;
            if (young && count < 2) {
                waiting = count + 1;
            } else {
                for (int step = 2 - waiting; step < 3; ++step)
                    if (watch(watched_.kinds, watched_.singular, points, step))
                        return step < 2 ? Advanced{0, true, initial} : Advanced{count, true, ds};
                waiting = 0;
            }
            block.lengths(count, 0) = ds;
            block.lengths(count, 1) = length;
            ds = next_step(ds, point.turn, point.contraction, control);
            if (above != above && count == 0) {
                for (size_t r = 0; r < way.size(); ++r) way[r] = place[r] - goal.position[r];
                above = height(place, goal.position, way);
            }
            points = {{points.values[1], points.values[2], points.values[3], points.values[3]},
                      {points.lengths[1], length, 0.0}};
            below = above;
            position = place;
            tangent = block.tangent[count];
            y = block.y[count];
        }
        return {block.rows() - 1, false, ds};
    }

    /// Take one step between two known steps from an orbit, or close in on a zero of a test function: these are the
    /// ends of the bracket.
    ///
    /// Returns the number of steps taken, in the rows of the block; and LANDED, or why the row after them holds none.
    /// The search ends with a narrow bracket, an exact zero, a value that is not known, or a step that is refused.
    std::pair<int, Inside> narrow(Values y, Values tangent, KnownStep low, KnownStep high, const Sought& sought,
                                  Samples samples, const StepRows& block) {
        bool slow = false;
        for (int row = 0; row < block.rows(); ++row) {
            double s = sought.length, part = 0.5;
            if (s != s) {
                const auto next = samples.next(sought.tolerance, slow);
                if (next.least > 0.5) return {row, Inside::LANDED};
                part = next.part;
                s = low.length + part * (high.length - low.length);
            }
            KnownStep found{s, std::vector<double>(y.size()), {}};
            const Inside answer = land_between(y, tangent, low, high, sought.least_turn, block, row, found);
            if (answer != Inside::LANDED) return {row, answer};
            block.lengths(row, 0) = s;
            const double value = block.tests(row, sought.test);
            if (value != value || value == 0.0 || row + 1 == block.rows()) return {row + 1, Inside::LANDED};
            slow = samples.is_slow(part, value);
            (samples.insert(s, value) ? high : low) = std::move(found);
        }
        return {0, Inside::LANDED};
    }

private:
    /// Fill a row of the block with the step between two known ones; `found` has its length.
    Inside land_between(Values y, Values tangent, const KnownStep& low, const KnownStep& high, double least_turn,
                        const StepRows& block, int row, KnownStep& found) {
        const double s = found.length;
        const size_t u = y.size();
        std::vector<double> along(2 * u);
        cubic_between(low, high, s, found.y);
        // The prediction is y + s (tangent + s/2 curvature).
        for (size_t j = 0; j < u; ++j) {
            along[j] = tangent[j];
            along[u + j] = 2.0 * (found.y[j] - y[j] - s * tangent[j]) / (s * s);
        }
        Point point;
        if (!land(y, along, s, block, row, point)) return Inside::REFUSED;
        if (!(point.turn >= least_turn)) return Inside::TURNED;
        copy(block.y[row], found.y);
        found.slope.resize(u);
        for (size_t j = 0; j < u; ++j) found.slope[j] = block.tangent(row, int(j)) / point.turn;
        return goes_aside(low.slope, high.slope, (s - low.length) / (high.length - low.length), found.slope)
                   ? Inside::PASSED_OVER
                   : Inside::LANDED;
    }

    Stepper<Problem>& stepper_;
    Tests& tests_;
    const WatchedTests& watched_;
    int maximum_;
};

}  // namespace saltus
