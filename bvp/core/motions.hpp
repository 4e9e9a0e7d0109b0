/// Many motions of one system, on several threads, without a record of their events.
#pragma once

#include <functional>

#include "motion.hpp"

namespace saltus {

/// What is wanted of all motions of a batch.
struct BatchLimits {
    double duration;
    std::vector<double> fractions;  // of the initial energy, ascending
    bool with_peaks, to_rest;       // see `Motion`
    int64_t passes;                 // of one motion between two questions whether the batch is interrupted
};

/// The motions of a batch: a row each.
struct Batch {
    Matrix<const double> starts;  // (B, 2 n) (u, v)
    Values energies, restitution;  // (B,); restitution NaN: that of the system
    Vector<const int64_t> leaving, most;  // (B,) the contact that each is on after its impact, or -1; impacts
    Vector<const int64_t> rows;           // the motions to run
    Matrix<double> summary, final, modal;  // (B, columns), (B, 2 n) final states (u, v), and in modal coordinates
};

/// Columns of a summary, for D + S + 1 parts, Q fractions and P peaks.
struct Summary {
    enum Column { REASON, TIME, IMPACTS, TOUCHES, LAST, CLEAR, STICKING, AT_REST, WANTED, SUMS };
    static int columns(int parts, int fractions, int peaks) { return SUMS + parts + fractions * (1 + parts) + peaks; }
};

/// Run motions; the result of each depends on its own row alone. Reason NEW_MODE: the mode WANTED is to be added, and the motion to
/// be run again. There are not more threads than processors. `interrupted` is asked ten times a second on the calling thread; the motions
/// that are not done then have the reason PAUSED, or are not begun.
void run_batch(const ContactModes& modes, const BatchLimits& limits, const Batch& batch, int threads,
               const std::function<bool()>& interrupted);

}  // namespace saltus
