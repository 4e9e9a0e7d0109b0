#include "collocation.hpp"

#include <algorithm>

namespace saltus {

namespace {

/// Points between the Gauss points, and the ends, at which a step is looked at.
constexpr int OTHERS = 7;

/// Legendre coefficients of the step before that begin Newton's method: higher ones grow too fast outside.
constexpr int EXTRAPOLATED = 10;

/// Length of the first step, in units of the time in which the motion turns by one radian.
constexpr double FIRST = 4.0;

constexpr int ITERATIONS = 24;

/// Largest last Legendre coefficient of the derivatives' accelerations, as a part. The error at the end of a step is its
/// square.
constexpr double RESOLVED_PART = 1e-9;

/// Part of what is left of a flight below which a step is too short.
constexpr double SMALLEST = 1e-13;

/// Largest change of the velocity by the defect, as a part of the speed; relative rounding of an input of the forces.
constexpr double DEFECT = 4e-16, INPUT_ROUNDING = 4e-16;

/// P_0(x) .. P_count(x).
void legendre(double x, int count, double* out) {
    out[0] = 1.0;
    if (count > 0) out[1] = x;
    for (int k = 1; k < count; ++k) out[k + 1] = ((2 * k + 1) * x * out[k] - k * out[k - 1]) / (k + 1);
}

/// Gauss points of a step from 0 to 1, and integrals of the polynomials through values at them.
struct Tables {
    double points[STAGES], others[OTHERS];
    double integrals[STAGES][STAGES], twice[STAGES][STAGES];  // from 0 to each point, of the polynomials that are 1 at one
    double coefficients[STAGES][STAGES];                      // shifted Legendre coefficients of these, in columns
    double powers[STAGES][STAGES];                            // of x^p in the shifted Legendre polynomial k
    double values[OTHERS][STAGES], areas[OTHERS][STAGES];     // of these polynomials at the others; their integrals from 0

    Tables() {
        constexpr double PI = 3.141592653589793;
        double p[STAGES + 2], weights[STAGES];
        for (int i = 0; i < STAGES; ++i) {
            double x = -cos(PI * (i + 0.75) / (STAGES + 0.5)), slope = 1.0;
            for (int round = 0; round < 8; ++round) {
                legendre(x, STAGES, p);
                slope = STAGES * (x * p[STAGES] - p[STAGES - 1]) / (x * x - 1.0);
                x -= p[STAGES] / slope;
            }
            points[i] = 0.5 * (1.0 + x);
            weights[i] = 1.0 / ((1.0 - x * x) * slope * slope);
        }
        for (int i = 0; i < STAGES; ++i) {
            legendre(2.0 * points[i] - 1.0, STAGES, p);
            for (int k = 0; k < STAGES; ++k) coefficients[k][i] = (2.0 * k + 1.0) * p[k] * weights[i];
        }
        for (int i = 0; i < STAGES; ++i) integrate(points[i], integrals[i]);
        for (int i = 0; i < STAGES; ++i)
            for (int j = 0; j < STAGES; ++j) {
                twice[i][j] = 0.0;
                for (int k = 0; k < STAGES; ++k) twice[i][j] += integrals[i][k] * integrals[k][j];
            }
        for (int k = 0; k < STAGES; ++k) {
            // (-1)^(k + q) times binomials (k, q) and (k + q, q), which are exact
            double term = k % 2 ? -1.0 : 1.0;
            for (int q = 0; q < STAGES; ++q) {
                powers[k][q] = q <= k ? term : 0.0;
                term = -(term * (k - q) * (k + q + 1)) / ((q + 1.0) * (q + 1.0));
            }
        }
        // The ends, where the polynomials are worst, and the middles of some of the gaps between points.
        const int gaps[] = {1, STAGES / 4, STAGES / 2 - 1, STAGES - 1 - STAGES / 4, STAGES - 3};
        others[0] = 0.0, others[OTHERS - 1] = 1.0;
        for (int d = 1; d < OTHERS - 1; ++d) others[d] = 0.5 * (points[gaps[d - 1]] + points[gaps[d - 1] + 1]);
        for (int d = 0; d < OTHERS; ++d) {
            integrate(others[d], areas[d]);
            // By products: sums of Legendre polynomials would lose two digits at the ends.
            for (int a = 0; a < STAGES; ++a) {
                values[d][a] = 1.0;
                for (int b = 0; b < STAGES; ++b)
                    if (b != a) values[d][a] *= (others[d] - points[b]) / (points[a] - points[b]);
            }
        }
    }

    /// Integrals from 0 to x of the polynomials that are 1 at one point each.
    void integrate(double x, double* out) const {
        double p[STAGES + 2];
        legendre(2.0 * x - 1.0, STAGES, p);
        for (int i = 0; i < STAGES; ++i) {
            out[i] = x * coefficients[0][i];
            for (int k = 1; k < STAGES; ++k)
                out[i] += (p[k + 1] - p[k - 1]) / (2.0 * (2.0 * k + 1.0)) * coefficients[k][i];
        }
    }
};

const Tables& tables() {
    static const Tables made;
    return made;
}

/// Elimination with partial pivoting, in place. Returns whether no pivot is zero.
bool eliminate(Array<>& a, std::vector<int>& pivots) {
    const int size = a.rows();
    for (int k = 0; k < size; ++k) {
        int pivot = k;
        for (int r = k + 1; r < size; ++r)
            if (std::fabs(a(r, k)) > std::fabs(a(pivot, k))) pivot = r;
        pivots[k] = pivot;
        if (!(std::fabs(a(pivot, k)) > 0.0)) return false;
        for (int c = 0; pivot != k && c < size; ++c) std::swap(a(k, c), a(pivot, c));
        for (int r = k + 1; r < size; ++r) {
            const double factor = a(r, k) /= a(k, k);
            if (factor == 0.0) continue;
            for (int c = k + 1; c < size; ++c) a(r, c) -= factor * a(k, c);
        }
    }
    return true;
}

/// Replace the first `count` columns of `right` by solutions.
void solve_with(const Array<>& a, const std::vector<int>& pivots, Array<>& right, int count) {
    const int size = a.rows();
    for (int k = 0; k < size; ++k)
        for (int c = 0; pivots[k] != k && c < count; ++c) std::swap(right(k, c), right(pivots[k], c));
    for (int r = 0; r < size; ++r)
        for (int k = 0; k < r; ++k)
            for (int c = 0; c < count; ++c) right(r, c) -= a(r, k) * right(k, c);
    for (int r = size - 1; r >= 0; --r) {
        for (int k = r + 1; k < size; ++k)
            for (int c = 0; c < count; ++c) right(r, c) -= a(r, k) * right(k, c);
        for (int c = 0; c < count; ++c) right(r, c) /= a(r, r);
    }
}

}  // namespace

Collocation::Collocation(const SmoothEquations& equations)
    : equations_(equations), begin_(1, equations.size()), columns_(equations.size(), columns()),
      rates_(STAGES, half()), before_(STAGES, half()), states_(STAGES, equations.size()),
      values_(equations.program.registers, STAGES), slopes_(STAGES, half() * equations.size()),
      matrix_(STAGES * half(), STAGES * half()), right_(STAGES * half(), columns()),
      moved_(STAGES * equations.size(), columns()), others_(OTHERS, equations.size()),
      polynomial_(ORDER + 1, equations.size()), pivots_(STAGES * half()) {}

void Collocation::fly(Values z, double t, bool with_map, TaylorPath& path) {
    const int size = equations_.size();
    const double whole = std::fabs(t), direction = t >= 0.0 ? 1.0 : -1.0;
    path.begin.assign(z.begin(), z.end());
    path.duration = t;
    path.width = size;
    path.has_map = has_map_ = with_map;
    path.times.assign(1, 0.0);
    if (whole != whole) return;
    copy(z, begin_[0]);
    for (int r = 0; r < size; ++r)
        for (int c = 0; c < columns(); ++c) columns_(r, c) = r == c ? 1.0 : 0.0;
    next_ = first_length(whole);
    last_ = 0.0;
    for (double at = 0.0; at < whole;) {
        if (path.steps() == equations_.most_steps) {
            path.exhausted = true;
            return;
        }
        const double length = step(whole - at, direction), h = direction * length;
        if (!(length > 0.0)) return;
        if (with_map) {
            // The columns at the end of the step: Gauss's rule for velocities and accelerations.
            const auto& weights = tables().areas[OTHERS - 1];
            const int n = half();
            for (int c = 0; c < columns(); ++c)
                for (int r = 0; r < n; ++r) {
                    double by_place = 0.0, by_speed = 0.0;
                    for (int j = 0; j < STAGES; ++j) {
                        by_place += weights[j] * moved_(j * size + n + r, c);
                        by_speed += weights[j] * right_(j * n + r, c);
                    }
                    columns_(r, c) += h * by_place;
                    columns_(n + r, c) += h * by_speed;
                }
        }
        path.least.push_back(0.0);
        path.coefficients.insert(path.coefficients.end(), polynomial_.data(), polynomial_.data() + (ORDER + 1) * size);
        at += length;
        path.times.push_back(at);
        Local<double> end(size);
        evaluate_series<double>(Matrix<const double>(polynomial_), h, end);
        copy(end, begin_[0]);
    }
    path.end.assign(begin_[0].begin(), begin_[0].end());
    path.complete = true;
    if (!with_map) return;
    path.map = Array<>(size, size), path.along = Array<>(size, columns() - size);
    for (int r = 0; r < size; ++r)
        for (int c = 0; c < columns(); ++c) (c < size ? path.map(r, c) : path.along(r, c - size)) = columns_(r, c);
}

/// A length of the first step, from the forces' derivatives at its begin.
double Collocation::first_length(double left) {
    for (int i = 0; i < STAGES; ++i) copy(Values(begin_[0]), states_[i]);
    if (!evaluate()) return left;
    double largest = 0.0;
    for (int r = 0; r < half(); ++r) {
        double total = 0.0;
        for (int c = 0; c < half(); ++c) total += std::fabs(slopes_(0, r * equations_.size() + c));
        largest = std::max(largest, total);
    }
    return largest > 0.0 ? std::min(left, FIRST / std::sqrt(largest)) : left;
}

/// Compute a step; its length, or 0 where there is none. Its polynomial and, at the points, its columns are filled.
double Collocation::step(double left, double direction) {
    double wanted = next_;
    while (wanted > SMALLEST * left) {
        // What is left over would be a short step.
        const double length = wanted >= left ? left : 2.0 * wanted > left ? std::min(wanted, 0.5 * left) : wanted;
        const double h = direction * length;
        if (last_ > 0.0 && length <= 2.0 * last_) guess(length);
        else hold_acceleration();
        if (!solve(h)) {
            wanted = 0.3 * length;
            continue;
        }
        double speed = 0.0;
        const double share = worst_defect(h, speed) * length, limit = ORDER * DEFECT * speed;
        double factor = 4.0;
        if (!(share <= limit * std::ldexp(1.0, -2 * STAGES)))
            factor = share < INFINITE ? std::max(0.2, std::min(4.0, 0.9 * pow(limit / share, 1.0 / STAGES))) : 0.2;
        if (!(share <= limit)) {
            wanted = std::min(0.8, factor) * length;
            continue;
        }
        if (has_map_ && !carry(h)) {
            wanted = 0.7 * length;
            continue;
        }
        write_polynomials(h);
        next_ = factor * length;
        last_ = length;
        return length;
    }
    return 0.0;
}

/// The accelerations at the points of a step, by Newton's method; whether it converges.
bool Collocation::solve(double h) {
    const int n = half();
    double last = INFINITE;
    bool known = false;
    for (int round = 0; round < ITERATIONS; ++round) {
        place(h);
        if (!evaluate() || (!known && !linearise(h))) return false;
        for (int i = 0; i < STAGES; ++i)
            for (int r = 0; r < n; ++r) right_(i * n + r, 0) = acceleration(states_[i], i, r) - rates_(i, r);
        solve_with(matrix_, pivots_, right_, 1);
        double change = 0.0, size = 0.0;
        for (int i = 0; i < STAGES; ++i)
            for (int r = 0; r < n; ++r) {
                rates_(i, r) += right_(i * n + r, 0);
                change = std::max(change, std::fabs(right_(i * n + r, 0)));
                size = std::max(size, std::fabs(rates_(i, r)));
            }
        if (!(size < INFINITE)) return false;
        if (change <= 2e-16 * size || (change <= 1e-12 * size && change >= 0.25 * last)) {
            place(h);
            return true;
        }
        // Once the accelerations are near, those of the factors are as good.
        known = change <= 1e-3 * size && change <= 0.1 * last;
        last = change;
    }
    return false;
}

/// Accelerations to begin with: those of the step before go on.
void Collocation::guess(double length) {
    double p[STAGES + 1];
    for (int i = 0; i < STAGES; ++i) {
        legendre(1.0 + 2.0 * tables().points[i] * length / last_, EXTRAPOLATED - 1, p);
        for (int r = 0; r < half(); ++r) {
            double rate = before_(0, r);
            for (int k = 1; k < EXTRAPOLATED; ++k) rate += before_(k, r) * p[k];
            rates_(i, r) = rate;
        }
    }
}

/// The same where there is none: the acceleration at the begin.
void Collocation::hold_acceleration() {
    put_inputs(begin_[0], 0);
    equations_.called->forces(values_, 1);
    for (int r = 0; r < half(); ++r) {
        const double here = acceleration(begin_[0], 0, r);
        for (int i = 0; i < STAGES; ++i) rates_(i, r) = here;
    }
}

/// The states at the points, from the accelerations there.
void Collocation::place(double h) {
    const int n = half();
    const Tables& table = tables();
    for (int i = 0; i < STAGES; ++i)
        for (int r = 0; r < n; ++r) {
            double once = 0.0, twice = 0.0;
            for (int j = 0; j < STAGES; ++j) {
                once += table.integrals[i][j] * rates_(j, r);
                twice += table.twice[i][j] * rates_(j, r);
            }
            states_(i, n + r) = begin_(0, n + r) + h * once;
            states_(i, r) = begin_(0, r) + h * (table.points[i] * begin_(0, n + r) + h * twice);
        }
}

/// Forces and derivatives at the states of the points. Returns whether all are finite.
bool Collocation::evaluate() {
    const int size = equations_.size(), n = half();
    for (int i = 0; i < STAGES; ++i) put_inputs(states_[i], i);
    equations_.called->forces(values_, STAGES);
    bool finite = true;
    for (int i = 0; i < STAGES; ++i) {
        std::fill(slopes_[i].begin(), slopes_[i].end(), 0.0);
        for (int r = 0; r < n; ++r)
            for (const auto& entry : equations_.linear[r]) slopes_(i, r * size + entry.column) = entry.value;
        for (const auto& slope : equations_.program.slopes)
            for (int r = 0; r < n; ++r) {
                const double part = equations_.dense_push(r, slope.force) * values_(slope.result, i);
                for (const auto& entry : equations_.inputs[slope.input]) slopes_(i, r * size + entry.column) += part * entry.value;
            }
        for (int f : equations_.program.forces) finite = finite && std::fabs(values_(f, i)) < INFINITE;
    }
    return finite;
}

/// The factors of the derivative of the residuals by the accelerations, without sign. Returns whether it is regular.
bool Collocation::linearise(double h) {
    const int size = equations_.size(), n = half();
    const Tables& table = tables();
    for (int j = 0; j < STAGES; ++j)
        for (int r = 0; r < n; ++r) {
            for (int c = 0; c < n; ++c) {
                const double by_place = h * h * slopes_(j, r * size + c), by_speed = h * slopes_(j, r * size + n + c);
                // The acceleration at point j depends on all others through the state there.
                for (int i = 0; i < STAGES; ++i)
                    matrix_(j * n + r, i * n + c) = -by_place * table.twice[j][i] - by_speed * table.integrals[j][i];
            }
            matrix_(j * n + r, j * n + r) += 1.0;
        }
    return eliminate(matrix_, pivots_);
}

void Collocation::put_inputs(Values z, int column) {
    for (int k = 0; k < equations_.inputs.rows(); ++k) values_(k, column) = equations_.inputs.times(k, z.data());
}

/// The acceleration of coordinate r at a state, with the forces in a column.
double Collocation::acceleration(Values z, int column, int r) const {
    double total = equations_.linear.times(r, z.data());
    for (size_t f = 0; f < equations_.program.forces.size(); ++f)
        total += equations_.dense_push(r, int(f)) * values_(equations_.program.forces[f], column);
    return total;
}

/// The largest defect at the other points of a step, and the largest speed in it. What rounding changes is left out, as
/// it is no error of the step: that of the state, in the forces, and that of the accelerations, in the polynomial.
double Collocation::worst_defect(double h, double& speed) {
    const int size = equations_.size(), n = half();
    const Tables& table = tables();
    for (int i = 0; i < STAGES; ++i)
        for (int r = n; r < size; ++r) speed = std::max(speed, std::fabs(states_(i, r)));
    for (int d = 0; d < OTHERS; ++d) {
        for (int r = 0; r < n; ++r) {
            double once = 0.0, twice = 0.0;
            for (int j = 0; j < STAGES; ++j) {
                once += table.areas[d][j] * rates_(j, r);
                twice += table.areas[d][j] * states_(j, n + r);
            }
            others_(d, n + r) = begin_(0, n + r) + h * once;
            others_(d, r) = begin_(0, r) + h * twice;
        }
        put_inputs(others_[d], d);
    }
    equations_.called->forces(values_, OTHERS);
    double worst = 0.0;
    for (int d = 0; d < OTHERS; ++d)
        for (int r = 0; r < n; ++r) {
            double defect = -acceleration(others_[d], d, r), rounding = 0.0;
            for (int j = 0; j < STAGES; ++j) {
                defect += table.values[d][j] * rates_(j, r);
                rounding += std::fabs(table.values[d][j] * rates_(j, r));
            }
            for (const auto& entry : equations_.linear[r]) rounding += std::fabs(entry.value * others_(d, entry.column));
            defect = std::fabs(defect) - INPUT_ROUNDING * rounding;
            for (const auto& slope : equations_.program.slopes) {
                rounding = 0.0;
                for (const auto& entry : equations_.inputs[slope.input]) rounding += std::fabs(entry.value * others_(d, entry.column));
                const double force = values_(slope.result, d) * equations_.dense_push(r, slope.force);
                defect -= 2.0 * INPUT_ROUNDING * rounding * std::fabs(force);
            }
            if (defect != defect) return defect;
            if (defect > worst) worst = defect;
        }
    return worst;
}

/// The accelerations of the columns at the points, from the linearised equations, into `right_`; the columns there into
/// `moved_`. Returns whether their last Legendre coefficients are small.
bool Collocation::carry(double h) {
    const int size = equations_.size(), n = half(), all = columns();
    const Tables& table = tables();
    for (int i = 0; i < STAGES; ++i)
        for (int c = 0; c < all; ++c) {
            for (int r = 0; r < n; ++r) {
                moved_(i * size + n + r, c) = columns_(n + r, c);
                moved_(i * size + r, c) = columns_(r, c) + h * table.points[i] * columns_(n + r, c);
            }
            for (int r = 0; r < n; ++r) {
                double total = c < size ? 0.0 : source(equations_.sources[c - size], i, r);
                for (int s = 0; s < size; ++s) total += slopes_(i, r * size + s) * moved_(i * size + s, c);
                right_(i * n + r, c) = total;
            }
        }
    if (!linearise(h)) return false;
    solve_with(matrix_, pivots_, right_, all);
    for (int i = 0; i < STAGES; ++i)
        for (int j = 0; j < STAGES; ++j)
            for (int r = 0; r < n; ++r)
                for (int c = 0; c < all; ++c) {
                    moved_(i * size + n + r, c) += h * table.integrals[i][j] * right_(j * n + r, c);
                    moved_(i * size + r, c) += h * h * table.twice[i][j] * right_(j * n + r, c);
                }
    for (int c = 0; c < all; ++c) {
        double largest = 0.0, last = 0.0;
        for (int r = 0; r < n; ++r) {
            double tail = 0.0;
            for (int i = 0; i < STAGES; ++i) {
                largest = std::max({largest, std::fabs(moved_(i * size + n + r, c)), std::fabs(h * right_(i * n + r, c))});
                tail += table.coefficients[STAGES - 1][i] * right_(i * n + r, c);
            }
            last = std::max(last, std::fabs(h * tail));
        }
        if (!(last <= RESOLVED_PART * largest)) return false;
    }
    return true;
}

/// What a source adds to the acceleration of coordinate r at a point of a step.
double Collocation::source(const MotionSource& source, int point, int r) const {
    double total = source.linear.times(r, &states_(point, 0));
    for (int f = 0; f < source.push.columns(); ++f) total += source.push(r, f) * values_(equations_.program.forces[f], point);
    for (const auto& change : source.changes)
        total += equations_.dense_push(r, change.force) * change.weight * values_(change.result, point);
    return total;
}

/// The polynomials of the step in powers of the time from its begin.
void Collocation::write_polynomials(double h) {
    const int size = equations_.size(), n = half();
    const Tables& table = tables();
    double sums[STAGES];
    std::fill(polynomial_.data(), polynomial_.data() + (ORDER + 1) * size, 0.0);
    copy(Values(begin_[0]), polynomial_[0]);
    for (int r = 0; r < size; ++r) {
        for (int j = 0; j < STAGES; ++j) {
            sums[j] = 0.0;
            for (int i = 0; i < STAGES; ++i)
                sums[j] += table.coefficients[j][i] * (r < n ? states_(i, n + r) : rates_(i, r - n));
            if (r >= n) before_(j, r - n) = sums[j];
        }
        double scale = 1.0;  // h^k
        for (int k = 0; k < STAGES; ++k, scale *= h) {
            double total = 0.0;
            for (int j = k; j < STAGES; ++j) total += table.powers[j][k] * sums[j];
            polynomial_(k + 1, r) = total / ((k + 1) * scale);
        }
    }
}

}  // namespace saltus
