/// Exact integrals of products along a linear flight, equation (29).
#include "budget.hpp"

#include <algorithm>

namespace saltus {

namespace {

/// |x t| below which (exp(x t) - 1)/(x t) is a series, and its terms.
constexpr double SMALL = 0.1;
constexpr int SERIES = 9;
/// The two exponentials of a pair are integrated separately up to this size, relative to the largest value of their sum
/// over the flight. A product can lose a factor of its square in accuracy.
constexpr double LOST = 4.0;
/// Decay, relative to the rate of a block, from which on it counts as coming to rest.
constexpr double SETTLES = 1e-9;
/// Taylor terms on a part of a flight with a rate times time of 1 at most: truncation below 1e-17.
constexpr int TERMS = 19;
/// Parts of a flight above which the doubled matrix is cheaper.
constexpr int MOST_PARTS = 24;

using Number = Complex<double>;

/// The integral of exp(x s) over 0 <= s <= t, given exp(x t) and 1/x.
Number mean_exponential(const Number& x, const Number& inverse, const Number& end, double t) {
    const double real = x.real * t, imaginary = x.imag * t;
    if (!(std::fabs(real) + std::fabs(imaginary) <= SMALL)) return (end - 1.0) * inverse;
    // Horner's scheme for (exp(x) - 1)/x; products with constants, since divisions would take most of the time.
    constexpr double PARTS[SERIES] = {1.0 / 2, 1.0 / 3, 1.0 / 4, 1.0 / 5, 1.0 / 6, 1.0 / 7, 1.0 / 8, 1.0 / 9, 1.0 / 10};
    Number total{1.0, 0.0};
    for (int k = SERIES - 1; k >= 0; --k) total = total * Number{real * PARTS[k], imaginary * PARTS[k]} + 1.0;
    return total * t;
}

/// Number of Taylor terms that leaves a remainder below 1e-17 of the first one, for x = rate times time <= 1.
int terms_of(double x) {
    double size = 1.0;
    int terms = 1;
    for (; size > 1e-17 && terms < TERMS; ++terms) size *= x / (terms + 1);
    return terms;
}

}  // namespace

FlightIntegrals::FlightIntegrals(const LinearFlight<>& flight, const Products& products)
    : flight_(flight), products_(products) {
    for (int k = 0; k < int(flight.blocks().size()); ++k) {
        const Block& b = flight.blocks()[k];
        if (b.is_pair() && b.delta < 0.0) {
            slots_.push_back({k, {b.mean, std::sqrt(-b.delta)}});
        } else if (b.is_pair() && b.delta > 0.0) {
            const RealRates rates(b);
            slots_.push_back({k, {rates.fast, 0.0}}), slots_.push_back({k, {rates.slow, 0.0}});
        } else if (b.is_pair() || b.is_single()) {
            slots_.push_back({k, {b.mean, 0.0}});
        } else {
            decays_ = false;
        }
        decays_ = decays_ && flight.steps().is_usable() && b.delta != 0.0 && b.is_pair();
    }
    for (const Slot& slot : slots_) decays_ = decays_ && slot.rate.real < -SETTLES * abs(slot.rate);
    for (size_t k = 0; k < slots_.size(); ++k) {
        for (size_t q = k; q < slots_.size(); ++q) {
            for (const Number& x : {slots_[k].rate + slots_[q].rate, slots_[k].rate + conj(slots_[q].rate)}) {
                const double square = x.real * x.real + x.imag * x.imag;
                sums_.push_back({x, square > 0.0 ? Number{x.real / square, -x.imag / square} : Number{0.0, 0.0}});
            }
        }
    }
    const Array<>&first = products.first, &second = products.second;
    for (int c = 0; c < products.count(); ++c)
        same_.push_back(std::equal(first[c].begin(), first[c].end(), second[c].begin()));
}

/// Weights of the exponentials in row . z(s). False if they do not exist or would cancel.
bool FlightIntegrals::weights(Values row, Values z, double t, Number* out) const {
    size_t s = 0;
    for (const Block& b : flight_.blocks()) {
        const int i = b.first, j = b.second;
        if (b.is_single()) {
            out[s++] = {row[i] * z[i], 0.0};
            continue;
        }
        if (!b.is_pair()) {
            for (int r = i; r < i + b.size(); ++r)
                if (row[r] != 0.0) return false;
            continue;
        }
        const double alpha = row[i] * z[i] + row[j] * z[j];
        const double beta = row[i] * ((b.b11 - b.mean) * z[i] + b.b12 * z[j]) +
            row[j] * (b.b21 * z[i] + (b.b22 - b.mean) * z[j]);
        double w = std::sqrt(std::fabs(b.delta));
        const bool nothing = alpha == 0.0 && beta == 0.0;
        if (!nothing && !(b.delta == 0.0 && beta == 0.0)) {
            const double lasting = std::min(t, 1.0 / std::fabs(b.mean));
            if (std::fabs(beta) > LOST * w * std::max(std::fabs(alpha), std::fabs(beta) * lasting)) return false;
        }
        if (b.delta < 0.0) {
            out[s++] = {alpha, -beta / w};
        } else if (b.delta > 0.0) {
            if (b.mean <= 0.0) w = -w;
            out[s++] = {nothing ? 0.0 : 0.5 * (alpha + beta / w), 0.0};
            out[s++] = {nothing ? 0.0 : 0.5 * (alpha - beta / w), 0.0};
        } else {
            out[s++] = {alpha, 0.0};
        }
    }
    return true;
}

/// The values of all exponentials at t.
void FlightIntegrals::ends(const LinearPath<DYNAMIC>& path, double t, Number* out) const {
    if (flight_.steps().is_usable() && t < INFINITE) {
        const StepTable::Turns& turns = path.turns(t);
        for (size_t s = 0; s < slots_.size(); ++s) {
            const bool turning = slots_[s].rate.imag != 0.0;
            const int k = slots_[s].block;
            out[s] = {turns.cosine.data()[k], turning ? turns.sine.data()[k] : 0.0};
        }
        return;
    }
    for (size_t s = 0; s < slots_.size(); ++s) {
        const Number& rate = slots_[s].rate;
        const double size = rate.real == 0.0 ? 1.0 : t < INFINITE ? exp(rate.real * t) : 0.0;
        double cosine = 1.0, sine = 0.0;
        if (rate.imag != 0.0 && t < INFINITE) sincos(rate.imag * t, sine, cosine);
        out[s] = {size * cosine, size * sine};
    }
}

void FlightIntegrals::over(const LinearPath<DYNAMIC>& path, double t, Vector<double> out) const {
    const int count = products_.count(), slots = int(slots_.size());
    for (int c = 0; c < count; ++c) out[c] = 0.0;
    if (count == 0 || t == 0.0) return;
    const Values z = path.begin();
    Local<Number, DYNAMIC, 64> weight(2 * count * slots), end(slots);
    bool apart = true;
    for (int c = 0; c < count && apart; ++c) {
        Number* first = weight.data() + 2 * c * slots;
        apart = weights(products_.second[c], z, t, first + slots);
        if (apart && !same_[c]) apart = weights(products_.first[c], z, t, first);
    }
    if (!apart) {
        if (flight_.fastest() * t <= MOST_PARTS) add_series(z, t, out);
        else add_doubled(z, t, out);
        return;
    }
    ends(path, t, end.data());
    const Sum* sum = sums_.data();
    for (int k = 0; k < slots; ++k) {
        for (int q = k; q < slots; ++q, sum += 2) {
            bool used = false;
            for (int c = 0; c < count && !used; ++c) {
                const Number* b = weight.data() + (2 * c + 1) * slots;
                const Number* a = same_[c] ? b : b - slots;
                used = (a[k].real != 0.0 || a[k].imag != 0.0) && (b[q].real != 0.0 || b[q].imag != 0.0);
                used = used || ((a[q].real != 0.0 || a[q].imag != 0.0) && (b[k].real != 0.0 || b[k].imag != 0.0));
            }
            if (!used) continue;
            const Number plus = mean_exponential(sum[0].rate, sum[0].inverse, end[k] * end[q], t);
            const bool turning = slots_[k].rate.imag != 0.0 || slots_[q].rate.imag != 0.0;
            const Number minus = turning ? mean_exponential(sum[1].rate, sum[1].inverse, end[k] * conj(end[q]), t) : plus;
            for (int c = 0; c < count; ++c) {
                // Re(a e^x) Re(b e^y) = Re(a b e^(x+y) + a conj(b) e^(x+conj(y)))/2.
                const Number* b = weight.data() + (2 * c + 1) * slots;
                const Number* a = same_[c] ? b : b - slots;
                Number with = a[k] * b[q], against = a[k] * conj(b[q]);
                double factor = 0.5;
                if (k != q && same_[c]) factor = 1.0;
                else if (k != q) with += a[q] * b[k], against += conj(a[q]) * b[k];
                out[c] += factor * ((with.real * plus.real - with.imag * plus.imag) + (against.real * minus.real - against.imag * minus.imag));
            }
        }
    }
    for (int c = 0; c < count; ++c) out[c] *= products_.weight[c];
}

/// out += the integrals, over equal parts of the flight, by Taylor series.
void FlightIntegrals::add_series(Values z, double t, Vector<double> out) const {
    const int size = int(z.size()), count = products_.count();
    const int parts = int(flight_.fastest() * t) + 1;
    const double h = t / parts;
    const int terms = terms_of(flight_.fastest() * h);
    Local<double> state(size), term(size), other(size);
    Array<> series(2 * count, TERMS + 1);
    copy(z, state);
    for (int part = 0; part < parts; ++part) {
        copy(Values(state), term);
        for (int k = 0; k <= terms; ++k) {
            for (int c = 0; c < count; ++c) {
                series(2 * c, k) = dot(products_.first[c], Values(term));
                series(2 * c + 1, k) = dot(products_.second[c], Values(term));
            }
            flight_.rate(Values(term), other);
            for (int r = 0; r < size; ++r) term[r] = other[r] * (h / (k + 1));
        }
        for (int c = 0; c < count; ++c) {
            double total = 0.0;
            for (int order = 2 * terms; order > 0; --order) {
                double coefficient = 0.0;
                for (int k = std::max(0, order - terms); k <= std::min(order, terms); ++k)
                    coefficient += series(2 * c, k) * series(2 * c + 1, order - k);
                total += coefficient / (order + 1);
            }
            out[c] += products_.weight[c] * (total + series(2 * c, 0) * series(2 * c + 1, 0)) * h;
        }
        flight_.end(Values(state), h, other);
        copy(Values(other), state);
    }
}

/// out += the integrals, by doubling.
void FlightIntegrals::add_doubled(Values z, double t, Vector<double> out) const {
    const int size = int(z.size());
    double h = t;
    int doublings = 0;
    for (; flight_.fastest() * h > 1.0 && doublings < 1100; ++doublings) h *= 0.5;
    Array<> flow(size, size), half(size, size), grown(size, size), terms(TERMS + 1, size);
    Local<double> column(size), image(size);
    // The Taylor terms of exp(B s) z, and the integral of each times the series.
    copy(z, terms[0]);
    for (int k = 0; k < TERMS; ++k) {
        flight_.rate(Values(terms[k]), terms[k + 1]);
        for (int r = 0; r < size; ++r) terms(k + 1, r) *= h / (k + 1);
    }
    for (int j = TERMS; j >= 0; --j) {
        for (int r = 0; r < size; ++r) {
            double entry = 0.0;
            for (int k = TERMS; k >= 0; --k) entry += terms(k, r) / (k + j + 1);
            for (int q = 0; q < size; ++q) half(r, q) += entry * h * terms(j, q);
        }
    }
    double span = h;
    for (int count = 0; count < doublings; ++count, span *= 2.0) {
        flight_.map(span, flow);
        for (int r = 0; r < size; ++r) flight_.carry(flow, Values(half[r]), grown[r]);
        for (int q = 0; q < size; ++q) {
            for (int r = 0; r < size; ++r) column[r] = grown(r, q);
            flight_.carry(flow, Values(column), image);
            for (int r = 0; r < size; ++r) half(r, q) += image[r];
        }
    }
    for (int c = 0; c < products_.count(); ++c) {
        double total = 0.0;
        for (int r = 0; r < size; ++r) total += products_.first(c, r) * dot(half[r], products_.second[c]);
        out[c] += products_.weight[c] * total;
    }
}

}  // namespace saltus
