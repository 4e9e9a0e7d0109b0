/// A linearised orbit: a chain of flights and saltations, equations (27) and (31).
///
/// A flight acts on a perturbation as its map, and an impact adds a matrix of rank two,
///
///     S = R + late g,     late = (f+ - R f-)/(g . f-),     R = 1 - (1 + r) push rate
///
/// (Mueller, Chaos, Solitons & Fractals 5 (1995) 1671). At a cut nothing is added. Closed orbits, and the half map
/// between two ends, are such chains.
#pragma once

#include "contact.hpp"
#include "dense.hpp"
#include "linear_flight.hpp"

namespace saltus {

/// The nodes of a closed orbit over its period, in order of time: impacts, and cuts.
struct Nodes {
    Matrix<const double> before, after;  // (P, N) states before each node and after it
    Values duration;                     // (P,) of the flight after each
    Vector<const int> contact;           // (P,) -1: a cut
    int count() const { return int(duration.size()); }
};

/// Whether each mode moves alone: entries r and n + r of a state are a pair.
template <class Flight>
bool is_modal(const Flight& flight) {
    if constexpr (requires { flight.blocks(); }) {
        const int half = flight.size() / 2;
        if (int(flight.blocks().size()) != half) return false;
        for (int k = 0; k < half; ++k)
            if (flight.blocks()[k].first != k || flight.blocks()[k].second != half + k) return false;
        return true;
    }
    return false;
}

/// Flights and nodes of an orbit with N entries a state, linearised. Flight i leads from node i to the next one.
template <int N = DYNAMIC>
class Chain {
public:
    static constexpr int SIZE = N;

    /// modal: whether `is_modal` holds; gaps then feel displacements alone, and impulses change velocities alone. A
    /// state is one of canonical coordinates (q, p) where there is an energy.
    explicit Chain(int size = N, bool modal = true) : size_(size), modal_(modal) {}

    constexpr int size() const {
        if constexpr (N != DYNAMIC) return N;
        return size_;
    }
    int nodes() const { return nodes_; }
    bool is_modal() const { return modal_; }
    int contact(int j) const { return contact_[j]; }
    Values coming(int j) const { return row(coming_, j); }    // f- before node j
    Values leaving(int j) const { return row(leaving_, j); }  // f+ after it
    Values late(int j) const { return row(late_, j); }        // the change of a perturbation that arrives late

    /// out = grad H after node j: the flow, turned by the symplectic form.
    template <class Out>
    void slope(int j, Out&& out) const {
        const int half = size() / 2;
        for (int r = 0; r < half; ++r) out[r] = -leaving(j)[half + r], out[half + r] = leaving(j)[r];
    }

    /// Make room for so many nodes. same: the orbit before, whose maps are kept.
    void begin(int nodes, bool same = false) {
        nodes_ = nodes;
        if (!same) maps_count_ = 0;
        nearest_ = 0;
        if (const size_t room = size_t(maps_count_) + nodes; times_.size() < room) {
            maps_.resize(room * stride());
            times_.resize(room);
        }
        if (int(contact_.size()) >= nodes) return;
        for (auto* rows : {&coming_, &leaving_, &late_}) rows->resize(size_t(nodes) * size());
        place_.resize(nodes);
        contact_.resize(nodes);
    }

    /// Linearise a closed orbit. same: see `begin`.
    template <class Flight>
    void set(const Flight& flight, const Contacts& contacts, const Nodes& orbit, bool same = false) {
        begin(orbit.count(), same);
        for (int i = 0; i < nodes_; ++i) {
            set_flight(i, flight, orbit.after[i], orbit.duration[i]);
            set_node(i, flight, contacts, orbit.contact[i], orbit.before[i], orbit.after[i]);
        }
    }

    /// Linearise flight i, over time t from the state z. An orbit passes flights of the same times forwards and backwards.
    template <class Flight>
    void set_flight(int i, const Flight& flight, Values z, double t) {
        for (int k = nearest_ > 0 ? nearest_ - 1 : 0; !Flight::is_series() && k < maps_count_ && k < nearest_ + 2; ++k)
            if (times_[k] == t) {
                place_[i] = nearest_ = k;
                return;
            }
        place_[i] = nearest_ = maps_count_++;
        times_[nearest_] = t;
        double* entries = maps_.data() + size_t(nearest_) * stride();
        if constexpr (requires { flight.blocks(); })
            if (modal_) {
                const int half = size() / 2;
                for (int k = 0; k < half; ++k) {
                    const auto e = flow_pair(flight.blocks()[k], t);
                    entries[k] = e.e11, entries[half + k] = e.e12, entries[2 * half + k] = e.e21,
                    entries[3 * half + k] = e.e22;
                }
                return;
            }
        Local<double, N> end(size());
        flight.end(z, t, end, Matrix<double>(entries, size(), size()));
    }
    /// The same by its map (N, N).
    void set_flight(int i, Matrix<const double> map) {
        place_[i] = i;
        std::copy(map.data(), map.data() + stride(), maps_.data() + size_t(i) * stride());
    }

    /// Linearise node j, with the states before and after it.
    template <class Flight>
    void set_node(int j, const Flight& flight, const Contacts& contacts, int contact, Values before, Values after) {
        flight.rate(before, row(coming_, j));
        flight.rate(after, row(leaving_, j));
        set_late(j, contacts, contact);
    }
    /// The same from the velocities before and after it.
    void set_node(int j, const Contacts& contacts, int contact, Values coming, Values leaving) {
        copy(coming, row(coming_, j));
        copy(leaving, row(leaving_, j));
        set_late(j, contacts, contact);
    }

    /// The first columns of x (N, ..) over flight i and the node after it, j.
    template <class X>
    void carry(int i, int j, const Contacts& contacts, X& x, int columns) const {
        if (!modal_) {
            carry_over_flight(i, x, columns);
            if (contact_[j] >= 0) carry_over_impact(j, contacts, x, columns);
            return;
        }
        each_modal(i, j, contacts, x, columns,
                   [](auto width, const Modal& node, double* at) { forwards<width()>(node, at); });
    }

    /// The same backwards, without losses, where each mode moves alone.
    template <class X>
    void carry_back(int i, int j, const Contacts& contacts, X& x, int columns) const {
        each_modal(i, j, contacts, x, columns,
                   [](auto width, const Modal& node, double* at) { backwards<width()>(node, at); });
    }

    /// J = R exp(B t) of flight i to node j, dense.
    template <class M>
    void landing(int i, int j, const Contacts& contacts, M& out) const {
        const int half = size() / 2;
        const double* e = map(i);
        for (int r = 0; r < size(); ++r)
            for (int c = 0; c < size(); ++c) out(r, c) = modal_ ? 0.0 : e[r * size() + c];
        if (modal_)
            for (int r = 0; r < half; ++r) {
                out(r, r) = e[r], out(r, half + r) = e[half + r];
                out(half + r, r) = e[2 * half + r], out(half + r, half + r) = e[3 * half + r];
            }
        if (const int c = contact_[j]; c >= 0)
            impact_columns(contacts.rate[c], contacts.push[c], 1.0 + contacts.restitution[c], out);
    }

    /// F = R f- at node j.
    template <class Out>
    void arrival(int j, const Contacts& contacts, Out&& out) const {
        copy(coming(j), out);
        if (contact_[j] >= 0) reflect(j, contacts, out);
    }

private:
    int stride() const { return modal_ ? 2 * size() : size() * size(); }
    const double* map(int i) const { return maps_.data() + size_t(place_[i]) * stride(); }
    Vector<double> row(std::vector<double>& rows, int j) { return {rows.data() + size_t(j) * size(), size_t(size())}; }
    Values row(const std::vector<double>& rows, int j) const {
        return {rows.data() + size_t(j) * size(), size_t(size())};
    }
    /// Entries of a gap that are not zero end here, and those of a rate and of an impulse begin here.
    constexpr int gap_end() const { return modal_ ? size() / 2 : size(); }
    constexpr int rate_begin() const { return modal_ ? size() / 2 : 0; }

    void set_late(int j, const Contacts& contacts, int contact) {
        contact_[j] = contact;
        if (contact < 0) return;
        const Values before = coming(j), after = leaving(j), gap = contacts.gap[contact];
        Vector<double> out = row(late_, j);
        double speed = 0.0;
        for (int r = 0; r < gap_end(); ++r) speed += gap[r] * before[r];
        copy(before, out);
        reflect(j, contacts, out);
        for (int r = 0; r < size(); ++r) out[r] = (after[r] - out[r]) / speed;
    }

    /// z <- R z.
    template <class Z>
    void reflect(int j, const Contacts& contacts, Z&& z) const {
        const int c = contact_[j];
        const Values rate = contacts.rate[c], push = contacts.push[c];
        double kick = 0.0;
        for (int r = rate_begin(); r < size(); ++r) kick += rate[r] * z[r];
        kick *= 1.0 + contacts.restitution[c];
        for (int r = rate_begin(); r < size(); ++r) z[r] -= kick * push[r];
    }

    /// A flight and the node after it, where each mode moves alone.
    struct Modal {
        int half, stride;                        // stride: from one row of perturbations to the next
        const double* e;                         // (4, n) entries of the flight
        const double *gap, *rate, *push, *late;  // null at a cut
        double jump;
    };

    template <class X, class Step>
    void each_modal(int i, int j, const Contacts& contacts, X& x, int columns, Step&& step) const {
        const int c = contact_[j], half = size() / 2;
        Modal node{half, x.columns(), map(i), nullptr, nullptr, nullptr, nullptr, 0.0};
        if (c >= 0) {
            node.gap = contacts.gap[c].data(), node.rate = contacts.rate[c].data() + half,
            node.push = contacts.push[c].data() + half;
            node.late = late(j).data(), node.jump = 1.0 + contacts.restitution[c];
        }
        in_groups(0, columns, [&](auto width, int at) { step(width, node, &x(0, at)); });
    }

    template <int W>
    static void forwards(const Modal& node, double* __restrict x) {
        const int half = node.half, stride = node.stride;
        const double *__restrict e = node.e, *__restrict gap = node.gap, *__restrict rate = node.rate;
        double lateness[W] = {}, kick[W] = {};
        for (int r = 0; r < half; ++r) {
            double *p = x + r * stride, *q = x + (half + r) * stride, a[W], b[W];
            for (int c = 0; c < W; ++c) a[c] = e[r] * p[c] + e[half + r] * q[c];
            for (int c = 0; c < W; ++c) b[c] = e[2 * half + r] * p[c] + e[3 * half + r] * q[c];
            for (int c = 0; c < W; ++c) p[c] = a[c];
            for (int c = 0; c < W; ++c) q[c] = b[c];
            if (!gap) continue;
            for (int c = 0; c < W; ++c) lateness[c] += gap[r] * a[c];
            for (int c = 0; c < W; ++c) kick[c] += rate[r] * b[c];
        }
        if (!gap) return;
        for (int c = 0; c < W; ++c) kick[c] *= node.jump;
        const double *__restrict late = node.late, *__restrict push = node.push;
        for (int r = 0; r < half; ++r) {
            double *p = x + r * stride, *q = x + (half + r) * stride;
            for (int c = 0; c < W; ++c) p[c] += late[r] * lateness[c];
            for (int c = 0; c < W; ++c) q[c] += late[half + r] * lateness[c] - push[r] * kick[c];
        }
    }

    /// The inverse of S is R (1 + late g), and that of a flight's pair has the determinant 1.
    template <int W>
    static void backwards(const Modal& node, double* __restrict x) {
        const int half = node.half, stride = node.stride;
        const double *__restrict e = node.e, *__restrict gap = node.gap;
        const double *__restrict late = node.late, *__restrict push = node.push;
        double lateness[W] = {}, kick[W] = {};
        for (int r = 0; gap && r < half; ++r)
            for (int c = 0; c < W; ++c) lateness[c] += gap[r] * x[r * stride + c];
        for (int r = 0; gap && r < half; ++r) {
            double *p = x + r * stride, *q = x + (half + r) * stride;
            for (int c = 0; c < W; ++c) p[c] += late[r] * lateness[c];
            for (int c = 0; c < W; ++c) q[c] += late[half + r] * lateness[c];
            for (int c = 0; c < W; ++c) kick[c] += node.rate[r] * q[c];
        }
        for (int c = 0; c < W; ++c) kick[c] *= node.jump;
        for (int r = 0; r < half; ++r) {
            double *p = x + r * stride, *q = x + (half + r) * stride, a[W], b[W];
            for (int c = 0; c < W; ++c) a[c] = p[c];
            for (int c = 0; c < W; ++c) b[c] = gap ? q[c] - push[r] * kick[c] : q[c];
            for (int c = 0; c < W; ++c) p[c] = e[3 * half + r] * a[c] - e[half + r] * b[c];
            for (int c = 0; c < W; ++c) q[c] = e[r] * b[c] - e[2 * half + r] * a[c];
        }
    }

    /// x <- map x of a flight whose modes are coupled.
    template <class X>
    void carry_over_flight(int i, X& x, int columns) const {
        const double* e = map(i);
        LocalSquare<double, N> out(size());
        for (int r = 0; r < size(); ++r) {
            for (int c = 0; c < columns; ++c) out(r, c) = 0.0;
            for (int k = 0; k < size(); ++k)
                if (e[r * size() + k] != 0.0) add(e[r * size() + k], x, k, columns, &out(r, 0));
        }
        for (int r = 0; r < size(); ++r)
            for (int c = 0; c < columns; ++c) x(r, c) = out(r, c);
    }

    /// x <- S x.
    template <class X>
    void carry_over_impact(int j, const Contacts& contacts, X& x, int columns) const {
        const int k = contact_[j];
        const Values gap = contacts.gap[k], rate = contacts.rate[k], push = contacts.push[k], change = late(j);
        Local<double, N> lateness(size()), kick(size());
        for (int c = 0; c < columns; ++c) lateness[c] = kick[c] = 0.0;
        for (int r = 0; r < size(); ++r) {
            add(gap[r], x, r, columns, lateness.data());
            add((1.0 + contacts.restitution[k]) * rate[r], x, r, columns, kick.data());
        }
        for (int r = 0; r < size(); ++r)
            for (int c = 0; c < columns; ++c) x(r, c) += change[r] * lateness[c] - push[r] * kick[c];
    }
    /// sum += factor times row r of x.
    template <class X>
    static void add(double factor, X& x, int r, int columns, double* __restrict sum) {
        const double *__restrict from = &x(r, 0);
        for (int c = 0; c < columns; ++c) sum[c] += factor * from[c];
    }

    int size_;
    bool modal_;
    int nodes_ = 0, maps_count_ = 0, nearest_ = 0;  // nearest_: the last map that was used
    std::vector<double> coming_, leaving_, late_, maps_, times_;
    std::vector<int> place_, contact_;
};

/// Sizes of the displacements and velocities of a closed orbit, (N,): the latter of a conservative system by sqrt(2 H),
/// as an impact may be its only slow part.
template <class Out>
void set_scale(const Nodes& orbit, double twice_energy, Out&& scale) {
    const int size = int(scale.size()), half = size / 2;
    double largest[2] = {0.0, 0.0};
    for (int i = 0; i < orbit.count(); ++i)
        for (int r = 0; r < size; ++r) largest[r >= half] = larger(largest[r >= half], std::fabs(orbit.before(i, r)));
    if (twice_energy > 0.0) largest[1] = std::sqrt(twice_energy);
    for (int r = 0; r < size; ++r) scale[r] = largest[r >= half] > 0.0 ? largest[r >= half] : 1.0;
}

}  // namespace saltus
