/// Flights with smooth forces under periodic loads: M u'' + C u' + K u + D' f(w) = g(t).
///
/// The states are (u, v). Each harmonic of the loads is an oscillator beside them, c'' = -nu^2 c: a flight of n + H
/// coordinates with smooth forces, which no time enters (`taylor.hpp`). A constant load has nu = 0. The oscillators are in
/// small units, so that the steps suit the motion.
#pragma once

#include "contact_mode.hpp"
#include "extrema.hpp"
#include "smooth_flight.hpp"

namespace saltus {

/// Part of the displacement that a load gives a free mass, as a power of two, that is the unit of its oscillator.
inline constexpr int SMALL_UNIT = -10;

/// The equations at values of the parameters, and the flights of their values.
template <class T>
struct SmoothDrive {
    T base;                        // w
    SmoothEquationsOf<T> equations;
    std::vector<double> units;     // (H,) of the oscillators
    std::vector<double> values;    // all that the flights depend on
    mutable std::shared_ptr<const TaylorFlights> flights;
};

/// Forces of which no formula is known, of inputs and numbers: the released parameters.
struct LoadedCalls {
    /// As those of `CalledForces`, then the derivatives by the numbers.
    std::function<void(Matrix<double> values, int count, Values numbers)> forces;
    /// The energy, its derivatives by the inputs, and by the numbers; empty where there is none.
    std::function<std::vector<double>(Values inputs, Values numbers)> energies;
    std::vector<std::array<int, 3>> changes;  // a force, a number and the register of its derivative
};

class SmoothLoadedFlight {
public:
    static constexpr int SIZE = DYNAMIC;
    template <class T>
    using DriveOf = SmoothDrive<T>;

    /// inputs (I, N), directions (F, n): W and D. numbers: those of the program, of the released parameters. potential: the
    /// energy of the forces, of the inputs and these parameters; without outputs where there is none.
    SmoothLoadedFlight(Array<> inputs, Array<> directions, ForceProgram program, Formulas numbers, Formulas potential,
                       std::vector<double> harmonics, int most_steps, int keep, std::shared_ptr<const LoadedCalls> called = nullptr)
        : inputs_(std::move(inputs)), directions_(std::move(directions)), program_(std::move(program)),
          numbers_(std::move(numbers)), potential_(std::move(potential)), harmonics_(std::move(harmonics)),
          most_steps_(most_steps), keep_(keep), called_(std::move(called)) {}

    int size() const { return inputs_.columns(); }
    int harmonics() const { return int(harmonics_.size()); }
    double harmonic(int h) const { return harmonics_[h]; }
    int parameters() const { return numbers_.parameters; }
    static constexpr bool is_series() { return true; }

    /// Write the equations for the base frequency w, forces (2 H, n), M, C and K, the inverse of M, and the released
    /// parameters.
    template <class T>
    void set(const T& base, Matrix<const T> forces, Vector<const T> entries, const Array<T>& inverse,
             Vector<const T> parameters, SmoothDrive<T>& out) const {
        const int n = size() / 2, all = n + harmonics();
        out.base = base;
        Array<T> linear(all, 2 * all), push(all, directions_.rows());
        const auto accelerations = [&](auto&& force, int r) {
            T total(0.0);
            for (int c = 0; c < n; ++c) total += inverse(r, c) * force(c);
            return total;
        };
        out.units.assign(harmonics(), 1.0);
        for (int r = 0; r < n; ++r) {
            for (int c = 0; c < n; ++c) {
                linear(r, c) = -accelerations([&](int q) { return entries[2 * n * n + q * n + c]; }, r);
                linear(r, all + c) = -accelerations([&](int q) { return entries[n * n + q * n + c]; }, r);
            }
            for (int f = 0; f < directions_.rows(); ++f)
                push(r, f) = -accelerations([&](int q) { return directions_(f, q); }, r);
        }
        for (int h = 0; h < harmonics(); ++h) {
            const T nu = harmonics_[h] * base;
            const bool turns = harmonics_[h] != 0.0;
            double strength = 0.0;
            for (int r = 0; r < n; ++r) {
                linear(r, n + h) = accelerations([&](int q) { return forces(2 * h, q); }, r);
                // sin = -c'/nu
                if (turns) linear(r, all + n + h) = -accelerations([&](int q) { return forces(2 * h + 1, q); }, r) / nu;
                strength = std::max(strength, std::fabs(value(linear(r, n + h))));
                if (turns) strength = std::max(strength, std::fabs(value(linear(r, all + n + h) * nu)));
            }
            if (!turns) continue;
            const double square = value(nu) * value(nu);
            out.units[h] = strength > 0.0 ? std::ldexp(1.0, binary_exponent(strength / square) + SMALL_UNIT) : 1e-30;
            for (int r = 0; r < n; ++r)
                for (int c : {n + h, all + n + h}) linear(r, c) = linear(r, c) * (1.0 / out.units[h]);
            linear(n + h, n + h) = -nu * nu;
        }
        auto& equations = out.equations;
        std::vector<T> numbers(called_ ? parameters.size() : numbers_.outputs.size());
        if (called_) std::copy(parameters.begin(), parameters.end(), numbers.begin());
        else
        numbers_.evaluate<T>(parameters, [&](int k, const T& number) { numbers[k] = number; });
        if (!note(linear, push, numbers, out)) return;
        equations.linear = SparseRowsOf<T>(Matrix<const T>(linear));
        equations.push = SparseRowsOf<T>(Matrix<const T>(push));
        equations.dense_push = std::move(push);
        if (called_) {
            std::vector<double> known;
            for (const T& number : numbers) known.push_back(value(number));
            auto bound = std::make_shared<CalledForces>();
            bound->forces = [calls = called_, known](Matrix<double> values, int count) { calls->forces(values, count, known); };
            equations.called = std::move(bound);
        }
        equations.numbers = std::move(numbers);
        if (!equations.weights.empty()) return;
        Array<> inputs(inputs_.rows(), 2 * all);
        for (int i = 0; i < inputs.rows(); ++i)
            for (int c = 0; c < n; ++c) inputs(i, c) = inputs_(i, c), inputs(i, all + c) = inputs_(i, n + c);
        equations.inputs = SparseRows(Matrix<const double>(inputs));
        equations.program = program_;
        equations.most_steps = most_steps_;
        equations.weights.assign(2 * all, 0.0);
    }

    /// out = the state a time t after the state z. begin, finish (2 H,): the oscillators then.
    template <class T, class Z, class O, class Out>
    void end(const SmoothDrive<T>& drive, const Z& z, const T& t, const O& begin, const O&, Out&& out) const {
        const int n = size() / 2, all = n + harmonics();
        std::vector<T> from(2 * all), to(2 * all);
        std::vector<double> values(2 * all);
        place(drive, z, begin, from);
        for (int r = 0; r < 2 * all; ++r) values[r] = value(from[r]);
        const auto path = flights(drive).fly(values, value(t), true);
        if (path->complete) go_along(*path, drive, from, t, to);
        for (int r = 0; r < n; ++r)
            for (int part : {0, 1}) out[part * n + r] = path->complete ? to[part * all + r] : NOT_A_NUMBER * z[part * n + r];
    }

    /// See `LoadedFlight`. Columns by parameters are jets.
    struct Slope {
        const SmoothDrive<Jet<double, 1>>* drive;
        double duration;
    };
    void end(const SmoothDrive<double>& drive, Vector<const Slope> slopes, Values z, double t, Values begin, Values,
             Vector<double> out, Matrix<double> map, Matrix<double> columns) const {
        using First = Jet<double, 1>;
        const int n = size() / 2, all = n + harmonics();
        const auto at = [&](int r) { return r < n ? r : all - n + r; };
        std::vector<double> from(2 * all), moved(2 * all);
        place(drive, z, begin, from);
        if (called_ && (!drive.flights || drive.flights->equations().sources.size() != slopes.size())) {
            SmoothEquations equations = drive.equations;
            for (const Slope& slope : slopes) equations.sources.push_back(source_of(slope.drive->equations, 0));
            drive.flights = std::make_shared<TaylorFlights>(std::move(equations), keep_);
        }
        const auto path = flights(drive).fly(from, t, true);
        if (!path->complete) {
            std::fill(out.begin(), out.end(), NOT_A_NUMBER);
            std::fill_n(map.data(), size() * size(), NOT_A_NUMBER);
            std::fill_n(columns.data(), columns.rows() * size(), NOT_A_NUMBER);
            return;
        }
        rate_of(drive, from, moved);
        for (int r = 0; r < size(); ++r) {
            out[r] = path->end[at(r)];
            // A begin that is perturbed along the path stays on it.
            columns(0, r) = 0.0;
            for (int c = 0; c < size(); ++c) {
                map(r, c) = path->map(at(r), at(c));
                columns(0, r) -= map(r, c) * moved[at(c)];
            }
        }
        rate_of(drive, path->end, moved);
        for (int r = 0; r < size(); ++r) columns(1, r) = moved[at(r)];
        std::vector<First> start(2 * all), finish(2 * all);
        for (int j = 0; j < int(slopes.size()); ++j) {
            First time(t);
            time.slopes[0] = slopes[j].duration;
            place(*slopes[j].drive, z, begin, start);
            if (called_) carry_along(*path, drive.equations, j, start, time, finish);
            else follow(*path, slopes[j].drive->equations, start, time, finish);
            for (int r = 0; r < size(); ++r) columns(2 + j, r) = finish[at(r)].slopes[0];
        }
    }

    /// out = z' at oscillators o.
    template <class Z, class O, class Out>
    void rate(const SmoothDrive<double>& drive, const Z& z, const O& o, Out&& out) const {
        const int n = size() / 2, all = n + harmonics();
        std::vector<double> from(2 * all), moved(2 * all);
        place(drive, z, o, from);
        rate_of(drive, from, moved);
        for (int r = 0; r < n; ++r) out[r] = moved[r], out[n + r] = moved[all + r];
    }

    /// The energy of the forces at a state.
    template <class T, class Z>
    T potential(const Z& z, Vector<const T> parameters) const {
        std::vector<T> known;
        for (int i = 0; i < inputs_.rows(); ++i) {
            T input(0.0);
            for (int c = 0; c < size(); ++c)
                if (inputs_(i, c) != 0.0) input += inputs_(i, c) * z[c];
            known.push_back(input);
        }
        if (called_) return called_energy(known, parameters);
        known.insert(known.end(), parameters.begin(), parameters.end());
        T found(0.0);
        potential_.evaluate<T>(known, [&](int k, const T& entry) {
            if (k == 0) found = entry;
        });
        return found;
    }

    /// out (2 n + 2 H,) = a state with oscillators.
    template <class T, class Z, class O, class Out>
    void place(const SmoothDrive<T>& drive, const Z& z, const O& o, Out&& out) const {
        const int n = size() / 2, all = n + harmonics();
        for (int r = 0; r < n; ++r) out[r] = T(z[r]), out[all + r] = T(z[n + r]);
        for (int h = 0; h < harmonics(); ++h) {
            out[n + h] = o[2 * h] * T(drive.units[h]);
            out[all + n + h] = -(harmonics_[h] * drive.base) * o[2 * h + 1] * drive.units[h];
        }
    }

    /// The flights of the values of a drive.
    template <class T>
    const TaylorFlights& flights(const SmoothDrive<T>& drive) const {
        if (!drive.flights) drive.flights = std::make_shared<TaylorFlights>(values_of(drive.equations), keep_);
        return *drive.flights;
    }

private:
    /// to = the end of a path whose begin, time and equations have derivatives.
    template <class T>
    void go_along(const TaylorPath& path, const SmoothDrive<T>& drive, const std::vector<T>& from, const T& t, std::vector<T>& to) const {
        if (!called_) return follow(path, drive.equations, from, t, to);
        if constexpr (JET_DEPTH<T> == 0) {
            copy(path.end, to);
        } else if constexpr (JET_DEPTH<T> == 1) {
            carry_along(path, flights(drive).equations(), 0, from, t, to);
        } else {
            for (T& entry : to) entry = T(NOT_A_NUMBER) * from[0];
        }
    }

    /// The same from the derivatives that the path carries, the first of them by source `first`.
    template <class T>
    static void carry_along(const TaylorPath& path, const SmoothEquations& equations, int first, const std::vector<T>& from, const T& t,
                            std::vector<T>& to) {
        std::vector<double> moved(from.size());
        Array<> series(equations.program.registers, 1);
        equations.rate<double>(path.end, 0.0, series, moved);
        for (size_t r = 0; r < from.size(); ++r) {
            to[r] = T(path.end[r]);
            for (size_t d = 0; d < t.slopes.size(); ++d) {
                double total = path.along(int(r), first + int(d)) + moved[r] * t.slopes[d];
                for (size_t c = 0; c < from.size(); ++c) total += path.map(int(r), int(c)) * from[c].slopes[d];
                to[r].slopes[d] = total;
            }
        }
    }

    /// The source of a derivative.
    template <class T>
    MotionSource source_of(const SmoothEquationsOf<T>& equations, int direction) const {
        const int size = equations.size();
        Array<> linear(size / 2, size), push(size / 2, equations.dense_push.columns());
        for (int r = 0; r < size / 2; ++r) {
            for (const auto& entry : equations.linear[r]) linear(r, entry.column) = entry.value.slopes[direction];
            for (int f = 0; f < push.columns(); ++f) push(r, f) = equations.dense_push(r, f).slopes[direction];
        }
        MotionSource out{SparseRows(Matrix<const double>(linear)), push, {}};
        for (const auto& [force, number, result] : called_->changes)
            out.changes.push_back({force, result, equations.numbers[number].slopes[direction]});
        return out;
    }

    template <class T>
    T called_energy(const std::vector<T>& inputs, Vector<const T> parameters) const {
        std::vector<double> at, numbers;
        for (const T& input : inputs) at.push_back(value(input));
        for (const T& parameter : parameters) numbers.push_back(value(parameter));
        const std::vector<double> found = called_->energies(at, numbers);
        if (found.empty()) return T(0.0);
        T out(found[0]);
        if constexpr (JET_DEPTH<T> == 1) {
            for (size_t d = 0; d < out.slopes.size(); ++d)
                for (size_t k = 0; k + 1 < found.size(); ++k)
                    out.slopes[d] += found[k + 1] * (k < inputs.size() ? inputs[k] : parameters[k - inputs.size()]).slopes[d];
        } else if constexpr (JET_DEPTH<T> > 1) {
            out = T(NOT_A_NUMBER);
        }
        return out;
    }

    static void rate_of(const SmoothDrive<double>& drive, const std::vector<double>& z, std::vector<double>& out) {
        Array<> series(drive.equations.program.registers, 1);
        drive.equations.rate<double>(z, 0.0, series, out);
    }

    template <class T>
    SmoothEquations values_of(const SmoothEquationsOf<T>& equations) const {
        if constexpr (JET_DEPTH<T> == 0) {
            return equations;
        } else {
            SmoothEquations out;
            const int size = equations.size();
            Array<> linear(size / 2, size), push(size / 2, equations.dense_push.columns());
            for (int r = 0; r < size / 2; ++r) {
                for (const auto& entry : equations.linear[r]) linear(r, entry.column) = value(entry.value);
                for (int f = 0; f < push.columns(); ++f) push(r, f) = value(equations.dense_push(r, f));
            }
            out.linear = SparseRows(Matrix<const double>(linear));
            out.push = SparseRows(Matrix<const double>(push));
            out.dense_push = push;
            out.inputs = equations.inputs;
            out.program = equations.program;
            for (const T& number : equations.numbers) out.numbers.push_back(value(number));
            out.most_steps = equations.most_steps, out.weights = equations.weights;
            out.called = equations.called;
            if constexpr (JET_DEPTH<T> == 1)
                for (size_t d = 0; called_ && d < std::tuple_size_v<decltype(T::slopes)>; ++d)
                    out.sources.push_back(source_of(equations, int(d)));
            return out;
        }
    }

    /// Keep the values that flights depend on. Whether the equations are others than before; then there are no flights yet.
    template <class T>
    static bool note(const Array<T>& linear, const Array<T>& push, const std::vector<T>& numbers, SmoothDrive<T>& out) {
        std::vector<double> values;
        const auto add = [&](const T* from, size_t count) {
            for (size_t k = 0; k < count; ++k) values.push_back(value(from[k]));
        };
        add(linear.data(), size_t(linear.rows()) * linear.columns());
        add(push.data(), size_t(push.rows()) * push.columns());
        add(numbers.data(), numbers.size());
        if (JET_DEPTH<T> == 0 && values == out.values) return false;
        out.values = std::move(values);
        out.flights = nullptr;
        return true;
    }

    Array<> inputs_, directions_;
    ForceProgram program_;
    Formulas numbers_, potential_;
    std::vector<double> harmonics_;
    int most_steps_, keep_;
    std::shared_ptr<const LoadedCalls> called_;
};

/// The path of a flight for `ForcedObservation`, as `LoadedPath`.
class SmoothLoadedPath {
public:
    SmoothLoadedPath(const SmoothLoadedFlight& flight, const SmoothDrive<double>& drive)
        : flight_(flight), drive_(drive), begin_(drive.equations.size()) {
        flight.flights(drive);
    }

    int size() const { return int(begin_.size()); }
    double growth() const { return 0.0; }
    void begin(Values z, Values o) { flight_.place(drive_, z, o, begin_); }
    /// rows (4, E) = a functional of displacements and its rate; the others are not needed.
    void functional(Values on_state, Values, Matrix<double> rows) const {
        const int n = flight_.size() / 2;
        std::fill(rows.data(), rows.data() + 4 * size(), 0.0);
        for (int r = 0; r < n; ++r) rows(0, r) = rows(1, size() / 2 + r) = on_state[r];
    }
    Clearance clearance(const ObservedGap& gap, double, double duration, double tie, double last) const {
        const SmoothFlight<> flight(drive_.flights);
        return saltus::clearance(path_of(flight, begin_, duration), gap, duration, tie, last);
    }

private:
    const SmoothLoadedFlight& flight_;
    const SmoothDrive<double>& drive_;
    std::vector<double> begin_;
};

}  // namespace saltus
