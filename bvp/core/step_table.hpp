/// Steps of fixed length along a linear flight: exp(B h), exp(B h/2), .. are computed once, so a step costs a few
/// products.
#pragma once

#include "blocks.hpp"

namespace saltus {

/// The table of a flight whose blocks are single indices and pairs that neither grow nor are overdamped. It takes a
/// state apart into x and y: the first and second entries of all blocks (y = 0 of a single index).
class StepTable {
public:
    static constexpr int LEVELS = 12;
    /// The longest step, in radians of the fastest pair.
    static constexpr double REACH = 1.4;

    StepTable() = default;
    explicit StepTable(const std::vector<Block>& blocks);

    bool is_usable() const { return usable_; }
    /// Whether no block damps, so that bounds do not become less.
    bool is_steady() const { return steady_; }
    int count() const { return count_; }
    double length(int level) const { return lengths_[level]; }
    /// The entries 11, 12, 21, 22 of exp(B h) of all blocks, `count` of each, one after another.
    const double* entries(int level) const { return entries_.data() + 4 * size_t(level) * count_; }

    /// Whether x and then y is the order of the entries themselves.
    bool is_split() const { return split_; }
    /// Take a vector of N entries apart: x, then y.
    void split(Values z, double* out) const {
        if (split_) {
            for (int r = 0; r < 2 * count_; ++r) out[r] = z[r];
            return;
        }
        for (int k = 0; k < count_; ++k) {
            out[k] = z[blocks_[k].first];
            out[count_ + k] = blocks_[k].is_pair() ? z[blocks_[k].second] : 0.0;
        }
    }

    /// out = exp(B t) z, up to rounding as `LinearFlight::end`, with what is known of the pairs.
    template <class Out>
    void flow(Values z, double t, Out&& out) const {
        Local<double, DYNAMIC, 32> cosines(count_), sines(count_);
        double *c = cosines.data(), *s = sines.data();
        for (int k = 0; k < count_; ++k) sincos(frequencies_[k] * t, s[k], c[k]);
        for (int k = 0; k < count_; ++k) {
            const Block& b = blocks_[k];
            const Shape& shape = shapes_[k];
            const double decay = b.mean == 0.0 ? 1.0 : exp(b.mean * t), x = z[b.first];
            if (!b.is_pair()) {
                out[b.first] = decay * x;
                continue;
            }
            const double y = z[b.second], slope = shape.rigid ? t : s[k];
            out[b.first] = decay * (c[k] * x + slope * (shape.c11 * x + shape.c12 * y));
            out[b.second] = decay * (c[k] * y + slope * (shape.c21 * x + shape.c22 * y));
        }
    }

    /// out = B z.
    template <class Z>
    void rate(const Z& z, double* out) const {
        for (int k = 0; k < count_; ++k) {
            const Block& b = blocks_[k];
            const double x = z[b.first];
            if (!b.is_pair()) {
                out[b.first] = b.mean * x;
                continue;
            }
            const double y = z[b.second];
            out[b.first] = b.b11 * x + b.b12 * y, out[b.second] = b.b21 * x + b.b22 * y;
        }
    }

    /// The state after the longest step.
    void step(Values z, Vector<double> out) const {
        const double* e = entries(0);
        for (int k = 0; k < count_; ++k) {
            const int i = blocks_[k].first, j = blocks_[k].second;
            out[i] = e[k] * z[i];
            if (!blocks_[k].is_pair()) continue;
            out[i] += e[count_ + k] * z[j];
            out[j] = e[2 * count_ + k] * z[i] + e[3 * count_ + k] * z[j];
        }
    }

    /// Bounds of f = row . z and of its derivatives from a state on, for all times up to a horizon.
    struct Amplitudes {
        double level, second, third, fourth;
        double size;  // what rounding errors of f are relative to
    };
    Amplitudes amplitudes(Values row, Values z, double horizon) const;

private:
    struct Shape {
        double c11, c12, c21, c22;  // D/w of a pair that oscillates, D of a rigid one, else 0
        double square, rate;        // |eigenvalue|^2, |eigenvalue|
        double up, down;            // ratios of the two entries of a pair
        bool rigid;
    };
    bool usable_ = false, steady_ = true, split_ = true;
    int count_ = 0;
    double lengths_[LEVELS];
    std::vector<Block> blocks_;
    std::vector<Shape> shapes_;
    std::vector<double> frequencies_;  // 0 of a single index and of a rigid pair
    std::vector<double> entries_;
};

}  // namespace saltus
