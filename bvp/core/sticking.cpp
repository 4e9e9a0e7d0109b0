/// Impacts while other contacts stick or are at their bounds, equation (8).
#include "sticking.hpp"

#include <algorithm>

namespace saltus {

namespace {

/// A start counts as near its stop until the distance is this many contact tolerances.
constexpr double NEAR = 1e9;

/// change (near + rest), rounded to either side alike. `near` is the nearest double to a number, and `rest` what it
/// leaves. Were rest left out, or added to a rounded product, every product would be off to the same side.
double kick(double change, double near, double rest) {
    constexpr double SPLIT = 134217729.0;  // 2^27 + 1, for the upper half of the digits (Veltkamp)
    const double scaled = near * SPLIT, head = scaled - (scaled - near);
    return change * head + change * ((near - head) + rest);
}

}  // namespace

void bounce(const ContactMode& mode, int c, double change, Vector<double> z) {
    const double *push = mode.contacts.push[c].data(), *rest = mode.push_rest[c].data();
    for (int r = 0; r < int(z.size()); ++r) z[r] -= kick(change, push[r], rest[r]);
}

ImpactRules::ImpactRules(const ContactMode& free, const ContactFrame& frame)
    : free_(free), frame_(frame), count_(free.contacts.count()), alone_(frame.stops == 1) {}

ImpactRules::AtBounds ImpactRules::at_bounds(int c, Values z) const {
    AtBounds out;
    if (alone_) return out;
    for (int k = 0; k < count_; ++k) {
        if (k == c) continue;
        const Gap gap = gauge(free_.contacts, k, z);
        if (gap.d > gap.tolerance) continue;
        (std::fabs(gap.slope) <= rounding(k, z) ? out.still : out.moving) |= only(k);
    }
    return out;
}

bool ImpactRules::sunk(ContactSet set, Values z) const {
    for (int k = 0; k < count_; ++k) {
        if (!has(set, k)) continue;
        const Gap gap = gauge(free_.contacts, k, z);
        if (gap.d < -0.25 * gap.tolerance) return true;
    }
    return false;
}

/// Equation (9), with 1 - rho^2 = (2 - jump) jump. The restitution of both is that of the rounded sum.
double ImpactRules::loss_of(int c, double speed) const {
    const double jump = 1.0 + free_.contacts.restitution[c];
    return 0.5 * frame_.contact_mass[c] * (2.0 - jump) * jump * speed * speed;
}

/// Whether the impulse of contact `first` changes the rate of contact `second` by more than rounding.
bool ImpactRules::interacts(int first, int second) const {
    const Values rate = free_.contacts.rate[second], push = free_.contacts.push[first];
    double change = 0.0, size = 0.0;
    for (int r = 0; r < int(rate.size()); ++r) {
        const double part = rate[r] * push[r];
        change += part;
        size += std::fabs(part);
    }
    return std::fabs(change) > INTERACTION_LEVEL * size;
}

bool ImpactRules::touches_sticking(ContactSet sticking, int c) const {
    for (int k = 0; k < count_; ++k)
        if (has(sticking, k) && interacts(c, k)) return true;
    return false;
}

/// Whether contact k moves so slowly that its accelerations, at full size, would stop it within `heights` contact
/// tolerances.
bool ImpactRules::is_low(int k, Values z, double heights) const {
    const Gap gap = gauge(free_.contacts, k, z);
    double size = 0.0;
    for (int r = 0; r < int(z.size()); ++r) size += std::fabs(free_.contacts.acceleration[k][r] * z[r]);
    return gap.slope * gap.slope <= 2.0 * size * heights * gap.tolerance;
}

/// The contacts of `still` that keep closed under an impact at c: those that stick, and those without rebound, which
/// need no force. At an impact of rounding, as where bodies collapse, it is all of them.
ContactSet ImpactRules::closed(ContactSet still, ContactSet sticking, int c, double rate, Values z) const {
    if (still == 0 || std::fabs(rate) <= RELEASED * rounding(c, z)) return still;
    ContactSet out = still & sticking;
    for (int k = 0; k < count_; ++k)
        if (has(still, k) && free_.contacts.restitution[k] == 0.0) out |= only(k);
    return out;
}

/// Whether the impact at c, after which the state is z, has made a contact of `touching` approach. These touch without a
/// force between them. The impact goes on through them at the same instant, and its outcome depends on whether they
/// touch: restitution does not define it.
bool ImpactRules::driven_together(ContactSet touching, int c, Values z) const {
    for (int k = 0; k < count_; ++k)
        if (has(touching, k) && interacts(c, k) && free_.contacts.side[k] * rate(k, z) > rounding(k, z)) return true;
    return false;
}

/// Solve equation (8) for the impulses at the contacts of `active`, into the last column of table (m, m + 1). They take
/// away rows . z at each contact, and `factor` times that at contact c. They are 0 at all other contacts. The gap of a
/// contact can depend on those of the others. If it stops with them, its impulse is 0; if not, the result is false.
bool ImpactRules::impulses(ContactSet active, const Array<>& rows, int c, double factor, Values z,
                           Matrix<double> table) const {
    double largest = 0.0;
    for (int i = 0; i < count_; ++i) {
        for (int j = 0; j < count_; ++j)
            table(i, j) = has(active, i) && has(active, j) ? dot(free_.contacts.rate[i], free_.contacts.push[j]) : 0.0;
        const double value = has(active, i) ? dot(rows[i], z) : 0.0;
        table(i, count_) = i == c ? factor * value : value;
        largest = std::max(largest, std::fabs(table(i, count_)));
        if (!has(active, i)) table(i, i) = 1.0;
    }
    for (int k = 0; k < count_; ++k) {  // Gauss-Jordan elimination; r_k . p_k is 1 before the others are eliminated
        if (!(table(k, k) > INTERACTION_LEVEL)) {
            if (k == c || !(std::fabs(table(k, count_)) <= INTERACTION_LEVEL * largest)) return false;
            std::fill(table[k].begin(), table[k].end(), 0.0);
            for (int i = 0; i < count_; ++i) table(i, k) = 0.0;
            table(k, k) = 1.0;
            continue;
        }
        for (int i = 0; i < count_; ++i) {
            if (i == k || table(i, k) == 0.0) continue;
            const double ratio = table(i, k) / table(k, k);
            for (int j = k; j <= count_; ++j) table(i, j) -= ratio * table(k, j);
        }
    }
    for (int k = 0; k < count_; ++k) table(k, count_) /= table(k, k);
    return true;
}

/// The contacts of `active` that take an impulse; those of `sticking` take one only where it presses. Returns -1 where
/// rounding does not decide which contacts these are.
ContactSet ImpactRules::pivot(ContactSet active, ContactSet sticking, const Array<>& rows, int c, double factor, Values z,
                              Matrix<double> table) const {
    for (int round = 0; round < 8 * (count_ + 1); ++round) {
        if (!impulses(active, rows, c, factor, z, table)) return -1;
        int wrong = -1;
        for (int k = 0; k < count_ && wrong < 0; ++k) {  // Murty's rule
            if (k == c || !has(sticking, k)) continue;
            double error = -table(k, count_);
            if (!has(active, k)) {
                error = dot(rows[k], z);
                for (int j = 0; j < count_; ++j)
                    error -= table(j, count_) * dot(free_.contacts.rate[k], free_.contacts.push[j]);
            }
            if (free_.contacts.side[k] * error > free_.flight.rounding_level(rows[k], z)) wrong = k;
        }
        if (wrong < 0) return active;
        active ^= only(wrong);
    }
    return -1;
}

void ImpactRules::push_off(Matrix<const double> table, Vector<double> z) const {
    for (int j = 0; j < count_; ++j)
        for (int r = 0; r < int(z.size()); ++r) z[r] -= table(j, count_) * free_.contacts.push(j, r);
}

/// Bring contact c and others to rest together, if they bounce no higher than the contact tolerance and c is pressed.
/// Returns whether this is so, or undecided.
bool ImpactRules::come_to_rest(int c, const AtBounds& at, Vector<double> z, Outcome& out) const {
    const std::vector<double>& restitution = free_.contacts.restitution;
    if (restitution[c] == 1.0 || !is_low(c, z, 1.0)) return false;
    ContactSet others = 0;
    for (int k = 0; k < count_; ++k)
        if (has(at.moving, k) && restitution[k] < 1.0 && is_low(k, z, 1.0)) others |= only(k);
    if (others == 0) return false;
    Array<> table(count_, count_ + 1);
    const ContactSet together = at.still | others | only(c);
    ContactSet stay = pivot(together, together, free_.contacts.acceleration, -1, 1.0, z, table);
    if (stay < 0 || !has(stay, c)) return false;
    double speed = 0.0, press = INFINITE, left = 1.0;
    for (int k = 0; k < count_; ++k) {
        if (has(others | only(c), k)) {
            const Gap gap = gauge(free_.contacts, k, z);
            speed = std::max(speed, std::sqrt(gap.slope * gap.slope + 2.0 * std::fabs(gap.bend) * std::max(gap.d, 0.0)));
        }
        if (!has(stay, k)) continue;
        const double own = std::fabs(table(k, count_));
        if (own <= free_.flight.rounding_level(free_.contacts.acceleration[k], z)) stay &= ~only(k);
        else press = std::min(press, own), left = std::min(left, 1.0 - restitution[k]);
    }
    if (stay == 0) return false;
    // Those of `stay` lose all speed across the contact, the others only a speed towards the stop.
    const ContactSet part = together & ~stay;
    out = {true, true, stay, 0.0, 2.0 * speed / (press * left)};
    if (pivot(stay | part, part, free_.contacts.rate, -1, 1.0, z, table) < 0) {
        out.decided = false;
        return true;
    }
    for (int k = 0; k < count_; ++k) {
        const double before = rate(k, z);
        double after = before;
        for (int j = 0; j < count_; ++j) after -= table(j, count_) * dot(free_.contacts.rate[k], free_.contacts.push[j]);
        out.loss += 0.5 * frame_.contact_mass[k] * table(k, count_) * (before + after);
    }
    out.loss = std::max(out.loss, 0.0);
    push_off(table, z);
    return true;
}

/// Whether it cannot be decided which of two contacts hits first: c and one of `moving`, which arrive together and act on
/// each other. span: the uncertainty of the end of bounces, in time.
bool ImpactRules::clashes(ContactSet moving, int c, Values z, double& span) const {
    const Gap own = gauge(free_.contacts, c, z);
    for (int k = 0; k < count_; ++k) {
        if (!has(moving, k) || !interacts(c, k)) continue;
        const Gap gap = gauge(free_.contacts, k, z);
        if (gap.slope > 0.0) continue;
        if (!(is_low(c, z, NEAR) && is_low(k, z, NEAR))) return true;
        if (gap.d <= free_.flight.rounding_level(free_.contacts.gap[k], z))
            span = std::max(span, (std::fabs(own.slope) + std::fabs(gap.slope)) / std::max(std::fabs(own.bend), std::fabs(gap.bend)));
    }
    return false;
}

ImpactRules::Outcome ImpactRules::resolve(int c, double rate, const AtBounds& others, ContactSet sticking, Vector<double> z) const {
    Outcome out;
    const double restitution = free_.contacts.restitution[c];
    const ContactSet still = others.still | sticking, moving = others.moving & ~sticking;
    if (moving != 0) {
        if (come_to_rest(c, {still, moving}, z, out)) return out;
        if (clashes(moving, c, z, out.span)) {
            out.decided = false;
            return out;
        }
    }
    const ContactSet shut = closed(still, sticking, c, rate, z);
    if (shut != 0 && touches_sticking(shut, c)) {
        Array<> table(count_, count_ + 1);
        const ContactSet active = pivot(shut | only(c), shut, free_.contacts.rate, c, 1.0 + restitution, z, table);
        if (active < 0) {
            out.decided = false;
            return out;
        }
        // Energy lost at c: impulse times the mean speed before and after.
        out.loss = std::max(0.5 * frame_.contact_mass[c] * table(c, count_) * (1.0 - restitution) * rate, 0.0);
        push_off(table, z);
        out.stay = active & ~only(c);
    } else {
        out.stay = shut;
        out.loss = loss_of(c, rate);
        bounce(free_, c, (1.0 + restitution) * rate, z);
    }
    if (driven_together(still & ~shut, c, z)) out.decided = false;
    return out;
}

}  // namespace saltus
