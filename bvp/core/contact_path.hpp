/// The path of a flight with smooth forces, for searches of its next impact.
///
/// Accelerations are linear in its states Z = (z, f, f', f''), with the forces and their first two derivatives by time:
/// rows of contacts are rows on Z. It is computed as far as a search comes.
#pragma once

#include "impact.hpp"
#include "smooth_flight.hpp"

namespace saltus {

class ContactPath {
public:
    static constexpr int SIZE = DYNAMIC, PAIRS = DYNAMIC;

    /// linear: of Z' = B Z without f''', whose blocks are pairs of displacements and velocities, and single forces. It
    /// shows how the entries of Z round.
    ContactPath(const SmoothFlight<>& flight, const LinearFlight<>& linear, Values z, double horizon)
        : linear_(linear), flight_(flight.shared(), z, horizon), begin_(linear.size(), 0.0) {
        std::copy(z.begin(), z.end(), begin_.begin());
        if (flight_.reach(0.0) == 0) copy(path().step(0)[0], begin_);
    }

    int size() const { return linear_.size(); }
    Values begin() const { return begin_; }
    template <class Out>
    void state(double t, Out&& out) const {
        const int s = flight_.reach(t);
        if (s >= 0) evaluate_series<double>(path().step(s), t - path().times[s], out);
        else std::fill(out.begin(), out.end(), NOT_A_NUMBER);
    }
    bool is_steady() const { return false; }
    /// Bounds hold in one step each.
    double growth() const { return 1e-300; }
    /// A step is a sixth of where its series converges.
    double fastest() const {
        return path().steps() > 0 ? std::max(linear_.fastest(), 1.0 / (6.0 * path().times[1])) : INFINITE;
    }
    double window(double t, double length) const {
        const int s = flight_.reach(t);
        return s >= 0 ? std::min(length, path().times[s + 1] - t) : 0.0;
    }
    Bounds bounds(Values row, double t, Values, double) const {
        const int s = flight_.reach(t);
        return s >= 0 ? path().bounds(row, s) : Bounds{INFINITE, INFINITE, INFINITE};
    }
    double rounding_level(Values row, Values z) const { return linear_.rounding_level(row, z); }
    const StepTable* steps() const { return nullptr; }

    /// By the coefficients of the first step.
    Parting parting(const Contacts& contacts, int c, double, double) const {
        double terms[ORDER + 1];
        path().project(contacts.gap[c], 0, terms);
        int order = 3;
        while (order * (order - 1) * std::fabs(terms[order]) <= rounding_level(contacts.acceleration[c], path().step(0)[order - 2]))
            if (++order > ORDER) return {0.0, 0};
        const double lead = -contacts.side[c] * terms[order], h = path().times[1];
        if (lead < 0.0) return {0.0, order};
        // lead t^order exceeds the rest of the series for all shorter times.
        double rest = 0.0;
        for (int k = ORDER; k > order; --k) rest = rest * h + std::fabs(terms[k]);
        return {rest > 0.0 ? std::min(lead / rest, h) : h, order};
    }
    /// Of the first step. The terms that are left out are those of a third of it, below 1e-19.
    double series(Values row, Vector<double> out) const {
        double terms[ORDER + 1];
        path().project(row, 0, terms);
        for (size_t k = 0; k < out.size(); ++k) out[k] = terms[k + 1];
        return NEAR_REACH / (0.3 * path().times[1]);
    }

private:
    const TaylorPath& path() const { return flight_.path(); }

    const LinearFlight<>& linear_;
    mutable GrowingFlight flight_;
    std::vector<double> begin_;
};

}  // namespace saltus
