/// The half map (13) of a symmetric orbit between its two reversals, and the test functions (35) that follow from it.
///
/// At an end the reduced perturbations (tangent to the energy level, modulo the flow) split into those kept by the
/// end's reversal (+) and those turned round by it (-), m of each. In these coordinates the linearised flow from one
/// end to the other is phi = [[a, b], [c, d]], symplectic, and the orbit's return map, R phi^-1 R phi, is [[d'a + b'c,
/// 2 d'b], [2 a'c, a'd + c'b]] (blocks; ' is transposition), whose trace is 2 m + 4 tr(b'c). A zero of det c is a fold
/// or branch point within the class of orbits between such ends, of det b the loss of the reversal, of det a or det d a
/// doubling. Motions that no spring and no stop resists are left out.
#pragma once

#include "chain.hpp"
#include "floquet.hpp"
#include "unfold.hpp"

namespace saltus {

/// The first rows of `out` (m, n): orthonormal, perpendicular to a direction (n,), and for n > 2 within the rows of
/// `held` (m + 1, n). They are oriented with that direction, so that determinants taken with them change sign only
/// through zero.
template <class V, class Out>
void section_basis(const V& direction, Matrix<const double> held, Out& out) {
    const int half = held.columns(), axes = held.rows();
    if (half == 2) {
        const double norm = hypot(direction[0], direction[1]);
        out(0, 0) = -direction[1] / norm, out(0, 1) = direction[0] / norm;
        return;
    }
    if (axes < 2) return;
    Local<double> v(axes);
    for (int a = 0; a < axes; ++a) {
        v[a] = 0.0;
        for (int r = 0; r < half; ++r) v[a] += held(a, r) * direction[r];
    }
    // Householder's reflection of v; its complement is the image of the other axes.
    const bool turned = v[0] < 0.0;
    const double factor = reflector(v, 0, axes);
    Local<double> along(half);
    for (int r = 0; r < half; ++r) along[r] = 0.0;
    for (int a = 0; a < axes; ++a)
        for (int r = 0; r < half; ++r) along[r] += v[a] * held(a, r);
    for (int b = 1; b < axes; ++b) {
        const double part = factor * v[b], sign = turned && b == axes - 1 ? -1.0 : 1.0;
        for (int r = 0; r < half; ++r) out(b - 1, r) = sign * (held(b, r) - part * along[r]);
    }
}

/// Factor by which the impact at node j magnifies rounding errors, sqrt(2 H) |g| / |g . v|; 1 for the fastest head-on
/// impact.
template <int N>
double magnification(const Chain<N>& chain, int j, Values gap, double reach) {
    double normal = 0.0;
    for (int r = 0; r < chain.size(); ++r) normal += gap[r] * gap[r];
    const double speed = std::fabs(dot(gap, chain.coming(j)));
    return speed > 0.0 ? reach * std::sqrt(normal) / speed : INFINITE;
}

/// An end of a half map: its kind, and its contact where it is at a stop.
template <class Kind>
struct HalfEnd {
    Kind kind;
    int contact = -1;
    bool keeps_velocity() const { return kind == Kind::ORIGIN; }
    bool is_stop() const { return kind == Kind::STOP; }
};

/// phi (2 m, 2 m) along a chain from its node 0 to the last one. held (m + 1, n): orthonormal rows, the displacements
/// without those that no spring and no stop resists. reach: sqrt(2 H). Returns the largest factor by which an impact
/// magnifies rounding (1: none).
template <int N, class Kind, class Phi>
double half_map(const Chain<N>& chain, const Contacts& contacts, HalfEnd<Kind> start, HalfEnd<Kind> finish,
                Matrix<const double> held, double reach, Phi&& phi) {
    constexpr int PAIRS = N == 4 ? 1 : DYNAMIC, HALF = N == DYNAMIC ? DYNAMIC : N / 2;
    const int size = chain.size(), half = size / 2, far = chain.nodes() - 1, pairs = held.rows() - 1,
              columns = 2 * pairs;
    // What the section at an end is perpendicular to: the velocity (origin), the force (rest), the stop's normal.
    Dense<PAIRS, HALF> first(pairs, half), last(pairs, half);
    const auto section = [&](HalfEnd<Kind> end, int j, Dense<PAIRS, HALF>& out) {
        Local<double, HALF> direction(half);
        for (int r = 0; r < half; ++r)
            direction[r] = end.is_stop()          ? contacts.gap[end.contact][r]
                           : end.keeps_velocity() ? chain.leaving(j)[r]
                                                  : -chain.leaving(j)[half + r];
        section_basis(direction, held, out);
    };
    section(start, 0, first);
    section(finish, far, last);
    double magnified = 1.0;
    if (start.is_stop()) magnified = larger(magnified, magnification(chain, 0, contacts.gap[start.contact], reach));
    if (finish.is_stop()) magnified = larger(magnified, magnification(chain, far, contacts.gap[finish.contact], reach));
    Dense<N> x(size, size);
    x.set(0.0);
    for (int column = 0; column < columns; ++column) {
        const bool kept = column < pairs;
        const int b = kept ? column : column - pairs, at = kept == start.keeps_velocity() ? half : 0;
        for (int r = 0; r < half; ++r) x(at + r, column) = start.keeps_velocity() && !kept ? -first(b, r) : first(b, r);
        if (!start.is_stop() || !kept) continue;
        // Tangent to the energy level: the impulse along the normal that makes up for the work.
        const Values gap = contacts.gap[start.contact];
        double normal = 0.0, work = 0.0;
        for (int r = 0; r < half; ++r)
            normal += gap[r] * chain.leaving(0)[r], work -= chain.leaving(0)[half + r] * first(b, r);
        for (int r = 0; r < half; ++r) x(half + r, column) = -work / normal * gap[r];
    }
    for (int i = 0; i < far; ++i) {
        chain.carry(i, i + 1, contacts, x, columns);
        if (const int c = chain.contact(i + 1); c >= 0)
            magnified = larger(magnified, magnification(chain, i + 1, contacts.gap[c], reach));
    }
    if (finish.is_stop()) {
        // At the far end the orbit is cut, not reflected: equation (27).
        const Values gap = contacts.gap[finish.contact], coming = chain.coming(far);
        const double speed = dot(gap, coming);
        for (int column = 0; column < columns; ++column) {
            double shift = 0.0;
            for (int r = 0; r < half; ++r) shift -= gap[r] * x(r, column);
            shift /= speed;
            for (int r = 0; r < size; ++r) x(r, column) += shift * coming[r];
        }
    }
    // Equation (13): the entries in the coordinates of the far end.
    const bool keeps = finish.keeps_velocity();
    for (int b = 0; b < pairs; ++b) {
        double *first_row = &phi(b, 0), *second_row = &phi(pairs + b, 0);
        for (int column = 0; column < columns; ++column) first_row[column] = second_row[column] = 0.0;
        for (int r = 0; r < half; ++r) {
            const double entry = last(b, r), second = keeps ? -entry : entry;
            const double *kept = &x(keeps ? half + r : r, 0), *turned = &x(keeps ? r : half + r, 0);
            for (int column = 0; column < columns; ++column) first_row[column] += entry * kept[column];
            for (int column = 0; column < columns; ++column) second_row[column] += second * turned[column];
        }
    }
    return magnified;
}

/// The multipliers of the map there and back, equation (13), of the half map phi (2 m, 2 m); turned: of that map
/// applied twice. Returns how far phi is from a symplectic map, relative to the square of its largest entry.
/// found.is_known: whether they are found.
template <class Phi>
double half_map_multipliers(const Phi& phi, bool turned, Spectrum<>& found) {
    const int m = phi.rows() / 2;
    Dense<> back(2 * m);
    double lost = 0.0, largest = 1.0;
    for (int r = 0; r < m; ++r)
        for (int c = 0; c < m; ++c) {
            // Sums over the rows of a pair of columns of a, b, c, d, taken from a and c, or b and d.
            const auto product = [&](int first, int second, int from, int to) {
                double total = 0.0;
                for (int k = 0; k < m; ++k) total += phi(first * m + k, from) * phi(second * m + k, to);
                return total;
            };
            back(r, c) = product(1, 0, m + r, c) + product(0, 1, m + r, c);
            back(r, m + c) = 2.0 * product(1, 0, m + r, m + c);
            back(m + r, c) = 2.0 * product(0, 1, r, c);
            back(m + r, m + c) = product(0, 1, r, m + c) + product(1, 0, r, m + c);
            const double unit = product(0, 1, r, m + c) - product(1, 0, r, m + c) - (r == c ? 1.0 : 0.0);
            lost = larger(lost, std::fabs(unit));
            lost = larger(lost, std::fabs(product(0, 1, r, c) - product(1, 0, r, c)));
            lost = larger(lost, std::fabs(product(0, 1, m + r, m + c) - product(1, 0, m + r, m + c)));
        }
    for (int r = 0; r < 2 * m; ++r)
        for (int c = 0; c < 2 * m; ++c) largest = larger(largest, std::fabs(phi(r, c)));
    found.is_known = eigenvalues(back, found.real.data(), found.imaginary.data());
    found.order(true);
    if (turned) found.square();
    return lost / (largest * largest);
}

/// The chain of the orbit y of a problem from its start to its far end. ends (k + 1, N): states at the end of each
/// flight. Returns sqrt(2 H).
template <class Problem, class Ends>
double set_half_chain(const Problem& problem, Values y, const Ends& ends, Chain<Problem::SIZE>& chain) {
    const auto& flight = problem.flight();
    const int k = problem.inner();
    double reach = 0.0;
    chain.begin(k + 2);
    problem.each_flight(y, [&](int i, auto z, double t) {
        if (i == 0) {
            chain.set_node(0, flight, problem.contacts(), -1, z, z);
            reach = std::sqrt(flight.twice_energy(z));
        } else {
            chain.set_node(i, flight, problem.contacts(), problem.contact(i - 1), ends[i - 1], z);
        }
        chain.set_flight(i, flight, z, t);
    });
    chain.set_node(k + 1, flight, problem.contacts(), -1, ends[k], ends[k]);
    return reach;
}

/// What is known of the stability of an orbit with two degrees of freedom.
struct PairStability {
    double a = NOT_A_NUMBER, b = NOT_A_NUMBER, c = NOT_A_NUMBER,
           d = NOT_A_NUMBER;  // the half map; NaN for a periodic closure
    double magnified = 1.0;   // largest factor by which an impact of the half map magnifies rounding
    double trace = NOT_A_NUMBER,
           determinant = NOT_A_NUMBER;  // of the pair of multipliers; NaN where they are unbounded or unknown
    Complex<double> larger{NOT_A_NUMBER, NOT_A_NUMBER}, smaller{NOT_A_NUMBER, NOT_A_NUMBER};
    double trivial = NOT_A_NUMBER;  // how badly the trivial directions are kept
    bool is_singular = false;       // an impact grazes
};

/// The half map of an orbit between two ends, and the multipliers of an orbit with two degrees of freedom.
template <class Problem>
class OrbitStability {
public:
    static constexpr int N = Problem::SIZE, M = N == 4 ? 2 : DYNAMIC;

    /// held (m + 1, n), free (f, n): the displacements without those that nothing resists, and these; f = 0 for two
    /// degrees of freedom.
    OrbitStability(const Problem& problem, Matrix<const double> held, Matrix<const double> free)
        : held_(held.rows(), held.columns()),
          chain_(problem.size(), is_modal(problem.flight())),
          floquet_(problem.size(), free, true),
          phi_(2 * (held.rows() - 1)),
          scale_(problem.size()) {
        std::copy(held.data(), held.data() + held.rows() * held.columns(), held_.data());
    }

    /// Find phi(). Returns the largest factor by which an impact magnifies rounding.
    template <class Ends>
    double find_half_map(const Problem& problem, Values y, const Ends& ends) {
        const double reach = set_half_chain(problem, y, ends, chain_);
        const auto& closure = problem.closure();
        const int k = problem.inner();
        return half_map(chain_, problem.contacts(), HalfEnd{closure.start, problem.contact(k + 1)},
                        HalfEnd{closure.finish, problem.contact(k)}, Matrix<const double>(held_), reach, phi_);
    }
    /// The entries of a half map that is known, for two degrees of freedom.
    void set_half_map(double a, double b, double c, double d) {
        phi_(0, 0) = a, phi_(0, 1) = b, phi_(1, 0) = c, phi_(1, 1) = d;
    }
    const Dense<M>& phi() const { return phi_; }

    /// Half map and multipliers for two degrees of freedom.
    template <class Ends>
    PairStability pair(const Problem& problem, Values y, const Ends& ends) {
        PairStability out;
        const bool turned = problem.closure().quarters == 1;
        if (!problem.periodic()) {
            out.magnified = find_half_map(problem, y, ends);
            out.a = phi_(0, 0), out.b = phi_(0, 1), out.c = phi_(1, 0), out.d = phi_(1, 1);
        }
        period_.unfold(problem, y, ends, turned);
        if (period_.count() == 0) {
            // Of a linear orbit without impacts each mode moves alone, and its family is no family of impacting orbits.
            if constexpr (Problem::FlightType::is_series()) without_impacts(turned, out);
            return out;
        }
        set_cycle(problem, period_.nodes());
        const Route route = floquet_.multipliers(chain_, problem.contacts(), scale_, turned, PAIR_LIMIT);
        out.is_singular = route == Route::SINGULAR;
        if (route > Route::FACTORED) return out;
        const Spectrum<M>& found = floquet_.found();
        out.larger = found.value(0), out.smaller = found.value(1);
        out.trace = out.larger.real + out.smaller.real;
        out.determinant = (out.larger * out.smaller).real;
        out.trivial = floquet_.trivial();
        return out;
    }

    /// The eigenvalues of the formed product along some nodes.
    const Spectrum<M>& form(const Problem& problem, const Nodes& nodes) {
        set_cycle(problem, nodes);
        floquet_.formed(chain_, problem.contacts(), scale_);
        return floquet_.found();
    }

    Period& period() { return period_; }
    Floquet<N, M>& floquet() { return floquet_; }

private:
    /// Norm up to which one pair is taken from the formed product, whose determinant loses its square. Without it a
    /// pair costs little more.
    static constexpr double PAIR_LIMIT = 30.0;

    void set_cycle(const Problem& problem, const Nodes& nodes) {
        chain_.set(problem.flight(), problem.contacts(), nodes, !problem.periodic());
        set_scale(nodes, problem.flight().twice_energy(nodes.after[0]), scale_);
    }

    /// From the half map, equation (13), of the chain of its flight.
    void without_impacts(bool turned, PairStability& out) {
        const double below = out.b * out.c, above = out.a * out.d;
        // trace/2, and (trace/2)^2 - 1 as a product of small numbers
        double half = 1.0 + 2.0 * below, square = 4.0 * below * above;
        out.determinant = (above - below) * (above - below);
        if (turned) {
            square *= 4.0 * half * half;
            half = 2.0 * half * half - 1.0;
            out.determinant *= out.determinant;
        }
        const double root = std::sqrt(std::fabs(square)), larger = half + std::copysign(root, half);
        out.trace = 2.0 * half;
        out.larger = square >= 0.0 ? Complex<double>{larger, 0.0} : Complex<double>{half, -root};
        out.smaller = square >= 0.0 ? Complex<double>{out.determinant / larger, 0.0} : Complex<double>{half, root};
        Dense<N> flow(int(scale_.size()), int(scale_.size()));
        flow.set(0.0);
        for (int r = 0; r < flow.rows(); ++r) flow(r, 0) = chain_.leaving(0)[r];
        double length = 0.0, defect = 0.0;
        chain_.carry(0, 1, Contacts{}, flow, 1);
        for (int r = 0; r < flow.rows(); ++r) {
            const double off = flow(r, 0) - chain_.coming(1)[r];
            length += chain_.leaving(0)[r] * chain_.leaving(0)[r], defect += off * off;
        }
        out.trivial = std::sqrt(defect / length);
    }

    Dense<> held_;
    Chain<N> chain_;
    Floquet<N, M> floquet_;
    Dense<M> phi_;
    Period period_;
    std::vector<double> scale_;
};

}  // namespace saltus
