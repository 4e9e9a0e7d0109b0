/// Arclength along families under loads: of the first node, its time and the parameters.
#pragma once

#include "forced.hpp"
#include "step.hpp"

namespace saltus {

/// A state x in its units gives x/R and log R, R = sqrt(1 + |x|^2). A parameter p with a unit u gives asinh(p/u), and
/// without one log p. The time gives c_0; without a clock, the logarithm of the duration.
template <class Flight, int P>
class Metric<ForcedProblem<Flight, P>> {
public:
    using Problem = ForcedProblem<Flight, P>;
    explicit Metric(const Problem& problem)
        : position(problem.coordinates()), direction(problem.coordinates()), problem_(problem), y_(problem.unknowns()) {}

    std::vector<double> position, direction;  // (N + 2 + P,)
    double energy = 0.0, alpha = 0.0;         // the first parameter and the period
    double change = 0.0;                      // of the first parameter along the tangent of `direct`

    void locate(Values y) {
        const int n = problem_.size(), count = problem_.released();
        copy(y, y_);
        double total = 1.0;
        for (int r = 0; r < n; ++r) {
            position[r] = y[problem_.begin(0) + r] / unit(r);
            total += position[r] * position[r];
        }
        reach_ = std::sqrt(total);
        for (int r = 0; r < n; ++r) position[r] /= reach_;
        alpha = problem_.has_clock() ? problem_.cycle(y) : problem_.total_time(y);
        position[n] = problem_.has_clock() ? y[problem_.time(0)] : logarithm(alpha);
        for (int j = 0; j < count; ++j) {
            const double p = y[problem_.parameter(j)], u = unit(n + 1 + j);
            position[n + 1 + j] = u > 0.0 ? asinh(p / u) : logarithm(p);
        }
        position[n + 1 + count] = log(reach_);
        energy = count > 0 ? y[problem_.parameter(0)] : 0.0;
    }

    double direct(Values tangent) {
        const int n = problem_.size(), count = problem_.released();
        double radial = 0.0;
        for (int r = 0; r < n; ++r) {
            direction[r] = tangent[problem_.begin(0) + r] / unit(r) / reach_;
            radial += position[r] * direction[r];
        }
        for (int r = 0; r < n; ++r) direction[r] -= position[r] * radial;
        direction[n] = problem_.has_clock() ? tangent[problem_.time(0)] : problem_.total_time(tangent) / alpha;
        for (int j = 0; j < count; ++j)
            direction[n + 1 + j] = tangent[problem_.parameter(j)] / hypot(unit(n + 1 + j), y_[problem_.parameter(j)]);
        direction[n + 1 + count] = radial;
        change = count > 0 ? tangent[problem_.parameter(0)] : 0.0;
        return std::sqrt(dot(direction, direction));
    }

    void constraint_row(Vector<double> row) const {
        const int n = problem_.size(), count = problem_.released();
        std::fill(row.begin(), row.end(), 0.0);
        double along = direction[n + 1 + count];
        for (int r = 0; r < n; ++r) along -= direction[r] * position[r];
        for (int r = 0; r < n; ++r) row[problem_.begin(0) + r] = (direction[r] + position[r] * along) / (unit(r) * reach_);
        for (int j = 0; j < count; ++j)
            row[problem_.parameter(j)] = direction[n + 1 + j] / hypot(unit(n + 1 + j), y_[problem_.parameter(j)]);
        if (problem_.has_clock()) row[problem_.time(0)] = direction[n];
        else
            for (int i = 0; i <= problem_.inner(); ++i) row[problem_.time(i)] = direction[n] / alpha;
    }

private:
    double unit(int r) const { return problem_.units()[r]; }
    static double logarithm(double x) { return x > 0.0 ? log(x) : -INFINITE; }

    const Problem& problem_;
    std::vector<double> y_;
    double reach_ = 1.0;
};

}  // namespace saltus
