/// Exact integrals of products along a linear flight, equation (29).
#include "budget.hpp"

#include <algorithm>

namespace saltus {

namespace {

/// |x t| below which (exp(x t) - 1)/(x t) is a series.
constexpr double SMALL = 0.1;
/// The two exponentials of a pair are integrated separately up to this size, relative to the largest value of their sum
/// over the flight. A product can lose a factor of its square in accuracy.
constexpr double LOST = 4.0;
/// Decay, relative to the rate of a block, from which on it counts as coming to rest.
constexpr double SETTLES = 1e-9;
/// Decay, as a logarithm, after which the products of a motion are nothing beside what they were.
constexpr double SETTLED = 50.0;
/// Taylor terms on a part of a flight with a rate times time of 1 at most: truncation below 1e-17.
constexpr int TERMS = 19;
/// Parts of a flight above which the doubled matrix is cheaper.
constexpr int MOST_PARTS = 24;

using Number = Complex<double>;

/// (exp(z) - 1)/z for |z| <= SMALL: 1 + z/2! + z^2/3! + .. + z^9/10!, by powers of z^2 and z^4, so chains of products are short.
template <class T>
inline T mean_of_small(const T& z) {
    const T q = z * z, square = q * q;
    const T even = (q * (1.0 / 6.0) + 1.0) + square * ((q * (1.0 / 5040.0) + 1.0 / 120.0) + square * (1.0 / 362880.0));
    const T odd = (q * (1.0 / 24.0) + 1.0 / 2.0) + square * ((q * (1.0 / 40320.0) + 1.0 / 720.0) + square * (1.0 / 3628800.0));
    return even + z * odd;
}

/// The integral of exp(x s) over 0 <= s <= t, given exp(x t) and 1/x.
inline Number mean_exponential(const Number& x, const Number& inverse, const Number& end, double t) {
    const double real = x.real * t, imaginary = x.imag * t;
    if (!(std::fabs(real) + std::fabs(imaginary) <= SMALL)) return (end - 1.0) * inverse;
    return mean_of_small(Number{real, imaginary}) * t;
}
inline double mean_exponential(double x, double inverse, double end, double t) {
    const double z = x * t;
    if (!(std::fabs(z) <= SMALL)) return (end - 1.0) * inverse;
    return mean_of_small(z) * t;
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
    double slowest = INFINITE;
    for (const Slot& slot : slots_) {
        decays_ = decays_ && slot.rate.real < -SETTLES * abs(slot.rate);
        slowest = std::min(slowest, -slot.rate.real);
    }
    if (decays_ && !slots_.empty()) settled_ = SETTLED / slowest;
    for (size_t k = 0; k < slots_.size(); ++k) {
        for (size_t q = k; q < slots_.size(); ++q) {
            for (const Number& x : {slots_[k].rate + slots_[q].rate, slots_[k].rate + conj(slots_[q].rate)}) {
                const double square = x.real * x.real + x.imag * x.imag;
                sums_.push_back({x, square > 0.0 ? Number{x.real / square, -x.imag / square} : Number{0.0, 0.0}});
            }
        }
    }
    for (const Block& b : flight.blocks()) {
        const double w = std::sqrt(std::fabs(b.delta));
        parts_.push_back({b.first, b.second, b.is_pair() ? b.delta : 0.0, w, w / std::fabs(b.mean)});
    }
    for (int c = 0; c < products.count(); ++c) add_forms(products.second[c]);
    for (int c = 0; c < products.count(); ++c) {
        const Values row = products.first[c];
        add_forms(row);
        same_.push_back(std::equal(row.begin(), row.end(), products.second[c].begin()));
    }
}

void FlightIntegrals::add_forms(Values row) {
    for (const Block& b : flight_.blocks()) {
        const int i = b.first, j = b.second;
        if (!b.is_pair()) {
            for (int r = i; r < i + b.size() && !b.is_single(); ++r) apart_ = apart_ && row[r] == 0.0;
            forms_.push_back({row[i], 0.0, 0.0, 0.0});
            continue;
        }
        const double unit = b.delta != 0.0 ? std::sqrt(std::fabs(b.delta)) : 1.0;
        forms_.push_back({row[i], row[j], (row[i] * (b.b11 - b.mean) + row[j] * b.b21) / unit,
                          (row[i] * b.b12 + row[j] * (b.b22 - b.mean)) / unit});
    }
}

/// Weights of the exponentials in row . z(s). False if they do not exist or would cancel.
template <int P>
bool FlightIntegrals::weights(int row, const double* z, double t, Number* out) const {
    const int count = P == DYNAMIC ? int(parts_.size()) : P;
    const Form* forms = forms_.data() + size_t(row) * count;
    for (int k = 0; k < count; ++k) {
        const Part& part = parts_[k];
        const Form& form = forms[k];
        const int i = part.first, j = part.second;
        if (P == DYNAMIC && j < 0) {
            if (j == -1) *out++ = {form.alpha_first * z[i], 0.0};
            continue;
        }
        const double alpha = form.alpha_first * z[i] + form.alpha_second * z[j];
        const double beta = form.beta_first * z[i] + form.beta_second * z[j], size = std::fabs(beta);
        if (P == DYNAMIC && part.delta == 0.0) {
            if (beta != 0.0) return false;
            *out++ = {alpha, 0.0};
            continue;
        }
        if (size > LOST * std::max(std::fabs(alpha), size * std::min(part.frequency * t, part.lasting))) return false;
        if (P != DYNAMIC || part.delta < 0.0) {
            *out++ = {alpha, -beta};
        } else {
            const double fast = flight_.blocks()[k].mean <= 0.0 ? -beta : beta;
            *out++ = {0.5 * (alpha + fast), 0.0};
            *out++ = {0.5 * (alpha - fast), 0.0};
        }
    }
    return true;
}

/// The values of all exponentials at t.
template <int P>
void FlightIntegrals::ends(const LinearPath<DYNAMIC, P>& path, double t, Number* out) const {
    const int slots = P == DYNAMIC ? int(slots_.size()) : P;
    if ((P != DYNAMIC || flight_.steps().is_usable()) && t < INFINITE) {
        const auto& turns = path.turns(t);
        for (int s = 0; s < slots; ++s) {
            const bool turning = P != DYNAMIC || slots_[s].rate.imag != 0.0;
            const int k = P == DYNAMIC ? slots_[s].block : s;
            out[s] = {turns.cosine.data()[k], turning ? turns.sine.data()[k] : 0.0};
        }
        return;
    }
    for (int s = 0; s < slots; ++s) {
        const Number& rate = slots_[s].rate;
        const double size = rate.real == 0.0 ? 1.0 : t < INFINITE ? exp(rate.real * t) : 0.0;
        double cosine = 1.0, sine = 0.0;
        if (rate.imag != 0.0 && t < INFINITE) sincos(rate.imag * t, sine, cosine);
        out[s] = {size * cosine, size * sine};
    }
}

template <int P>
void FlightIntegrals::over(const LinearPath<DYNAMIC, P>& path, double t, Vector<double> out) const {
    const int count = products_.count(), slots = P == DYNAMIC ? int(slots_.size()) : P;
    for (int c = 0; c < count; ++c) out[c] = 0.0;
    if (count == 0 || t == 0.0) return;
    const double* z = path.begin().data();
    Local<Number, DYNAMIC, 64> weight(2 * count * slots);
    Local<Number, P> end(slots);
    bool apart = apart_;
    for (int c = 0; c < count && apart; ++c) {
        Number* first = weight.data() + 2 * c * slots;
        apart = weights<P>(c, z, t, first + slots);
        if (apart && !same_[c]) apart = weights<P>(count + c, z, t, first);
    }
    if (!apart) {
        t = std::min(t, settled_);
        if (flight_.fastest() * t <= MOST_PARTS) add_series(path.begin(), t, out);
        else add_doubled(path.begin(), t, out);
        return;
    }
    ends<P>(path, t, end.data());
    const Sum* sum = sums_.data();
    for (int k = 0; k < slots; ++k) {
        for (int q = k; q < slots; ++q, sum += 2) {
            bool used = P != DYNAMIC;
            for (int c = 0; c < count && !used; ++c) {
                const Number* b = weight.data() + (2 * c + 1) * slots;
                const Number* a = same_[c] ? b : b - slots;
                used = (a[k].real != 0.0 || a[k].imag != 0.0) && (b[q].real != 0.0 || b[q].imag != 0.0);
                used = used || ((a[q].real != 0.0 || a[q].imag != 0.0) && (b[k].real != 0.0 || b[k].imag != 0.0));
            }
            if (!used) continue;
            const Number plus = mean_exponential(sum[0].rate, sum[0].inverse, end[k] * end[q], t);
            Number minus = plus;
            if (P != DYNAMIC || slots_[k].rate.imag != 0.0 || slots_[q].rate.imag != 0.0) {
                const Number product = end[k] * conj(end[q]);
                minus = k == q ? Number{mean_exponential(sum[1].rate.real, sum[1].inverse.real, product.real, t), 0.0}
                    : mean_exponential(sum[1].rate, sum[1].inverse, product, t);
            }
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

template void FlightIntegrals::over(const LinearPath<DYNAMIC>&, double, Vector<double>) const;
template void FlightIntegrals::over(const LinearPath<DYNAMIC, 1>&, double, Vector<double>) const;
template void FlightIntegrals::over(const LinearPath<DYNAMIC, 2>&, double, Vector<double>) const;
template void FlightIntegrals::over(const LinearPath<DYNAMIC, 3>&, double, Vector<double>) const;

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
