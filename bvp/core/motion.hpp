/// The motion of a system through its contact modes: flight, next impact or release, restitution, chattering, sticking, and
/// where its energy goes.
///
/// The distance of a sticking contact is its force, so the next impact and the next release are found alike.
///
/// The end of chattering: if a force presses a body against a stop, its bounces shrink by the restitution. The speed s after
/// each impact obeys s -> restitution s (1 + O(s)). The iterates of this map are a power series in restitution^k (Koenigs),
/// and so are time, displacements, velocities and energies lost. With q = restitution^stride, values after every stride-th
/// impact are x_k = x + a_1 q^k + a_2 q^2k + ..., and Neville's scheme, equation (28), takes one power away after the other.
/// The difference between the two last orders is the error of the lower one. The stride keeps q below 1/2, so rounding grows
/// tenfold at most.
#pragma once

#include <optional>

#include "sticking.hpp"

namespace saltus {

/// How `Motion::move` returned. REACHED: at the duration; the motion can be carried on to a longer one. NEW_MODE: add the
/// contact mode `wanted()` and call again. PAUSED: the passes are used up; set them and call again.
enum class Reason {
    REACHED = 0, NEW_MODE = 2, INTERACTING = 3, STARTED_OUTSIDE = 4, MOST = 5, CYCLING = 6, GAVE_UP = 7, PIERCED = 8, PAUSED = 9
};

/// Kinds of events of a record: the start; an impact; a touch; a contact that sticks from here on; one that is released; loads
/// that are set anew; a flight that goes on; bounces that are summed up to the next event.
enum class Event { START, IMPACT, TOUCH, STICK, RELEASE, BREAK, PIECE, CHATTER };

/// A compensated sum (Neumaier).
struct Compensated {
    double total = 0.0, low = 0.0;
    void add(double value) {
        const double sum = total + value;
        low += std::fabs(total) >= std::fabs(value) ? (total - sum) + value : (value - sum) + total;
        total = sum;
    }
    double value() const { return total + low; }
};

/// The events of a motion, one row each.
struct Record {
    std::vector<int64_t> kinds, contacts, modes;
    std::vector<double> times, speeds, losses;
    std::vector<double> before, states, sums;  // rows one after another; those of states have the size of their mode
    void clear() { *this = Record(); }
};

/// The moment at which a fraction of the initial energy is gone.
struct EnergyMark {
    double fraction;
    double time = NOT_A_NUMBER;
    std::vector<double> sums = {};
};

/// One motion. It keeps a view of its contact modes.
class Motion {
public:
    /// start (2 n,): (u, v). leaving: the contact that it is on after its impact, or -1. fractions: ascending. peaks: whether
    /// the largest displacements are wanted. Beyond the last possible impact, to_rest counts the dissipation up to infinite
    /// time where all motion decays.
    Motion(const ContactModes& modes, Values start, double energy, int leaving, Values fractions, bool with_peaks, bool to_rest);

    /// Carry the motion on, to a duration, a number of impacts, or another reason to return. It returns after so many
    /// events. In the end it returns, whatever happens: between two impacts faster than rounding, or two breaks, every event
    /// is counted within each radian of the fastest motion, the more where it takes no time or makes no way. record: to
    /// write events to, or nullptr.
    Reason move(double duration, int64_t most, int64_t passes, Record* record);

    ContactSet wanted() const { return pending_; }
    double time() const { return time_; }
    int64_t impacts() const { return impacts_; }
    int64_t touches() const { return touches_; }
    double last_impact() const { return impacts_ > 0 ? last_impact_ : NOT_A_NUMBER; }
    double clear_from() const { return clear_ ? clear_time_ : NOT_A_NUMBER; }
    bool is_at_rest() const { return at_rest_; }  // infinite time has passed
    double sticking_time() const { return sticking_time_; }
    double switch_error() const { return switch_error_; }
    int mode() const { return f_; }
    Values state() const { return z_; }
    Values peaks() const { return peaks_; }
    const std::vector<EnergyMark>& marks() const { return marks_; }
    std::vector<double> sums() const {
        std::vector<double> out;
        for (const Compensated& sum : sums_) out.push_back(sum.value());
        return out;
    }

private:
    /// P: see `StepTable::pairs`.
    template <int P>
    using Path = LinearPath<DYNAMIC, P>;

    const ContactMode& present() const { return modes_[f_]; }
    bool begin_mode();
    template <int P>
    std::optional<Reason> pass(double duration);
    template <int P>
    NextImpact search(const ContactMode& mode, const Path<P>& path, double horizon);
    bool is_impatient(const ContactMode& mode, const NextImpact& found);
    template <int P>
    bool fly(const ContactMode& mode, const Path<P>& path, double flight, Values end);
    template <int P>
    void raise_marks(const ContactMode& mode, const Path<P>& path, double flight, double total);
    template <int P>
    double mark_time(const ContactMode& mode, const Path<P>& path, double flight, double total, double wanted);
    double dissipated() const;
    template <int P>
    double spent(const ContactMode& mode, const Path<P>& path, double t);
    void add_loss(int c, double loss);
    void advance(double flight);
    void leave_mode();
    void enter_mode(int f);
    void write_loads();
    void reset_loads(int index);
    void lift(ContactSet freed);
    void request(ContactSet sticking, Event kind);
    void stop_contact(int c);
    bool chatter(int c, double left);
    bool out_of_reach(const ContactMode& mode, int c, double span, double speed, double force) const;
    std::optional<Reason> hit(int c, double rate, double end);
    void after_impact(int c, double end);
    void note(Event kind, int contact);
    void note_chatter();
    void note_before(const ContactMode& mode);

    const ContactModes& modes_;
    ImpactRules rules_;
    bool with_peaks_, to_rest_;
    double initial_;
    Record* record_ = nullptr;

    // The state z of contact mode f, and what a motion passes through from mode to mode: modal coordinates, at the start (u, v),
    // and states of the loads.
    int f_ = 0;
    std::vector<double> z_, x_, end_, kept_;
    std::vector<Compensated> angles_;  // of the loads

    // The contact that the flight leaves; whether its force has just come to 0.
    int leaving_;
    bool released_ = false;
    // The contact mode that begins next, or -1, the event that leads to it, and the rate across its contact after an impact.
    ContactSet pending_ = 0;
    Event kind_ = Event::START;
    int contact_;
    double rebound_ = 0.0;

    double time_ = 0.0, time_low_ = 0.0;
    int break_index_ = 0;
    int64_t impacts_ = 0, touches_ = 0;
    double last_impact_ = 0.0, sticking_time_ = 0.0, clear_time_ = 0.0, switch_error_ = 0.0;
    bool clear_ = false, at_rest_ = false;
    double speed_ = 0.0, loss_ = 0.0;  // of the present event

    // Events since the motion has turned by a radian.
    int64_t idle_ = 0;
    double progress_ = 0.0;

    // The bounces that are being extrapolated.
    int bounces_ = 0, rows_ = 0, bouncing_ = -1;
    double reference_ = 0.0, reference_low_ = 0.0;
    double begin_ = 0.0, span_ = 0.0;  // of what is left of them
    static constexpr int LEVELS = 10;
    std::vector<double> table_, values_;

    std::vector<Compensated> sums_;  // dissipated by each damper and stop, work done
    std::vector<double> taken_;      // integrals over a flight
    std::vector<EnergyMark> marks_;
    size_t mark_ = 0;
    std::vector<double> peaks_, before_;
};

}  // namespace saltus
