/// The multipoint problem of an impacting orbit, equation (30): its data, its residual and its Jacobian.
///
/// Unknowns   y = (s, t_0, z_1, t_1, ..., z_k, t_k [, xi]): start parameters, flight times, node states after each
///            inner impact
/// Equations  R exp(B t_i) z_i - z_{i+1} = 0,  g . z_{i+1} - bound = 0   for each inner impact, then the closing ones:
///            two ends   L exp(B t_k) z_k = l                       (n equations; z_0 = Z s + c)
///            periodic   R exp(B t_k) z_k + xi grad H(z_0) - z_0 = 0,  g . z_0 - bound = 0
///
/// The start of a periodic orbit is an impact, which is its phase condition. Without impacts it is where the sum of the
/// modal displacements is largest: g is then the row of its rate. xi is the unfolding parameter of the
/// conserved energy (Munoz-Almaraz et al., Physica D 181 (2003) 1), a kick along grad H at the closure: H(z_0) = H(z_0
/// - xi grad H) forces xi = 0 on every solution. There is one unknown more than equations: a family.
///
/// At a cut, a node where nothing is hit, t_i - t_{i+1} = 0 takes the place of the gap, equation (45).
#pragma once

#include "contact.hpp"
#include "elimination.hpp"
#include "linear_flight.hpp"

namespace saltus {

/// Largest displacement, largest velocity (both in modal units) and longest flight of an orbit.
struct Sizes {
    double displacement = 1.0, velocity = 1.0, longest = 1.0;
};

/// Scaled residual of a converged solution.
inline constexpr double CONVERGED_RESIDUAL = 1e-15;

/// Kinds of an end.
enum class End { ORIGIN, REST, STOP, PERIODIC };

/// In place of the power of two in the arclength of a system without a frequency: the unit of time is the quarter
/// period.
inline constexpr int UNPACED = 1 << 20;

/// How the orbit begins and closes.
struct Closure {
    End start, finish;                             // both periodic, or neither
    int quarters;                                  // quarter periods that its flights last: 1, 2 or 4
    int pace;                                      // unit of time of the arclength: 2^-pace, or UNPACED
    Array<> start_map, end_map;                    // (N, s) Z; (c, N) L, no rows of a periodic orbit
    std::vector<double> start_offset, end_offset;  // (N,) c; (c,) l
    bool periodic() const { return start == End::PERIODIC; }
};

/// A multipoint problem of orbits that consist of flights of one kind.
template <class Flight>
class OrbitProblem {
public:
    static constexpr int SIZE = Flight::SIZE;
    static constexpr int ROWS = SIZE == DYNAMIC ? DYNAMIC : SIZE + 1;
    using FlightType = Flight;
    template <class T = double>
    using State = Local<T, SIZE>;

    /// contact (k + 2,): of each inner node (-1: a cut), of the closing node and of the start (-1: none).
    OrbitProblem(Flight flight, Contacts contacts, Closure closure, std::vector<int> contact)
        : flight_(std::move(flight)), contacts_(std::move(contacts)), closure_(std::move(closure)),
          contact_(std::move(contact)), end_columns_(closure_.end_map.columns(), closure_.end_map.rows()), phase_(size(), 0.0) {
        for (int r = 0; r < end_columns_.rows(); ++r)
            for (int e = 0; e < end_columns_.columns(); ++e) end_columns_(r, e) = closure_.end_map(e, r);
        std::fill(phase_.begin() + size() / 2, phase_.end(), 1.0);
    }

    const Flight& flight() const { return flight_; }
    const Closure& closure() const { return closure_; }
    const Contacts& contacts() const { return contacts_; }

    constexpr int size() const { return flight_.size(); }
    /// Equations of a flight to the next node.
    constexpr int rows() const { return size() + 1; }
    /// Inner nodes k; there are k + 1 flights.
    int inner() const { return int(contact_.size()) - 2; }
    int parameters() const { return closure_.start_map.columns(); }
    bool periodic() const { return closure_.periodic(); }
    /// Entries of a position in arclength.
    int coordinates() const { return size() + 2; }
    int closers() const { return periodic() ? rows() : closure_.end_map.rows(); }
    int unknowns() const { return parameters() + 1 + inner() * rows() + (periodic() ? 1 : 0); }

    BlockElimination<ROWS> elimination() const { return {inner(), rows(), parameters() + 1, closers(), periodic()}; }

    /// Flights of an orbit: their ends (k + 1, N), and their derivatives (k + 1, N^2) by the nodes where they begin.
    struct Flown {
        explicit Flown(const OrbitProblem& problem)
            : before(problem.inner() + 1, problem.size()),
              maps(problem.inner() + 1, problem.size() * problem.size()) {}
        Array<> before, maps;
    };

    /// Where the unknowns of flight i begin: the state (of the first flight its parameters), then its time.
    int begin(int i) const { return i == 0 ? 0 : parameters() + 1 + (i - 1) * rows(); }
    int states(int i) const { return i == 0 ? parameters() : size(); }
    int time(int i) const { return parameters() + i * rows(); }
    int unfolding() const { return time(inner()) + 1; }

    /// Whether a stop is hit at the end of flight i.
    bool hits(int i) const { return contact_[i] >= 0; }
    bool is_cut(int i) const { return Flight::is_series() && contact_[i] < 0; }
    /// The last node is followed by the first one, or the far end is at a stop.
    bool ends_at_stop() const { return closure_.finish == End::STOP || closure_.finish == End::PERIODIC; }
    int contact(int node) const { return contact_[node]; }
    /// Node of the contact at the start.
    int start_node() const { return inner() + 1; }
    /// Row g of the contact at a node, or of the phase condition.
    Values gap(int node) const { return hits(node) ? contacts_.gap[contact_[node]] : Values(phase_); }
    Values rate(int node) const { return contacts_.rate[contact_[node]]; }
    Values push(int node) const { return contacts_.push[contact_[node]]; }
    double side(int node) const { return contacts_.side[contact_[node]]; }
    double bound(int node) const { return hits(node) ? contacts_.bound[contact_[node]] : 0.0; }
    double jump(int node) const { return 1.0 + contacts_.restitution[contact_[node]]; }

    /// z_0 = Z s + c.
    template <class Y, class Out>
    void start_state(const Y& y, Out&& out) const {
        for (int r = 0; r < size(); ++r) {
            out[r] = closure_.start_offset[r];
            for (int j = 0; j < parameters(); ++j) out[r] += closure_.start_map(r, j) * y[j];
        }
    }

    /// Sum of the flight times in the unknowns y, or in a change of them.
    template <class Y>
    auto total_time(const Y& y) const {
        auto total = y[time(0)];
        for (int i = 1; i <= inner(); ++i) total += y[time(i)];
        return total;
    }

    /// Call visit(i, z, t) for each flight from its node z over its time t.
    template <class Y, class Visit>
    void each_flight(const Y& y, Visit&& visit) const {
        using T = std::remove_cvref_t<decltype(y[0])>;
        State<T> start(size());
        start_state(y, start);
        visit(0, Vector<const T>(start), y[time(0)]);
        for (int i = 1; i <= inner(); ++i) visit(i, Vector<const T>(&y[begin(i)], size()), y[time(i)]);
    }

    /// F(y), (u - 1,), in any number type: equation (30).
    template <class Y, class Out>
    void residual(const Y& y, Out&& out) const {
        using T = std::remove_cvref_t<decltype(y[0])>;
        Array<T> before(inner() + 1, size());
        each_flight(y, [&](int i, auto z, const T& t) { flight_.end(z, t, before[i]); });
        equations(y, before, out);
    }

    /// The same from the states `before` the impacts, at the end of each flight, (k + 1, N).
    template <class Y, class Before, class Out>
    void equations(const Y& y, const Before& before, Out&& out) const {
        for (int i = 0; i < inner(); ++i) {
            // Equation (30): the flight lands on the next node, which lies on its stop.
            const int row = i * rows(), next = begin(i + 1);
            land(i, before[i], &out[row]);
            for (int r = 0; r < size(); ++r) out[row + r] -= y[next + r];
            out[row + size()] = is_cut(i) ? y[time(i)] - y[time(i + 1)] : place(i, &y[next]);
        }
        const int row = inner() * rows();
        if (periodic()) {
            // Equation (30): the orbit closes, but for a kick along the energy's gradient.
            using T = std::remove_cvref_t<decltype(y[0])>;
            State<T> slope(size());
            flight_.energy_slope(y, slope);
            land(inner(), before[inner()], &out[row]);
            for (int r = 0; r < size(); ++r) out[row + r] += y[unfolding()] * slope[r] - y[r];
            out[row + size()] = place(inner(), &y[0]);
        } else {
            // Equation (30): the end condition.
            for (int e = 0; e < closers(); ++e) out[row + e] = -closure_.end_offset[e];
            for (int r = 0; r < size(); ++r)
                for (int e = 0; e < closers(); ++e) out[row + e] += end_columns_(r, e) * before[inner()][r];
        }
    }

    /// F(y), and the flights.
    void evaluate(Values y, Flown& flown, Vector<double> out) const {
        const int n = size();
        each_flight(y, [&](int i, auto z, double t) {
            flight_.end(z, t, flown.before[i], Matrix<double>(flown.maps[i].data(), n, n));
        });
        equations(y, flown.before, out);
    }

    /// Fill the typical size of each unknown at an orbit y.
    Sizes sizes(Values y, const Flown& flown, Vector<double> scale) const {
        const int half = size() / 2, k = inner();
        Sizes sizes{0.0, 0.0, 0.0};
        each_flight(y, [&](int i, auto z, double t) {
            // 2h: near the grazing of a mode the velocities at all nodes are small.
            if (i == 0) sizes.velocity = std::sqrt(flight_.twice_energy(z));
            for (int r = 0; r < half; ++r) {
                sizes.displacement = largest(sizes.displacement, z[r], flown.before(i, r));
                sizes.velocity = largest(sizes.velocity, z[half + r], flown.before(i, half + r));
            }
            sizes.longest = largest(sizes.longest, t, 0.0);
        });
        // Between two origins only rounding is left of the displacements at the ends.
        if (k == 0 && closure_.start == End::ORIGIN && closure_.finish == End::ORIGIN)
            sizes.displacement = sizes.velocity * sizes.longest;
        if (sizes.displacement == 0.0) sizes.displacement = 1.0;
        if (sizes.velocity == 0.0) sizes.velocity = sizes.displacement;
        if (sizes.longest == 0.0) sizes.longest = 1.0;
        for (int i = 0; i <= k; ++i) {
            for (int j = 0; j < states(i); ++j)
                scale[begin(i) + j] =
                    (i == 0 ? moves_displacement(j) : j < half) ? sizes.displacement : sizes.velocity;
            scale[time(i)] = sizes.longest;
        }
        if (periodic()) scale[unfolding()] = 1.0;
        return sizes;
    }

    /// The largest residual, displacements and velocities each by their own scale.
    double scaled_residual(Values, const Flown& flown, Values residual, const Sizes& sizes) const {
        const int n = size(), half = n / 2, k = inner(), full = periodic() ? k + 1 : k;
        double worst = 0.0;
        auto note = [&worst](double entry, double unit) { worst = worst_of(worst, std::fabs(entry) / unit); };
        const auto unit_at = [&](int i) { return flight_.velocity_unit(flown.before[i], sizes.velocity, sizes.longest); };
        for (int i = 0; i < full; ++i) {
            const double* entries = &residual[i * rows()];
            const double velocity = unit_at(i);
            for (int r = 0; r < n; ++r) note(entries[r], r < half ? sizes.displacement : velocity);
            if (i < k && is_cut(i)) continue;  // each update fulfils equation (45), which is linear
            double square = 0.0;
            for (int r = 0; r < half; ++r) square += gap(i)[r] * gap(i)[r];
            note(entries[n],
                 square > 0.0 ? sizes.displacement * std::sqrt(square) : sizes.displacement);  // in units of length
        }
        for (int e = 0; e < int(residual.size()) - full * rows(); ++e) {
            double total = 0.0;
            for (int c = 0; c < half; ++c) total += std::fabs(closure_.end_map(e, c));
            note(residual[full * rows() + e], total > 0.0 ? sizes.displacement * total : unit_at(k));
        }
        return worst;
    }

    /// Scaled residual of a converged solution.
    double residual_level() const { return CONVERGED_RESIDUAL; }

    /// Squares of lengths that closing equations have at least: of an equation at an end, the scale of its condition.
    /// Of a mode that moves alone, it is only that mode's cosine, and a pivot relative to it would jump from -1 to 1 at
    /// zero.
    void least_lengths(const Sizes& sizes, Vector<double> out) const {
        std::fill(out.begin(), out.end(), 0.0);
        for (int r = 0; r < end_columns_.rows(); ++r)
            for (int e = 0; e < end_columns_.columns(); ++e) {
                const double entry = end_columns_(r, e) * (r < size() / 2 ? sizes.displacement : sizes.velocity);
                out[e] += entry * entry;
            }
    }

    /// The largest factor by which perturbations grow along a flight, relative to the sizes of displacements and
    /// velocities.
    double growth(const Flown& flown, const Sizes& sizes) const {
        const int n = size();
        const auto unit = [&](int r) { return r < n / 2 ? sizes.displacement : sizes.velocity; };
        double worst = 0.0;
        for (int i = 0; i <= inner(); ++i)
            for (int r = 0; r < n; ++r)
                for (int c = 0; c < n; ++c)
                    worst = worst_of(worst, std::fabs(flown.maps(i, r * n + c)) * unit(c) / unit(r));
        return worst;
    }

    /// Write the transpose of F'(y), each unknown times its scale, into an elimination.
    template <class Elimination>
    void linearise(Values y, const Flown& flown, Values scale, Elimination& out) const {
        const auto& [before, maps] = flown;
        out.clear();
        State<> along(size());
        LocalSquare<double, SIZE> landing(size());
        for (int i = 0; i <= inner(); ++i) {
            landing_blocks(i, before, maps, landing, along);
            if (i < inner()) flight_columns(i, landing, along, scale, out);
            else if (periodic()) periodic_columns(y, landing, along, scale, out);
            else end_columns(landing, along, scale, out);
        }
    }

    /// out = the state after the impact at the end of flight i, equation (4).
    template <class Z, class Out>
    void land(int i, const Z& before, Out* out) const {
        if (hits(i)) apply_impact(rate(i), push(i), jump(i), before, Vector<Out>(out, size()));
        else
            for (int r = 0; r < size(); ++r) out[r] = before[r];
    }

private:
    /// The larger one; NaN if one is.
    static double worst_of(double worst, double entry) { return entry <= worst || worst != worst ? worst : entry; }

    static double largest(double a, double b, double c) { return std::max(a, std::max(std::fabs(b), std::fabs(c))); }

    /// Whether a start parameter moves displacements.
    bool moves_displacement(int j) const {
        for (int r = 0; r < size() / 2; ++r)
            if (closure_.start_map(r, j) != 0.0) return true;
        return false;
    }

    /// How far a node's state is beyond its stop.
    template <class T>
    T place(int node, const T* z) const {
        T distance = T(-bound(node));
        for (int r = 0; r < size(); ++r) distance += gap(node)[r] * z[r];
        return distance;
    }

    /// J and F of equation (27): the node after flight i by the one before it, and by the flight time. At the far end
    /// nothing is reflected.
    template <class Landing, class Along>
    void landing_blocks(int i, const Array<>& before, const Array<>& maps, Landing& landing, Along& along) const {
        const double* map = maps[i].data();
        std::copy(map, map + size() * size(), &landing(0, 0));
        flight_.rate(before[i], along);
        if (hits(i) && (i < inner() || periodic())) {
            impact_columns(rate(i), push(i), jump(i), landing);
            apply_impact(rate(i), push(i), jump(i), along, along);
        }
    }

    /// The derivative of a landing by unknown c of flight i: a column of landing, or of landing Z for start parameters.
    /// Most entries of Z are 0.
    template <class Landing>
    void by_unknown(int i, const Landing& landing, int c, State<>& out) const {
        const bool parameter = i == 0 && !periodic();
        for (int r = 0; r < size(); ++r) out[r] = parameter ? 0.0 : landing(r, c);
        for (int q = 0; parameter && q < size(); ++q)
            if (const double z = closure_.start_map(q, c); z != 0.0)
                for (int r = 0; r < size(); ++r) out[r] += landing(r, q) * z;
    }

    template <class Landing, class Along, class Elimination>
    void flight_columns(int i, Landing& landing, Along& along, Values scale, Elimination& out) const {
        const int at = begin(i), next = begin(i + 1);
        State<> column(size());
        for (int c = 0; c < states(i); ++c) {
            double* row = out.entries(i, at + c);
            by_unknown(i, landing, c, column);
            for (int r = 0; r < size(); ++r) row[r] = column[r] * scale[at + c];
        }
        double* by_time = out.entries(i, time(i));
        for (int r = 0; r < size(); ++r) by_time[r] = along[r] * scale[time(i)];
        for (int c = 0; c < size(); ++c) {
            double* row = out.entries(i, next + c);
            row[c] = -scale[next + c];
            if (!is_cut(i)) row[size()] = gap(i)[c] * scale[next + c];
        }
        if (is_cut(i)) by_time[size()] = scale[time(i)], out.entries(i, time(i + 1))[size()] = -scale[time(i + 1)];
    }

    template <class Landing, class Along, class Elimination>
    void periodic_columns(Values y, Landing& landing, Along& along, Values scale, Elimination& out) const {
        const int k = inner(), at = begin(k);
        State<> slope(size());
        flight_.energy_slope(y, slope);
        for (int r = 0; r < size(); ++r) {
            for (int c = 0; c < size(); ++c) out.closing(at + c)[r] += landing(r, c) * scale[at + c];
            out.closing(time(k))[r] += along[r] * scale[time(k)];
            out.closing(r)[r] -= scale[r];
            out.closing(r)[size()] += gap(k)[r] * scale[r];
            out.closing(unfolding())[r] += slope[r] * scale[unfolding()];
        }
        flight_.bend(y, y[unfolding()], [&](int r, int c, double entry) { out.closing(c)[r] += entry * scale[c]; });
    }

    template <class Landing, class Along, class Elimination>
    void end_columns(Landing& landing, Along& along, Values scale, Elimination& out) const {
        const int k = inner(), at = begin(k), count = closers();
        State<> by_state(size());
        Local<double> total(count);
        for (int c = 0; c <= states(k); ++c) {
            if (c < states(k)) by_unknown(k, landing, c, by_state);
            else copy(along, by_state);
            for (double& entry : total) entry = 0.0;
            for (int r = 0; r < size(); ++r)
                if (const double entry = by_state[r]; entry != 0.0)  // a mode that moves alone has two
                    for (int e = 0; e < count; ++e) total[e] += end_columns_(r, e) * entry;
            double* row = out.closing(at + c);
            for (int e = 0; e < count; ++e) row[e] += total[e] * scale[at + c];
        }
    }

    Flight flight_;
    Contacts contacts_;
    Closure closure_;
    std::vector<int> contact_;
    Array<> end_columns_;  // the transpose of L: sums over a state then run along the closing equations
    std::vector<double> phase_;  // (N,)
};

}  // namespace saltus
