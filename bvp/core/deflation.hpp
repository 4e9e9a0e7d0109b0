/// Multipliers of a conservative orbit without a product in which large ones drown small ones.
///
/// The perturbations that grow most span a subspace that the orbit carries along. Run round the cycle, any frame
/// turns into it, and a frame run backwards turns into the subspace of those that shrink most. The orbit carries a
/// frame Q into Q+: M Q = Q+ R with a product R of triangular factors, graded. In the frame Q the map is W R, with W
/// = Q' Q+ orthogonal and, as the frame settles, block diagonal; periodic QR of the two factors finds its
/// eigenvalues. What is left, modulo the first subspace, neither grows nor shrinks much: there the formed product
/// loses no digit. Each impact takes a few operations a column, and no factor of the orbit is ever reduced as a
/// whole.
///
/// Subspace iteration: Golub and Van Loan, Matrix Computations, 4th ed. 2013, 7.3.
#pragma once

#include "chain.hpp"
#include "periodic_qr.hpp"
#include "spectrum.hpp"

namespace saltus {

/// The large and the small of M multipliers of orbits with N entries a state.
template <int N = DYNAMIC, int M = DYNAMIC>
class Deflation {
public:
    Deflation(int count, int size)
        : size_(size), count_(count), basis_(count, size), columns_(size), frame_(count), turn_(count), upper_(count),
          triangle_(count), image_(count), part_(count), block_(count), rest_(count), weights_(size), line_(size),
          other_real_(count), other_imaginary_(count) {}

    /// Replace the eigenvalues of the formed map in `found`. vectors: the trivial rows of node 0, which are
    /// overwritten. Returns how many times the orbit was run round; 0 where the multipliers do not part well.
    template <class V>
    int multipliers(const Chain<N>& chain, const Contacts& contacts, Values scale, V& vectors, Spectrum<M>& found) {
        if (!found.is_known || !(largest_change(chain, contacts, scale) < NORM)) return 0;
        scale_ = scale;
        complement(vectors, size_ - count_, basis_);
        const int m = count_;
        for (int r = 0; r < m; ++r) {
            other_real_[r] = found.real[r], other_imaginary_[r] = found.imaginary[r];
            for (int c = 0; c < m; ++c) rest_(c, r) = found.matrix(r, c), frame_(r, c) = r == c ? 1.0 : 0.0;
        }
        int count = 0, rounds = 0, first = 0;
        double norm = 0.0, ratio = 0.0;
        while (true) {
            const int size = m - count;
            Matrix<double> block = block_.square(size);
            for (int r = 0; r < size; ++r)
                for (int c = 0; c < size; ++c) block(r, c) = rest_(c, r);
            norm = std::sqrt(sum_of_squares(block));
            if (count > 0) {
                if (!(norm < INFINITE) || !eigenvalues(block, other_real_.data(), other_imaginary_.data())) return 0;
                found.sort(other_real_, other_imaginary_, size);
            }
            const auto [lead, parted] = leading(norm, size);
            if (lead == 0) break;
            if (lead < 0 || 2 * (count + lead) > m) return 0;
            ratio = parted;
            iterate(rest_, size, lead, ratio);
            add_to_frame(count, lead);
            count += lead;
            first = first == 0 ? count : first;
            const int more =
                settle(chain, contacts, false, count, 2 * count < m ? m : count, ratio, found.real, found.imaginary);
            if (more == 0) return 0;
            rounds += more;
            if (2 * count == m) break;
            for (int a = count; a < m; ++a)
                for (int c = 0; c < m - count; ++c) {
                    double total = 0.0;
                    for (int b = 0; b < m; ++b) total += frame_(a, b) * image_(b, count + c);
                    rest_(c, a - count) = total;
                }
        }
        const int middle = m - 2 * count;
        if (count == 0 || (middle > 0 && !(norm < NORM))) return 0;
        for (int j = 0; j < middle; ++j)
            found.real[count + j] = other_real_[j], found.imaginary[count + j] = other_imaginary_[j];
        if (middle > 0) {
            double least = INFINITE;
            for (int j = 0; j < count; ++j) least = smaller(least, found.modulus(j));
            ratio = found.modulus(count) / least;
            const double smallest = found.modulus(count + middle - 1);
            if (!(GRADE * smallest * smallest > 1.0)) return 0;
        }
        if (count == first) {  // the formed product's own left subspace
            iterate(found.matrix, m, count, ratio);
            for (int j = 0; j < count; ++j) copy(part_[j], frame_[j]);
        }
        turn_to_dual(count);
        const int more = settle(chain, contacts, true, count, count, ratio, other_real_, other_imaginary_);
        if (more == 0) return 0;
        for (int j = 0; j < count; ++j) {
            const Complex<double> inverse = Complex<double>(1.0) / Complex<double>(other_real_[j], other_imaginary_[j]);
            found.real[count + middle + j] = inverse.real;
            found.imaginary[count + middle + j] = other_imaginary_[j] == 0.0 ? 0.0 : inverse.imag;
        }
        found.order(true);
        return rounds + more;
    }

private:
    static constexpr double PART = 0.8;       // largest ratio of two neighbouring moduli that are parted
    static constexpr double TRUSTED = 1e-10;  // part of the norm of a formed matrix below which its eigenvalues mean nothing
    static constexpr double GROWTH = 8.0;     // of the leading columns, after which they are orthonormalised again
    static constexpr double ROUNDED = 1e-16;  // error of a frame below which no further round improves it
    static constexpr double SETTLED = 1e-14;  // error of a frame that is rounding if it no longer decreases
    static constexpr double APART = 1e-15;    // coupling of two directions of a frame that is rounding
    static constexpr int MOST_ROUNDS = 40;    // for one frame
    /// Norm of the product of what is left, and of the change at an impact, up to which they are taken. The change is
    /// large near a grazing, and what it does not magnify is lost in its rounding.
    static constexpr double NORM = 1e3;

    /// The largest change of a scaled perturbation by its late arrival at an impact.
    double largest_change(const Chain<N>& chain, const Contacts& contacts, Values scale) const {
        double largest = 0.0;
        for (int j = 0; j < chain.nodes(); ++j) {
            if (chain.contact(j) < 0) continue;
            double late = 0.0, gap = 0.0;
            for (int r = 0; r < size_; ++r) {
                const double a = chain.late(j)[r] / scale[r], b = contacts.gap[chain.contact(j)][r] * scale[r];
                late += a * a, gap += b * b;
            }
            largest = larger(largest, late * gap);
        }
        return std::sqrt(largest);
    }

    /// How many eigenvalues (other_real_, other_imaginary_), sorted by modulus, to part from the others, and the ratio
    /// of moduli there; -1: they do not part.
    std::pair<int, double> leading(double norm, int size) const {
        int found = 0;
        double ratio = PART;
        for (int j = 0; j < size; ++j) {
            const double larger = hypot(other_real_[j], other_imaginary_[j]);
            if (larger <= std::sqrt(GRADE) || larger < TRUSTED * norm) break;
            if (found == 0) found = -1;
            const double smaller = j + 1 < size ? hypot(other_real_[j + 1], other_imaginary_[j + 1]) : 0.0;
            if (smaller <= ratio * larger) found = j + 1, ratio = smaller / larger;
        }
        return {found, ratio};
    }

    /// Rows of part_: an orthonormal basis of the subspace of the leading eigenvalues of the transpose of a matrix of
    /// `size` rows.
    template <class A>
    void iterate(const A& matrix, int size, int lead, double ratio) {
        for (int j = 0; j < lead; ++j)
            for (int b = 0; b < size; ++b) part_(j, b) = cos(1.0 + 7.0 * j + 3.0 * b * (j + 1));
        const int steps = ratio > 0.0 ? 3 + int(37.0 / -log(ratio)) : 3;
        for (int step = 0; step < steps; ++step)
            for (int j = 0; j < lead; ++j) {
                for (int b = 0; b < size; ++b) line_[b] = 0.0;
                for (int c = 0; c < size; ++c)
                    for (int b = 0; b < size; ++b) line_[b] += matrix(c, b) * part_(j, c);
                for (int twice = 0; twice < 2; ++twice)
                    for (int a = 0; a < j; ++a) {
                        double total = 0.0;
                        for (int b = 0; b < size; ++b) total += part_(a, b) * line_[b];
                        for (int b = 0; b < size; ++b) line_[b] -= total * part_(a, b);
                    }
                double largest = 0.0, total = 0.0;
                for (int b = 0; b < size; ++b) largest = larger(largest, std::fabs(line_[b]));
                for (int b = 0; b < size; ++b) total += (line_[b] / largest) * (line_[b] / largest);
                for (int b = 0; b < size; ++b) part_(j, b) = line_[b] / (largest * std::sqrt(total));
            }
    }

    /// The rows of part_, in coordinates of the frame's rows from `count` on, become the next rows of the frame.
    void add_to_frame(int count, int lead) {
        for (int j = 0; j < lead; ++j)
            for (int b = 0; b < count_; ++b) {
                turn_(j, b) = 0.0;
                for (int a = count; a < count_; ++a) turn_(j, b) += part_(j, a - count) * frame_(a, b);
            }
        for (int j = 0; j < lead; ++j) copy(turn_[j], frame_[count + j]);
    }

    /// Rounds until the first `count` rows of the frame span what the cycle carries along, with their multipliers in
    /// real, imaginary. ratio: of the largest other modulus to the least of theirs. columns: that the last round
    /// carries. Returns how many rounds; 0 if they do not settle.
    int settle(const Chain<N>& chain, const Contacts& contacts, bool back, int count, int columns, double ratio,
               std::vector<double>& real, std::vector<double>& imaginary) {
        bool known = false;
        double older = INFINITE;
        for (int rounds = 1; rounds <= MOST_ROUNDS; ++rounds) {
            const bool wide = known && columns > count;
            if (wide) complete(count);
            run_round(chain, contacts, back, wide ? columns : count, count);
            const double away = turn(count);
            if (!(away < INFINITE)) return 0;
            // A frame has the multipliers of the span that the round began with, and ends with a better one.
            if (known) return leading_multipliers(count, real, imaginary) ? rounds : 0;
            known = away * ratio < ROUNDED || (away < SETTLED && away > 0.5 * older);
            older = away;
        }
        return 0;
    }

    /// The rows of the frame from `count` on: perpendicular to the first ones.
    void complete(int count) {
        for (int c = 0; c < count; ++c) copy(frame_[c], turn_[c]);
        Matrix<double> rest = Matrix<double>(frame_).rows(count, count_ - count);
        complement(turn_, count, rest);
    }

    /// Carry the first rows of the frame once round the cycle, or back: `columns` of them, of which the first `count`
    /// are kept orthonormal and the others perpendicular to these. Column c of image_ becomes the image of row c in the
    /// same coordinates, and triangle_ the triangular factor of the first ones.
    void run_round(const Chain<N>& chain, const Contacts& contacts, bool back, int columns, int count) {
        const int nodes = chain.nodes();
        for (int r = 0; r < count; ++r)
            for (int c = 0; c < count; ++c) triangle_(r, c) = r == c ? 1.0 : 0.0;
        for (int c = 0; c < columns; ++c) {
            for (int r = 0; r < size_; ++r) line_[r] = 0.0;
            for (int b = 0; b < count_; ++b)
                for (int r = 0; r < size_; ++r) line_[r] += frame_(c, b) * basis_(b, r);
            for (int r = 0; r < size_; ++r) columns_(r, c) = scale_[r] * line_[r];
        }
        for (int r = 0; r < size_; ++r) weights_[r] = 1.0 / (scale_[r] * scale_[r]);
        for (int step = 0; step < nodes; ++step) {
            const int at = back ? nodes - 1 - step : step, next = at + 1 < nodes ? at + 1 : 0;
            if (back) chain.carry_back(at, next, contacts, columns_, columns);
            else chain.carry(at, next, contacts, columns_, columns);
            if (largest_square(count) > GROWTH * GROWTH) orthonormalise(columns_, size_, count, columns);
        }
        image_.set(0.0);
        for (int b = 0; b < count_; ++b)
            for (int r = 0; r < size_; ++r) {
                const double a = basis_(b, r) / scale_[r];
                for (int c = 0; c < columns; ++c) image_(b, c) += a * columns_(r, c);
            }
        std::fill(weights_.begin(), weights_.end(), 1.0);
        orthonormalise(image_, count_, count, columns);
    }

    /// The largest weighted square of the length of a leading column.
    double largest_square(int count) {
        double most = 0.0;
        in_groups(0, count, [&](auto width, int at) {
            double total[width()] = {};
            for (int r = 0; r < size_; ++r)
                for (int c = 0; c < width(); ++c) total[c] += weights_[r] * columns_(r, at + c) * columns_(r, at + c);
            for (int c = 0; c < width(); ++c) most = larger(most, total[c]);
        });
        return most;
    }

    /// The first `count` columns of x orthonormal with the weights, x = x' R, and the others perpendicular to them.
    template <class X>
    void orthonormalise(X& x, int size, int count, int columns) {
        for (int j = 0; j < count; ++j) {
            double square = 0.0;
            for (int r = 0; r < size; ++r) square += weights_[r] * x(r, j) * x(r, j);
            upper_(j, j) = std::sqrt(square);
            for (int r = 0; r < size; ++r) x(r, j) /= upper_(j, j);
            in_groups(j + 1, columns, [&](auto width, int at) {
                double total[width()] = {};
                for (int r = 0; r < size; ++r) {
                    const double a = weights_[r] * x(r, j);
                    for (int c = 0; c < width(); ++c) total[c] += a * x(r, at + c);
                }
                for (int r = 0; r < size; ++r) {
                    const double a = x(r, j);
                    for (int c = 0; c < width(); ++c) x(r, at + c) -= a * total[c];
                }
                for (int c = 0; c < width() && at + c < count; ++c) upper_(j, at + c) = total[c];
            });
        }
        // The triangle multiplies the one before it from the left.
        for (int r = 0; r < count; ++r)
            for (int c = r; c < count; ++c) {
                double total = 0.0;
                for (int k = r; k <= c; ++k) total += upper_(r, k) * triangle_(k, c);
                triangle_(r, c) = total;
            }
    }

    /// turn_: the image's leading columns in the frame. Returns how far they are from the frame's span; they replace
    /// it.
    double turn(int count) {
        double away = 0.0;
        turn_.set(0.0);
        for (int c = 0; c < count; ++c) {
            for (int a = 0; a < count; ++a) {
                double total = 0.0;
                for (int b = 0; b < count_; ++b) total += frame_(a, b) * image_(b, c);
                turn_(a, c) = total;
            }
            for (int b = 0; b < count_; ++b) {
                double rest = image_(b, c);
                for (int a = 0; a < count; ++a) rest -= turn_(a, c) * frame_(a, b);
                away = larger(away, std::fabs(rest));
            }
        }
        for (int c = 0; c < count; ++c)
            for (int b = 0; b < count_; ++b) frame_(c, b) = image_(b, c);
        return away == away ? away : INFINITE;
    }

    /// Eigenvalues of W R, the first `count` rows and columns, which keep their digits however far apart they are:
    /// periodic QR. Returns whether they are found.
    bool leading_multipliers(int count, std::vector<double>& real, std::vector<double>& imaginary) {
        ProductChain<> chain(count);
        chain.begin(2);
        for (int r = 0; r < count; ++r)
            for (int c = 0; c < count; ++c) {
                chain.factor(0)(r, c) = r <= c ? triangle_(r, c) : 0.0;
                chain.factor(1)(r, c) = std::fabs(turn_(r, c)) < APART ? 0.0 : turn_(r, c);
            }
        if (chain.eigenvalues(block_.square(count)) < 1) return false;
        for (int j = 0; j < count; ++j) {
            real[j] = chain.real()[j], imaginary[j] = chain.imaginary()[j];
            if (!(hypot(real[j], imaginary[j]) < INFINITE)) return false;
        }
        return true;
    }

    /// Rows of the frame that the map multiplies from the right become columns that its inverse multiplies from the
    /// left, by the symplectic form: (q, p) becomes (p, -q).
    void turn_to_dual(int count) {
        const int half = size_ / 2;
        for (int c = 0; c < count; ++c) {
            for (int r = 0; r < size_; ++r) line_[r] = 0.0;
            for (int b = 0; b < count_; ++b)
                for (int r = 0; r < half; ++r) {
                    line_[r] += frame_(c, b) * basis_(b, half + r);
                    line_[half + r] -= frame_(c, b) * basis_(b, r);
                }
            for (int b = 0; b < count_; ++b) frame_(c, b) = dot(basis_[b], line_);
        }
    }

    int size_, count_;
    Values scale_;
    Dense<M, N> basis_;
    Dense<N> columns_;
    Dense<M> frame_, turn_, upper_, triangle_, image_, part_, block_;
    Dense<M> rest_;  // the transpose of the map of what is left
    std::vector<double> weights_, line_, other_real_, other_imaginary_;
};

}  // namespace saltus
