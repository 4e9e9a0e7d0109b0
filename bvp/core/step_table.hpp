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
    /// The number of blocks where all are pairs that oscillate, else 0. Where the compiler knows it, it is the parameter P of what
    /// follows, with the same arithmetic; DYNAMIC: any table.
    int pairs() const { return pairs_; }
    /// Whether no block damps, so that bounds do not become less.
    bool is_steady() const { return steady_; }
    int count() const { return count_; }
    double length(int level) const { return lengths_[level]; }
    /// The entries 11, 12, 21, 22 of exp(B h) of all blocks, `count` of each, one after another.
    const double* entries(int level) const { return entries_.data() + 4 * size_t(level) * count_; }

    /// Whether x and then y is the order of the entries themselves.
    bool is_split() const { return split_; }
    /// Take a vector of N entries apart: x, then y.
    template <int P = DYNAMIC>
    void split(const double* z, double* out) const {
        if (split_) {
            for (int r = 0; r < 2 * size<P>(); ++r) out[r] = z[r];
            return;
        }
        for (int k = 0; k < size<P>(); ++k) {
            out[k] = z[blocks_[k].first];
            out[size<P>() + k] = P != DYNAMIC || blocks_[k].is_pair() ? z[blocks_[k].second] : 0.0;
        }
    }

    /// exp(mean t) cos(w t) and exp(mean t) sin(w t) of all blocks at one time: the exact flow takes nothing else.
    template <int P = DYNAMIC>
    struct Turns {
        Local<double, P> cosine, sine;
        explicit Turns(int count) : cosine(count), sine(count) {}
    };
    /// Set the turns of a time.
    template <int P>
    void turn(double t, Turns<P>& turns) const {
        double *c = turns.cosine.data(), *s = turns.sine.data();
        for (int k = 0; k < size<P>(); ++k) sincos(shapes_[k].frequency * t, s[k], c[k]);
        for (int k = 0; k < size<P>(); ++k) {
            const Shape& shape = shapes_[k];
            if (P == DYNAMIC && shape.rigid) s[k] = t;
            if (shape.mean == 0.0) continue;
            const double decay = exp(shape.mean * t);
            c[k] *= decay, s[k] *= decay;
        }
    }
    /// The turns of a time later by less than `slight()`: five terms of the series of exp(z) - 1, with z = (mean + i w) t, are
    /// exact to rounding. The change is added. A product with the cosine of a small angle would be rounded to the same side at
    /// each impact of a nearly steady motion.
    template <int P>
    void turn_slightly(const Turns<P>& turns, double t, Turns<P>& out) const {
        const double *cosines = turns.cosine.data(), *sines = turns.sine.data();
        double *later_cosines = out.cosine.data(), *later_sines = out.sine.data();
        for (int k = 0; k < size<P>(); ++k) {
            const Shape& shape = shapes_[k];
            const double c = cosines[k], s = sines[k];
            if (P == DYNAMIC && shape.rigid) {
                later_cosines[k] = c, later_sines[k] = s + t;
                continue;
            }
            // z + z^2/2 + z^2 (z/6 + z^2 (1/24 + z/120)): short chains of products.
            const double x = shape.mean * t, y = shape.frequency * t;
            const double square = x * x - y * y, other = 2.0 * (x * y);
            const double last = 1.0 / 24.0 + x * (1.0 / 120.0), last_other = y * (1.0 / 120.0);
            const double inner = x * (1.0 / 6.0) + (square * last - other * last_other);
            const double inner_other = y * (1.0 / 6.0) + (square * last_other + other * last);
            const double real = (x + 0.5 * square) + (square * inner - other * inner_other);
            const double imaginary = (y + 0.5 * other) + (square * inner_other + other * inner);
            later_cosines[k] = c + (c * real - s * imaginary);
            later_sines[k] = s + (c * imaginary + s * real);
        }
    }
    /// A time within which `turn_slightly` holds.
    double slight() const { return slight_; }

    /// out = exp(B t) z, up to rounding as `LinearFlight::end`, with what is known of the pairs.
    template <int P>
    void flow(const double* z, const Turns<P>& turns, double* out) const {
        const double *cosines = turns.cosine.data(), *sines = turns.sine.data();
        for (int k = 0; k < size<P>(); ++k) {
            const Shape& shape = shapes_[k];
            const int i = shape.first, j = shape.second;
            const double c = cosines[k], s = sines[k], x = z[i];
            if (P == DYNAMIC && j < 0) {
                out[i] = c * x;
                continue;
            }
            const double y = z[j];
            if (P == DYNAMIC && shape.rigid) {
                out[i] = c * x + s * (shape.c11 * x + shape.c12 * y);
                out[j] = c * y + s * (shape.c21 * x + shape.c22 * y);
                continue;
            }
            // As `flow_pair`: b21 is the value that belongs to the other numbers, which are the exact ones of the energy. Rounding
            // errors of the determinant then have either sign, and the energy of many flights does not drift.
            const double part = s / shape.frequency, turned = part * x;
            out[i] = c * x + part * (shape.half * x + shape.b12 * y);
            out[j] = c * y - part * (shape.half * y) -
                (shape.frequency * (shape.frequency * turned) + shape.half * (shape.half * turned)) / shape.b12;
        }
    }

    /// out = B z.
    template <int P>
    void rate(const double* z, double* out) const {
        for (int k = 0; k < size<P>(); ++k) {
            const Block& b = blocks_[k];
            const int i = b.first, j = b.second;
            const double x = z[i];
            if (P == DYNAMIC && j < 0) {
                out[i] = b.mean * x;
                continue;
            }
            const double y = z[j];
            out[i] = b.b11 * x + b.b12 * y, out[j] = b.b21 * x + b.b22 * y;
        }
    }

    /// Amplitudes of the first entries of all blocks: every amplitude of a pair is a multiple of its one.
    template <int P>
    void radii(const double* z, double* out) const {
        for (int k = 0; k < size<P>(); ++k) {
            const Shape& shape = shapes_[k];
            const double x = z[shape.first];
            double y = P != DYNAMIC || shape.second >= 0 ? z[shape.second] : 0.0;
            if (P != DYNAMIC || !shape.rigid) y = shape.c11 * x + shape.c12 * y;
            out[k] = std::sqrt(x * x + y * y);
        }
    }
    /// The amplitudes of row . z for first entries of amplitude 1, one of each block.
    void reaches(Values row, double* out) const;
    /// out = the row of the rate of row . z.
    void rate_row(Values row, Vector<double> out) const;
    /// What rounding errors of row . z are relative to, the same way.
    void sizes(Values row, double* out) const;

    /// Bounds of f = row . z and of its derivatives from a state on, for all times up to a horizon.
    struct Amplitudes {
        double level = 0.0, second = 0.0, third = 0.0, fourth = 0.0, fifth = 0.0;
    };
    /// radii: of the state; reaches: of the row. Of a rigid pair both are taken anew.
    template <int P>
    Amplitudes amplitudes(Values row, const double* reaches, const double* z, const double* radii, double horizon) const {
        Amplitudes out;
        for (int k = 0; k < size<P>(); ++k) {
            const Shape& shape = shapes_[k];
            double level = reaches[k] * radii[k];
            if (P == DYNAMIC && shape.rigid) {
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
            out.fifth += shape.square * (shape.rate * second);
        }
        return out;
    }

private:
    struct Shape {
        double c11, c12, c21, c22;  // D/w of a pair that oscillates, D of a rigid one, else 0
        double square, rate;        // |eigenvalue|^2, |eigenvalue|
        double mean, frequency;     // 0 of a single index and of a rigid pair
        double half, b12;           // (b11 - b22)/2
        bool rigid;
        int first, second;          // the indices; second < 0: there is none
    };
    template <int P>
    int size() const { return P == DYNAMIC ? count_ : P; }

    bool usable_ = false, steady_ = true, split_ = true;
    int count_ = 0, pairs_ = 0;
    double slight_ = 0.0;
    double lengths_[LEVELS];
    std::vector<Block> blocks_;
    std::vector<Shape> shapes_;
    std::vector<double> entries_;
};

}  // namespace saltus
