/// Multipliers of an orbit under loads: eigenvalues of the product of its flights and saltations, equation (27).
///
/// A perturbation of the state at a fixed time, not at an impact, is carried on: all N multipliers appear. Of half a period
/// the map is that of x -> -x over it, whose square is that of the period.
#pragma once

#include "floquet.hpp"
#include "forced.hpp"

namespace saltus {

/// Norm of a formed map up to which the products of its eigenvalues keep twelve digits, however small they are.
inline constexpr double SMALL_MAP = 60.0;

/// A number with the sign and the zeros of the product of real numbers and conjugate pairs, between -1 and 1; 1 without
/// factors, NaN if a factor is.
///
/// Let e_j be the mean of all products of m - j factors. The number is e_0/sqrt(e_0^2 + .. + e_4^2): beside one small
/// factor about m times this factor, however large the others are, and a smooth function of all.
inline double bounded_product(const std::vector<Complex<double>>& factors) {
    constexpr double SMALL = 1e-100;  // products below it are scaled
    Complex<double> means[5] = {0.0, 0.0, 0.0, 0.0, 0.0};
    means[0] = 1.0;
    for (const auto& factor : factors) {
        const double length = hypot(1.0, hypot(factor.real, factor.imag));
        if (std::isnan(length)) return NOT_A_NUMBER;
        const double inverse = 1.0 / length;
        const Complex<double> part = length < INFINITE ? Complex<double>(factor.real * inverse, factor.imag * inverse)
                                                       : Complex<double>(std::copysign(1.0, factor.real), 0.0);
        double largest = 0.0;
        for (int j = 4; j >= 0; --j) {
            means[j] = means[j] * part;
            if (j > 0) means[j] = {means[j].real + means[j - 1].real * inverse, means[j].imag + means[j - 1].imag * inverse};
            largest = std::max(largest, std::fabs(means[j].real) + std::fabs(means[j].imag));
        }
        if (0.0 < largest && largest < SMALL)
            for (auto& mean : means) mean = {mean.real / largest, mean.imag / largest};
    }
    double total = 0.0, ways = 1.0;
    const int count = int(factors.size());
    for (int j = 0; j <= std::min(count, 4); ++j) {
        total += means[j].real / ways * (means[j].real / ways);
        ways *= (count - j) / (j + 1.0);
    }
    return total > 0.0 ? means[0].real / std::sqrt(total) : 0.0;
}

/// The multipliers of orbits of one problem.
template <class Problem>
class Stroboscopic {
    static constexpr int N = Problem::SIZE;

public:
    explicit Stroboscopic(const Problem& problem)
        : found(problem.size()), problem_(problem), map_(problem.size()), work_(problem.size()), chain_(problem.size()),
          scale_(problem.size()), after_(problem.inner() + 1, problem.size()), going_(problem.inner() + 1, problem.size()) {}

    Spectrum<N> found;

    /// Find the multipliers of an orbit y whose flights were computed last; false where they are not found. They are those
    /// of the formed map where no digit is lost. products: or where no digit of their products is.
    bool find(Values y, const typename Problem::Flown& flown, bool products) {
        const int size = problem_.size(), half = size / 2, vanishing = std::min(problem_.vanishing(flown.at), size);
        const Sizes sizes = problem_.motion_size(y, flown);
        for (int r = 0; r < size; ++r) scale_[r] = r < half ? sizes.displacement : sizes.velocity;
        for (int i = 0; i <= problem_.inner(); ++i) {
            problem_.land(i, flown.at, flown.before[i], &after_(i, 0));
            // The last impact of half a period is the mirror image of the first one: the same stop is closed.
            const int mode = problem_.events().mode[i < problem_.inner() ? i + 1 : 0];
            problem_.mode(mode, flown.at).rate(flown.at.drives[mode], Values(after_[i]), flown.turns[i + 1], going_[i]);
        }
        form(flown);
        double norm = 0.0;
        for (int r = 0; r < size; ++r)
            for (int c = 0; c < size; ++c) {
                found.matrix(r, c) = work_(r, c) = map_(r, c);
                norm += map_(r, c) * map_(r, c);
            }
        norm = std::sqrt(norm);
        found.is_known = norm < INFINITE && eigenvalues(work_, found.real.data(), found.imaginary.data());
        if (found.is_known) {
            found.order(false);
            const bool keeps = vanishing == size || found.modulus(0) <= GRADE * found.modulus(size - 1 - vanishing);
            take_out(vanishing);
            if ((products && norm < SMALL_MAP) || (norm < FORMED_LIMIT && keeps)) return true;
        }
        if (!factored(flown)) return false;
        take_out(vanishing);
        return true;
    }

    /// The first has the zeros of det(M + 1), the second those of the product of 1 - mu_i mu_j over all pairs. At a grazing
    /// a multiplier goes through infinity: the sign of the impact speeds keeps both continuous. Without a clock one
    /// multiplier is 1 for all orbits, and has no part in the pairs.
    std::pair<double, double> tests(Values y, const typename Problem::Flown& flown) {
        if (!find(y, flown, true)) return {NOT_A_NUMBER, NOT_A_NUMBER};
        double sign = 1.0, nearest = INFINITE;
        for (int i = 0; i <= problem_.inner(); ++i)
            if (problem_.hits(i) && problem_.events().side[i] * dot(problem_.events().rate[i], flown.before[i]) < 0.0)
                sign = -sign;
        int trivial = -1;
        const int size = problem_.size();
        factors_.clear();
        for (int i = 0; i < size; ++i) {
            factors_.push_back({1.0 + found.real[i], found.imaginary[i]});
            const double distance = hypot(found.real[i] - 1.0, found.imaginary[i]);
            if (!problem_.has_clock() && distance < nearest) trivial = i, nearest = distance;
        }
        const double doubling = sign * bounded_product(factors_);
        factors_.clear();
        for (int i = 0; i < size; ++i)
            for (int j = 0; j < i; ++j) {
                if (i == trivial || j == trivial) continue;
                if (found.imaginary[i] == 0.0 && found.imaginary[j] == 0.0)
                    factors_.push_back({1.0 - found.real[i] * found.real[j], 0.0});
                else {
                    const Complex<double> both = found.value(i) * found.value(j);
                    factors_.push_back({1.0 - both.real, -both.imag});
                }
            }
        return {doubling, sign * bounded_product(factors_)};
    }

private:
    /// The smallest multipliers, so many, are zero but for rounding.
    void take_out(int vanishing) {
        for (int k = problem_.size() - vanishing; k < problem_.size(); ++k) found.real[k] = found.imaginary[k] = 0.0;
    }

    /// map <- the product in scaled states, from the last event on.
    void form(const typename Problem::Flown& flown) {
        const int size = problem_.size();
        for (int r = 0; r < size; ++r)
            for (int c = 0; c < size; ++c) map_(r, c) = r == c ? scale_[r] : 0.0;
        Local<double, N> lateness(size);
        for (double& late : lateness) late = 0.0;
        for (int i = 0; i <= problem_.inner(); ++i) {
            const int event = problem_.before(i);
            const bool chatters = problem_.is_summed(event);
            if (problem_.hits(event)) pass(event, flown, lateness);
            const double* flow = flown.maps[i].data();
            const double sign = i == 0 ? problem_.closure().sign : 1.0;
            for (int r = 0; r < size; ++r)
                for (int c = 0; c < size; ++c) work_(r, c) = chatters ? flown.columns(i, r) * lateness[c] : 0.0;
            for (int r = 0; r < size; ++r)
                for (int q = 0; q < size; ++q)
                    for (int c = 0; c < size; ++c) work_(r, c) += flow[r * size + q] * (sign * map_(q, c));
            std::swap(map_, work_);
        }
        for (int r = 0; r < size; ++r)
            for (int c = 0; c < size; ++c) map_(r, c) *= 1.0 / scale_[r];
    }

    /// map <- S map, S = R + late gap of event i, equation (27). A chatter is in the map of the flight that follows: there the
    /// state is moved to the time of its first impact. lateness (N,): by how much later that is for each column.
    template <class Lateness>
    void pass(int i, const typename Problem::Flown& flown, Lateness& lateness) {
        const int size = problem_.size();
        const auto& events = problem_.events();
        const Values coming = flown.columns[i].subspan(size, size), gap = events.gap[i], rate = events.rate[i],
                     push = problem_.push(i, flown.at);
        const double jump = problem_.rebound(i, flown.at), speed = dot(gap, coming);
        const double turned = jump * dot(rate, coming);
        Local<double, N> kick(size);
        for (int c = 0; c < size; ++c) lateness[c] = kick[c] = 0.0;
        for (int r = 0; r < size; ++r)
            for (int c = 0; c < size; ++c) lateness[c] -= gap[r] * map_(r, c) / speed, kick[c] += jump * rate[r] * map_(r, c);
        const bool chatters = problem_.is_summed(i);
        for (int r = 0; r < size; ++r) {
            const double late = chatters ? coming[r] : coming[r] - going_(i, r) - turned * push[r];
            for (int c = 0; c < size; ++c) map_(r, c) += late * lateness[c] - (chatters ? 0.0 : push[r] * kick[c]);
        }
    }

    /// Without the product. A saltation matrix is right left^-1: it takes f- and the directions along the stop to f+ and
    /// their images under R. Nothing is divided by the speed of the impact.
    bool factored(const typename Problem::Flown& flown) {
        const int size = problem_.size(), count = problem_.inner() + 1;
        chain_.begin(2 * count);
        for (int i = 0; i < count; ++i) {
            const int next = i + 1 < count ? i + 1 : 0;
            auto &left = chain_.factor(2 * i), &right = work_, &flown_on = chain_.factor(2 * i + 1);
            chain_.set_inverse(2 * i);
            for (int r = 0; r < size; ++r)
                for (int c = 0; c < size; ++c) left(r, c) = right(r, c) = r == c ? 1.0 : 0.0;
            double length = 0.0;
            if (problem_.hits(i)) length = frames(i, flown, left, right);
            const double* flow = flown.maps[next].data();
            const double sign = next == 0 ? problem_.closure().sign : 1.0;
            for (int r = 0; r < size; ++r)
                for (int c = 0; c < size; ++c) {
                    double total = 0.0;
                    for (int q = 0; q < size; ++q) total += flow[r * size + q] * scale_[q] * right(q, c);
                    // A state that is moved along the flow begins its chatter earlier.
                    total *= sign;
                    if (problem_.is_summed(i) && c == 0) total -= flown.columns(next, r) / length;
                    flown_on(r, c) = total / scale_[r];
                }
        }
        found.is_known = chain_.eigenvalues(found.matrix) > 0;
        for (int k = 0; k < size; ++k) {
            found.real[k] = chain_.real()[k], found.imaginary[k] = chain_.imaginary()[k];
            found.is_known = found.is_known && !std::isnan(found.real[k]) && !std::isnan(found.imaginary[k]);
        }
        if (found.is_known) found.order(false);
        return found.is_known;
    }

    /// Returns the size of f-.
    template <class Left, class Right>
    double frames(int i, const typename Problem::Flown& flown, Left& left, Right& right) {
        const int size = problem_.size();
        const auto& events = problem_.events();
        const double jump = problem_.rebound(i, flown.at);
        Local<double, N> normal(size), coming(size);
        double length = 0.0;
        for (int r = 0; r < size; ++r) {
            coming[r] = flown.columns(i, size + r) / scale_[r];
            normal[r] = events.gap(i, r) * scale_[r];
            length = std::max(length, std::fabs(coming[r]));
        }
        // The reflection of the normal to the first axis: its other columns are orthonormal, and at right angles to the
        // normal.
        const double factor = reflector(normal, 0, size);
        for (int c = 0; c < size; ++c) {
            double kick = 0.0;
            for (int r = 0; r < size; ++r) {
                left(r, c) = c == 0 ? coming[r] / length : (r == c ? 1.0 : 0.0) - factor * normal[r] * normal[c];
                kick += events.rate(i, r) * scale_[r] * left(r, c);
            }
            kick *= jump;
            if (problem_.is_summed(i)) {
                for (int r = 0; r < size; ++r) right(r, c) = c == 0 ? 0.0 : left(r, c);
                continue;
            }
            for (int r = 0; r < size; ++r)
                right(r, c) = c == 0 ? going_(i, r) / scale_[r] / length : left(r, c) - kick * problem_.push(i, flown.at)[r] / scale_[r];
        }
        return length;
    }

    const Problem& problem_;
    Dense<N> map_, work_;
    ProductChain<N> chain_;
    std::vector<double> scale_;
    Array<> after_, going_;
    std::vector<Complex<double>> factors_;
};

}  // namespace saltus
