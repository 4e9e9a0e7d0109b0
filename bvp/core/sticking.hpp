/// Impacts while other contacts stick or are at their bounds, and bounces of several contacts that end together.
///
/// Newton's law holds at several contacts at once (Moreau), equation (8). A sticking contact has no speed before and
/// after the impact. It takes the impulse that this requires if the impulse presses. If it would pull, the contact opens
/// and takes none. With r_i the rates and p_j the changes by a unit impulse, the impulses a solve
///
///     r_i . (z - sum_j a_j p_j) = -restitution r_i . z   at the contact that is hit, = 0 at those that keep sticking
///
/// Murty's principal pivoting finds the set that stays: the first contact with a wrong sign, a pull or an approach,
/// changes sides. It ends, since the matrix r_i . p_j is c_i M^-1 c_j with scaled columns, and sticking gaps do not
/// depend on each other.
///
/// Bounces of several contacts that act on each other have one accumulation point. There all speeds across the contacts
/// are zero. The velocity loses its part along M^-1 c_S, whatever the order of the bounces. The contacts that press under
/// the present forces then stick; the same pivoting finds them, with accelerations in place of rates.
///
/// All states here are those of the free mode. Sets of contacts are bits.
#pragma once

#include "contact_modes.hpp"

namespace saltus {

using ContactSet = int64_t;
inline bool has(ContactSet set, int c) { return (set >> c & 1) != 0; }
inline ContactSet only(int c) { return ContactSet(1) << c; }

/// A contact just released counts as being without rate and acceleration within this many roundings: its force has gone
/// through other numbers.
inline constexpr double RELEASED = 1000.0;
/// c_i M^-1 c_j below this fraction of the sizes it is summed from is rounding.
inline constexpr double INTERACTION_LEVEL = 1e-13;

/// Impacts of one system, by its free mode.
class ImpactRules {
public:
    ImpactRules(const ContactMode& free, const ContactFrame& frame);

    /// Contacts other than c within the contact tolerance of their bound. The still ones need not stick: a body may lie on
    /// its stop unpressed.
    struct AtBounds {
        ContactSet still = 0, moving = 0;
    };
    AtBounds at_bounds(int c, Values z) const;
    /// Whether rounding has carried a contact of a set a good part of the tolerance beyond its bound.
    bool sunk(ContactSet set, Values z) const;
    /// Whether c hits at a rate that is faster than rounding.
    bool is_fast(int c, double rate, Values z) const { return std::fabs(rate) > rounding(c, z); }
    double rate(int c, Values z) const { return dot(free_.contacts.rate[c], z); }

    /// What an impact leaves.
    struct Outcome {
        bool decided = true;          // false: restitution does not define what follows
        bool at_rest = false;         // c sticks from here on
        ContactSet stay = 0;          // the contacts that keep sticking
        double loss = 0.0;            // of energy
        double span = 0.0;            // the time that bounces would still last
    };
    /// Resolve the impact at contact c, whose gap changes at a rate: z becomes the state after it.
    Outcome resolve(int c, double rate, const AtBounds& others, ContactSet sticking, Vector<double> z) const;

private:
    double rounding(int c, Values z) const { return free_.flight.rounding_level(free_.contacts.rate[c], z); }
    double loss_of(int c, double speed) const;
    bool interacts(int first, int second) const;
    bool touches_sticking(ContactSet sticking, int c) const;
    bool is_low(int k, Values z, double heights) const;
    ContactSet closed(ContactSet still, ContactSet sticking, int c, double rate, Values z) const;
    bool driven_together(ContactSet touching, int c, Values z) const;
    bool impulses(ContactSet active, const Array<>& rows, int c, double factor, Values z, Matrix<double> table) const;
    ContactSet pivot(ContactSet active, ContactSet sticking, const Array<>& rows, int c, double factor, Values z,
                     Matrix<double> table) const;
    void push_off(Matrix<const double> table, Vector<double> z) const;
    bool come_to_rest(int c, const AtBounds& others, Vector<double> z, Outcome& out) const;
    bool clashes(ContactSet moving, int c, Values z, double& span) const;

    const ContactMode& free_;
    const ContactFrame& frame_;
    int count_;
    bool alone_;  // there is one stop: no other contact can be at its bound
};

/// z -= change push with the change (1 + restitution) (rate . z), along a push that is known beyond double precision, so that the
/// energy of many impacts does not drift: equation (4).
void bounce(const ContactMode& mode, int c, double change, Vector<double> z);

}  // namespace saltus
