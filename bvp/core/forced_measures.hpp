/// Largest displacements of an orbit under loads with linear flights, and exact integrals along them.
#pragma once

#include "budget.hpp"
#include "forced.hpp"
#include "loaded_path.hpp"
#include "peaks.hpp"

namespace saltus {

/// Largest phase of a flight. A longer one, as of a wild guess, is not measured.
inline constexpr double MOST_PHASE = 1e7;

template <class Problem>
class ForcedMeasures {
public:
    /// flown: the flights of an orbit.
    ForcedMeasures(const Problem& problem, const typename Problem::Flown& flown)
        : problem_(problem), flown_(flown), n_(problem.size() / 2) {}

    /// peaks (n,): the largest |u|. totals: the integrals of u^2 (n), of v_i v_j with i <= j, and of the powers of the loads (n). False
    /// where the search for a peak gave up.
    bool run(Vector<double> peaks, Vector<double> totals) {
        std::fill(totals.begin(), totals.end(), 0.0);
        std::fill(peaks.begin(), peaks.end(), 0.0);
        // The starts of all flights first: a flight that begins at rest is long searched, unless it is known to stay below these.
        for (int i = 0; i <= problem_.inner(); ++i)
            for (int c = 0; c < n_; ++c) peaks[c] = std::max(peaks[c], std::fabs(flown_.starts(i, c)));
        std::optional<Path> path;
        std::optional<FlightIntegrals> integrals;
        std::vector<double> part(totals.size());
        int present = -1;
        for (int i = 0; i <= problem_.inner(); ++i) {
            const int mode = problem_.events().mode[i];
            if (mode != present) {
                present = mode;
                path.emplace(problem_.flight(i, flown_.at), flown_.at.drives[mode]);
                set_rows(i, *path);
                integrals.emplace(path->linear(), products_);
            }
            path->begin(flown_.starts[i], flown_.begins[i]);
            if (!(turning_ * std::fabs(flown_.durations[i]) < MOST_PHASE)) return false;
            integrals->over(path_of(path->linear(), path->state(), flown_.durations[i]), flown_.durations[i], part);
            for (size_t k = 0; k < part.size(); ++k) totals[k] += part[k];
            if (!measure(*path, flown_.durations[i], peaks)) return false;
        }
        return true;
    }

private:
    using Path = LoadedPath<Problem::SIZE>;

    void set_rows(int i, const Path& path) {
        const int size = path.size(), harmonics = 2 * problem_.harmonics();
        place_ = speed_ = Array<>(n_, size);
        Array<> rows(4, size), load(n_, size);
        const std::vector<double> none(harmonics, 0.0);
        for (int c = 0; c < n_; ++c) {
            std::vector<double> state(2 * n_, 0.0), forces(harmonics);
            state[c] = 1.0;
            path.functional(state, none, rows);
            copy(rows[0], place_[c]), copy(rows[1], speed_[c]);
            for (int q = 0; q < harmonics; ++q) forces[q] = flown_.at.forces(q, c);
            path.functional(std::vector<double>(2 * n_, 0.0), forces, rows);
            copy(rows[0], load[c]);
        }
        const int count = 2 * n_ + n_ * (n_ + 1) / 2;
        products_ = {Array<>(count, size), Array<>(count, size), std::vector<double>(count, 1.0)};
        int row = 0;
        const auto add = [&](Values first, Values second) { copy(first, products_.first[row]), copy(second, products_.second[row++]); };
        for (int c = 0; c < n_; ++c) add(place_[c], place_[c]);
        for (int a = 0; a < n_; ++a)
            for (int b = a; b < n_; ++b) add(speed_[a], speed_[b]);
        for (int c = 0; c < n_; ++c) add(load[c], speed_[c]);
        const auto& flight = problem_.flight(i, flown_.at);
        turning_ = 0.0;
        for (const Block& block : flight.free().blocks()) {
            if (block.is_pair() || block.is_single())
                turning_ = std::max(turning_, std::sqrt(std::fabs(std::min(block.is_pair() ? block.delta : 0.0, 0.0))));
            else turning_ = std::max(turning_, flight.free().fastest());
        }
        turning_ = std::max(turning_, path.growth());
        const double base = flown_.at.drives[problem_.events().mode[i]].base;
        for (int h = 0; h < problem_.harmonics(); ++h) turning_ = std::max(turning_, flight.harmonic(h) * base);
    }

    bool measure(const Path& path, double duration, Vector<double> peaks) {
        const LinearFlight<>& linear = path.linear();
        Local<double> state(path.size()), end(path.size());
        bool found = true;
        path.each_piece(0.0, duration, [&](double at, double width) {
            linear.end(path.state(), at, state);
            linear.end(path.state(), at + width, end);
            const Displacements rows{place_, speed_};
            return found = raise_peaks(path_of(linear, Values(state), width), rows, width, Values(end), {peaks, {}});
        });
        return found;
    }

    const Problem& problem_;
    const typename Problem::Flown& flown_;
    const int n_;
    Array<> place_, speed_;
    Products products_;
    double turning_ = 0.0;
};

}  // namespace saltus
