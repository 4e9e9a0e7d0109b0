/// Zeros in a bracket, with few evaluations: each can be a corrected point of a family.
#pragma once

#include "array.hpp"
#include "blocks.hpp"

namespace saltus {

/// Samples that are interpolated, at most.
inline constexpr int MOST_INTERPOLATED = 6;

/// Relative difference of the direction of the unknowns from that between its neighbours, beyond their own difference.
inline constexpr double ASIDE = 0.2;

/// Samples of a function in order of their places; the zero is between sample `at` - 1 and sample `at`.
struct Samples {
    std::vector<double> places, values;
    int at;

    double low() const { return places[at - 1]; }
    double high() const { return places[at]; }

    /// Where the function is zero: the place as a polynomial of the value, by Neville's scheme, through the ends of the
    /// bracket and up to two more samples on either side, neither too near to the others nor beyond an extremum.
    double interpolated() const {
        constexpr double APART = 0.05;  // least distance of samples that are interpolated, as a part of the bracket
        double x[MOST_INTERPOLATED] = {low(), high()}, v[MOST_INTERPOLATED] = {values[at - 1], values[at]};
        const double least = APART * (x[1] - x[0]), rise = v[1] - v[0];
        int size = 2;
        for (int side = 0; side < 2; ++side) {
            const int way = side == 1 ? 1 : -1, wanted = size + 2, count = int(places.size());
            int last = side, i = side == 1 ? at + 1 : at - 2;
            for (; size < wanted && 0 <= i && i < count && (values[i] - v[last]) * way * rise > 0.0; i += way) {
                if (!(std::fabs(places[i] - x[last]) > least)) continue;
                x[size] = places[i];
                v[size] = values[i];
                last = size++;
            }
        }
        for (int k = 1; k < size; ++k)
            for (int i = 0; i < size - k; ++i) x[i] = (v[i + k] * x[i] - v[i] * x[i + 1]) / (v[i + k] - v[i]);
        return x[0];
    }

    /// Where to look next, as a part of the bracket; and the least part that is of use. If that is above 0.5, the
    /// bracket is narrow enough.
    struct Place {
        double part, least;
    };
    Place next(double tolerance, bool bisect) const {
        constexpr double ROUNDING_OF_PLACES = 0x1p-51;  // least distance of two places, as a part of their size
        const double width = high() - low();
        // The ends of the bracket may be nearer to the root than this part of it.
        const double least =
            std::max(0.5 * tolerance, ROUNDING_OF_PLACES * std::max(std::fabs(low()), std::fabs(high()))) / width;
        if (least > 0.5) return {0.5, least};
        double part = 0.5;
        if (!bisect) {
            part = (interpolated() - low()) / width;
            if (!(-least <= part && part <= 1.0 + least)) part = 0.5;
        }
        return {std::min(std::max(part, least), 1.0 - least), least};
    }

    /// Whether to bisect next, from the value at a part of the bracket: neither was the bracket halved, nor did the
    /// value at an end go down much.
    bool is_slow(double part, double value) const {
        constexpr double SLOW = 0.1;
        if ((value > 0.0) == (values[at] > 0.0)) return part > 0.5 && std::fabs(value) > SLOW * std::fabs(values[at]);
        return 1.0 - part > 0.5 && std::fabs(value) > SLOW * std::fabs(values[at - 1]);
    }

    /// Add a sample inside the bracket, which becomes one of its ends. Returns whether it is beyond the zero.
    bool insert(double place, double value) {
        const bool beyond = (value > 0.0) == (values[at] > 0.0);
        places.insert(places.begin() + at, place);
        values.insert(values.begin() + at, value);
        if (!beyond) ++at;
        return beyond;
    }
};

/// The unknowns of a known step and their derivatives by the length of the step.
struct KnownStep {
    double length;
    std::vector<double> y, slope;
};

/// out = the cubic through the unknowns of two known steps, with their derivatives there, at the length s.
inline void cubic_between(const KnownStep& low, const KnownStep& high, double s, Vector<double> out) {
    const double width = high.length - low.length, part = (s - low.length) / width;
    for (size_t j = 0; j < out.size(); ++j) {
        const double change = part * part * (3.0 - 2.0 * part) * (high.y[j] - low.y[j]);
        out[j] = low.y[j] + change + width * part * (1.0 - part) * ((1.0 - part) * low.slope[j] - part * high.slope[j]);
    }
}

/// Whether the derivative `found` of the unknowns, at a part of the way between two known ones, is far from both: the
/// step is on another family.
inline bool goes_aside(Values low, Values high, double part, Values found) {
    double change = 0.0, expected = 0.0, aside = 0.0;
    for (size_t j = 0; j < found.size(); ++j) {
        const double difference = high[j] - low[j], middle = low[j] + part * difference, away = found[j] - middle;
        change += difference * difference;
        expected += middle * middle;
        aside += away * away;
    }
    return std::sqrt(aside) > std::sqrt(change) + ASIDE * std::sqrt(expected);
}

}  // namespace saltus
