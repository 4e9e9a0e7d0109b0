/// Floquet multipliers of a closed orbit, from its chain of flights and saltations.
///
/// Where no multiplier is much larger than another one, they are the eigenvalues of the formed product. Directions
/// whose multipliers are known to be 1 are split off by reflections. A formed product loses small multipliers beside
/// large ones. There, a conservative orbit has the large and the small ones split off (`deflation.hpp`), and else the
/// linearised problem is reduced by orthogonal transformations to a product pencil, equation (31), whose eigenvalues
/// are found by periodic QR.
#pragma once

#include "chain.hpp"
#include "deflation.hpp"
#include "periodic_qr.hpp"
#include "spectrum.hpp"

namespace saltus {

/// Norm of a formed matrix up to which its eigenvalues are taken, for eigenvalues of size 1.
inline constexpr double FORMED_LIMIT = 1e7;

/// Which method found the multipliers: the formed product, large ones split off, periodic QR. None where an inverse
/// does not exist, or where the iteration does not converge.
enum class Route { FORMED, PARTED, FACTORED, SINGULAR, DIVERGED };

/// Multipliers of closed orbits with N entries a state, M of them nontrivial.
template <int N = DYNAMIC, int M = DYNAMIC>
class Floquet {
    static constexpr int TRIVIAL = N == DYNAMIC || M == DYNAMIC ? DYNAMIC : N - M;

public:
    /// free (f, n): orthonormal motions that no spring and no stop resists.
    Floquet(int size, Matrix<const double> free, bool conservative)
        : size_(size),
          conservative_(conservative),
          free_(free.rows(), free.columns()),
          trivial_count_(conservative ? 2 + 2 * free.rows() : 1),
          map_(size),
          vectors_(trivial_count_, size),
          work_(size - trivial_count_),
          found_(size - trivial_count_),
          factors_(size - trivial_count_),
          deflation_(size - trivial_count_, size) {
        std::copy(free.data(), free.data() + free.rows() * free.columns(), free_.data());
    }

    constexpr int count() const {
        if constexpr (M != DYNAMIC) return M;
        return size_ - trivial_count_;
    }
    constexpr int trivial_count() const {
        if constexpr (TRIVIAL != DYNAMIC) return TRIVIAL;
        return trivial_count_;
    }
    bool is_conservative() const { return conservative_; }
    const Spectrum<M>& found() const { return found_; }
    /// Steps of periodic QR, or rounds of the frames of large and small multipliers.
    int steps() const { return steps_; }
    /// How badly the product keeps the trivial directions: the larger of |(M - 1) f|/|f| for the flow f and, for a
    /// conservative system, |grad H (M - 1)|/|grad H|.
    double trivial() const { return trivial_; }
    /// Norm of the map without the trivial directions.
    double norm() const { return norm_; }

    /// Find the multipliers. scale (N,): sizes of a state's entries. turned: the chain is half of the period, and the
    /// other half its mirror image. limit: norm up to which the formed product may do.
    Route multipliers(const Chain<N>& chain, const Contacts& contacts, Values scale, bool turned = false,
                      double limit = FORMED_LIMIT) {
        Route route = Route::FORMED;
        if (!formed(chain, contacts, scale, turned) || !(norm_ < limit)) {
            route = Route::PARTED;
            steps_ = 0;
            if (conservative_ && chain.is_modal() && size_ > 4) {
                trivial_rows(chain, 0, Kind::FLOW, contacts, scale);
                steps_ = deflation_.multipliers(chain, contacts, scale, vectors_, found_);
            }
            if (steps_ == 0) route = factored(chain, contacts, scale);
        }
        if (turned) found_.square();
        return route;
    }

    /// From the formed product. Returns whether no digit is lost.
    bool formed(const Chain<N>& chain, const Contacts& contacts, Values scale, bool turned = false) {
        form(chain, contacts, scale);
        trivial_rows(chain, 0, Kind::FLOW, contacts, scale);
        trivial_ = departure(vectors_[0], turned, false);
        if (conservative_) trivial_ = larger(trivial_, departure(vectors_[1], turned, true));
        reduce();
        steps_ = 0;
        for (int r = 0; r < count(); ++r)
            for (int c = 0; c < count(); ++c)
                found_.matrix(r, c) = work_(r, c) = map_(trivial_count() + r, trivial_count() + c);
        norm_ = std::sqrt(sum_of_squares(work_));
        found_.is_known = norm_ < INFINITE && eigenvalues(work_, found_.real.data(), found_.imaginary.data());
        if (!found_.is_known) return false;
        found_.order(conservative_);
        if (count() == 0) return true;
        return norm_ < FORMED_LIMIT && found_.modulus(0) <= GRADE * found_.modulus(count() - 1);
    }

    /// Without the product, equation (31): orthogonal bases N_i of the admissible perturbations (tangent to the stop;
    /// for a conserved energy also to its level) and Q_i of the rows that annihilate F_i turn the linearised orbit into
    /// E_i y_{i+1} = A_i y_i with A_i = Q_i J_i N_i and E_i = Q_i N_{i+1}. E_i is singular only where an impact grazes.
    Route factored(const Chain<N>& chain, const Contacts& contacts, Values scale) {
        const int nodes = chain.nodes(), m = count();
        Dense<M, N> basis(m, size_), following(m, size_), rows(m, size_);
        factors_.begin(2 * nodes);
        trivial_rows(chain, 0, Kind::SECTION, contacts, scale);
        complement(vectors_, trivial_count(), basis);
        for (int i = 0; i < nodes; ++i) {
            const int j = i + 1 < nodes ? i + 1 : 0;
            trivial_rows(chain, j, Kind::SECTION, contacts, scale);
            complement(vectors_, trivial_count(), following);
            trivial_rows(chain, j, Kind::ARRIVAL, contacts, scale);
            complement(vectors_, trivial_count(), rows);
            // In the order in which they are applied, from the coordinates before the last inverse on.
            auto &left = factors_.factor(2 * j), &right = factors_.factor(2 * i + 1);
            factors_.set_inverse(2 * j);
            chain.landing(i, j, contacts, map_);
            Local<double, N> image(size_);
            for (int a = 0; a < m; ++a) {
                for (int b = 0; b < m; ++b) left(a, b) = dot(rows[a], following[b]);
                for (int c = 0; c < size_; ++c) image[c] = 0.0;
                for (int r = 0; r < size_; ++r)
                    for (int c = 0; c < size_; ++c) image[c] += rows(a, r) / scale[r] * map_(r, c);
                for (int c = 0; c < size_; ++c) image[c] *= scale[c];
                for (int b = 0; b < m; ++b) right(a, b) = dot(image, basis[b]);
            }
            std::swap(basis, following);
        }
        steps_ = factors_.eigenvalues(found_.matrix);
        found_.is_known = steps_ > 0;
        for (int k = 0; k < m; ++k) {
            found_.real[k] = factors_.real()[k];
            found_.imaginary[k] = factors_.imaginary()[k];
        }
        norm_ = std::sqrt(sum_of_squares(found_.matrix));
        if (steps_ < 1) return steps_ < 0 ? Route::SINGULAR : Route::DIVERGED;
        found_.order(conservative_);
        return Route::FACTORED;
    }

private:
    /// What a perturbation is orthogonal to at a node: the first of the trivial rows.
    enum class Kind { FLOW, SECTION, ARRIVAL };

    /// Fill the trivial rows at node j, in states divided by their scale: the flow after it, the section that
    /// perturbations lie in (at a cut across the flow), or the direction F of late arrival; of a conservative system
    /// also the gradient of the energy, and the displacements and velocities of the free motions.
    void trivial_rows(const Chain<N>& chain, int j, Kind kind, const Contacts& contacts, Values scale) {
        Vector<double> first = vectors_[0];
        if (kind == Kind::ARRIVAL) chain.arrival(j, contacts, first);
        else copy(chain.leaving(j), first);
        const bool is_gap = kind == Kind::SECTION && chain.contact(j) >= 0;
        for (int r = 0; r < size_; ++r)
            first[r] = is_gap ? contacts.gap[chain.contact(j)][r] * scale[r] : first[r] / scale[r];
        if (!conservative_) return;
        chain.slope(j, vectors_[1]);
        for (int r = 0; r < size_; ++r) vectors_(1, r) *= scale[r];
        const int half = size_ / 2;
        for (int k = 2; k < trivial_count(); ++k)
            for (int r = 0; r < size_; ++r) vectors_(k, r) = r / half == k % 2 ? free_((k - 2) / 2, r % half) : 0.0;
    }

    /// map <- the product, in states divided by their scale.
    void form(const Chain<N>& chain, const Contacts& contacts, Values scale) {
        for (int r = 0; r < size_; ++r)
            for (int c = 0; c < size_; ++c) map_(r, c) = r == c ? scale[r] : 0.0;
        for (int i = 0; i < chain.nodes(); ++i)
            chain.carry(i, i + 1 < chain.nodes() ? i + 1 : 0, contacts, map_, map_.columns());
        for (int r = 0; r < size_; ++r)
            for (int c = 0; c < size_; ++c) map_(r, c) /= scale[r];
    }

    /// |M v - v|/|v|, or |v M - v|/|v| (left), with the map applied twice where it is that of half a period.
    double departure(Values v, bool twice, bool left) const {
        Local<double, N> from(size_), to(size_);
        copy(v, from);
        for (int turn = 0; turn < 1 + twice; ++turn) {
            for (int r = 0; r < size_; ++r) to[r] = 0.0;
            for (int r = 0; r < size_; ++r)
                for (int c = 0; c < size_; ++c) {
                    if (left) to[c] += from[r] * map_(r, c);
                    else to[r] += map_(r, c) * from[c];
                }
            copy(to, from);
        }
        double length = 0.0, defect = 0.0;
        for (int r = 0; r < size_; ++r) length += v[r] * v[r], defect += (to[r] - v[r]) * (to[r] - v[r]);
        return std::sqrt(defect / length);
    }

    /// map <- H map H with the reflections H of the trivial rows, which are overwritten, one after the other: the first
    /// rows and columns then belong to them.
    void reduce() {
        Local<double, N> line(size_);
        for (int k = 0; k < trivial_count(); ++k) {
            Vector<double> v = vectors_[k];
            const double factor = reflector(v, k, size_);
            if (factor == 0.0) continue;
            for (int other = k + 1; other < trivial_count(); ++other) reflect(v, k, size_, factor, vectors_[other]);
            for (int c = 0; c < size_; ++c) line[c] = 0.0;
            for (int r = k; r < size_; ++r)
                for (int c = 0; c < size_; ++c) line[c] += v[r] * map_(r, c);
            for (int r = k; r < size_; ++r)
                for (int c = 0; c < size_; ++c) map_(r, c) -= factor * v[r] * line[c];
            for (int r = 0; r < size_; ++r) reflect(v, k, size_, factor, map_[r]);
        }
    }

    int size_;
    bool conservative_;
    Dense<> free_;
    int trivial_count_;
    Dense<N> map_;
    Dense<TRIVIAL, N> vectors_;
    Dense<M> work_;
    Spectrum<M> found_;
    ProductChain<M> factors_;
    Deflation<N, M> deflation_;
    double trivial_ = 0.0, norm_ = 0.0;
    int steps_ = 0;
};

}  // namespace saltus
