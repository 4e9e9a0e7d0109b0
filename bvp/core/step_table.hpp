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

    /// exp(mean t) cos(w t) and exp(mean t) sin(w t) of all blocks at one time: the exact flow takes nothing else.
    struct Turns {
        Local<double, DYNAMIC, 32> cosine, sine;
        explicit Turns(int count) : cosine(count), sine(count) {}
    };
    /// Set the turns of a time.
    void turn(double t, Turns& turns) const {
        double *c = turns.cosine.data(), *s = turns.sine.data();
        for (int k = 0; k < count_; ++k) sincos(frequencies_[k] * t, s[k], c[k]);
        for (int k = 0; k < count_; ++k) {
            if (shapes_[k].rigid) s[k] = t;
            if (blocks_[k].mean == 0.0) continue;
            const double decay = exp(blocks_[k].mean * t);
            c[k] *= decay, s[k] *= decay;
        }
    }
    /// The turns of a time later by less than `SLIGHT` over the fastest rate: five terms of a series are exact to
    /// rounding. The change is added. A product with the cosine of a small angle would be rounded to the same side at
    /// each impact of a nearly steady motion.
    void turn_slightly(const Turns& turns, double t, Turns& out) const {
        const double *cosines = turns.cosine.data(), *sines = turns.sine.data();
        double *later_cosines = out.cosine.data(), *later_sines = out.sine.data();
        for (int k = 0; k < count_; ++k) {
            const double c = cosines[k], s = sines[k];
            if (shapes_[k].rigid) {
                later_cosines[k] = c, later_sines[k] = s + t;
                continue;
            }
            const double x = blocks_[k].mean * t, y = frequencies_[k] * t;
            double real = 1.0, imaginary = 0.0;
            for (const double factor : {1.0 / 5.0, 1.0 / 4.0, 1.0 / 3.0, 1.0 / 2.0}) {
                const double product = (real * y + imaginary * x) * factor;
                real = 1.0 + (real * x - imaginary * y) * factor;
                imaginary = product;
            }
            const double product = real * y + imaginary * x;
            real = real * x - imaginary * y;
            later_cosines[k] = c + (c * real - s * product);
            later_sines[k] = s + (c * product + s * real);
        }
    }
    /// A time, over the fastest rate of all blocks, within which `turn_slightly` holds.
    static constexpr double SLIGHT = 2e-3;
    double slight() const {
        double fastest = 0.0;
        for (const Shape& shape : shapes_) fastest = shape.rate > fastest ? shape.rate : fastest;
        return SLIGHT / fastest;
    }

    /// out = exp(B t) z, up to rounding as `LinearFlight::end`, with what is known of the pairs.
    template <class Out>
    void flow(Values z, const Turns& turns, Out&& out) const {
        const double *cosines = turns.cosine.data(), *sines = turns.sine.data();
        for (int k = 0; k < count_; ++k) {
            const Block& b = blocks_[k];
            const Shape& shape = shapes_[k];
            const double c = cosines[k], s = sines[k], x = z[b.first];
            if (!b.is_pair()) {
                out[b.first] = c * x;
                continue;
            }
            const double y = z[b.second];
            out[b.first] = c * x + s * (shape.c11 * x + shape.c12 * y);
            if (shape.rigid) {
                out[b.second] = c * y + s * (shape.c21 * x + shape.c22 * y);
            } else {
                // c21 by the other entries of D/w, whose square is -1: rounding errors of the determinant then have either
                // sign, and the energy of many flights does not drift.
                const double turned = s * x;
                out[b.second] = c * y + s * (shape.c22 * y) - (turned + shape.c11 * (shape.c11 * turned)) / shape.c12;
            }
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

    /// Amplitudes of the first entries of all blocks: every amplitude of a pair is a multiple of its one.
    void radii(Values z, double* out) const {
        for (int k = 0; k < count_; ++k) {
            const Shape& shape = shapes_[k];
            const double x = z[blocks_[k].first];
            double y = blocks_[k].is_pair() ? z[blocks_[k].second] : 0.0;
            if (!shape.rigid) y = shape.c11 * x + shape.c12 * y;
            out[k] = std::sqrt(x * x + y * y);
        }
    }
    /// The amplitudes of row . z for first entries of amplitude 1, one of each block.
    void reaches(Values row, double* out) const;
    /// What rounding errors of row . z are relative to, the same way.
    void sizes(Values row, double* out) const;

    /// Bounds of f = row . z and of its derivatives from a state on, for all times up to a horizon.
    struct Amplitudes {
        double level = 0.0, second = 0.0, third = 0.0, fourth = 0.0;
    };
    /// radii: of the state; reaches: of the row. Of a rigid pair both are taken anew.
    Amplitudes amplitudes(Values row, const double* reaches, Values z, const double* radii, double horizon) const {
        Amplitudes out;
        for (int k = 0; k < count_; ++k) {
            const Shape& shape = shapes_[k];
            double level = reaches[k] * radii[k];
            if (shape.rigid) {
                const double a = row[blocks_[k].first], b = row[blocks_[k].second];
                const double x = z[blocks_[k].first], y = z[blocks_[k].second];
                level = std::fabs(a * x + b * y) + horizon *
                    std::fabs(a * (shape.c11 * x + shape.c12 * y) + b * (shape.c21 * x + shape.c22 * y));
                if (!(level >= 0.0)) level = std::fabs(a * x + b * y);  // no rate over an infinite time
            }
            const double second = shape.square * level;
            out.level += level;
            out.second += second;
            out.third += shape.rate * second;
            out.fourth += shape.square * second;
        }
        return out;
    }

private:
    struct Shape {
        double c11, c12, c21, c22;  // D/w of a pair that oscillates, D of a rigid one, else 0
        double square, rate;        // |eigenvalue|^2, |eigenvalue|
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
