/// Many motions of one system.
#include "motions.hpp"

#include <atomic>
#include <optional>
#include <thread>

namespace saltus {

namespace {

void summarise(const ContactModes& modes, const Motion& motion, Reason reason, double duration, Vector<double> row) {
    row[Summary::REASON] = double(reason);
    row[Summary::TIME] = reason == Reason::REACHED ? duration : motion.time();
    row[Summary::IMPACTS] = double(motion.impacts());
    row[Summary::TOUCHES] = double(motion.touches());
    row[Summary::LAST] = motion.last_impact();
    row[Summary::CLEAR] = motion.clear_from();
    row[Summary::STICKING] = motion.sticking_time();
    row[Summary::AT_REST] = motion.is_at_rest() ? 1.0 : 0.0;
    row[Summary::WANTED] = double(motion.wanted());
    size_t at = Summary::SUMS;
    for (const double sum : motion.sums()) row[at++] = sum;
    const size_t parts = size_t(modes.frame().parts());
    for (const EnergyMark& mark : motion.marks()) {
        row[at++] = mark.time;
        for (size_t i = 0; i < parts; ++i) row[at++] = mark.sums.empty() ? NOT_A_NUMBER : mark.sums[i];
    }
    at = row.size() - motion.peaks().size();
    for (const double peak : motion.peaks()) row[at++] = peak;
}

void run_one(const ContactModes& modes, const BatchLimits& limits, const Batch& batch, int64_t b,
             const std::function<bool()>& stops) {
    constexpr int64_t PASSES = 1 << 14;
    std::optional<ContactModes> changed;
    if (batch.restitution[b] == batch.restitution[b]) changed.emplace(modes.with_restitution(batch.restitution[b]));
    const ContactModes& own = changed ? *changed : modes;
    Motion motion(own, batch.starts[int(b)], batch.energies[b], int(batch.leaving[b]), limits.fractions, limits.with_peaks, limits.to_rest);
    Reason reason = Reason::PAUSED;
    while (reason == Reason::PAUSED && !stops()) reason = motion.move(limits.duration, batch.most[b], PASSES, nullptr);
    Vector<double> row = batch.summary[int(b)];
    std::fill(row.begin(), row.end(), NOT_A_NUMBER);
    summarise(own, motion, reason, limits.duration, row);
    if (motion.state().empty()) return;
    const ContactMode& mode = own[motion.mode()];
    multiply(Matrix<const double>(mode.leave), motion.state(), batch.final[int(b)]);
    multiply(Matrix<const double>(mode.to_modes), motion.state(), batch.modal[int(b)]);
}

}  // namespace

void run_batch(const ContactModes& modes, const BatchLimits& limits, const Batch& batch, int threads,
               const std::function<bool()>& interrupted) {
    std::atomic<size_t> next = 0;
    std::atomic<bool> ends = false;
    const auto work = [&](const std::function<bool()>& stops) {
        for (size_t k = next++; k < batch.rows.size(); k = next++) run_one(modes, limits, batch, batch.rows[k], stops);
    };
    std::vector<std::thread> others;
    for (int i = 1; i < threads && size_t(i) < batch.rows.size(); ++i)
        others.emplace_back(work, [&ends] { return ends.load(); });
    int count = 0;
    work([&] {
        // A question costs more than a motion.
        if (count++ % 64 == 0 && !ends && interrupted()) ends = true;
        return ends.load();
    });
    for (std::thread& other : others) other.join();
}

}  // namespace saltus
