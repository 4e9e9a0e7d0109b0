/// Exact integrals of products along a linear flight, equation (29): sum over products of weight (a . z(s)) (b . z(s)),
/// integrated over 0 <= s <= t.
///
/// There are three methods.
///
/// 1. If every block has distinct rates, a . z is a sum of exponentials: those of oscillating pairs, of pairs with two
///    separate real rates, of single rates and of constant loads. The integral of each product of exponentials is
///
///        (exp(x t) - 1)/x,   x a sum of two rates,
///
///    computed from the exponentials, or from a series if |x t| is small, so nothing cancels. The integrals of the
///    exponentials are the same for all products, and each product is a quadratic form of them.
/// 2. Otherwise (near critical damping, rigid bodies, loads joined with a block, ramps) it is the product of two Taylor
///    series. The flight is divided into parts on which they converge.
/// 3. If there were many parts, the integral W of the matrix z(s) z(s)' is doubled: W(2 t) = W(t) + exp(B t) W(t)
///    exp(B't) (Van Loan, IEEE Trans. Automat. Control 23 (1978) 395, without its inverse). One W is enough for all
///    products a . W b.
#pragma once

#include "complex.hpp"
#include "path.hpp"

namespace saltus {

/// Products of two linear functionals: rows `first` and `second` (R, N), weights (R,).
struct Products {
    Array<> first, second;
    std::vector<double> weight;
    int count() const { return int(weight.size()); }
};

/// The integrals of products along the flights of one linear flow. It keeps a view of the flow and of the products.
class FlightIntegrals {
public:
    FlightIntegrals(const LinearFlight<>& flight, const Products& products);

    /// out (R,) = the integrals over a flight of t from the path's begin. t may be infinite where all motion decays.
    template <int P>
    void over(const LinearPath<DYNAMIC, P>& path, double t, Vector<double> out) const;
    /// Whether the integrals over infinite time exist for every flight.
    bool decays() const { return decays_; }

private:
    /// One exponential, or a conjugate pair of them.
    struct Slot {
        int block;
        Complex<double> rate;
    };
    /// A sum of two rates x, and 1/x or 0.
    struct Sum {
        Complex<double> rate, inverse;
    };
    /// A block, with w = sqrt(|delta|) and w/|mean|.
    struct Part {
        int first, second;
        double delta, frequency, lasting;
    };
    /// What a row makes of the two entries of a block: alpha = row . z, and beta/w = row . (B - mean) z/w.
    struct Form {
        double alpha_first, alpha_second, beta_first, beta_second;
    };

    void add_forms(Values row);
    template <int P>
    bool weights(int row, const double* z, double t, Complex<double>* out) const;
    template <int P>
    void ends(const LinearPath<DYNAMIC, P>& path, double t, Complex<double>* out) const;
    void add_series(Values z, double t, Vector<double> out) const;
    void add_doubled(Values z, double t, Vector<double> out) const;

    const LinearFlight<>& flight_;
    const Products& products_;
    std::vector<Part> parts_;
    std::vector<Form> forms_;  // of the second rows of all products, then of the first
    std::vector<Slot> slots_;
    std::vector<Sum> sums_;   // of slots k <= q: of the rates, then of the first and the conjugate of the second
    std::vector<char> same_;  // whether both functionals of a product are the same
    bool apart_ = true;       // whether no row has a part in a block of three and more
    bool decays_ = true;
    double settled_ = INFINITE;  // after this time nothing is left to integrate
};

}  // namespace saltus
