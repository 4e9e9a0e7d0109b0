/// The path of a flight under periodic loads as that of a linear flight, whose states contain the oscillators.
///
/// The particular solution of each block is a row on the oscillators. A load that has joined a block is a part of it, with
/// an oscillator of its own; the states of such a block are scaled so that its matrix is nearly balanced.
#pragma once

#include <optional>

#include "extrema.hpp"
#include "loaded_flight.hpp"

namespace saltus {

/// What a state can grow or decay by in a piece of a flight, as a logarithm, where bounds grow or modes damp.
inline constexpr double PIECE_GROWTH = 2.0;
/// A piece is not shorter than this part of a flight where bounds grow.
inline constexpr int MOST_PIECES = 1000;
/// Decay, as a logarithm, after which a mode is rounding: pieces grow with the time, and their number with the logarithm of
/// a rate.
inline constexpr double FADED = 40.0;

/// A loaded flight at values of the parameters, and the state where one path begins. E entries.
template <int N>
class LoadedPath {
public:
    LoadedPath(const LoadedFlight<N>& flight, const Drive<double>& drive)
        : flight_(flight), drive_(drive), place_(flight.size()), unit_(flight.size(), 1.0) {
        const auto& free = flight.free();
        const int harmonics = flight.harmonics();
        int size = flight.size() + 2 * (harmonics + int(drive.joined.size()));
        Array<> matrix(size, size);
        std::vector<Block> blocks;
        blocks.reserve(free.blocks().size() + harmonics);
        int at = 0;
        for (int k = 0; k < int(free.blocks().size()); ++k) at = add_block(k, at, matrix, blocks);
        last_ = at;
        for (int h = 0; h < harmonics; ++h, at += 2) {
            const double nu = flight.harmonic(h) * drive.base;
            blocks.push_back({at, at + 1, 0.0, -nu * nu, 0.0, -nu, nu, 0.0});
            matrix(at, at + 1) = -nu, matrix(at + 1, at) = nu;
        }
        linear_.emplace(std::move(blocks), std::move(matrix), std::vector<double>(size, 1.0), false);
        state_.resize(size);
        for (const Block& block : linear_->blocks()) {
            if (!block.is_pair())
                for (int r = block.first; r < block.first + block.size(); ++r)
                    decay_ = std::max(decay_, -linear_->matrix()(r, r));
            else decay_ = std::max(decay_, (block.delta > 0.0 ? std::sqrt(block.delta) : 0.0) - block.mean);
        }
    }

    int size() const { return linear_->size(); }
    const LinearFlight<>& linear() const { return *linear_; }
    double growth() const { return linear_->growth(); }
    Values state() const { return state_; }

    /// Begin at the state z with oscillators o.
    void begin(Values z, Values o) {
        Local<double, N> q(flight_.size());
        multiply(flight_.enter(), z, q);
        for (int row = 0; row < 2 * flight_.harmonics(); ++row) {
            state_[last_ + row] = o[row];
            for (int r = 0; r < flight_.size(); ++r) q[r] -= drive_.steady(row, r) * o[row];
        }
        for (int r = 0; r < flight_.size(); ++r) state_[place_[r]] = q[r] / unit_[r];
        for (const Copy& copy : copies_)
            for (int part = 0; part < 2; ++part) state_[copy.at + part] = o[2 * copy.harmonic + part] * copy.strength;
    }

    /// rows (4, E) = a functional of the state (N,) and of the oscillators (2 H,), and three derivatives.
    void functional(Values on_state, Values on_oscillators, Matrix<double> rows) const {
        std::fill(rows.data(), rows.data() + 4 * size(), 0.0);
        for (int row = 0; row < int(on_oscillators.size()); ++row) rows(0, last_ + row) = on_oscillators[row];
        for (int r = 0; r < flight_.size(); ++r) {
            double total = 0.0;
            for (int i = 0; i < flight_.size(); ++i) total += on_state[i] * flight_.leave()(i, r);
            rows(0, place_[r]) += total * unit_[r];
            for (int row = 0; row < 2 * flight_.harmonics(); ++row) rows(0, last_ + row) += total * drive_.steady(row, r);
        }
        const Matrix<const double> b = linear_->matrix();
        for (int order = 0; order < 3; ++order)
            for (int r = 0; r < size(); ++r)
                if (const double factor = rows(order, r); factor != 0.0)
                    for (int c = 0; c < size(); ++c) rows(order + 1, c) += factor * b(r, c);
    }

    /// Call use(at, width) for pieces of a flight from the time `start` on, in which no mode decays by more than
    /// `PIECE_GROWTH` until it has faded; until it returns false.
    template <class Use>
    void each_piece(double start, double duration, Use&& use) const {
        const double longest = growth() > 0.0 ? std::max(PIECE_GROWTH / growth(), duration / MOST_PIECES) : duration;
        double width = decay_ > 0.0 ? PIECE_GROWTH / decay_ : duration;
        for (double at = start; at < duration;) {
            width = std::min(width, longest);
            if (at + width >= duration) width = duration - at;
            if (!use(at, width) || at + width == at) return;
            at += width;
            width = std::max(width, at * PIECE_GROWTH / FADED);
        }
    }

    /// `nearest_turn` from the time `start` on, piece by piece.
    Clearance clearance(const ObservedGap& gap, double start, double duration, double tie, double last) const {
        Local<double> piece(size());
        Clearance best;
        TurnState turns;
        each_piece(start, duration, [&](double at, double width) {
            linear_->end(Values(state_), at, piece);
            Clearance found = nearest_turn(path_of(*linear_, piece, width), gap, width, tie, last - at, turns);
            if (std::isnan(found.distance)) {
                best = found;
                return false;
            }
            found.time += at;
            best.take(found, tie, found.time > last ? INFINITE : 0.0);
            return true;
        });
        return best;
    }

private:
    /// An oscillator of a block.
    struct Copy {
        int at, harmonic;
        double strength;
    };

    /// Write block k, from entry `at` on; returns where the next one begins.
    int add_block(int k, int at, Array<>& matrix, std::vector<Block>& blocks) {
        const Block& block = flight_.free().blocks()[k];
        const Matrix<const double> b = flight_.free().matrix();
        const int size = block.size(), first = at;
        const auto row_of = [&](int r) { return r == 1 && block.is_pair() ? block.second : block.first + r; };
        bool joined = false;
        for (const auto& join : drive_.joined) joined = joined || join.block == k;
        // A pair with loads gets the entries of equal size off its diagonal that a rotation has.
        double balance = 1.0;
        if (joined && block.is_pair() && block.b12 != 0.0)
            balance = std::max({1.0, std::sqrt(std::fabs(block.b21 / block.b12)), drive_.base / std::fabs(block.b12)});
        for (int r = 0; r < size; ++r) {
            place_[row_of(r)] = at + r;
            if (block.is_pair() && r == 1) unit_[row_of(r)] = balance;
        }
        for (int r = 0; r < size; ++r)
            for (int c = 0; c < size; ++c)
                matrix(at + r, at + c) = b(row_of(r), row_of(c)) * unit_[row_of(c)] / unit_[row_of(r)];
        at += size;
        for (const auto& join : drive_.joined) {
            if (join.block != k) continue;
            const int one = 2 * join.harmonic;
            const double nu = flight_.harmonic(join.harmonic) * drive_.base;
            double strength = 0.0;
            for (int r = 0; r < size; ++r) {
                const double along = std::fabs(drive_.modal(one, row_of(r))), across = std::fabs(drive_.modal(one + 1, row_of(r)));
                strength = std::max(strength, (along + across) / unit_[row_of(r)]);
            }
            if (drive_.base > 0.0) strength /= drive_.base;
            copies_.push_back({at, join.harmonic, strength});
            for (int r = 0; r < size; ++r)
                for (int part = 0; part < 2; ++part)
                    matrix(first + r, at + part) = drive_.modal(one + part, row_of(r)) / (unit_[row_of(r)] * strength);
            matrix(at, at + 1) = -nu, matrix(at + 1, at) = nu;
            at += 2;
        }
        const double mean = block.mean, delta = block.delta;
        if (at > first + size) blocks.push_back({first, first - at, size * mean / (at - first), 0.0, 0.0, 0.0, 0.0, 0.0});
        else if (block.is_pair()) blocks.push_back({first, first + 1, mean, delta, block.b11, block.b12, block.b21, block.b22});
        else blocks.push_back({first, block.second, mean, delta, 0.0, 0.0, 0.0, 0.0});
        return at;
    }

    const LoadedFlight<N>& flight_;
    const Drive<double>& drive_;
    std::optional<LinearFlight<>> linear_;
    std::vector<int> place_;     // of each coordinate of the flight
    std::vector<double> unit_;   // of the state there
    std::vector<Copy> copies_;
    std::vector<double> state_;
    int last_ = 0;               // where the oscillators begin that no block contains
    double decay_ = 0.0;
};

}  // namespace saltus
