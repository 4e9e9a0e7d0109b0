/// Derivatives of a problem's residual along directions, by jets: equations (38) and (53).
#pragma once

#include <vector>

#include "array.hpp"
#include "jet.hpp"

namespace saltus {

/// out = F''(y)[a, b].
template <class Problem>
void second_derivative(const Problem& problem, Values y, Values a, Values b, Vector<double> out) {
    using Inner = Jet<double, 1>;
    using Outer = Jet<Inner, 1>;
    std::vector<Outer> at(y.size()), value(out.size());
    for (size_t j = 0; j < y.size(); ++j) {
        at[j] = Outer(Inner(y[j]));
        at[j].value.slopes[0] = a[j];
        at[j].slopes[0] = Inner(b[j]);
    }
    problem.residual(at, value);
    for (size_t j = 0; j < out.size(); ++j) out[j] = value[j].slopes[0].slopes[0];
}

/// out = F'''(y)[a, b, c].
template <class Problem>
void third_derivative(const Problem& problem, Values y, Values a, Values b, Values c, Vector<double> out) {
    using First = Jet<double, 1>;
    using Second = Jet<First, 1>;
    using Third = Jet<Second, 1>;
    std::vector<Third> at(y.size()), value(out.size());
    for (size_t j = 0; j < y.size(); ++j) {
        at[j] = Third(Second(First(y[j])));
        at[j].value.value.slopes[0] = a[j];
        at[j].value.slopes[0] = First(b[j]);
        at[j].slopes[0] = Second(First(c[j]));
    }
    problem.residual(at, value);
    for (size_t j = 0; j < out.size(); ++j) out[j] = value[j].slopes[0].slopes[0].slopes[0];
}

}  // namespace saltus
