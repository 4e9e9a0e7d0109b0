#include "taylor.hpp"

#include <algorithm>

#include "collocation.hpp"
#include "columns.hpp"

namespace saltus {

namespace {

/// Largest last term, as a part of the speed in a step: rounding. The terms that are left out are smaller.
constexpr double TRUNCATION = 1e-16;

/// Largest change of the velocity by the defect, as a part of that speed: rounding.
constexpr double DEFECT = 4e-16;

/// Relative rounding of an input of the forces.
constexpr double INPUT_ROUNDING = 4e-16;

/// Part of the accelerations, over the largest factor of a force, below which a power of small inputs is left out.
constexpr double NONE_LEFT = 1e-19;

/// Part of a step after which an input that begins at rest has a rate.
constexpr double EARLY = 1e-3;

/// Part of a flight below which a step is too short: the forces are too large for a number, or not smooth.
constexpr double SHORTEST = 1e-14;

/// Bounds are widened by this, more than their own rounding.
constexpr double MARGIN = 1.0 + 1e-12;

double largest_size(Values values) {
    double largest = 0.0;
    for (double value : values) largest = std::max(largest, std::fabs(value));
    return largest;
}

}  // namespace

Bounds TaylorPath::project(Values row, int s, Vector<double> out) const {
    const Matrix<const double> coefficients = step(s);
    std::fill(out.begin(), out.end(), 0.0);
    for (int r = 0; r < size(); ++r)
        if (row[r] != 0.0)
            for (int k = 0; k <= ORDER; ++k) out[k] += row[r] * coefficients(k, r);
    const double h = times[s + 1] - times[s];
    double level = 0.0, second = 0.0, third = 0.0;
    for (int k = ORDER; k >= 0; --k) {
        level = level * h + std::fabs(out[k]);
        if (k > 1) second = second * h + k * (k - 1) * std::fabs(out[k]);
        if (k > 2) third = third * h + k * (k - 1) * (k - 2) * std::fabs(out[k]);
    }
    return {level * MARGIN, second * MARGIN, third * MARGIN};
}

/// The computation of flights, with its scratch.
class TaylorWork {
public:
    explicit TaylorWork(const SmoothEquations& equations)
        : equations_(equations), columns_(equations), states_(ORDER + 1, equations.size()), series_(equations.program.registers, ORDER + 1),
          now_(equations.program.registers, 1), state_(equations.size()), change_(equations.size()), defect_(equations.size() / 2),
          rates_(equations.program.inputs), rates_before_(equations.program.inputs) {
        for (int r = 0; r < equations.push.rows(); ++r)
            for (const auto& entry : equations.push[r]) weight_ = std::max(weight_, std::fabs(entry.value));
        for (double number : equations.numbers) weight_ = std::max(weight_, weight_ * std::fabs(number));
    }

    /// The flight of time t from z.
    std::shared_ptr<const TaylorPath> fly(Values z, double t, bool with_map) {
        begin(z, t, with_map, false, equations_.most_steps, draft_);
        while (advance(draft_)) {}
        return std::make_shared<const TaylorPath>(draft_);
    }

    /// Begin a flight of time t from z, of so many steps at most.
    void begin(Values z, double t, bool with_map, bool with_forces, int most, TaylorPath& path) {
        path.begin.assign(z.begin(), z.end());
        path.duration = t;
        path.width = int(z.size()) + (with_forces ? 3 * int(equations_.program.forces.size()) : 0);
        path.has_map = with_map;
        path.times.assign(1, 0.0);
        path.least.clear(), path.coefficients.clear(), path.end.clear();
        path.map = Array<>();
        path.complete = path.exhausted = false;
        has_map_ = with_map, with_forces_ = with_forces, most_ = most;
        copy(z, states_[0]);
        if (has_map_) columns_.begin();
        largest_ = natural_acceleration(z, std::fabs(t));
    }

    /// Add a step. False: there is none, for the flight is complete or cannot go on.
    bool advance(TaylorPath& path) {
        const int size = equations_.size();
        const double whole = std::fabs(path.duration), at = path.times.back();
        if (whole != whole) return false;
        if (!(at < whole)) {
            finish(path);
            return false;
        }
        if (path.steps() == most_) {
            path.exhausted = true;
            return false;
        }
        equations_.rate<double>(states_[0], 0.0, now_, change_);
        largest_ = std::max(largest_, largest_size(Values(change_).subspan(size / 2)));
        const double least = NONE_LEFT * largest_ / weight_;
        equations_.expand<double>(least, states_, series_);
        if (has_map_) columns_.expand(series_);
        const double direction = path.duration < 0.0 ? -1.0 : 1.0;
        const double length = confirmed_length(whole, whole - at, direction, least);
        if (!(length > 0.0)) return false;
        path.least.push_back(least);
        if (with_forces_) keep_with_forces(least, path);
        else path.coefficients.insert(path.coefficients.end(), states_.data(), states_.data() + (ORDER + 1) * size);
        path.times.push_back(at + length);
        const double h = direction * length;
        evaluate_series<double>(states_, h, state_);
        copy(Values(state_), states_[0]);
        if (has_map_) columns_.advance(h);
        if (!(path.times.back() < whole)) finish(path);
        return true;
    }

private:
    void finish(TaylorPath& path) {
        const int size = equations_.size();
        path.end.assign(states_[0].begin(), states_[0].end());
        path.complete = true;
        if (!has_map_) return;
        path.map = Array<>(size, size);
        columns_.write(path.map);
    }

    /// The coefficients of the state, of the forces and of their first two derivatives.
    void keep_with_forces(double least, TaylorPath& path) {
        const auto& program = equations_.program;
        for (int i = 0; i < program.inputs; ++i) series_(i, ORDER) = equations_.inputs.times(i, states_[ORDER].data());
        program.extend<double>(series_, ORDER, least, equations_.numbers);
        for (int k = 0; k <= ORDER; ++k) {
            path.coefficients.insert(path.coefficients.end(), states_[k].begin(), states_[k].end());
            for (int order = 0; order < 3; ++order)
                for (const int force : program.forces) {
                    double factor = 1.0;
                    for (int q = 1; q <= order; ++q) factor *= k + q;
                    path.coefficients.push_back(k + order <= ORDER ? factor * series_(force, k + order) : 0.0);
                }
        }
    }

    /// The length of a step; 0 where it would be too short.
    double confirmed_length(double whole, double left, double direction, double least) {
        double speed = 0.0, length = step_length(left, speed);
        if (!(length > SHORTEST * whole || length == left)) return 0.0;
        const double limit = ORDER * DEFECT * speed;
        while (!is_confirmed(direction * length, least, limit)) {
            length *= 0.8;
            if (!(length > SHORTEST * whole)) return 0.0;
        }
        return length;
    }

    /// The acceleration that linear springs give a motion with the speeds of a state: at an origin there is none yet.
    double natural_acceleration(Values z, double t) const {
        const int n = equations_.size() / 2;
        double stiffest = 0.0, largest = 0.0;
        for (int r = 0; r < n; ++r)
            for (const auto& entry : equations_.linear[r])
                if (entry.column < n) stiffest = std::max(stiffest, std::fabs(entry.value));
        const double while_it_grows = stiffest > 0.0 ? std::min(t, 1.0 / std::sqrt(stiffest)) : 0.0;
        for (int r = 0; r < n; ++r) {
            double total = 0.0;
            for (const auto& entry : equations_.linear[r])
                if (entry.column < n) total += std::fabs(entry.value * z[n + entry.column]);
            largest = std::max(largest, total * while_it_grows);
        }
        return largest;
    }

    Values velocities(int order) { return Values(states_[order]).subspan(equations_.size() / 2); }

    /// The length at which the last two terms of the velocities are below TRUNCATION, and of the columns' velocities the
    /// last but one below COLUMN_TRUNCATION.
    double step_length(double left, double& reached) {
        const double speed = largest_size(velocities(0));
        double length = left;
        for (int attempt = 0; attempt < 2; ++attempt) {
            // A motion that begins at rest has the speed of its first terms.
            double size = 1.0;
            reached = speed;
            for (int k = 1; k < 4; ++k) {
                size *= length;
                reached = std::max(reached, largest_size(velocities(k)) * size);
            }
            if (reached == 0.0) return left;
            double room = has_map_ && attempt == 1 ? COLUMN_TRUNCATION / TRUNCATION * columns_.room(length) : INFINITE;
            length = left;
            for (int k = ORDER - 1; k <= ORDER; ++k, room = INFINITE) {
                room = std::min(room, reached / largest_size(velocities(k)));
                if (power(length, k) > TRUNCATION * room) length = pow(TRUNCATION * room, 1.0 / k);
            }
        }
        return length;
    }

    /// Whether the defect of a step changes the velocities by no more than a limit. It is looked at after each third.
    /// Where an input has rates of other signs at both ends of a third, it is also looked at where the input turns: the
    /// force of a near contact is largest there, and a step could jump over it.
    bool is_confirmed(double length, double least, double limit) {
        const int inputs = equations_.program.inputs;
        double before = EARLY * length;  // the rate of what begins at rest is zero at the begin
        for (int i = 0; i < inputs; ++i) rates_before_[i] = rate_of_input(i, before);
        for (int part = 1; part < 4; ++part) {
            const double h = length * part / 3.0;
            if (!(defect(h, least) * std::fabs(h) <= limit)) return false;
            for (int i = 0; i < inputs; ++i) rates_[i] = equations_.inputs.times(i, change_.data());
            for (int i = 0; i < inputs; ++i) {
                if (!(rates_before_[i] * rates_[i] < 0.0)) continue;
                const double turn = turning_time(i, before, rates_before_[i], h, rates_[i]);
                if (!(defect(turn, least) * std::fabs(turn) <= limit)) return false;
            }
            std::swap(rates_, rates_before_);
            before = h;
        }
        return true;
    }

    /// How far the acceleration along the polynomial is from that of the forces, at a time in the step. What the
    /// rounding of the state changes in the forces is left out: it is no error of the step.
    double defect(double h, double least) {
        const int size = equations_.size(), n = size / 2;
        state_with_acceleration(h);
        equations_.rate<double>(state_, least, now_, change_);
        for (int r = 0; r < n; ++r) {
            double rounding = 0.0;
            for (const auto& entry : equations_.linear[r]) rounding += std::fabs(entry.value * state_[entry.column]);
            defect_[r] = std::fabs(defect_[r] - change_[n + r]) - INPUT_ROUNDING * rounding;
        }
        for (const auto& slope : equations_.program.slopes) {
            double rounding = 0.0;
            for (const auto& entry : equations_.inputs[slope.input]) rounding += std::fabs(entry.value * state_[entry.column]);
            rounding *= INPUT_ROUNDING * std::fabs(now_(slope.result, 0));
            for (int r = 0; r < n; ++r) defect_[r] -= rounding * std::fabs(equations_.dense_push(r, slope.force));
        }
        double worst = 0.0;
        for (double entry : defect_) {
            if (entry != entry) return entry;
            if (entry > worst) worst = entry;
        }
        return worst;
    }

    /// The polynomials at a time into `state_`, and their accelerations into `defect_`.
    void state_with_acceleration(double t) {
        const int n = equations_.size() / 2;
        by_parts(n, [&]<int W>(int first) {
            double place[W], velocity[W], acceleration[W];
            for (int e = 0; e < W; ++e) {
                place[e] = states_(ORDER, first + e);
                velocity[e] = states_(ORDER, n + first + e);
                acceleration[e] = ORDER * velocity[e];
            }
            for (int k = ORDER - 1; k >= 0; --k) {
                const double *u = &states_(k, first), *v = &states_(k, n + first);
                for (int e = 0; e < W; ++e) {
                    place[e] = place[e] * t + u[e];
                    velocity[e] = velocity[e] * t + v[e];
                    if (k > 0) acceleration[e] = acceleration[e] * t + k * v[e];
                }
            }
            for (int e = 0; e < W; ++e) {
                state_[first + e] = place[e];
                state_[n + first + e] = velocity[e];
                defect_[first + e] = acceleration[e];
            }
        });
    }

    double rate_of_input(int i, double t) const {
        double rate = 0.0;
        for (int k = ORDER - 1; k > 0; --k) rate = rate * t + k * series_(i, k);
        return rate;
    }

    /// Where an input turns in a step: its rate has other signs at low and high. What lies between is halved six times.
    /// In the rest the rate is a straight line.
    double turning_time(int i, double low, double rate_low, double high, double rate_high) const {
        for (int count = 0; count < 6; ++count) {
            const double middle = 0.5 * (low + high), rate = rate_of_input(i, middle);
            if ((rate > 0.0) == (rate_low > 0.0)) low = middle, rate_low = rate;
            else high = middle, rate_high = rate;
        }
        return low + rate_low / (rate_low - rate_high) * (high - low);
    }

    const SmoothEquations& equations_;
    Columns columns_;
    Array<> states_, series_, now_;  // (ORDER + 1, N), (registers, ORDER + 1); forces at one instant, (registers, 1)
    std::vector<double> state_, change_, defect_, rates_, rates_before_;
    TaylorPath draft_;  // its arrays keep their room
    bool has_map_ = false, with_forces_ = false;
    int most_ = 0;
    double largest_ = 0.0;  // acceleration so far
    double weight_ = 1.0;  // largest factor of a force
};

TaylorFlights::TaylorFlights(SmoothEquations equations, int keep) : equations_(std::move(equations)), keep_(std::max(keep, 1)) {}
TaylorFlights::~TaylorFlights() = default;

void TaylorFlights::keep(int count) const {
    const std::lock_guard lock(mutex_);
    keep_ = std::max(keep_, count);
}

std::shared_ptr<const TaylorPath> TaylorFlights::latest() const {
    const std::lock_guard lock(mutex_);
    return latest_;
}

std::unique_ptr<TaylorWork> TaylorFlights::borrow() const {
    {
        const std::lock_guard lock(mutex_);
        if (!idle_.empty()) {
            std::unique_ptr<TaylorWork> work = std::move(idle_.back());
            idle_.pop_back();
            return work;
        }
    }
    return std::make_unique<TaylorWork>(equations_);
}

void TaylorFlights::give_back(std::unique_ptr<TaylorWork> work) const {
    const std::lock_guard lock(mutex_);
    idle_.push_back(std::move(work));
}

std::shared_ptr<const TaylorPath> TaylorFlights::fly(Values z, double t, bool with_map) const {
    {
        const std::lock_guard lock(mutex_);
        for (const auto& path : kept_)
            if (path->duration == t && path->has_map == with_map && std::equal(z.begin(), z.end(), path->begin.begin()))
                return latest_ = path;
    }
    std::shared_ptr<const TaylorPath> path;
    if (equations_.called) {
        auto made = std::make_shared<TaylorPath>();
        Collocation(equations_).fly(z, t, with_map, *made);
        path = std::move(made);
    } else {
        auto work = borrow();
        path = work->fly(z, t, with_map);
        give_back(std::move(work));
    }
    const std::lock_guard lock(mutex_);
    if (int(kept_.size()) < keep_) {
        kept_.push_back(path);
    } else {
        kept_[oldest_] = path;
        oldest_ = (oldest_ + 1) % kept_.size();
    }
    return latest_ = path;
}

GrowingFlight::GrowingFlight(std::shared_ptr<const TaylorFlights> flights, Values z, double duration)
    : flights_(std::move(flights)), work_(flights_->borrow()) {
    work_->begin(z, duration, false, true, std::numeric_limits<int>::max(), path_);
}
GrowingFlight::~GrowingFlight() { flights_->give_back(std::move(work_)); }

int GrowingFlight::reach(double t) {
    while (!over_ && !(t < path_.times.back())) over_ = !work_->advance(path_);
    const bool inside = t < path_.times.back() || (path_.complete && t == path_.times.back());
    return inside && path_.steps() > 0 ? path_.step_at(t) : -1;
}

}  // namespace saltus
