/// The multipoint problem of an orbit under periodic loads, equation (39), in released parameters.
///
/// Unknowns   y = (c_0, z_0, c_1, z_1, ..., c_k, z_k, parameters): nodes z = (u, v) after each event, and their times c,
///            fractions of the period T = 2 pi p/w
/// Equations  R flight(z_i, c_i, c_{i+1}) - z_{i+1} = 0,  g . u_{i+1} - bound = 0  for each flight but the last, then
///            R flight(z_k, c_k, c_0 + 1) - z_0 = 0,      g . u_0 - bound = 0
///            and an equation of the user for each released parameter but one
///
/// Of half a period, -z_0 and c_0 + 1/2 take the places of z_0 and c_0 + 1. At a release the contact force, equation
/// (43), takes the place of the gap. Without impacts c_0 = 0 takes the place of the last gap, and flights of equal time
/// that of the others. A node that begins a chatter, equation (44), is that before its first impact: the chatter is a part of
/// the flight that follows. Without harmonic loads there is no clock: the flight times t_i are unknowns in place of c_i.
///
/// Free orbits, equation (41), have no loads and no clock. The user's equations can name their energy H and quarter
/// period, and there are as many as released parameters. A closed one has the unknown xi before the parameters, and
///     R flight(z_k, t_k) + xi grad H(z_0) - z_0 = 0
/// and one between two ends has n conditions of each in place of the closure.
#pragma once

#include <functional>
#include <memory>

#include "contact.hpp"
#include "contact_mode.hpp"
#include "elimination.hpp"
#include "loaded_flight.hpp"
#include "modes.hpp"
#include "problem.hpp"
#include "program.hpp"
#include "smooth_loaded_flight.hpp"
#include "summed_chatter.hpp"

namespace saltus {

/// What of a system depends on parameters: entries of the vector that `bvp.entries` describes, from the bounds on; where
/// masses, dampers or springs vary, all of them.
struct Parameters {
    /// An entry or a released parameter, and its domain.
    struct Domain {
        int place;
        double low, high;
    };
    Formulas program;              // the entries of `rows`
    std::vector<int> rows;
    std::vector<double> values;    // of all parameters
    std::vector<int> released;     // those among them that are unknowns
    std::vector<double> entries;   // at these values
    int constant, cosine, sine, frequency;  // where the loads begin
    Formulas kept;                 // left less right sides of the user's equations
    /// Where masses, dampers or springs vary: the contact modes at values of all parameters, and all entries there. None
    /// where the system cannot have them.
    std::function<std::vector<LoadedFlight<>>(Values parameters, Values entries)> modes;
    bool varies = false;           // whether they do
    bool undamped = false;         // whether there are no dampers, and no stop sticks: the modes then need no function
    /// Entries that are no numbers beyond their domains, where the released parameters are in theirs.
    std::vector<Domain> unseen, located;
};

/// The events of an orbit, in order of time from the second one on: node i is that at the end of flight i.
struct ForcedEvents {
    std::vector<int> mode;         // (k + 1,) contact mode of each flight
    std::vector<int> release;      // (k + 1,) force row that vanishes at a node; -1: no release
    // Of the nodes, and between two ends of the start behind them:
    std::vector<int> bound, restitution;  // (k + 1,) entries of a node's stop; -1: none, and no rebound
    std::vector<double> side;      // (k + 1,) +1 upper, -1 lower, 0 no impact
    Array<> gap, rate, push;       // (k + 1, N)
    /// Contact forces of unit states and of unit loads, equation (43), one in each row.
    Array<> pull, reach;           // (F, N), (F, n)
    Array<> closed;                // (F, n) the gaps of these stops
    std::vector<double> unit;      // (F,) of the forces, with the side of the stop as its sign
    std::vector<int> force_mode;   // (F,) the contact mode in which each acts, in ascending order
    std::vector<int> summed;       // (k + 1,) 1: the impact of a node begins a chatter
    std::vector<int> kept;         // of each of them, the contact mode in which the impulse of a node acts
    int nodes() const { return int(mode.size()); }
};

/// How the orbit closes.
struct ForcedClosure {
    double sign;          // what the state is multiplied by over the segment: -1 of half a period
    double part;          // of the period that it lasts; 0: there is no clock
    double load_periods;  // periods of the base frequency in one of the orbit
    // Of free orbits:
    bool is_free = false, unfolds = false;            // whether it is one, and whether it has xi
    int quarters = 4;                                 // quarter periods that the flights last
    End start = End::PERIODIC, finish = End::PERIODIC;
    Array<> ends;                                     // (N, N) rows of the conditions at the start, then at the far end; else (0, N)
};

/// Orbits in P released parameters, which may be DYNAMIC. Flight: `LoadedFlight`, or `SmoothLoadedFlight`.
template <class Flight, int P = DYNAMIC>
class ForcedProblem {
public:
    static constexpr int N = Flight::SIZE, SIZE = N;
    static constexpr int ROWS = N == DYNAMIC || P == DYNAMIC ? DYNAMIC : N + 1 + P;
    static constexpr bool SMOOTH = Flight::is_series();
    using FlightType = Flight;
    using First = Jet<double, 1>;
    using Bundle = Jet<double, 8>;
    template <class T = double>
    using State = Local<T, N>;

    using Flights = std::shared_ptr<const std::vector<Flight>>;

    /// What is known of a system at values of the released parameters.
    template <class T>
    struct Setting {
        std::vector<T> parameters, entries;
        T cycle;                        // T
        Array<T> forces;                // (2 H, n) by cos and by sin
        std::vector<typename Flight::template DriveOf<T>> drives;  // of each contact mode
        Flights flights;                // of each contact mode
        std::vector<ContactMode<T>> modes;  // where masses, dampers or springs vary, and with smooth forces; then also
        Array<T> push, pull, reach;         // (k + 1, N), (F, N), (F, n)
    };

    /// The time of a node comes first: then reflections of the elimination are short.
    ///
    /// units (N + 1 + P,): a unit of arclength for each entry of a state, for the time, and for each parameter; 0: a
    /// unit of its logarithm.
    ForcedProblem(std::vector<Flight> modes, Parameters parameters, ForcedEvents events, ForcedClosure closure,
                  std::vector<double> units)
        : modes_(std::make_shared<const std::vector<Flight>>(std::move(modes))), parameters_(std::move(parameters)),
          events_(std::move(events)), closure_(closure), units_(std::move(units)) {}

    constexpr int size() const {
        if constexpr (N != DYNAMIC) return N;
        return (*modes_)[0].size();
    }
    constexpr int released() const {
        if constexpr (P != DYNAMIC) return P;
        return int(parameters_.released.size());
    }
    constexpr int rows() const { return size() + 1; }
    int inner() const { return events_.nodes() - 1; }
    int kept() const { return int(parameters_.kept.outputs.size()); }
    /// Closing equations but the user's.
    int closures() const { return has_ends() ? size() : rows(); }
    int closers() const { return closures() + kept(); }
    int unknowns() const { return parameter(0) + released(); }
    int harmonics() const { return (*modes_)[0].harmonics(); }
    bool has_clock() const { return closure_.part > 0.0; }
    bool is_free() const { return closure_.is_free; }
    bool has_ends() const { return closure_.ends.rows() > 0; }
    const ForcedClosure& closure() const { return closure_; }
    const ForcedEvents& events() const { return events_; }
    /// Whether masses, dampers or springs vary.
    bool varies() const { return parameters_.varies; }
    /// Whether contact modes vary with them.
    bool moves() const { return parameters_.undamped || parameters_.modes; }
    template <class T>
    const Flight& flight(int i, const Setting<T>& at) const {
        return (*at.flights)[events_.mode[i]];
    }
    template <class T>
    const Flight& mode(int f, const Setting<T>& at) const {
        return (*at.flights)[f];
    }
    int modes() const { return int(modes_->size()); }
    Values push(int i, const Setting<double>& at) const { return varies() ? at.push[i] : events_.push[i]; }
    Values pull(int row, const Setting<double>& at) const { return varies() ? at.pull[row] : events_.pull[row]; }
    Values reach(int row, const Setting<double>& at) const { return varies() ? at.reach[row] : events_.reach[row]; }
    int frequency() const { return parameters_.frequency; }
    Values units() const { return units_; }
    /// Coordinates of arclength.
    int coordinates() const { return rows() + released() + 1; }

    int time(int i) const { return i * rows(); }
    int begin(int i) const { return i * rows() + 1; }
    int unfolding() const { return (inner() + 1) * rows(); }
    int parameter(int j) const { return unfolding() + closure_.unfolds + j; }
    int before(int i) const { return i > 0 ? i - 1 : inner(); }
    bool hits(int i) const { return events_.side[i] != 0.0; }
    /// How many multipliers are exactly zero: a stop that sticks takes two directions, an impact that leaves no speed and opens
    /// at once takes one; as many as at the narrowest place of the orbit.
    int vanishing(const Setting<double>& at) const {
        const auto held = [&](int f) { return 2 * int(std::count(events_.force_mode.begin(), events_.force_mode.end(), f)); };
        int most = 0;
        for (int i = 0; i <= inner(); ++i) {
            most = std::max(most, held(events_.mode[i]));
            if (hits(i) && !is_summed(i) && rebound(i, at) == 1.0) most = std::max(most, held(events_.kept[i]) + 1);
        }
        return most;
    }
    /// Whether the impact at the end of flight i begins a chatter.
    bool is_summed(int i) const { return i <= inner() && events_.summed[i] == 1; }
    /// Whether nothing is asked of the state of node i.
    bool is_cut(int i) const { return events_.bound[i] < 0 && events_.release[i] < 0; }
    /// Whether impact i has a rebound that is known by an entry.
    bool rebounds(int i) const { return hits(i) && events_.restitution[i] >= 0; }

    BlockElimination<ROWS> elimination() const { return {inner(), rows(), rows(), closers(), true, released()}; }

    /// Fill what is known at values p (P,) of the released parameters. known: the flights there.
    template <class T>
    void set(Vector<const T> p, Setting<T>& out, const Flights& known = nullptr) const {
        const auto& entries = parameters_.entries;
        out.parameters.assign(parameters_.values.begin(), parameters_.values.end());
        for (int j = 0; j < released(); ++j) out.parameters[parameters_.released[j]] = p[j];
        out.entries.assign(entries.begin(), entries.end());
        parameters_.program.evaluate<T>(out.parameters,
                                [&](int k, const T& entry) { out.entries[parameters_.rows[k]] = entry; });
        hide_unseen(p, out);
        const T& base = out.entries[parameters_.frequency];
        if (has_clock()) out.cycle = 2.0 * PI * closure_.load_periods / base;
        else out.cycle = T(1.0);
        const int n = size() / 2;
        if (out.drives.empty()) out.forces = Array<T>(2 * harmonics(), n), out.drives.resize(modes_->size());
        const bool constant = harmonics() > 0 && (*modes_)[0].harmonic(0) == 0.0;
        for (int h = 0; h < harmonics(); ++h)
            for (int part = 0; part < 2; ++part) {
                const bool steady = constant && h == 0;
                const int first = steady ? parameters_.constant
                                         : (part == 0 ? parameters_.cosine : parameters_.sine) + (h - constant) * n;
                for (int c = 0; c < n; ++c) out.forces(2 * h + part, c) = steady && part == 1 ? T(0.0) : out.entries[first + c];
            }
        out.flights = modes_;
        if constexpr (!SMOOTH)
            if (moves()) out.flights = known ? known : flights_at(out);
        if (varies() || SMOOTH) vary(out);
        for (int f = 0; f < modes(); ++f) {
            const Flight& flight = (*out.flights)[f];
            const Matrix<const T> forces(out.forces);
            const Vector<const T> entries(out.entries);
            if constexpr (SMOOTH) {
                flight.set(base, forces, entries, out.modes[f].inverse, p, out.drives[f]);
            } else if (moves() && JET_DEPTH<T> > 0) {
                auto& mode = out.modes[f];
                mode.set_change(flight, entries);
                flight.set(base, forces, Matrix<const T>(mode.drive), Matrix<const T>(mode.change), out.drives[f]);
            } else {
                flight.set(base, forces, out.drives[f]);
            }
        }
    }

    /// The oscillators (2 H,) at a time c of the clock.
    template <class T, class Out>
    void oscillators(const T& c, Out&& out) const {
        for (int h = 0; h < harmonics(); ++h) {
            T sine(0.0), cosine(1.0);
            if ((*modes_)[0].harmonic(h) != 0.0) sincos(turn_rate(h) * c, sine, cosine);
            out[2 * h] = cosine, out[2 * h + 1] = sine;
        }
    }

    /// The clock at node i; k + 1: at the end. That can be one more unknown, behind all others: then the orbit is open.
    template <class Y>
    auto clock(const Y& y, int i) const {
        using T = std::remove_cvref_t<decltype(y[0])>;
        if (!has_clock()) return T(0.0);
        if (i <= inner()) return T(y[time(i)]);
        return int(y.size()) > unknowns() ? T(y[unknowns()]) : T(y[time(0)] + closure_.part);
    }
    /// The duration of flight i.
    template <class Y, class T>
    T duration(const Y& y, int i, const T& cycle) const {
        if (!has_clock()) return y[time(i)];
        return (clock(y, i + 1) - clock(y, i)) * cycle;
    }
    /// The period T at y.
    double cycle(Values y) const {
        Local<double, DYNAMIC, 64> values(int(parameters_.values.size()));
        copy(parameters_.values, values);
        for (int j = 0; j < released(); ++j) values[parameters_.released[j]] = y[parameter(j)];
        double base = parameters_.entries[parameters_.frequency];
        parameters_.program.evaluate<double>(values, [&](int k, double entry) {
            if (parameters_.rows[k] == parameters_.frequency) base = entry;
        });
        return 2.0 * PI * closure_.load_periods / base;
    }
    /// Sum of the flight times in the unknowns y, or in a change of them, where there is no clock.
    template <class Y>
    auto total_time(const Y& y) const {
        auto total = y[time(0)];
        for (int i = 1; i <= inner(); ++i) total += y[time(i)];
        return total;
    }

    /// The first entry of the state that xi changes: with smooth forces a kick along the momentum alone, for the same reason.
    int first_kicked() const { return SMOOTH ? size() / 2 : 0; }

    /// Entry r of grad H of a free orbit at its state z, without smooth forces. M and K are the first and third of the
    /// entries.
    template <class T, class Z>
    auto energy_slope(const std::vector<T>& entries, const Z& z, int r) const {
        const int n = size() / 2, first = r < n ? 2 * n * n + r * n : (r - n) * n, from = r < n ? 0 : n;
        auto total = entries[first] * z[from];
        for (int c = 1; c < n; ++c) total += entries[first + c] * z[from + c];
        return total;
    }
    template <class T, class Z>
    auto energy(const Setting<T>& at, const Z& z) const {
        auto total = 0.5 * energy_slope(at.entries, z, 0) * z[0];
        for (int r = 1; r < size(); ++r) total += 0.5 * energy_slope(at.entries, z, r) * z[r];
        if constexpr (SMOOTH) {
            using Number = decltype(total);
            std::vector<Number> p;
            for (int j : parameters_.released) p.push_back(Number(at.parameters[j]));
            total += (*modes_)[0].template potential<Number>(z, Vector<const Number>(p));
        }
        return total;
    }
    /// Entry r of grad H.
    double energy_rate(const Setting<double>& at, Values z, int r) const {
        if constexpr (SMOOTH) {
            std::vector<First> moved(z.begin(), z.end());
            moved[r].slopes[0] = 1.0;
            return energy(at, moved).slopes[0];
        } else {
            return energy_slope(at.entries, z, r);
        }
    }

    /// F(y), (u - 1,), in any number type.
    template <class Y, class Out>
    void residual(const Y& y, Out&& out) const {
        using T = std::remove_cvref_t<decltype(y[0])>;
        Setting<T> at;
        set(Vector<const T>(&y[parameter(0)], released()), at);
        for (int i = 0; i <= inner(); ++i) flight_equations(i, y, at, &out[i * rows()]);
        each_kept(at, y, [&](int e, const T& entry) { out[inner() * rows() + closures() + e] = entry; });
    }

    /// Those of flight i in any number type, at what is known of the parameters of y.
    template <class Y, class T, class Out>
    void flight_equations(int i, const Y& y, const Setting<T>& at, Out* out) const {
        std::vector<T> z, before(size()), begin_turns(2 * harmonics()), turns(2 * harmonics());
        T c;
        depart(i, at, y, z, c);
        oscillators(c, begin_turns);
        oscillators(clock(y, i + 1), turns);
        flight(i, at).end(at.drives[events_.mode[i]], Vector<const T>(z), remaining(i, at, y, c), Vector<T>(begin_turns),
                          Vector<T>(turns), Vector<T>(before));
        equations(i, y, at, Vector<const T>(before), Vector<T>(turns), out);
    }

    /// z, c: the state and the time at the begin of flight i of an orbit, behind a chatter.
    template <class Y, class T>
    void depart(int i, const Setting<T>& at, const Y& y, std::vector<T>& z, T& c) const {
        z.assign(&y[begin(i)], &y[begin(i)] + size());
        c = clock(y, i);
        if (is_summed(before(i))) sum_chatter(i, at, z, c);
    }

    /// How long flight i lasts that begins at the time c.
    template <class Y, class T>
    T remaining(int i, const Setting<T>& at, const Y& y, const T& c) const {
        return has_clock() ? T((clock(y, i + 1) - c) * at.cycle) : T(y[time(i)]);
    }

    /// z, c become the state and the time a time t later, as in flight i. turns (2 H,): the oscillators then.
    template <class T>
    void fly(int i, const Setting<T>& at, const T& t, std::vector<T>& z, T& c, std::vector<T>& turns) const {
        std::vector<T> from(2 * harmonics()), place(size());
        oscillators(c, from);
        if (has_clock()) c += t / at.cycle;
        turns.resize(2 * harmonics());
        oscillators(c, turns);
        flight(i, at).end(at.drives[events_.mode[i]], Vector<const T>(z), t, Vector<T>(from), Vector<T>(turns), Vector<T>(place));
        z = std::move(place);
    }

    /// The equations of flight i from the state `before` its event, and the oscillators there.
    template <class Y, class T, class Z, class O, class Out>
    void equations(int i, const Y& y, const Setting<T>& at, const Z& before, const O& turns, Out* out) const {
        // Equation (39): the flight lands on the next node, which lies on its stop, or opens it.
        const int next = begin(i < inner() ? i + 1 : 0);
        if (i == inner() && has_ends()) return end_equations(y, at, before, out);
        const double sign = i < inner() ? 1.0 : closure_.sign;
        land(i, at, before, out);
        for (int r = 0; r < size(); ++r) out[r] -= sign * y[next + r];
        if (is_cut(i)) out[size()] = cut(y, i);
        else out[size()] = place(i, at, Vector<const T>(&y[next], size()), sign, turns);
        // Equation (41).
        if (i == inner() && closure_.unfolds)
            for (int r = first_kicked(); r < size(); ++r) out[r] += y[unfolding()] * energy_slope(at.entries, &y[next], r);
    }

    /// Call take(e, left less right side) for the user's equations.
    template <class T, class Y, class Take>
    void each_kept(const Setting<T>& at, const Y& y, Take&& take) const {
        if (!is_free()) return parameters_.kept.evaluate<T>(at.parameters, take);
        std::vector<T> known(at.parameters);
        known.push_back(T(energy(at, &y[begin(0)])));
        known.push_back(T(total_time(y) / double(closure_.quarters)));
        parameters_.kept.evaluate<T>(known, take);
    }

    /// The conditions of both ends, equation (41), at a stop of the state after an impact without rebound. before: the state
    /// after the last flight.
    template <class Y, class T, class Z, class Out>
    void end_equations(const Y& y, const Setting<T>& at, const Z& before, Out* out) const {
        const int n = size() / 2;
        State<T> z(size());
        for (int end = 0; end < 2; ++end) {
            const int node = inner() + 1 - end;
            if (end == 0) land(node, at, Vector<const T>(&y[begin(0)], size()), &z[0]);
            else land(node, at, before, &z[0]);
            for (int e = 0; e < n; ++e) {
                const bool stop = is_stop(end, e);
                out[end * n + e] = dot(stop ? events_.gap[node] : closure_.ends[end * n + e], Vector<const T>(z));
                if (stop) out[end * n + e] -= at.entries[events_.bound[node]];
            }
        }
    }

    /// out = the state after event i, equation (4).
    template <class T, class Z, class Out>
    void land(int i, const Setting<T>& at, const Z& before, Out* out) const {
        const Vector<Out> to(out, size());
        if (!hits(i) || is_summed(i)) return copy(before, to);
        if (varies()) apply_impact(events_.rate[i], at.push[i], rebound(i, at), before, to);
        else apply_impact(events_.rate[i], events_.push[i], rebound(i, at), before, to);
    }

    /// 1 + restitution of the impact at node i.
    template <class T>
    T rebound(int i, const Setting<T>& at) const {
        const int entry = events_.restitution[i];
        return entry >= 0 ? 1.0 + at.entries[entry] : T(1.0);
    }

    /// The contact force of a row at a state, equation (43).
    template <class T, class Z, class O>
    T force(int row, const Setting<T>& at, const Z& z, const O& turns) const {
        const auto sum = [&](const auto& pull, const auto& reach) {
            T total(0.0);
            for (int r = 0; r < size(); ++r) total -= pull[r] * z[r];
            for (int q = 0; q < 2 * harmonics(); ++q) total += dot(reach, at.forces[q]) * turns[q];
            return total;
        };
        return varies() ? sum(at.pull[row], at.reach[row]) : sum(events_.pull[row], events_.reach[row]);
    }

    /// Flights of an orbit, and what belongs to them.
    struct Flown {
        explicit Flown(const ForcedProblem& problem)
            : before(problem.inner() + 1, problem.size()),
              maps(problem.inner() + 1, problem.size() * problem.size()),
              columns(problem.inner() + 1, (2 + problem.released()) * problem.size()),
              turns(problem.inner() + 2, 2 * problem.harmonics()), starts(problem.inner() + 1, problem.size()),
              begins(problem.inner() + 1, 2 * problem.harmonics()), landed(2 + problem.released(), problem.size()),
              durations(problem.inner() + 1), lasted(problem.inner() + 1), errors(problem.inner() + 1),
              slopes(problem.released()) {}
        Array<> before, maps, columns, turns;  // see `LoadedFlight::end`
        Array<> starts, begins;                // behind a chatter: states and oscillators
        Array<> landed;                        // columns behind an event
        std::vector<double> durations, lasted, errors;  // of flights; of the chatter before each, as a part of the period; of its end
        Setting<double> at;
        std::vector<Setting<First>> slopes;    // along each parameter
        Setting<Bundle> bundle;                // along several unknowns of a chatter
        std::vector<typename FlightType::Slope> along;
    };

    /// F(y), and the flights.
    void evaluate(Values y, Flown& flown, Vector<double> out) const {
        const Values p = y.subspan(parameter(0), released());
        set(p, flown.at);
        Local<First, P> moved(released());
        for (int j = 0; j < released(); ++j) {
            for (int q = 0; q < released(); ++q) moved[q] = First(p[q]);
            moved[j].slopes[0] = 1.0;
            set(Vector<const First>(moved), flown.slopes[j], flown.at.flights);
        }
        for (int i = 0; i <= inner() + 1; ++i) oscillators(clock(y, i), flown.turns[i]);
        for (int i = 0; i <= inner(); ++i) {
            flown.along.clear();
            const int mode = events_.mode[i];
            double begun = clock(y, i);
            copy(y.subspan(begin(i), size()), flown.starts[i]);
            copy(flown.turns[i], flown.begins[i]);
            const bool chatters = is_summed(before(i));
            Array<> lead;
            if (chatters) begun = sum_chatter(i, y, flown, lead);
            const double lasting = clock(y, i + 1) - begun;
            flown.durations[i] = has_clock() ? lasting * flown.at.cycle : y[time(i)];
            for (const auto& slope : flown.slopes) flown.along.push_back({&slope.drives[mode], lasting * slope.cycle.slopes[0]});
            flight(i, flown.at).end(flown.at.drives[mode], flown.along, flown.starts[i], flown.durations[i], flown.begins[i], flown.turns[i + 1],
                          flown.before[i], Matrix<double>(flown.maps[i].data(), size(), size()),
                          Matrix<double>(flown.columns[i].data(), 2 + released(), size()));
            if (chatters) compose(i, lead, flown);
        }
        for (int i = 0; i <= inner(); ++i)
            equations(i, y, flown.at, Values(flown.before[i]), Values(flown.turns[i + 1]), &out[i * rows()]);
        each_kept(flown.at, y, [&](int e, double entry) { out[inner() * rows() + closures() + e] = entry; });
    }

    /// Fill the typical size of each unknown at an orbit y.
    ///
    /// All impacts can be at one place, at rest there, as where the only one grazes at the origin. There the
    /// acceleration gives the size.
    Sizes sizes(Values y, const Flown& flown, Vector<double> scale) const {
        const int half = size() / 2;
        Sizes found = motion_size(y, flown);
        for (int i = 0; i <= inner(); ++i) {
            for (int r = 0; r < size(); ++r) scale[begin(i) + r] = r < half ? found.displacement : found.velocity;
            scale[time(i)] = has_clock() ? 1.0 : found.longest;
        }
        for (int j = 0; j < released(); ++j) scale[parameter(j)] = hypot(units_[rows() + j], y[parameter(j)]);
        if (closure_.unfolds) {
            double kick = 0.0;
            for (int r = first_kicked(); r < size(); ++r)
                kick = std::max(kick, std::fabs(energy_slope(flown.at.entries, &y[begin(0)], r)) / scale[begin(0) + r]);
            scale[unfolding()] = kick > 0.0 ? 1.0 / kick : 1.0;
        }
        return found;
    }

    Sizes motion_size(Values y, const Flown& flown) const {
        const int half = size() / 2;
        Sizes found{0.0, 0.0, 0.0};
        double bend = 0.0;
        for (int i = 0; i <= inner(); ++i) {
            for (int r = 0; r < half; ++r) {
                found.displacement = larger(found.displacement, y[begin(i) + r], flown.before(i, r));
                found.velocity = larger(found.velocity, y[begin(i) + half + r], flown.before(i, half + r));
                if (hits(i)) bend = larger(bend, flown.columns(i, size() + half + r), 0.0);
            }
            found.longest = larger(found.longest, flown.durations[i], 0.0);
        }
        const double fastest = units_[half] / units_[0];
        found.velocity = std::max(found.velocity, bend / fastest);
        double w = flown.at.entries[parameters_.frequency];
        if (w == 0.0) w = found.longest > 0.0 ? 1.0 / found.longest : fastest;
        found.displacement = std::max(found.displacement, found.velocity / w);
        found.velocity = std::max(found.velocity, found.displacement * w);
        if (found.displacement == 0.0) found.displacement = units_[0], found.velocity = units_[half];
        if (found.longest == 0.0) found.longest = 1.0 / w;
        return found;
    }

    /// The largest residual, displacements and velocities each by their own scale.
    double scaled_residual(Values y, const Flown& flown, Values residual, const Sizes& sizes) const {
        double worst = 0.0;
        const int closing = inner() * rows(), user = closing + closures();
        std::vector<double> terms(kept(), 1.0);  // at most, beside 1
        if (is_free())
            each_known_slope(flown.at, y, [&](int e, const Known& entry, double energy, double quarter) {
                terms[e] = larger(1.0, entry.slopes[0] * energy, entry.slopes[1] * quarter);
            });
        for (int row = 0; row < int(residual.size()); ++row) {
            const int r = row % rows();
            double unit = 1.0;
            if (row >= user) unit = terms[row - user];
            else if (row >= closing && has_ends()) unit = has_displacement(row - closing) ? sizes.displacement : velocity_unit(inner(), flown, sizes);
            else if (r < size() / 2 || (r == size() && !is_cut(row / rows()))) unit = sizes.displacement;
            else if (r < size()) unit = velocity_unit(row / rows(), flown, sizes);
            const double entry = std::fabs(residual[row]) / unit;
            if (!(entry <= worst)) worst = entry;
        }
        return worst;
    }

    /// The unit of residuals of velocities at the end of flight i: see `SmoothFlight`.
    double velocity_unit(int i, const Flown& flown, const Sizes& sizes) const {
        double unit = sizes.velocity;
        for (int r = size() / 2; SMOOTH && r < size(); ++r)
            unit = std::max(unit, std::fabs(flown.columns(i, size() + r)) * sizes.longest);
        return unit;
    }

    /// Scaled residual of a converged solution: each state is a sum over the modes, whose rounding adds up.
    double residual_level() const { return CONVERGED_RESIDUAL * size(); }

    /// Squares of lengths that closing equations have at least: none.
    void least_lengths(const Sizes&, Vector<double> out) const { std::fill(out.begin(), out.end(), 0.0); }

    /// Write the transpose of F'(y), each unknown times its scale, into an elimination.
    template <class Elimination>
    void linearise(Values y, Flown& flown, Values scale, Elimination& out) const {
        out.clear();
        LocalSquare<double, N> landing(size());
        Array<>& columns = flown.landed;
        for (int i = 0; i <= inner(); ++i) {
            std::copy_n(flown.maps[i].data(), size() * size(), &landing(0, 0));
            std::copy_n(flown.columns[i].data(), columns.rows() * size(), columns.data());
            landing_blocks(i, flown, landing, columns);
            if (i < inner()) flight_columns(i, y, flown, landing, columns, scale, out);
            else if (has_ends()) end_columns(y, flown, landing, columns, scale, out);
            else closing_columns(y, flown, landing, columns, scale, out);
        }
        kept_columns(y, flown, scale, out);
    }

private:
    static constexpr double PI = 3.14159265358979323846;
    static double larger(double a, double b, double c) { return std::max(a, std::max(std::fabs(b), std::fabs(c))); }

    /// Entries beyond their domains become no numbers.
    template <class T>
    void hide_unseen(Vector<const T> p, Setting<T>& out) const {
        if (parameters_.unseen.empty()) return;
        for (const auto& domain : parameters_.located)
            if (const double x = value(p[domain.place]); !(domain.low <= x && x <= domain.high)) return;
        for (const auto& domain : parameters_.unseen)
            if (const double x = value(out.entries[domain.place]); !(domain.low <= x && x <= domain.high))
                out.entries[domain.place] = T(NOT_A_NUMBER);
    }

    /// The angle of oscillator h in a period of the orbit.
    double turn_rate(int h) const { return 2.0 * PI * closure_.load_periods * (*modes_)[0].harmonic(h); }

    /// The equation of a node where nothing is hit: equation (45), and at the last one that of the first time.
    template <class Y>
    auto cut(const Y& y, int i) const {
        using T = std::remove_cvref_t<decltype(y[0])>;
        if (i == inner()) return T(y[time(0)]);
        return T(y[time(i + 1)] - y[time(i)] - closure_.part / (inner() + 1));
    }

    /// How far a node's state, times a sign, is beyond its stop; or the contact force where it opens.
    template <class T, class O>
    T place(int i, const Setting<T>& at, Vector<const T> z, double sign, const O& turns) const {
        if (events_.release[i] >= 0) return force(events_.release[i], at, z, turns);
        T distance = -at.entries[events_.bound[i]];
        for (int r = 0; r < size() / 2; ++r) distance += (sign * events_.gap(i, r)) * z[r];
        return distance;
    }

    /// Derivatives of the node after event i, from those of the state before it.
    template <class Landing>
    void landing_blocks(int i, const Flown& flown, Landing& landing, Array<>& columns) const {
        if (!hits(i) || is_summed(i)) return;
        const Values rate = events_.rate[i], push = this->push(i, flown.at);
        const double by = rebound(i, flown.at), speed = dot(rate, flown.before[i]);
        impact_columns(rate, push, by, landing);
        for (int c = 0; c < columns.rows(); ++c) apply_impact(rate, push, by, Values(columns[c]), columns[c]);
        for (int j = 0; j < released(); ++j) {
            const auto& slope = flown.slopes[j];
            const double change = rebounds(i) ? slope.entries[events_.restitution[i]].slopes[0] * speed : 0.0;
            for (int r = 0; r < size(); ++r) columns(2 + j, r) -= change * push[r];
            for (int r = 0; varies() && r < size(); ++r) columns(2 + j, r) -= by * speed * slope.push(i, r).slopes[0];
        }
    }

    template <class Landing, class Elimination>
    void flight_columns(int i, Values y, const Flown& flown, Landing& landing, const Array<>& columns, Values scale,
                        Elimination& out) const {
        const int at = begin(i), next = begin(i + 1);
        const double cycle = flown.at.cycle;
        for (int c = 0; c < size(); ++c) {
            double* row = out.entries(i, at + c);
            for (int r = 0; r < size(); ++r) row[r] = landing(r, c) * scale[at + c];
            row = out.entries(i, next + c);
            row[c] = -scale[next + c];
        }
        double* by_time = out.entries(i, time(i));
        for (int r = 0; r < size(); ++r) by_time[r] = columns(has_clock() ? 0 : 1, r) * (cycle * scale[time(i)]);
        if (has_clock()) {
            by_time = out.entries(i, time(i + 1));
            for (int r = 0; r < size(); ++r) by_time[r] = columns(1, r) * (cycle * scale[time(i + 1)]);
        }
        for (int j = 0; j < released(); ++j) {
            double* row = out.shared_entries(i, j);
            for (int r = 0; r < size(); ++r) row[r] = columns(2 + j, r) * (scale[parameter(j)] * out.spread());
        }
        if (is_cut(i)) {
            out.entries(i, time(i))[size()] = -scale[time(i)];
            out.entries(i, time(i + 1))[size()] = scale[time(i + 1)];
            return;
        }
        place_columns(
            i, y, flown, 1.0, [&](int at, double entry) { out.entries(i, at)[size()] = entry * scale[at]; },
            [&](int j, double entry) {
                out.shared_entries(i, j)[size()] = entry * (scale[parameter(j)] * out.spread());
            });
    }

    template <class Landing, class Elimination>
    void closing_columns(Values y, const Flown& flown, Landing& landing, const Array<>& columns, Values scale,
                         Elimination& out) const {
        const int k = inner(), at = begin(k);
        const double cycle = flown.at.cycle;
        for (int c = 0; c < size(); ++c) {
            double* row = out.closing(at + c);
            for (int r = 0; r < size(); ++r) row[r] += landing(r, c) * scale[at + c];
            out.closing(begin(0) + c)[c] -= closure_.sign * scale[begin(0) + c];
        }
        double* by_time = out.closing(time(k));
        for (int r = 0; r < size(); ++r) by_time[r] += columns(has_clock() ? 0 : 1, r) * (cycle * scale[time(k)]);
        if (has_clock()) {
            by_time = out.closing(time(0));
            for (int r = 0; r < size(); ++r) by_time[r] += columns(1, r) * (cycle * scale[time(0)]);
        }
        for (int j = 0; j < released(); ++j) {
            double* row = out.shared_closing(j);
            for (int r = 0; r < size(); ++r) row[r] += columns(2 + j, r) * (scale[parameter(j)] * out.spread());
        }
        if (is_cut(k)) out.closing(time(0))[size()] += scale[time(0)];
        else
            place_columns(
                k, y, flown, closure_.sign, [&](int at, double entry) { out.closing(at)[size()] += entry * scale[at]; },
                [&](int j, double entry) {
                    out.shared_closing(j)[size()] += entry * (scale[parameter(j)] * out.spread());
                });
        if (!closure_.unfolds) return;
        const Values z = y.subspan(begin(0), size());
        const double xi = y[unfolding()];
        const int n = size() / 2;
        for (int r = first_kicked(); r < size(); ++r) {
            out.closing(unfolding())[r] += energy_slope(flown.at.entries, z, r) * scale[unfolding()];
            const int first = r < n ? 2 * n * n + r * n : (r - n) * n, from = begin(0) + (r < n ? 0 : n);
            for (int c = 0; c < n; ++c) out.closing(from + c)[r] += xi * flown.at.entries[first + c] * scale[from + c];
            for (int j = 0; j < released(); ++j)
                out.shared_closing(j)[r] +=
                    xi * energy_slope(flown.slopes[j].entries, z, r).slopes[0] * (scale[parameter(j)] * out.spread());
        }
    }

    /// Whether condition e of an end is that of its stop.
    bool is_stop(int end, int e) const { return e == 0 && (end == 0 ? closure_.start : closure_.finish) == End::STOP; }
    /// Whether a row of the ends is on displacements.
    bool has_displacement(int row) const {
        for (int c = 0; c < size() / 2; ++c)
            if (closure_.ends(row, c) != 0.0) return true;
        return false;
    }

    /// Derivatives of `end_equations`. landing, columns: of the state after the last flight, and an impact without rebound.
    template <class Landing, class Elimination>
    void end_columns(Values y, const Flown& flown, Landing& landing, const Array<>& columns, Values scale,
                     Elimination& out) const {
        const int k = inner(), n = size() / 2, start = k + 1;
        const Values z = y.subspan(begin(0), size()), rate = events_.rate[start], push = this->push(start, flown.at);
        for (int e = 0; e < n; ++e) {
            const bool stop = is_stop(1, e), from_stop = is_stop(0, e);
            const Values far = stop ? events_.gap[k] : closure_.ends[n + e], near = from_stop ? events_.gap[start] : closure_.ends[e];
            const double kick = hits(start) ? dot(near, push) : 0.0;
            for (int c = 0; c < size(); ++c) {
                double total = 0.0;
                for (int r = 0; r < size(); ++r) total += far[r] * landing(r, c);
                out.closing(begin(k) + c)[n + e] += total * scale[begin(k) + c];
                out.closing(begin(0) + c)[e] += (near[c] - kick * rate[c]) * scale[begin(0) + c];
            }
            out.closing(time(k))[n + e] += dot(far, columns[1]) * scale[time(k)];
            for (int j = 0; j < released(); ++j) {
                const auto bound = [&](int node) { return flown.slopes[j].entries[events_.bound[node]].slopes[0]; };
                double late = dot(far, columns[2 + j]) - (stop ? bound(k) : 0.0), early = from_stop ? -bound(start) : 0.0;
                for (int r = 0; varies() && hits(start) && r < size(); ++r)
                    early -= near[r] * flown.slopes[j].push(start, r).slopes[0] * dot(rate, z);
                out.shared_closing(j)[n + e] += late * (scale[parameter(j)] * out.spread());
                out.shared_closing(j)[e] += early * (scale[parameter(j)] * out.spread());
            }
        }
    }

    using Known = Jet<double, 2>;
    /// Call take(e, an equation of the user with its derivatives by energy and quarter period, and these).
    template <class Take>
    void each_known_slope(const Setting<double>& at, Values y, Take&& take) const {
        const double h = energy(at, &y[begin(0)]), quarter = total_time(y) / closure_.quarters;
        std::vector<Known> known(at.parameters.begin(), at.parameters.end());
        known.push_back(Known::variable(h, 0));
        known.push_back(Known::variable(quarter, 1));
        parameters_.kept.evaluate<Known>(known, [&](int e, const Known& entry) { take(e, entry, h, quarter); });
    }

    /// Derivatives of the user's equations.
    template <class Elimination>
    void kept_columns(Values y, const Flown& flown, Values scale, Elimination& out) const {
        for (int j = 0; j < released(); ++j)
            each_kept(flown.slopes[j], y, [&](int e, const First& entry) {
                out.shared_closing(j)[closures() + e] += entry.slopes[0] * (scale[parameter(j)] * out.spread());
            });
        if (!is_free()) return;
        each_known_slope(flown.at, y, [&](int e, const Known& entry, double, double) {
            const int row = closures() + e;
            for (int r = 0; r < size(); ++r)
                out.closing(begin(0) + r)[row] +=
                    entry.slopes[0] * energy_rate(flown.at, y.subspan(begin(0), size()), r) * scale[begin(0) + r];
            for (int i = 0; i <= inner(); ++i)
                out.closing(time(i))[row] += entry.slopes[1] / closure_.quarters * scale[time(i)];
        });
    }

    /// Call by_node(unknown, entry) and by_parameter(j, entry) for the derivatives of `place`.
    template <class ByNode, class ByParameter>
    void place_columns(int i, Values y, const Flown& flown, double sign, ByNode&& by_node, ByParameter&& by_parameter) const {
        const int next = i < inner() ? i + 1 : 0;
        if (const int row = events_.release[i]; row >= 0) {
            for (int r = 0; r < size(); ++r) by_node(begin(next) + r, -pull(row, flown.at)[r]);
            double by_clock = 0.0;
            for (int h = 0; h < harmonics(); ++h) {
                const double cosine = dot(reach(row, flown.at), flown.at.forces[2 * h]);
                const double sine = dot(reach(row, flown.at), flown.at.forces[2 * h + 1]);
                by_clock += turn_rate(h) * (sine * flown.turns(i + 1, 2 * h) - cosine * flown.turns(i + 1, 2 * h + 1));
            }
            if (has_clock()) by_node(time(next), by_clock);
            const Values z = y.subspan(begin(next), size());
            for (int j = 0; j < released(); ++j)
                by_parameter(j, force(row, flown.slopes[j], z, flown.turns[i + 1]).slopes[0]);
            return;
        }
        for (int r = 0; r < size() / 2; ++r)
            if (const double entry = events_.gap(i, r); entry != 0.0) by_node(begin(next) + r, sign * entry);
        for (int j = 0; j < released(); ++j) by_parameter(j, -flown.slopes[j].entries[events_.bound[i]].slopes[0]);
    }

    /// The chatter that begins at node i: z, c become the state and time at its end, NaN where it has none. Returns the error.
    template <class T>
    double sum_chatter(int i, const Setting<T>& at, std::vector<T>& z, T& c) const {
        if constexpr (SMOOTH) {
            return 0.0;  // no stop sticks
        } else {
            const int event = before(i), f = events_.mode[event], n = size() / 2, count = 2 * harmonics();
            const double side = events_.side[event] * (i == 0 ? closure_.sign : 1.0);
            // The acceleration of the gap, by the state and by the oscillators.
            std::vector<T> by_state(size(), T(0.0)), by_turn(count, T(0.0)), turns(count), turned(count), place(size()), moved(size());
            const auto& inverse = at.modes[events_.kept[event]].inverse;
            for (int r = 0; r < n; ++r) {
                const T reach = dot(events_.gap[event].first(n), inverse[r]);
                for (int c = 0; c < n; ++c) {
                    by_state[c] -= reach * at.entries[2 * n * n + r * n + c];
                    by_state[n + c] -= reach * at.entries[n * n + r * n + c];
                }
                for (int q = 0; q < count; ++q) by_turn[q] += reach * at.forces(q, r);
            }
            const auto& flight = mode(f, at);
            const auto& drive = at.drives[f];
            const auto fly = [&](const std::vector<T>& from, const T& clock, const T& t, std::vector<T>& to) {
                oscillators(clock, turns);
                oscillators(T(clock + t / at.cycle), turned);
                flight.end(drive, Vector<const T>(from), t, Vector<T>(turns), Vector<T>(turned), to);
            };
            Chatter<T> chatter;
            chatter.restitution = T(rebound(event, at) - 1.0);
            chatter.impact = [&](std::vector<T>& state) {
                if (varies()) apply_impact(events_.rate[event], at.push[event], rebound(event, at), state, state);
                else apply_impact(events_.rate[event], events_.push[event], rebound(event, at), state, state);
            };
            chatter.speed = [&](const std::vector<T>& state) { return T(dot(events_.rate[event], state)); };
            // The acceleration a time after a state, and its rate.
            chatter.acceleration = [&](const std::vector<T>& state, const T& clock, const T& t, double* rate) {
                fly(state, clock, t, place);
                T total = dot(by_state, place);
                for (int q = 0; q < count; ++q) total += by_turn[q] * turned[q];
                if (rate != nullptr) {
                    flight.rate(drive, Vector<const T>(place), Vector<T>(turned), moved);
                    *rate = value(dot(by_state, moved));
                    for (int h = 0; h < harmonics(); ++h)
                        *rate += turn_rate(h) / value(at.cycle) *
                            (value(by_turn[2 * h + 1] * turned[2 * h]) - value(by_turn[2 * h] * turned[2 * h + 1]));
                }
                return total;
            };
            chatter.fly = [&](std::vector<T>& state, T& clock, const T& t) {
                fly(state, clock, t, place);
                clock += t / at.cycle;
                std::copy(place.begin(), place.end(), state.begin());
            };
            return chatter.sum(side, units_, z, c);
        }
    }

    /// The same of doubles, into `flown`; returns the time at the end. lead (N + 1, N + 1 + P): derivatives of state and time at
    /// the end by those before it, and by the parameters.
    double sum_chatter(int i, Values y, Flown& flown, Array<>& lead) const {
        const int n = size(), all = n + 1 + released(), width = int(Bundle().slopes.size());
        lead = Array<>(n + 1, all);
        double end = 0.0;
        for (int first = 0; first < all; first += width) {
            const auto along = [&](double x, int direction) {
                Bundle out(x);
                if (direction >= first && direction < first + width) out.slopes[direction - first] = 1.0;
                return out;
            };
            std::vector<Bundle> p, z;
            for (int j = 0; j < released(); ++j) p.push_back(along(y[parameter(j)], n + 1 + j));
            for (int r = 0; r < n; ++r) z.push_back(along(y[begin(i) + r], r));
            Bundle c = along(clock(y, i), n);
            set(Vector<const Bundle>(p), flown.bundle, flown.at.flights);
            flown.errors[i] = sum_chatter(i, flown.bundle, z, c);
            for (int d = first; d < std::min(all, first + width); ++d) {
                for (int r = 0; r < n; ++r) lead(r, d) = z[r].slopes[d - first];
                lead(n, d) = c.slopes[d - first];
            }
            for (int r = 0; r < n; ++r) flown.starts(i, r) = z[r].value;
            end = c.value;
        }
        flown.lasted[i] = end - clock(y, i);
        oscillators(end, flown.begins[i]);
        return end;
    }

    /// Derivatives of flight i by its node before the chatter, from those by the begin behind it.
    void compose(int i, const Array<>& lead, Flown& flown) const {
        const int n = size();
        const double cycle = flown.at.cycle;
        const Matrix<double> map(flown.maps[i].data(), n, n), columns(flown.columns[i].data(), 2 + released(), n);
        Array<> moved(n, n + 1 + released());
        for (int r = 0; r < n; ++r)
            for (int d = 0; d < moved.columns(); ++d) {
                moved(r, d) = columns(0, r) * cycle * lead(n, d);
                for (int q = 0; q < n; ++q) moved(r, d) += map(r, q) * lead(q, d);
            }
        for (int r = 0; r < n; ++r) {
            for (int c = 0; c < n; ++c) map(r, c) = moved(r, c);
            columns(0, r) = moved(r, n) / cycle;
            for (int j = 0; j < released(); ++j) columns(2 + j, r) += moved(r, n + 1 + j);
        }
    }

    /// The contact modes at what is known.
    template <class T>
    Flights flights_at(const Setting<T>& at) const {
        std::vector<double> parameters(at.parameters.size()), entries(at.entries.size());
        for (size_t k = 0; k < parameters.size(); ++k) parameters[k] = value(at.parameters[k]);
        for (size_t k = 0; k < entries.size(); ++k) entries[k] = value(at.entries[k]);
        std::vector<Flight> out;
        if (parameters_.undamped) {
            out.push_back((*modes_)[0].undamped(entries));
            return std::make_shared<const std::vector<Flight>>(std::move(out));
        }
        auto found = parameters_.modes(parameters, entries);
        for (int f = 0; f < modes(); ++f) {
            if (found.empty()) out.push_back((*modes_)[f].unknown());
            else out.emplace_back(std::move(found[f]));
        }
        return std::make_shared<const std::vector<Flight>>(std::move(out));
    }

    /// What impacts, contact forces and flights take from masses, dampers and springs.
    template <class T>
    void vary(Setting<T>& out) const {
        const int n = size() / 2, forces = events_.pull.rows();
        out.modes.resize(modes());
        out.push = Array<T>(events_.gap.rows(), size()), out.pull = Array<T>(forces, size()), out.reach = Array<T>(forces, n);
        for (int f = 0, row = 0; f < modes(); ++f) {
            int count = 0;
            while (row + count < forces && events_.force_mode[row + count] == f) ++count;
            const Matrix<const double> gaps = Matrix<const double>(events_.closed).rows(row, count);
            const Values units = Values(events_.unit).subspan(row, count);
            out.modes[f].set(Vector<const T>(out.entries), gaps, units);
            for (int k = 0; k < count; ++k, ++row)
                copy(out.modes[f].pull[k], out.pull[row]), copy(out.modes[f].reach[k], out.reach[row]);
        }
        for (int i = 0; i < events_.gap.rows(); ++i) {
            if (!hits(i)) continue;
            const Array<T>& inverse = out.modes[events_.kept[i]].inverse;
            T along(0.0);
            for (int r = 0; r < n; ++r) {
                out.push(i, n + r) = dot(events_.gap[i].first(n), inverse[r]);
                along += events_.gap(i, r) * out.push(i, n + r);
            }
            for (int r = 0; r < n; ++r) out.push(i, n + r) = out.push(i, n + r) / along;
        }
    }

    Flights modes_;
    Parameters parameters_;
    ForcedEvents events_;
    ForcedClosure closure_;
    std::vector<double> units_;
};

}  // namespace saltus
