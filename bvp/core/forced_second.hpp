/// Second derivatives of a forced problem along a direction, by jets of eight unknowns at once: equation (38).
#pragma once

#include "forced.hpp"

namespace saltus {

/// The derivative of the Jacobian along a direction. An unknown of a node is in the equations of the flights that end and
/// begin there alone.
template <class Problem>
class SecondAlong {
    static constexpr int WIDTH = 8;
    using Number = Jet<Jet<double, WIDTH>, 1>;

public:
    /// out (u - 1, u) = F''(y)[a, .].
    SecondAlong(const Problem& problem, Values y, Values a, Matrix<double> out)
        : problem_(problem), out_(out), at_(y.size()), rows_(problem.rows()) {
        std::fill_n(out.data(), size_t(out.rows()) * out.columns(), 0.0);
        for (size_t j = 0; j < y.size(); ++j) {
            at_[j] = Number(Jet<double, WIDTH>(y[j]));
            at_[j].slopes[0] = Jet<double, WIDTH>(a[j]);
        }
    }

    void run() {
        const int last = problem_.inner(), nodes = problem_.unfolding(), all = int(at_.size());
        typename Problem::template Setting<Number> plain;
        set(plain);
        for (int i = 0; i <= last; ++i) {
            std::vector<int> unknowns;
            for (int k = 0; k < problem_.rows(); ++k) unknowns.push_back(problem_.time(i) + k);
            for (int k = 0; last > 0 && k < problem_.rows(); ++k) unknowns.push_back(problem_.time(i < last ? i + 1 : 0) + k);
            in_bundles(unknowns, [&](auto&& take) { flight(i, plain, take); });
        }
        std::vector<int> unknowns, others;
        for (int j = 0; j < nodes; ++j) unknowns.push_back(j);
        for (int j = nodes; j < all; ++j) others.push_back(j);
        if (problem_.is_free()) in_bundles(unknowns, [&](auto&& take) { kept(plain, take); });
        in_bundles(others, [&](auto&& take) {
            typename Problem::template Setting<Number> moved;
            set(moved, plain.flights);
            for (int i = 0; i <= last; ++i) flight(i, moved, take);
            kept(moved, take);
        });
    }

private:
    void set(typename Problem::template Setting<Number>& out, const typename Problem::Flights& known = nullptr) const {
        problem_.set(Vector<const Number>(&at_[problem_.parameter(0)], problem_.released()), out, known);
    }

    /// Call use(take) for eight of the unknowns at once; take(row, number) keeps their derivatives of an equation.
    template <class Use>
    void in_bundles(const std::vector<int>& unknowns, Use&& use) {
        for (size_t first = 0; first < unknowns.size(); first += WIDTH) {
            const int count = int(std::min<size_t>(WIDTH, unknowns.size() - first));
            for (int d = 0; d < count; ++d) at_[unknowns[first + d]].value.slopes[d] = 1.0;
            use([&](int row, const Number& number) {
                for (int d = 0; d < count; ++d) out_(row, unknowns[first + d]) = number.slopes[0].slopes[d];
            });
            for (int d = 0; d < count; ++d) at_[unknowns[first + d]].value.slopes[d] = 0.0;
        }
    }

    template <class Take>
    void flight(int i, const typename Problem::template Setting<Number>& known, Take&& take) {
        problem_.flight_equations(i, at_, known, rows_.data());
        const int count = i < problem_.inner() ? problem_.rows() : problem_.closures();
        for (int r = 0; r < count; ++r) take(i * problem_.rows() + r, rows_[r]);
    }

    template <class Take>
    void kept(const typename Problem::template Setting<Number>& known, Take&& take) {
        const int first = problem_.inner() * problem_.rows() + problem_.closures();
        problem_.each_kept(known, at_, [&](int e, const Number& number) { take(first + e, number); });
    }

    const Problem& problem_;
    Matrix<double> out_;
    std::vector<Number> at_, rows_;
};

}  // namespace saltus
