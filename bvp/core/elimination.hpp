/// Orthogonal elimination of a block-bidiagonal Jacobian, equation (32).
///
/// J has one row less than columns. Each block of m equations couples its own unknowns with the next ones only, and a
/// few closing equations couple any. Householder reflections that work inside a moving window give J^T = Q [R; 0]
/// without pivoting and without growth:
///     least-norm solution of J d = f:   d = Q [R^-T f; 0]
///     null vector of J:                 t = Q e_last
/// both backward stable, for whatever growth the blocks have. The cost is linear in the number of blocks.
#pragma once

#include <algorithm>

#include "array.hpp"
#include "blocks.hpp"

namespace saltus {

/// J^T = Q [R; 0] for blocks of M equations (DYNAMIC: any number). It knows nothing of what the equations are.
///
/// J^T is stored row by row: a row holds the entries of one unknown in the equations of one block, so that reflections
/// run along equations.
template <int M = DYNAMIC>
class BlockElimination {
public:
    /// blocks: their number. start: unknowns of the first block; each later one has m. closers: closing equations; they
    /// are of the last block's unknowns alone, or (couples) of any.
    /// shared: the last unknowns, which may be in all equations. In J^T their rows would fill all others. So each block
    /// gets copies of its own, and equations that make them equal. These copies are in all that follows called unknowns.
    BlockElimination(int blocks, int block_size, int start, int closers, bool couples, int shared = 0)
        : blocks_(blocks), m_(block_size + shared), start_(start + shared), closers_(closers), shared_(shared),
          closing_first_(couples || blocks == 0 ? 0 : blocks - 1), unknowns_(blocks * m_ + closers + 1),
          window_(blocks * (2 * m_ + start_), m_), closing_(unknowns_, closers),
          reflectors_(blocks * m_, start_ + m_), closing_reflectors_(closers, closers + 1), length_(blocks * m_),
          diagonal_(unknowns_ - 1), factor_(unknowns_ - 1), norm_(unknowns_ - 1), copies_(shared > 0 ? unknowns_ : 0),
          spread_(std::sqrt(blocks + 1.0)) {}

    /// Number of unknowns with one copy of each shared one.
    int unknowns() const { return unknowns_ - blocks_ * shared_; }
    int blocks() const { return blocks_; }
    /// Equations of a block, without those that make copies equal.
    int block_size() const { return m() - shared_; }
    /// Whether the equations of block i can have an unknown, which is not shared.
    bool has(int i, int unknown) const {
        const int row = place(unknown) - (i - 1) * m();
        return (i > 0 ? 0 : m()) <= row && row < window_rows();
    }

    /// Set all entries to zero.
    void clear() {
        std::fill(window_.data(), window_.data() + window_.rows() * window_.columns(), 0.0);
        std::fill(closing_.data(), closing_.data() + closing_.rows() * closing_.columns(), 0.0);
        for (int i = 0; i < blocks_; ++i)
            for (int j = 0; j < shared_; ++j) {
                window(i, m() + start_ - shared_ + j)[m() - shared_ + j] = 1.0;
                window(i, 2 * m() + start_ - shared_ + j)[m() - shared_ + j] = -1.0;
            }
    }
    /// The entries of one unknown, which is not shared, in the equations of block i, (m,).
    double* entries(int i, int unknown) { return window(i, place(unknown) - (i - 1) * m()); }
    /// Its entries in the closing equations, (c,).
    double* closing(int unknown) { return closing_row(place(unknown)); }
    /// The same of a shared unknown, of which the entries are those of an unknown of size `spread`.
    double* shared_entries(int i, int j) { return window(i, m() + start_ - shared_ + j); }
    double* shared_closing(int j) { return closing_row(copy_of(blocks_, j)); }
    /// What an unknown is multiplied by that stands for all copies of it: a vector is then as long as with one copy.
    double spread() const { return spread_; }

    /// The matrix J of the entries, (u - 1, u), before `factorise`.
    void dense(Matrix<double> out) {
        std::fill(out.data(), out.data() + out.rows() * out.columns(), 0.0);
        const int rows = m() - shared_;
        for (int i = 0; i < blocks_; ++i)
            for (int r = i > 0 ? 0 : m(); r < window_rows(); ++r) {
                const auto [column, factor] = unknown_of((i - 1) * m() + r);
                for (int e = 0; e < rows; ++e) out(i * rows + e, column) += factor * window(i, r)[e];
            }
        for (int r = 0; r < unknowns_; ++r) {
            const auto [column, factor] = unknown_of(r);
            for (int e = 0; e < closers_; ++e) out(blocks_ * rows + e, column) += factor * closing_row(r)[e];
        }
    }

    /// Sign of the determinant that goes with the null vector, and smallest diagonal entry of R as a part of the length
    /// of its equation.
    struct Pivots {
        double sign, smallest;
    };

    /// Factorise J. least (c,): squares of lengths that closing equations have at least.
    Pivots factorise(Values least) {
        measure(least);
        int reflections = 0;
        for (int i = 0; i < blocks_; ++i) reflections += eliminate(i);
        reflections += eliminate_closing();
        Pivots found{reflections % 2 ? -1.0 : 1.0, 1.0};
        for (int j = 0; j < unknowns_ - 1; ++j) {
            if (diagonal_[j] < 0.0) found.sign = -found.sign;
            found.smallest =
                std::min(found.smallest, norm_[j] > 0.0 ? std::fabs(diagonal_[j]) / std::sqrt(norm_[j]) : 0.0);
        }
        return found;
    }

    /// out = the least-norm solution of J out = right; `right` is overwritten.
    void solve(Vector<double> right, Vector<double> out) {
        if (shared_ > 0) {
            const int rows = m() - shared_;
            std::fill(copies_.begin(), copies_.end(), 0.0);
            for (int i = 0; i < blocks_; ++i) std::copy_n(&right[i * rows], rows, &copies_[i * m()]);
            std::copy_n(&right[blocks_ * rows], closers_, &copies_[blocks_ * m()]);
            forward({copies_.data(), size_t(unknowns_ - 1)});
            apply_reflectors(copies_);
            return gather(out);
        }
        forward(right);
        std::copy(right.begin(), right.begin() + unknowns_ - 1, out.begin());
        out[unknowns_ - 1] = 0.0;
        apply_reflectors(out);
    }

    /// The null vector of J, of unit length. Its entry along the last reflected axis is positive: the sign of `Pivots`
    /// is for this.
    void null_vector(Vector<double> out) {
        const Vector<double> x = shared_ > 0 ? Vector<double>(copies_) : out;
        std::fill(x.begin(), x.end(), 0.0);
        x[unknowns_ - 1] = 1.0;
        apply_reflectors(x);
        if (shared_ > 0) gather(out);
    }

    /// Size of the smallest singular value of J with its equations scaled to length 1: from the growth of two right
    /// sides of unit entries with irregular signs. right (u - 1,): scratch.
    double conditioning(Vector<double> right) {
        double largest = 0.0;
        if (shared_ > 0) right = Vector<double>(copies_.data(), unknowns_ - 1);
        for (int pattern = 0; pattern < 2; ++pattern) {
            for (int j = 0; j < unknowns_ - 1; ++j) {
                const int k = j % 5;  // the square of a large j is no int
                const bool up = (k * (7 + 4 * pattern) + k * k * (3 - pattern)) % 5 < 3 - pattern;
                right[j] = up ? std::sqrt(norm_[j]) : -std::sqrt(norm_[j]);
            }
            forward(right);
            for (int j = 0; j < unknowns_ - 1; ++j) largest = std::max(largest, std::fabs(right[j]));
        }
        return largest > 0.0 ? 1.0 / largest : 1.0;
    }

    /// x <- Q x.
    void apply_reflectors(Vector<double> x) const {
        const int first = blocks_ * m();
        for (int e = closers_ - 1; e >= 0; --e)
            reflect(closing_reflectors_[e], closers_ + 1 - e, factor_[first + e], &x[first + e]);
        for (int j = first - 1; j >= 0; --j) reflect(reflectors_[j], length_[j], factor_[j], &x[j]);
    }

    /// x <- R^-T x.
    void forward(Vector<double> x) const {
        Local<double, M> total(m());
        for (int i = 0; i < blocks_; ++i) {
            double* own = &x[i * m()];
            for (int e = 0; e < m(); ++e) total[e] = own[e];
            if (i > 0)
                for (int r = 0; r < m(); ++r) subtract(window(i, r), m(), own[r - m()], &total[0]);
            for (int e = 0; e < m(); ++e) {
                own[e] = total[e] / diagonal_[i * m() + e];
                subtract(window(i, m() + e), m(), own[e],
                         &total[0]);  // the entries below the diagonal are of no later use
            }
        }
        const int first = blocks_ * m();
        for (int r = closing_first_ * m(); r < first + closers_; ++r) {
            if (r >= first) x[r] /= diagonal_[r];
            for (int e = std::max(0, r - first + 1); e < closers_; ++e) x[first + e] -= closing_(r, e) * x[r];
        }
    }

private:
    constexpr int m() const {
        if constexpr (M != DYNAMIC) return M;
        return m_;
    }
    double* closing_row(int at) { return closing_.data() + std::ptrdiff_t(at) * closers_; }
    int window_rows() const { return 2 * m() + start_; }
    double* window(int i, int r) { return window_.data() + std::ptrdiff_t(i * window_rows() + r) * m(); }
    const double* window(int i, int r) const { return window_.data() + std::ptrdiff_t(i * window_rows() + r) * m(); }

    /// Where unknown x, which is not shared, stands among the copies.
    int place(int x) const {
        const int start = start_ - shared_;
        if (shared_ == 0 || x < start) return x;
        return x + shared_ * std::min(1 + (x - start) / (m() - shared_), blocks_ + 1);
    }
    /// Copy i of shared unknown j.
    int copy_of(int i, int j) const { return i * m() + start_ - shared_ + j; }
    /// The unknown at a place, and the factor of what stands there.
    std::pair<int, double> unknown_of(int at) const {
        const int block = at < start_ ? 0 : 1 + (at - start_) / m(), within = at < start_ ? at : (at - start_) % m();
        const int width = (block == 0 ? start_ : m()) - shared_;
        if (shared_ == 0 || block > blocks_) return {at - std::min(block, blocks_ + 1) * shared_, 1.0};
        if (within >= width) return {unknowns() - shared_ + within - width, 1.0 / spread_};
        return {at - block * shared_, 1.0};
    }
    /// out = the unknowns of `copies_`.
    void gather(Vector<double> out) const {
        for (int x = 0; x < unknowns() - shared_; ++x) out[x] = copies_[place(x)];
        for (int j = 0; j < shared_; ++j) out[unknowns() - shared_ + j] = copies_[copy_of(0, j)] * spread_;
    }

    static void subtract(const double* row, int count, double factor, double* total) {
        for (int e = 0; e < count; ++e) total[e] -= row[e] * factor;
    }

    /// v . x in two sums, which do not wait for each other.
    static double product(const double* v, const double* x, int count) {
        double even = 0.0, odd = 0.0;
        int r = 0;
        for (; r + 1 < count; r += 2) even += v[r] * x[r], odd += v[r + 1] * x[r + 1];
        if (r < count) even += v[r] * x[r];
        return even + odd;
    }

    static void reflect(Vector<const double> v, int count, double factor, double* x) {
        if (factor == 0.0) return;
        const double along = factor * product(v.data(), x, count);
        for (int r = 0; r < count; ++r) x[r] -= along * v[r];
    }

    /// Reflect W columns of rows that are `stride` apart. Their sums stay in registers.
    template <int W>
    static void reflect_some(const double* v, int count, double factor, double* rows, int stride) {
        double along[W] = {};
        const double* row = rows;
        for (int r = 0; r < count; ++r, row += stride)
            for (int c = 0; c < W; ++c) along[c] += v[r] * row[c];
        for (int c = 0; c < W; ++c) along[c] *= factor;
        for (int r = 0; r < count; ++r, rows += stride)
            for (int c = 0; c < W; ++c) rows[c] -= along[c] * v[r];
    }

    /// Reflect columns begin .. end - 1. If the compiler knows the width of a row, all its columns.
    template <int WIDTH>
    static void reflect_columns(const double* v, int count, double factor, double* rows, int stride, int begin,
                                int end) {
        if constexpr (WIDTH != DYNAMIC) return reflect_some<WIDTH>(v, count, factor, rows, stride);
        for (; begin + 8 <= end; begin += 8) reflect_some<8>(v, count, factor, rows + begin, stride);
        if (begin + 4 <= end) reflect_some<4>(v, count, factor, rows + begin, stride), begin += 4;
        if (begin + 2 <= end) reflect_some<2>(v, count, factor, rows + begin, stride), begin += 2;
        if (begin < end) reflect_some<1>(v, count, factor, rows + begin, stride);
    }

    /// Turn v into a reflector with the sign that does not cancel; returns 2/(v . v), 0 where nothing is to be
    /// reflected.
    static double make_reflector(double* v, int count, double& diagonal) {
        const double total = product(v + 1, v + 1, count - 1);
        diagonal = v[0];
        if (total == 0.0) return 0.0;
        double norm = std::sqrt(v[0] * v[0] + total);
        if (v[0] > 0.0) norm = -norm;
        diagonal = norm;
        v[0] -= norm;
        return 2.0 / (v[0] * v[0] + total);
    }

    void measure(Values least) {
        std::fill(norm_.begin(), norm_.end(), 0.0);
        for (int i = 0; i < blocks_; ++i)
            for (int r = i > 0 ? 0 : m(); r < window_rows(); ++r)
                for (int e = 0; e < m(); ++e) norm_[i * m() + e] += window(i, r)[e] * window(i, r)[e];
        double* closing_norm = &norm_[0] + blocks_ * m();
        for (int r = 0; r < unknowns_; ++r)
            for (int e = 0; e < closers_; ++e) closing_norm[e] += closing_row(r)[e] * closing_row(r)[e];
        for (int e = 0; e < closers_; ++e) closing_norm[e] = std::max(closing_norm[e], least[e]);
    }

    /// Eliminate the equations of block i; returns the number of reflections. Unknowns of the next node that have not
    /// come into an equation yet take no part: half of the work.
    int eliminate(int i) {
        int reflections = 0;
        for (int e = 0; e < m(); ++e) {
            const int j = i * m() + e;
            int count = start_ + m() - e;
            while (count > 1 && window(i, m() + e + count - 1)[e] == 0.0) --count;
            double* v = reflectors_[j].data();
            for (int r = 0; r < count; ++r) v[r] = window(i, m() + e + r)[e];
            length_[j] = count;
            const double factor = factor_[j] = make_reflector(v, count, diagonal_[j]);
            if (factor == 0.0) continue;
            ++reflections;
            // What a reflection changes in columns that are eliminated already is of no use any more.
            reflect_columns<M>(v, count, factor, window(i, m() + e), m(), e + 1, m());
            if (i + 1 < blocks_) reflect_columns<M>(v, count, factor, window(i + 1, e), m(), 0, m());
            if (i >= closing_first_) reflect_columns<DYNAMIC>(v, count, factor, closing_row(j), closers_, 0, closers_);
        }
        return reflections;
    }

    int eliminate_closing() {
        int reflections = 0;
        for (int e = 0; e < closers_; ++e) {
            const int j = blocks_ * m() + e, count = closers_ + 1 - e;
            double* v = closing_reflectors_[e].data();
            for (int r = 0; r < count; ++r) v[r] = closing_row(j + r)[e];
            const double factor = factor_[j] = make_reflector(v, count, diagonal_[j]);
            if (factor == 0.0) continue;
            ++reflections;
            reflect_columns<DYNAMIC>(v, count, factor, closing_row(j), closers_, e + 1, closers_);
        }
        return reflections;
    }

    int blocks_, m_, start_, closers_, shared_, closing_first_, unknowns_;
    Array<> window_;                           // (blocks (2 m + start), m) rows of the unknowns from block i - 1 on
    Array<> closing_;                          // (u, c)
    Array<> reflectors_, closing_reflectors_;  // each from its pivot on
    std::vector<int> length_;                  // of the reflectors
    std::vector<double> diagonal_, factor_,
        norm_;  // of R; 2/(v . v), 0: no reflection; squared lengths of the equations
    std::vector<double> copies_;  // (u,) scratch
    double spread_;
};

}  // namespace saltus
