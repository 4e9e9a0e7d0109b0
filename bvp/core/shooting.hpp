/// Motions of many starts through their impacts, for two degrees of freedom without damping and one stop.
///
/// One start is followed with the derivative of everything by the start's parameter. The states z_k after the impacts
/// and their derivatives along the curve of starts are taken on the section of the impact: with the flight's variation
/// y' = Phi(d) z', the duration changes by d' = -(g . y')/(g B . y), the arrival by y' + B y d', and restitution acts
/// on both alike, equation (19). Between z_k and the next impact the motion of neighbouring starts is compared at equal
/// times since impact k, where it is linear.
#pragma once

#include <array>
#include <cstdint>
#include <memory>

#include "contact.hpp"
#include "linear_flight.hpp"
#include "steps.hpp"

namespace saltus {

using State4 = std::array<double, 4>;  // (q_1, q_2, p_1, p_2) in modal coordinates

/// A state and its derivative by the parameter of starts.
struct Moving {
    State4 z{}, dz{};
};

/// A number and its derivative by the parameter of starts.
struct Varied {
    double value = 0.0, rate = 0.0;
};

/// A system of two degrees of freedom and one stop.
class PlanarSystem {
public:
    /// squares: of the frequencies. lower, upper: bounds of the gap coordinate, infinite where there is none.
    PlanarSystem(std::array<double, 2> squares, Contacts contacts, double lower, double upper);

    const std::array<double, 2>& squares() const { return squares_; }
    const Contacts& contacts() const { return contacts_; }
    const LinearFlight<4>& flight() const { return flight_; }
    const StepStops* stops() const { return stops_.get(); }
    double lower() const { return lower_; }
    double upper() const { return upper_; }
    /// The unit vector along the stop.
    const std::array<double, 2>& across() const { return across_; }
    /// The rows of w (order 0), w', w'' and w'''.
    Values gap(int order) const { return rows_[order]; }

    Moving fly(const Moving& begin, double t) const;
    /// Bound of |q| (order 0), |q'| (1) or |q''| (2) of a mode over a flight from a state of at most `horizon`,
    /// equation (24).
    double amplitude(int mode, const State4& z, double horizon, int order) const;

private:
    std::array<double, 2> squares_, frequencies_, across_;
    Contacts contacts_;
    LinearFlight<4> flight_;
    std::unique_ptr<const StepStops> stops_;
    double lower_, upper_;
    std::array<State4, 4> rows_;
};

enum class Curve { TRIGONOMETRIC, LINEAR, HYPERBOLIC, QUADRATIC };

/// A curve of starts: z = coefficients[0] + first(theta) coefficients[1] + second(theta) coefficients[2].
struct Starts {
    std::shared_ptr<const PlanarSystem> system;
    std::array<State4, 3> coefficients;
    Curve shape;
    int contact;  // that the start leaves, -1: none

    Moving at(double theta) const;
};

/// The far ends that a scan can look for, and in the middle of a segment: the states after impacts (`arcs.hpp`).
enum FarEnd { ORIGIN, REST, STOP, MIDDLE };

/// How a flight ends that has no impact: within the time searched; pressed against a stop, or the search gave up; it is
/// not followed, because it begins later than any that is asked for.
inline constexpr int FREE = -1, STUCK = -2, AHEAD = -3;

/// One flight of a motion, from impact k to the next.
struct FlightRecord {
    Moving begin;
    Varied time;           // of impact k
    Varied duration;
    int contact = FREE;    // hit at its end
    Varied speed;          // of approach there
    Varied residual;       // velocity along the stop there
    double acceleration = 0.0;  // towards the stop there
    // least distance to a stop at a turning point inside the flight; not a number: not yet looked for
    Varied clearance{NOT_A_NUMBER, 0.0};
    double second = 0.0;   // the second least
    double turn = 0.0;     // time of the least one
    int turning_points = 0;
};

/// A start followed.
struct Followed {
    std::vector<FlightRecord> flights;  // those that are not counted are left over
    int count = 0;
    Moving after;  // the last impact
};

/// Follow one start up to `most` impacts and a little past the time `longest`. A flight that begins more than a little
/// past `latest` is not followed: it has the state at its start and the contact AHEAD.
void follow(const Starts& starts, double theta, double longest, double latest, int most, Followed& out);

/// Follows starts and measures the residual of one far end on their way: what is transverse to the end's condition when
/// the rest of it holds. Where the gap coordinate passes zero, that is the other displacement (ORIGIN); where its
/// velocity passes zero, the other velocity (REST); at an impact the velocity along the stop (STOP).
struct StartScan {
    FarEnd kind;
    std::vector<bool> wanted;  // (K + 1,) whether the crossings after so many inner impacts are looked for
    double longest;

    /// What it finds of one start; not a number, or -1, where there is nothing. C: room for crossings of one flight, 1
    /// for STOP.
    struct Found {
        Vector<int64_t> contacts;  // (K + 1,) hit
        Matrix<double> times;      // (K + 1, C) of the crossings after k inner impacts; for STOP of impact k + 1
        Matrix<double> residuals;  // (K + 1, C)
        Matrix<double> nodes;      // (K, 4) states after the inner impacts; no rows where they are not wanted
        Vector<double> instants;   // (K,) their times
    };
    void follow(const PlanarSystem& system, Values start, const Found& out) const;
};

/// Fill in the clearance of a flight, if not yet done, from the turning points of w inside it.
void find_clearance(const PlanarSystem& system, FlightRecord& flight, double longest);

}  // namespace saltus
