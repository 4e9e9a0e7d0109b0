/// Orbits under periodic loads for Python, whatever their numbers of states and parameters.
#pragma once

#include "any_problem.hpp"
#include "forced_measures.hpp"
#include "forced_second.hpp"
#include "forced_tests.hpp"

namespace saltus {

/// A forced problem of any size.
class AnyForcedProblem : public AnyProblem {
public:
    /// The multipliers (N,) of an orbit by modulus descending; of half a period those of x -> -x over it. False where they
    /// are not found.
    virtual bool multipliers(Values y, Vector<double> real, Vector<double> imaginary) = 0;
    /// starts (k + 1, N + 1): states and times at the begin of flights, behind a chatter; durations (k + 1,); ends (k + 1, N): the
    /// states before the events.
    virtual void flights(Values y, Matrix<double> starts, Vector<double> durations, Matrix<double> ends) = 0;
    /// Fill what is seen of an orbit along such flights, which need not be all of those of y. Multipliers are left out.
    virtual void observe_flights(Values y, Matrix<const double> starts, Values durations, Matrix<const double> ends, Point& point) = 0;
    /// The largest factor by which perturbations grow along a flight.
    virtual double growth(Values y) = 0;
    /// values (N + 2,): the state and the time a time t after a place (N + 1,), as in flight i at the parameters p, and a contact
    /// force there (row -1: 0). slopes (N + 2, 1 + N + 1 + P): their derivatives by t, the place and the parameters; or (0, 0).
    virtual void fly(Values p, int i, Values place, double t, int row, Vector<double> values, Matrix<double> slopes) = 0;
    /// slopes (N + 1, N + 1 + P): the derivatives of the state and time at the begin of flight i by those of its node, and by the
    /// parameters.
    virtual void begin_slopes(Values y, int i, Matrix<double> slopes) = 0;
    /// out (u - 1,) = the derivative of F along one, two or three directions, of an open orbit, whose last unknown is the clock at its end.
    virtual void open_derivative(Values y, Matrix<const double> directions, Vector<double> out) = 0;
    /// out (u - 1, u) = F''(y)[a, .]; (u - 1, u + 1) of an open orbit.
    virtual void second_along(Values y, Values a, Matrix<double> out) = 0;
    /// See `ForcedMeasures`; false with smooth forces, too.
    virtual bool measures(Values y, Vector<double> peaks, Vector<double> totals) = 0;
    /// The steps of a flight as of `fly`; nullptr for linear flights.
    virtual std::shared_ptr<const TaylorPath> path(Values p, int i, Values place, double t) = 0;
    /// The first flight of y that has no end, and its steps; nullptr where all have one.
    virtual std::pair<int, std::shared_ptr<const TaylorPath>> failure(Values y) = 0;
};

/// What a forced problem consists of.
struct ForcedParts {
    std::vector<LoadedFlight<>> modes;
    std::vector<SmoothLoadedFlight> smooth;  // or one flight with smooth forces
    Parameters parameters;
    ForcedEvents events;
    ForcedClosure closure;
    std::vector<double> units;
    ForcedWatch watch;
};

template <class Flight, int P>
std::unique_ptr<AnyForcedProblem> make_forced_problem(ForcedParts parts);

template <class Flight, int P>
class ForcedProblemOf final
    : public ProblemOf<AnyForcedProblem, ForcedProblem<Flight, P>, ForcedTests<ForcedProblem<Flight, P>>, ForcedWatch> {
public:
    using Base = ProblemOf<AnyForcedProblem, ForcedProblem<Flight, P>, ForcedTests<ForcedProblem<Flight, P>>, ForcedWatch>;
    using typename Base::Work;
    using Kind = ForcedProblem<Flight, P>;

    explicit ForcedProblemOf(ForcedParts parts)
        : Base({parts_of(parts), std::move(parts.parameters), std::move(parts.events),
                parts.closure, std::move(parts.units)},
               std::move(parts.watch)) {}

    bool multipliers(Values y, Vector<double> real, Vector<double> imaginary) override {
        return this->with_work([&](Work& work) {
            if (this->problem_.is_free()) return false;
            work.tests.prepare(y);
            const auto& flown = work.stepper.newton.flown;
            const double slow = GRAZING * this->problem_.motion_size(y, flown).velocity;
            for (int i = 0; i <= this->problem_.inner(); ++i)
                if (this->problem_.hits(i) && this->problem_.events().side[i] * dot(this->problem_.events().rate[i], flown.before[i]) < slow)
                    return false;
            auto& stroboscopic = work.tests.stroboscopic;
            if (!stroboscopic.find(y, flown, false)) return false;
            copy(stroboscopic.found.real, real);
            copy(stroboscopic.found.imaginary, imaginary);
            return true;
        });
    }

    void flights(Values y, Matrix<double> starts, Vector<double> durations, Matrix<double> ends) override {
        this->with_work([&](Work& work) {
            work.tests.prepare(y);
            const auto& flown = work.stepper.newton.flown;
            for (int i = 0; i < starts.rows(); ++i) {
                copy(flown.starts[i], starts[i].first(this->size()));
                starts(i, this->size()) = this->problem_.clock(y, i) + flown.lasted[i];
                durations[i] = flown.durations[i];
                copy(flown.before[i], ends[i]);
            }
        });
    }

    void observe_flights(Values y, Matrix<const double> starts, Values durations, Matrix<const double> ends, Point& point) override {
        this->with_work([&](Work& work) {
            work.tests.prepare(y);
            auto& flown = work.stepper.newton.flown;
            for (int i = 0; i < starts.rows(); ++i) {
                copy(starts[i].first(this->size()), flown.starts[i]);
                this->problem_.oscillators(starts(i, this->size()), flown.begins[i]);
                flown.durations[i] = durations[i];
                copy(ends[i], flown.before[i]);
            }
            point.gave_up = 0.0;
            ForcedObservation(this->problem_, work.tests.watch(), y, flown, point).run();
        });
    }

    double growth(Values y) override {
        return this->with_work([&](Work& work) {
            work.tests.prepare(y);
            const auto& flown = work.stepper.newton.flown;
            const Sizes sizes = this->problem_.motion_size(y, flown);
            const int n = this->size(), half = n / 2;
            double most = 0.0;
            for (int i = 0; i <= this->inner(); ++i)
                for (int r = 0; r < n; ++r)
                    for (int c = 0; c < n; ++c) {
                        const double to = r < half ? sizes.displacement : sizes.velocity, from = c < half ? sizes.displacement : sizes.velocity;
                        const double entry = std::fabs(flown.maps(i, r * n + c)) * from / to;
                        if (!(entry <= most)) most = entry;
                    }
            return most;
        });
    }

    void fly(Values p, int i, Values place, double t, int row, Vector<double> values, Matrix<double> slopes) override {
        const int n = this->size(), all = slopes.columns();
        this->with_work([&](Work& work) {
            auto& at = work.tests.place;  // its flights are known again at the same parameters
            this->problem_.set(p, at);
            if (all == 0) return state_of(at, i, place, t, row, values);
            using Bundle = typename Kind::Bundle;
            constexpr int WIDTH = int(std::tuple_size_v<decltype(Bundle::slopes)>);
            for (int first = 0; first < all; first += WIDTH) {
                const auto along = [&](double x, int direction) {
                    Bundle out(x);
                    if (direction >= first && direction < first + WIDTH) out.slopes[direction - first] = 1.0;
                    return out;
                };
                std::vector<Bundle> parameters, z, turns;
                for (size_t j = 0; j < p.size(); ++j) parameters.push_back(along(p[j], 2 + n + int(j)));
                for (int r = 0; r < n; ++r) z.push_back(along(place[r], 1 + r));
                Bundle c = along(place[n], 1 + n), force(0.0);
                typename Kind::template Setting<Bundle> moved;
                this->problem_.set(Vector<const Bundle>(parameters), moved, at.flights);
                this->problem_.fly(i, moved, along(t, 0), z, c, turns);
                if (row >= 0) force = this->problem_.force(row, moved, z, turns);
                for (int r = 0; r < n + 2; ++r) {
                    const Bundle& entry = r < n ? z[r] : r == n ? c : force;
                    values[r] = entry.value;
                    for (int d = first; d < std::min(all, first + WIDTH); ++d) slopes(r, d) = entry.slopes[d - first];
                }
            }
        });
    }

    void begin_slopes(Values y, int i, Matrix<double> slopes) override {
        using Bundle = typename Kind::Bundle;
        constexpr int WIDTH = int(std::tuple_size_v<decltype(Bundle::slopes)>);
        const int n = this->size();
        for (int first = 0; first < slopes.columns(); first += WIDTH) {
            std::vector<Bundle> at(y.begin(), y.end()), z;
            const auto unknown = [&](int d) {
                return d < n ? this->problem_.begin(i) + d : d == n ? this->problem_.time(i) : this->problem_.parameter(d - n - 1);
            };
            const int last = std::min(slopes.columns(), first + WIDTH);
            for (int d = first; d < last; ++d) at[unknown(d)].slopes[d - first] = 1.0;
            Bundle c;
            typename Kind::template Setting<Bundle> moved;
            this->problem_.set(Vector<const Bundle>(&at[this->problem_.parameter(0)], this->problem_.released()), moved);
            this->problem_.depart(i, moved, at, z, c);
            for (int d = first; d < last; ++d) {
                for (int r = 0; r < n; ++r) slopes(r, d) = z[r].slopes[d - first];
                slopes(n, d) = c.slopes[d - first];
            }
        }
    }

    void open_derivative(Values y, Matrix<const double> directions, Vector<double> out) override {
        if (directions.rows() == 2) return second_derivative(this->problem_, y, directions[0], directions[1], out);
        if (directions.rows() == 3) return third_derivative(this->problem_, y, directions[0], directions[1], directions[2], out);
        using First = Jet<double, 1>;
        std::vector<First> at(y.begin(), y.end()), found(out.size());
        for (size_t j = 0; j < y.size(); ++j) at[j].slopes[0] = directions(0, int(j));
        this->problem_.residual(at, found);
        for (size_t r = 0; r < out.size(); ++r) out[r] = found[r].slopes[0];
    }

    void second_along(Values y, Values a, Matrix<double> out) override { SecondAlong(this->problem_, y, a, out).run(); }

    bool measures(Values y, Vector<double> peaks, Vector<double> totals) override {
        if constexpr (Flight::is_series()) {
            return false;
        } else {
            return this->with_work([&](Work& work) {
                work.tests.prepare(y);
                return ForcedMeasures(this->problem_, work.stepper.newton.flown).run(peaks, totals);
            });
        }
    }

    std::shared_ptr<const TaylorPath> path(Values p, int i, Values place, double t) override {
        if constexpr (!Flight::is_series()) {
            return nullptr;
        } else {
            typename Kind::template Setting<double> at;
            this->problem_.set(p, at);
            const int all = this->size() + 2 * this->problem_.harmonics();
            std::vector<double> turns(2 * this->problem_.harmonics()), from(all);
            this->problem_.oscillators(place[this->size()], turns);
            const auto& drive = at.drives[this->problem_.events().mode[i]];
            const auto& flight = this->problem_.flight(i, at);
            flight.place(drive, place.first(this->size()), turns, from);
            return flight.flights(drive).fly(from, t, false);
        }
    }

    std::pair<int, std::shared_ptr<const TaylorPath>> failure(Values y) override {
        if constexpr (Flight::is_series()) {
            Array<> starts(this->inner() + 1, this->size() + 1), ends(this->inner() + 1, this->size());
            std::vector<double> durations(this->inner() + 1);
            flights(y, starts, durations, ends);
            const Values p = y.subspan(this->problem_.parameter(0), this->problem_.released());
            for (int i = 0; i <= this->inner(); ++i)
                if (!std::isfinite(ends(i, 0)))
                    if (auto found = path(p, i, starts[i], durations[i]); !found->complete) return {i, found};
        }
        return {0, nullptr};
    }

private:
    void state_of(const typename Kind::template Setting<double>& at, int i, Values place, double t, int row, Vector<double> values) {
        const int n = this->size();
        std::vector<double> z(place.begin(), place.begin() + n), turns;
        double c = place[n];
        this->problem_.fly(i, at, t, z, c, turns);
        copy(z, values.first(n));
        values[n] = c;
        values[n + 1] = row >= 0 ? this->problem_.force(row, at, z, turns) : 0.0;
    }

    static std::vector<Flight> parts_of(const ForcedParts& parts) {
        if constexpr (Flight::is_series()) return parts.smooth;
        else return {parts.modes.begin(), parts.modes.end()};
    }
};

}  // namespace saltus
