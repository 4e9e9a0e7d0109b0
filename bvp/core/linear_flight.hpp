/// Exact linear flight: the seam between flights and what uses them, and its kind for z' = B z.
///
/// A flight class has these members; another kind of flight provides the same.
///     size()                        N, entries of a state; constexpr where it is known to the compiler
///     end(z, t, out)                state after a time, for any number type
///     end(z, t, out, map)           the same, and its derivative by the state; NaN where the flight has no end
///     rate(z, out)                  z'
///     carry(map, x, out)            out = map x, with what is known of the map's pattern
///     path_of(flight, z, duration)  a function beside it: an object for evaluations along one flight, see path.hpp
///     twice_energy(z), energy_slope(z, out), bend(z, factor, add)   2 H of the conserved energy H, its gradient, its second
///                                   derivative
///     is_series()                   whether flights are series with an error, and can have cuts (equation (45))
///     velocity_unit(z, v, t)        the unit of residuals of velocities at the end z of a flight: a typical velocity v; or
///                                   the change of the velocities there in a typical duration t, if that is more
///     keep(count)                   where flights are series: how many are kept, by state and duration
#pragma once

#include <algorithm>

#include "step_table.hpp"

namespace saltus {

/// Linear flight of N states; N may be DYNAMIC.
template <int N = DYNAMIC>
class LinearFlight {
public:
    static constexpr int SIZE = N;
    template <class T>
    using State = Local<T, N>;

    /// matrix (N, N) is zero outside the blocks; weights (N,): H = sum(weights z^2)/2. tabled: whether many steps of fixed
    /// length are taken.
    LinearFlight(std::vector<Block> blocks, Array<> matrix, std::vector<double> weights, bool tabled = true)
        : blocks_(std::move(blocks)), exchanges_(blocks_.begin(), blocks_.end()), matrix_(std::move(matrix)),
          weights_(std::move(weights)) {
        for (const Block& block : blocks_) {
            steady_ = steady_ && block.is_steady();
            if (!block.is_steady()) growth_ = std::fmax(growth_, growth_of(matrix_, block));
            fastest_ = std::fmax(fastest_, fastest_of(matrix_, block));
        }
        if (tabled) steps_ = StepTable(blocks_);
    }

    /// The same flights, with a size that the compiler knows in one of the two.
    template <int M>
        requires(M != N)
    explicit LinearFlight(const LinearFlight<M>& other)
        : LinearFlight(other.blocks(), copy_of(other.matrix()), {other.weights().begin(), other.weights().end()}) {}

    constexpr int size() const {
        if constexpr (N != DYNAMIC) return N;
        return matrix_.rows();
    }
    Matrix<const double> matrix() const { return matrix_; }
    const std::vector<Block>& blocks() const { return blocks_; }
    Values weights() const { return weights_; }
    static constexpr bool is_series() { return false; }
    /// Forces are no larger than displacements.
    double velocity_unit(Values, double velocity, double) const { return velocity; }

    /// Whether no block damps or grows: bounds of one instant then hold at all later ones.
    bool is_steady() const { return steady_; }
    /// A bound of the growth rate of every block, at least 0.
    double growth() const { return growth_; }
    /// A rate that bounds how fast the terms of the series of a path can grow.
    double fastest() const { return fastest_; }
    /// Steps of fixed length; the table may be unusable.
    const StepTable& steps() const { return steps_; }

    /// out = exp(B t) z, equation (23) for each block. `out` and z may be the same.
    template <class T, class Z, class Out>
    void end(const Z& z, const T& t, Out&& out) const {
        for (const Block& block : blocks_) {
            const int i = block.first, j = block.second;
            if (j >= 0) {
                const Square2<T> e = flow_pair(block, t);
                const auto a = z[i], b = z[j];
                out[i] = e.e11 * a + e.e12 * b;
                out[j] = e.e21 * a + e.e22 * b;
            } else if (j == -1) {
                out[i] = exp(block.mean * t) * z[i];
            } else {
                LocalSquare<T> flow(-j);
                flow_large<double, T>(matrix_, i, -j, t, flow);
                Local<T> ends(-j);
                for (int r = 0; r < -j; ++r) {
                    T entry = flow(r, 0) * z[i];
                    for (int q = 1; q < -j; ++q) entry += flow(r, q) * z[i + q];
                    ends[r] = entry;
                }
                for (int r = 0; r < -j; ++r) out[i + r] = ends[r];
            }
        }
    }

    /// exp(B t), dense.
    void map(double t, Matrix<double> out) const {
        std::fill(out.data(), out.data() + out.rows() * out.columns(), 0.0);
        for (const Block& block : blocks_) {
            const int i = block.first, j = block.second;
            if (j >= 0) {
                const Square2<double> e = flow_pair(block, t);
                out(i, i) = e.e11, out(i, j) = e.e12, out(j, i) = e.e21, out(j, j) = e.e22;
            } else if (j == -1) {
                out(i, i) = exp(block.mean * t);
            } else {
                LocalSquare<double> flow(-j);
                flow_large<double, double>(matrix_, i, -j, t, flow);
                for (int r = 0; r < -j; ++r) copy(flow[r], out[i + r].subspan(i, -j));
            }
        }
    }

    template <class Z, class Out>
    void end(const Z& z, double t, Out&& out, Matrix<double> derivative) const {
        map(t, derivative);
        carry(derivative, z, out);
    }

    /// out = matrix z for a matrix that is zero outside the blocks; `out` and z differ.
    template <class Z, class Out>
    void carry(Matrix<const double> matrix, const Z& z, Out&& out) const {
        for (const Block& block : blocks_) {
            const int i = block.first, j = block.second;
            if (j >= 0) {
                const auto a = z[i], b = z[j];
                out[i] = matrix(i, i) * a + matrix(i, j) * b;
                out[j] = matrix(j, i) * a + matrix(j, j) * b;
            } else {
                for (int r = i; r < i + block.size(); ++r) {
                    auto entry = matrix(r, i) * z[i];
                    for (int q = i + 1; q < i + block.size(); ++q) entry += matrix(r, q) * z[q];
                    out[r] = entry;
                }
            }
        }
    }

    /// out = B z.
    template <class Z, class Out>
    void rate(const Z& z, Out&& out) const { carry(matrix_, z, out); }

    /// Bounds of |f|, |f''| and |f'''| for f(t) = row . exp(B t) z over 0 <= t <= horizon, equation (24).
    Bounds bounds(Values row, Values z, double horizon) const {
        constexpr double MARGIN = 1.0 + 1e-9;  // far more than the rounding of the bounds
        Bounds found;
        for (const Block& block : blocks_) add_bounds(matrix_, block, row, z, horizon, found);
        return {found.level * MARGIN, found.second * MARGIN, found.third * MARGIN};
    }

    /// Sixteen rounding errors of row . z for a computed state z. The two entries of a pair exchange their energy, so each rounds with
    /// the size of both: at its frequency, or its fast rate.
    template <class Row, class Z>
    double rounding_level(const Row& row, const Z& z) const {
        double total = 0.0;
        const Exchange* exchange = exchanges_.data();
        for (const Block& block : blocks_) {
            const int i = block.first, j = block.second;
            if (j >= 0) {
                total += std::fabs(row[i]) * (std::fabs(z[i]) + exchange->up * std::fabs(z[j]));
                total += std::fabs(row[j]) * (std::fabs(z[j]) + exchange->down * std::fabs(z[i]));
            } else {
                double weight = 0.0, level = 0.0;
                for (int r = i; r < i + block.size(); ++r) weight += std::fabs(row[r]), level += std::fabs(z[r]);
                total += weight * level;
            }
            ++exchange;
        }
        return ROUNDING * total;
    }

    /// 2 H.
    template <class Z>
    auto twice_energy(const Z& z) const {
        auto total = weights_[0] * z[0] * z[0];
        for (int r = 1; r < size(); ++r) total += weights_[r] * z[r] * z[r];
        return total;
    }
    /// out = grad H.
    template <class Z, class Out>
    void energy_slope(const Z& z, Out&& out) const {
        for (int r = 0; r < size(); ++r) out[r] = weights_[r] * z[r];
    }
    /// Call add(r, c, entry) for each entry of the second derivative of H at z, times a factor.
    template <class Z, class Add>
    void bend(const Z&, double factor, Add&& add) const {
        for (int r = 0; r < size(); ++r) add(r, r, factor * weights_[r]);
    }

private:
    /// What the first entry of a pair takes of the second one, and the other way, when they exchange their energy.
    struct Exchange {
        double up = 0.0, down = 0.0;
        Exchange(const Block& block) {
            if (!block.is_pair()) return;
            const double y = std::fabs(block.b12), x = std::fabs(block.b21);
            if (y == 0.0 || x == 0.0) return;
            const double pace = std::fmax(std::sqrt(x * y), 0.5 * std::fabs(block.b11 + block.b22));
            up = y / pace, down = x / pace;
        }
    };

    std::vector<Block> blocks_;
    std::vector<Exchange> exchanges_;
    Array<> matrix_;
    std::vector<double> weights_;
    StepTable steps_;
    bool steady_ = true;
    double growth_ = 0.0, fastest_ = 0.0;
};

}  // namespace saltus
