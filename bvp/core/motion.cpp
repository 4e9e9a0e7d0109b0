/// The motion of a system through its contact modes.
#include "motion.hpp"

#include <algorithm>

namespace saltus {

namespace {

/// For each contact, and two more, so much may be spent within a radian of the fastest motion: 1 for each event, this for one
/// to which no time passes, and for a search that gave up.
constexpr int64_t PATIENCE = 256, INSTANT = 16, SEARCH = 64;
/// An impact faster than rounding ends the count. It is asked for that when the count is this high.
constexpr int64_t SEEN_IDLE = 32;
/// Rounds in which contacts are lifted off what they are beyond: one can push another down.
constexpr int LIFTS = 8;
/// Impacts, and breaks, after which the loads' states are written anew. In between they are carried by the flights like all
/// others: passing through (u, v) each time would round in one direction.
constexpr int REFRESH = 256;
/// Time left to the end of chattering, times the fastest rate, below which its series is begun.
constexpr double CHATTER_REACH = 0.3;
/// Errors allowed to the end of chattering: of the time, times the fastest rate; of a displacement or velocity, of the largest
/// one; of the energies, of the largest one.
constexpr double SWITCH_TIME = 1e-13, SWITCH_LEVEL = 2e-14;
/// A bounce that rises less than this part of the contact tolerance, or no faster than rounding, is rest, though the series of
/// the chattering has not come to its end.
constexpr double FLAT = 1e-10;
/// A bound that cannot be reached.
constexpr double NEVER = 1e299;
/// Tolerance of the energy dissipated at a mark, relative to the initial energy.
constexpr double MARK_LEVEL = 4e-16;

/// Whether no contact can be hit at any later time: equation (24).
bool stays_within(const ContactMode& mode, Values z) {
    for (int c = 0; c < mode.contacts.count(); ++c) {
        if (has(mode.sticking, c)) return false;
        const Bounds bounds = mode.flight.bounds(mode.contacts.gap[c], z, INFINITE);
        if (!(bounds.level < mode.contacts.side[c] * mode.contacts.bound[c])) return false;
    }
    return true;
}

}  // namespace

Motion::Motion(const ContactModes& modes, Values start, double energy, int leaving, Values fractions, bool with_peaks,
               bool to_rest)
    : modes_(modes), rules_(modes[0], modes.frame()), with_peaks_(with_peaks), to_rest_(to_rest), initial_(energy),
      x_(start.size() + 2 * modes.frame().loads()), angles_(modes.frame().loads()), leaving_(leaving), contact_(leaving),
      sums_(modes.frame().parts()), taken_(modes.frame().part.size()) {
    std::copy(start.begin(), start.end(), x_.begin());
    if (energy > 0.0)
        for (const double fraction : fractions) marks_.push_back({fraction});
    if (with_peaks) peaks_.assign(modes.frame().coordinates, 0.0);
    before_.assign(start.begin(), start.end());
    values_.resize(start.size() + sums_.size() + 1);
}

// -- contact modes

/// Set x to the modal coordinates of z.
void Motion::leave_mode() {
    const Matrix<const double> rows = present().to_modes;
    for (int r = 0; r < rows.rows(); ++r) x_[r] = dot(rows[r], z_);
}

/// Set z to the state of mode f with the modal coordinates and loads x.
void Motion::enter_mode(int f) {
    f_ = f;
    const Matrix<const double> rows = present().from_modes;
    z_.resize(rows.rows());
    multiply(rows, x_, z_);
}

/// Begin the contact mode that is pending. False: it does not exist yet.
bool Motion::begin_mode() {
    const int f = modes_.find(pending_);
    if (f < 0) return false;
    write_loads();
    if (kind_ == Event::START) {
        f_ = f;
        z_.resize(modes_[f].size());
        multiply(Matrix<const double>(modes_[f].enter), x_, z_);
    } else {
        lift(present().sticking & ~modes_[f].sticking);
        enter_mode(f);
    }
    pending_ = -1;
    if (kind_ == Event::IMPACT) {
        const double lacks = rebound_ - dot(present().contacts.rate[contact_], z_);
        for (int r = 0; r < int(z_.size()); ++r) z_[r] += lacks * present().contacts.push(contact_, r);
    }
    if (span_ > 0.0) note_chatter();
    span_ = 0.0;
    note(kind_, contact_);
    return true;
}

/// Let the contact mode in which exactly these contacts stick begin next, after an event of this kind.
void Motion::request(ContactSet sticking, Event kind) {
    pending_ = sticking;
    kind_ = kind;
    bounces_ = 0;
}

/// Move x, modal, so that no contact of `freed` is beyond its bound. Contacts that stuck until now can be so by rounding,
/// others by what counts as a touch.
void Motion::lift(ContactSet freed) {
    if (freed == 0) return;
    const ContactMode& free = modes_[0];
    const int n = modes_.frame().coordinates;
    std::vector<double> z(free.size());
    for (int round = 0; round < LIFTS; ++round) {
        bool still = true;
        for (int c = 0; c < modes_.contacts(); ++c) {
            if (!has(freed, c)) continue;
            multiply(Matrix<const double>(free.from_modes), x_, z);
            const double beyond = dot(free.contacts.gap[c], z) - free.contacts.bound[c];
            if (!(free.contacts.side[c] * beyond > 0.0)) continue;
            still = false;
            // Displacements move along M^-1 c, like velocities at an impact.
            for (int i = 0; i < n; ++i) x_[i] -= beyond * dot(free.to_modes[n + i], free.contacts.push[c]);
        }
        if (still) return;
    }
}

// -- loads

/// The present states of the loads, into x: equation (5). A rotation for a harmonic, level and slope else. The angles are
/// compensated sums: the product of a frequency with a long time would round to less than the flights are exact to.
void Motion::write_loads() {
    const ContactFrame& frame = modes_.frame();
    double* y = x_.data() + 2 * frame.coordinates;
    for (int g = 0; g < frame.loads(); ++g, y += 2) {
        if (frame.frequency[g] > 0.0) {
            double sine, cosine;
            sincos(angles_[g].total, sine, cosine);
            y[0] = cosine - angles_[g].low * sine;
            y[1] = sine + angles_[g].low * cosine;
        } else {
            const double slope = frame.slopes(break_index_, g);
            y[0] = frame.levels(break_index_, g) + slope * ((time_ - frame.breaks[break_index_]) + time_low_);
            y[1] = slope;
        }
    }
}

/// Add, at a break, the jumps of the loads' levels and slopes to z.
void Motion::reset_loads(int index) {
    const ContactFrame& frame = modes_.frame();
    const double span = frame.breaks[index] - frame.breaks[index - 1];
    for (int g = 0; g < frame.loads(); ++g) {
        const int at = 2 * frame.coordinates + 2 * g;
        const double slope = frame.slopes(index, g) - frame.slopes(index - 1, g);
        const double level = frame.levels(index, g) - (frame.levels(index - 1, g) + frame.slopes(index - 1, g) * span);
        for (int r = 0; r < int(z_.size()); ++r)
            z_[r] += present().enter(r, at) * level + present().enter(r, at + 1) * slope;
    }
}

// -- the energy budget

double Motion::dissipated() const {
    double total = 0.0;
    for (size_t i = 0; i + 1 < sums_.size(); ++i) total += sums_[i].value();
    return total;
}

/// Energy dissipated by the dampers over a flight of t; all integrals into `taken`.
template <int P>
double Motion::spent(const ContactMode& mode, const Path<P>& path, double t) {
    mode.integrals.over(path, t, taken_);
    double total = 0.0;
    for (size_t k = 0; k < taken_.size(); ++k)
        if (modes_.frame().part[k] < modes_.frame().dampers) total += taken_[k];
    return total;
}

/// Add the loss of an impact at contact c.
void Motion::add_loss(int c, double loss) {
    sums_[modes_.frame().dampers + modes_.frame().contact_stop[c]].add(loss);
    if (mark_ == marks_.size()) return;
    const double total = dissipated();
    for (; mark_ < marks_.size() && total >= marks_[mark_].fraction * initial_; ++mark_)
        marks_[mark_].time = time_, marks_[mark_].sums = sums();
}

/// The time after which the dampers have dissipated `wanted`, on a flight that dissipates `total`, and may be infinite; all
/// integrals up to it into `taken`. It is the zero of a Taylor polynomial about a time; where that is farther than a radian, it
/// is looked for between the ends of a bracket.
template <int P>
double Motion::mark_time(const ContactMode& mode, const Path<P>& path, double flight, double total, double wanted) {
    // The next term of the polynomial, over a step of x radians, is (2 x)^5/240 of the power at most: below rounding if x is SHORT.
    constexpr double RADIAN = 1.0, SHORT = 1e-3;
    constexpr int ORDER = 4;
    struct Side {
        double t, error;
    };
    const Products& products = mode.products;
    const int size = mode.size(), count = products.count();
    const double left = total - wanted, fastest = mode.flight.fastest();
    double decay = 0.0;
    for (const Block& block : mode.flight.blocks()) decay -= block.mean;
    Side low{0.0, -wanted}, high{flight, left};
    double t = flight < INFINITE ? flight * wanted / total : left > 0.0 ? log(total / left) / decay : 0.0;
    Local<double, DYNAMIC, 64> states(ORDER * size), terms(ORDER * count);
    const auto state = [&](int k) { return Vector<double>(states.data() + k * size, size_t(size)); };
    for (int evaluations = 0; evaluations < 200; ++evaluations) {
        const double error = spent(mode, path, t) - wanted;
        if (std::fabs(error) <= MARK_LEVEL * initial_) break;
        (error > 0.0 ? high : low) = {t, error};
        path.state(t, state(0));
        for (int k = 1; k < ORDER; ++k) mode.flight.rate(Values(state(k - 1)), state(k));
        double sum[ORDER] = {};
        for (int c = 0; c < count; ++c) {
            // The integral of f g has the terms f0 g0, (f1 g0 + f0 g1)/2!, (f2 g0 + 2 f1 g1 + f0 g2)/3!, ..
            double f[ORDER], g[ORDER], *term = terms.data() + c * ORDER;
            for (int k = 0; k < ORDER; ++k) f[k] = dot(products.first[c], state(k)), g[k] = dot(products.second[c], state(k));
            const double weight = products.weight[c];
            term[0] = weight * (f[0] * g[0]);
            term[1] = weight * ((f[1] * g[0] + f[0] * g[1]) / 2.0);
            term[2] = weight * ((f[2] * g[0] + 2.0 * (f[1] * g[1]) + f[0] * g[2]) / 6.0);
            term[3] = weight * (((f[3] * g[0] + f[0] * g[3]) + 3.0 * (f[2] * g[1] + f[1] * g[2])) / 24.0);
            if (modes_.frame().part[c] < modes_.frame().dampers)
                for (int k = 0; k < ORDER; ++k) sum[k] += term[k];
        }
        // The zero of the polynomial within a radian towards the mark.
        const auto value = [&](double s) { return error + s * (sum[0] + s * (sum[1] + s * (sum[2] + s * sum[3]))); };
        double near = 0.0, far = (error > 0.0 ? -RADIAN : RADIAN) / fastest, s = 0.0;
        const bool found = error * value(far) < 0.0;
        for (int step = 0; step < 40 && found; ++step) {
            const double here = value(s), slope = sum[0] + s * (2.0 * sum[1] + s * (3.0 * sum[2] + 4.0 * (s * sum[3])));
            (error * here > 0.0 ? near : far) = s;
            const double last = s;
            s = slope > 0.0 ? s - here / slope : far;
            if (!(std::min(near, far) <= s && s <= std::max(near, far))) s = 0.5 * (near + far);
            if (std::fabs(s - last) <= 1e-15 * std::max(t, std::fabs(s))) break;
        }
        const double before = t;
        if (found && std::fabs(s) * fastest <= SHORT) {
            for (int c = 0; c < count; ++c) {
                const double* term = terms.data() + c * ORDER;
                taken_[c] += s * (term[0] + s * (term[1] + s * (term[2] + s * term[3])));
            }
            return std::max(before + s, 0.0);
        }
        if (found) {
            t = before + s;
        } else if (flight == INFINITE) {
            // What is left decays, by and large, as an exponential: between the ends of the bracket, or as from the begin on.
            const double first = high.t < INFINITE ? low.t : 0.0, last = high.t < INFINITE ? high.t : low.t;
            const double at_first = high.t < INFINITE ? left - low.error : total, at_last = high.t < INFINITE ? left - high.error : left - low.error;
            t = first + (last - first) * log(at_first / left) / log(at_first / at_last);
        } else {
            t = low.t + (high.t - low.t) * (low.error / (low.error - high.error));
        }
        if (!found && evaluations % 3 == 2) t = INFINITE;  // where that is no good, half of the bracket is
        if (!(low.t < t && t < high.t)) t = high.t < INFINITE ? 0.5 * (low.t + high.t) : 2.0 * before + 1.0;
        if (std::fabs(t - before) <= 1e-14 * t || high.t <= low.t * (1.0 + 1e-15)) break;
    }
    return t;
}

/// Note the marks that a flight passes. It dissipates `total`.
template <int P>
void Motion::raise_marks(const ContactMode& mode, const Path<P>& path, double flight, double total) {
    const double start = dissipated();
    for (; mark_ < marks_.size() && start + total >= marks_[mark_].fraction * initial_; ++mark_) {
        EnergyMark& mark = marks_[mark_];
        const double at = mark_time(mode, path, flight, total, mark.fraction * initial_ - start);
        mark.time = time_ + at;
        mark.sums = sums();
        for (size_t k = 0; k < taken_.size(); ++k) mark.sums[modes_.frame().part[k]] += taken_[k];
    }
}

/// Add a flight to the time, kept in two parts, and to the angles of the loads.
void Motion::advance(double flight) {
    for (int g = 0; g < modes_.frame().loads(); ++g) angles_[g].add(modes_.frame().frequency[g] * flight);
    const double total = time_ + flight;
    time_low_ += time_ >= flight ? (time_ - total) + flight : (flight - total) + time_;
    time_ = total + time_low_;
    time_low_ = (total - time_) + time_low_;
}

/// Take a flight into the sums and the clock. `end`: the state after it. False where that is not finite.
template <int P>
bool Motion::fly(const ContactMode& mode, const Path<P>& path, double flight, Values end) {
    if (flight == 0.0) return true;
    for (const double entry : end)
        if (!(std::fabs(entry) < INFINITE)) return false;
    // Equation (29): what the dampers take over the flight.
    if (!taken_.empty()) {
        const double total = spent(mode, path, flight);
        if (total > 0.0 && mark_ < marks_.size() && dissipated() + total >= marks_[mark_].fraction * initial_) {
            const std::vector<double> whole = taken_;
            raise_marks(mode, path, flight, total);
            taken_ = whole;
        }
        for (size_t k = 0; k < taken_.size(); ++k) sums_[modes_.frame().part[k]].add(taken_[k]);
    }
    if (flight == INFINITE) return true;
    advance(flight);
    if (mode.sticking != 0) sticking_time_ += flight;
    return true;
}

// -- events

/// The event after a flight counts; true where too many have come since the fastest motion has turned by a radian.
bool Motion::is_impatient(const ContactMode& mode, const NextImpact& found) {
    const int64_t cost = found.found == Found::EXHAUSTED ? SEARCH : found.time == 0.0 ? INSTANT : 1;
    idle_ += cost;
    if (idle_ <= PATIENCE * (2 + modes_.contacts())) return false;
    const double now = time_ + found.time;
    if ((now - progress_) * mode.flight.fastest() < 1.0) return true;
    idle_ = cost;
    progress_ = now;
    return false;
}

/// Equation (3): the next impact, or the next release, whose distance is the contact force (7). The state there becomes `end_`.
template <int P>
NextImpact Motion::search(const ContactMode& mode, const Path<P>& path, double horizon) {
    const StepStops* stops = !released_ && mode.stops && mode.stops->fit() ? mode.stops.get() : nullptr;
    NextImpact found;
    // A short bounce is known better by the series of its distance than by steps.
    const auto is_bounce = [&] { return found.contact == leaving_ && leaving_ >= 0 && found.time * mode.flight.fastest() <= NEAR_REACH; };
    end_.resize(z_.size());
    if (!with_peaks_) {
        NoObserver none;
        if (!stops || !step_to_impact(path, *stops, leaving_, horizon, found, none) || is_bounce())
            found = next_impact_on(path, mode.contacts, leaving_, released_, horizon, nullptr);
        path.state(found.time, end_);
        return found;
    }
    // The looks at peaks have a path of their own: they must not change how this one rounds.
    const Path<P> looks(mode.flight, path.begin());
    const Peaks peaks{peaks_, {}};
    if (stops) {
        PeakObserver<Path<P>> observer(looks, *mode.peak_rows, peaks);
        if (step_to_impact(path, *stops, leaving_, horizon, found, observer) && !is_bounce()) {
            path.state(found.time, end_);
            observer.finish(found.time, end_);
            if (observer.gave_up()) found = {Found::EXHAUSTED, -1, 0.0};
            return found;
        }
    }
    found = next_impact_on(path, mode.contacts, leaving_, released_, horizon, nullptr);
    path.state(found.time, end_);
    if (found.time > 0.0 && !raise_peaks(looks, mode.displacements(), found.time, end_, peaks)) found = {Found::EXHAUSTED, -1, 0.0};
    return found;
}

/// The flight from the present state, and the event at its end. A reason where the motion pauses or ends there.
template <int P>
std::optional<Reason> Motion::pass(double duration) {
    const ContactFrame& frame = modes_.frame();
    const ContactMode& mode = present();
    const int ahead = break_index_ + 1;
    double end = duration;
    if (ahead < int(frame.breaks.size()) && frame.breaks[ahead] < duration) end = frame.breaks[ahead];
    const double horizon = std::max((end - time_) - time_low_, 0.0);
    const Path<P> path(mode.flight, z_);
    const NextImpact found = search(mode, path, horizon);
    const int c = found.contact;
    if (is_impatient(mode, found)) return found.found == Found::EXHAUSTED ? Reason::GAVE_UP : Reason::CYCLING;
    speed_ = loss_ = 0.0;
    leaving_ = -1;
    released_ = false;
    const bool releases = c >= 0 && has(mode.sticking, c);
    if (found.found == Found::OUTSIDE && !releases)
        return time_ == 0.0 && impacts_ == 0 ? Reason::STARTED_OUTSIDE : Reason::PIERCED;
    if (found.found == Found::EXHAUSTED && found.time == 0.0) return Reason::GAVE_UP;
    const double begin = time_;
    double flight = found.time;
    const bool reached = found.found == Found::NONE && end == duration;
    if (reached && stays_within(mode, end_)) {
        clear_ = true;
        clear_time_ = begin;
        if (to_rest_ && mode.integrals.decays()) {
            flight = INFINITE;
            at_rest_ = true;
            std::fill(end_.begin(), end_.end(), 0.0);
        }
    }
    if (!fly(mode, path, flight, end_)) return Reason::GAVE_UP;
    if (flight > 0.0) z_.swap(end_);
    if (reached) return Reason::REACHED;
    if (record_) note_before(mode);
    if (found.found == Found::NONE) {
        time_ = end;
        time_low_ = 0.0;
        break_index_ = ahead;
        bounces_ = 0;
        idle_ = 0;
        progress_ = end;
        if (ahead % REFRESH == 0) {
            leave_mode();
            write_loads();
            enter_mode(f_);
        } else {
            reset_loads(ahead);
        }
        note(Event::BREAK, -1);
        return {};
    }
    if (found.found == Found::EXHAUSTED) {
        note(Event::PIECE, -1);
        return {};
    }
    const double rate = dot(mode.contacts.rate[c], z_);
    // Where a hit opens the contact, its distance is rounding.
    if (found.found == Found::TOUCH || (found.found == Found::HIT && !releases && mode.contacts.side[c] * rate < 0.0)) {
        leaving_ = c;
        if (releases) return {};
        ++touches_;
        note(Event::TOUCH, c);
        return {};
    }
    contact_ = c;
    if (releases) {  // the contact force has come to 0
        leave_mode();
        request(mode.sticking & ~only(c), Event::RELEASE);
        leaving_ = c;
        released_ = true;
    } else if (found.found == Found::PRESSED) {  // the contact presses at zero speed
        leave_mode();
        stop_contact(c);
        request(mode.sticking | only(c), Event::STICK);
    } else {
        return hit(c, rate, duration);
    }
    return {};
}

Reason Motion::move(double duration, int64_t most, int64_t passes, Record* record) {
    record_ = record;
    while (true) {
        if (pending_ >= 0) {
            const bool impact = kind_ == Event::IMPACT;
            if (!begin_mode()) return Reason::NEW_MODE;
            if (impact) after_impact(contact_, duration);
            if (pending_ >= 0) continue;
        }
        if (impacts_ >= most) return Reason::MOST;
        if (passes-- <= 0) return Reason::PAUSED;
        std::optional<Reason> ended;
        switch (present().flight.steps().pairs()) {
            case 1: ended = pass<1>(duration); break;
            case 2: ended = pass<2>(duration); break;
            case 3: ended = pass<3>(duration); break;
            default: ended = pass<DYNAMIC>(duration);
        }
        if (ended) return *ended;
    }
}

/// The impact at contact c, whose gap changes at a rate. A reason where the motion ends there.
std::optional<Reason> Motion::hit(int c, double rate, double duration) {
    const int f = f_;
    const ContactSet sticking = present().sticking;
    const ContactMode& free = modes_[0];
    if (f != 0) {
        kept_ = z_;
        leave_mode();
        write_loads();
        enter_mode(0);
        rate = rules_.rate(c, z_);
    }
    const ImpactRules::AtBounds others = rules_.at_bounds(c, z_);
    if (others.moving != 0 && rules_.sunk(others.moving | only(c), z_)) {
        leave_mode();
        write_loads();
        lift(others.moving | only(c));
        enter_mode(0);
        rate = rules_.rate(c, z_);
    }
    const bool progresses = idle_ >= SEEN_IDLE && rules_.is_fast(c, rate, z_);
    const ImpactRules::Outcome out = rules_.resolve(c, rate, others, sticking, z_);
    if (!out.decided) return Reason::INTERACTING;
    switch_error_ = std::max(switch_error_, out.span);
    add_loss(c, out.loss);
    ++impacts_;
    last_impact_ = time_;
    speed_ = free.contacts.side[c] * rate;
    loss_ = out.loss;
    contact_ = c;
    if (progresses) {
        idle_ = 0;
        progress_ = time_;
    }
    if (out.at_rest) {
        note(Event::IMPACT, c);
        leave_mode();
        if (record_) note_before(free);
        speed_ = loss_ = 0.0;
        lift(others.moving & ~sticking & ~out.stay);
        request(out.stay, Event::STICK);
        return {};
    }
    const ContactSet stay = out.stay & sticking;
    const bool renews = modes_.frame().loads() > 0 && impacts_ % REFRESH == 0;
    leaving_ = c;
    if (f == 0 || out.stay == sticking) {
        if (f != 0) {
            // All that stick, and no others, take part: the same impact within their mode takes nothing through other coordinates.
            z_ = kept_;
            f_ = f;
            bounce(present(), c, (1.0 + free.contacts.restitution[c]) * dot(present().contacts.rate[c], z_), z_);
        }
        if (renews) {
            leave_mode();
            write_loads();
            enter_mode(f_);
        }
        note(Event::IMPACT, c);
        after_impact(c, duration);
        return {};
    }
    rebound_ = rules_.rate(c, z_);
    leave_mode();
    lift((sticking & ~stay) | only(c));
    request(stay, Event::IMPACT);
    return {};
}

/// See whether the bounces of contact c end after this impact, by equation (28), and the contact sticks.
void Motion::after_impact(int c, double duration) {
    const bool elastic = modes_[0].contacts.restitution[c] == 1.0 && modes_.frame().dampers == 0;  // without losses
    if (elastic) {
        bounces_ = 0;
        return;
    }
    const std::vector<double>& breaks = modes_.frame().breaks;
    double end = duration;
    if (break_index_ + 1 < int(breaks.size())) end = std::min(end, breaks[break_index_ + 1]);
    const ContactSet sticking = present().sticking;
    if (!chatter(c, (end - time_) - time_low_)) return;
    if (record_) {
        std::vector<double> z(modes_[0].size());
        multiply(Matrix<const double>(modes_[0].from_modes), x_, z);
        multiply(Matrix<const double>(modes_[0].leave), z, before_);
    }
    stop_contact(c);
    request(sticking | only(c), Event::STICK);
    contact_ = c;
    leaving_ = -1;
}

/// Set the remaining velocity across contact c to zero, at modal coordinates x. Its energy is a loss at the stop.
void Motion::stop_contact(int c) {
    std::vector<double> z(modes_[0].size());
    multiply(Matrix<const double>(modes_[0].from_modes), x_, z);
    const double speed = rules_.rate(c, z), loss = 0.5 * modes_.frame().contact_mass[c] * speed * speed;
    add_loss(c, loss);
    speed_ = std::fabs(speed);
    loss_ = loss;
}

/// Whether no other contact can be hit within a short `span` in which contact c chatters.
bool Motion::out_of_reach(const ContactMode& mode, int c, double span, double speed, double force) const {
    const Contacts& free = modes_[0].contacts;
    for (int k = 0; k < modes_.contacts(); ++k) {
        if (k == c || mode.contacts.bound[k] >= NEVER) continue;
        const Gap gap = gauge(mode.contacts, k, z_);
        const double pushed = has(mode.sticking, k) ? 0.0 : dot(free.rate[k], free.push[c]);
        const double moved = span * (std::fabs(gap.slope) + std::fabs(pushed) * (speed + force * span)) +
            span * span * std::fabs(gap.bend);
        if (gap.d - 4.0 * moved <= gap.tolerance) return false;
    }
    return true;
}

/// After an impact at contact c: whether chattering ends here, with x and the clock and the sums at its end. left: time to the
/// duration or the next break.
bool Motion::chatter(int c, double left) {
    const ContactMode& mode = present();
    const double restitution = modes_[0].contacts.restitution[c], fastest = mode.flight.fastest();
    const auto [d, slope, bend, tolerance] = gauge(mode.contacts, c, z_);
    if (bend >= 0.0) {
        bounces_ = 0;
        return false;
    }
    bool small = slope * std::fabs(slope) <= -2.0 * bend * FLAT * tolerance;
    // So is one whose speed is rounding, and one within the tolerance that outlasts the series of its distance: the dampers end it
    // there.
    small = small || slope <= mode.flight.rounding_level(mode.contacts.rate[c], Values(z_));
    const bool within = -2.0 * slope * slope >= bend * tolerance;
    small = small || (slope * fastest > -0.5 * bend * NEAR_REACH && within);
    if (restitution == 1.0) {
        // Where a damper acts on its gap, each elastic bounce is slower than the one before, too: those within the tolerance are
        // none.
        const double pushed = dot(mode.contacts.rate[c], mode.contacts.push[c]);
        const double slowed = -dot(mode.contacts.acceleration[c], mode.contacts.push[c]);
        small = small || (slope * slowed / pushed > -ROUNDING * bend && within);
    }
    if (restitution == 0.0 || restitution == 1.0) {
        bounces_ = 0;
        if (small) leave_mode();
        return small;
    }
    // Time to the end of the bounces, were the press constant: a geometric series.
    const double span = -2.0 * slope / (bend * (1.0 - restitution));
    if (span * fastest > CHATTER_REACH || bouncing_ != c) {
        bounces_ = 0;
        bouncing_ = c;
    }
    if (span * fastest <= CHATTER_REACH) {
        const int stride = std::max(1, int(std::ceil(log(0.5) / log(restitution))));
        if (bounces_ == 0) {
            reference_ = time_;
            reference_low_ = time_low_;
            rows_ = 0;
        }
        if (bounces_++ % stride == 0) {
            const int n = modes_.frame().coordinates, width = 2 * n, size = int(values_.size());
            leave_mode();
            values_[0] = (time_ - reference_) + (time_low_ - reference_low_);
            std::copy(x_.begin(), x_.begin() + width, values_.begin() + 1);
            for (size_t i = 0; i < sums_.size(); ++i) values_[1 + width + i] = sums_[i].value();
            table_.resize(size_t(LEVELS) * size);
            // Equation (28), one order after the other; row i keeps the last value of order i.
            const double ratio = pow(restitution, double(stride));
            for (int w = 0; w < size; ++w) {
                double next = values_[w], power = 1.0;
                for (int i = 0; i <= std::min(rows_, LEVELS - 1); ++i) {
                    double& entry = table_[size_t(i) * size + w];
                    const double old = entry;
                    entry = next;
                    power *= ratio;
                    next = (next - power * old) / (1.0 - power);
                }
            }
            ++rows_;
            const int order = std::min(rows_, LEVELS) - 1;
            if (order > 0) {
                // The error estimate is the difference of the two highest orders.
                const double *best = table_.data() + size_t(order) * size, *other = best - size;
                const double ahead = best[0] - values_[0], time_error = std::fabs(best[0] - other[0]);
                double size_u = 0.0, size_v = 0.0, error_u = 0.0, error_v = 0.0;
                for (int r = 0; r < n; ++r) {
                    size_u = std::max(size_u, std::fabs(x_[r]));
                    size_v = std::max(size_v, std::fabs(x_[n + r]));
                    error_u = std::max(error_u, std::fabs(best[1 + r] - other[1 + r]));
                    error_v = std::max(error_v, std::fabs(best[1 + n + r] - other[1 + n + r]));
                }
                double energy = std::fabs(initial_), energy_error = 0.0;
                for (int k = 1 + width; k < size; ++k) {
                    energy = std::max(energy, std::fabs(values_[k]));
                    energy_error += std::fabs(best[k] - other[k]);
                }
                const bool good = time_error * fastest <= SWITCH_TIME &&
                    error_u <= SWITCH_LEVEL * std::max(size_u, size_v / fastest) &&
                    error_v <= SWITCH_LEVEL * std::max(size_v, size_u * fastest) && energy_error <= SWITCH_LEVEL * energy;
                if ((good || small) && 0.0 <= ahead && ahead < left && out_of_reach(mode, c, 2.0 * span, slope, -bend)) {
                    switch_error_ = std::max(switch_error_, time_error);
                    std::copy(best + 1, best + 1 + width, x_.begin());
                    for (size_t i = 0; i < sums_.size(); ++i) sums_[i].add(best[1 + width + i] - values_[1 + width + i]);
                    begin_ = time_;
                    advance(ahead);
                    if (mode.sticking != 0) sticking_time_ += ahead;
                    span_ = ahead;
                    return true;
                }
            }
        }
    }
    if (small) {
        leave_mode();
        switch_error_ = std::max(switch_error_, span);
    }
    return small;
}

// -- the record

/// (u, v) just before an event, from the present state of a mode.
void Motion::note_before(const ContactMode& mode) { multiply(Matrix<const double>(mode.leave), z_, before_); }

void Motion::note(Event kind, int contact) {
    if (!record_) return;
    record_->kinds.push_back(int64_t(kind));
    record_->contacts.push_back(contact);
    record_->modes.push_back(f_);
    record_->times.push_back(time_);
    record_->speeds.push_back(speed_);
    record_->losses.push_back(loss_);
    record_->before.insert(record_->before.end(), before_.begin(), before_.end());
    record_->states.insert(record_->states.end(), z_.begin(), z_.end());
    for (const Compensated& sum : sums_) record_->sums.push_back(sum.value());
}

/// Log the interval of bounces that are summed as a series. It is one flight of the contact mode in which they end, up to the
/// present state.
void Motion::note_chatter() {
    if (!record_) return;
    std::vector<double> back(z_.size());
    path_of(present().flight, Values(z_), span_).state(-span_, back);
    z_.swap(back);
    note(Event::CHATTER, contact_);
    record_->times.back() = begin_;
    spent(present(), path_of(present().flight, Values(z_), span_), span_);
    for (size_t k = 0; k < taken_.size(); ++k)
        record_->sums[record_->sums.size() - sums_.size() + modes_.frame().part[k]] -= taken_[k];
    z_.swap(back);
}

}  // namespace saltus
