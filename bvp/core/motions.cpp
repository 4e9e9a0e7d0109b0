/// Many motions of one system.
#include "motions.hpp"

#include <algorithm>
#include <atomic>
#include <chrono>
#include <exception>
#include <mutex>
#include <optional>
#include <system_error>
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
    std::optional<ContactModes> changed;
    if (batch.restitution[b] == batch.restitution[b]) changed.emplace(modes.with_restitution(batch.restitution[b]));
    const ContactModes& own = changed ? *changed : modes;
    Motion motion(own, batch.starts[int(b)], batch.energies[b], int(batch.leaving[b]), limits.fractions, limits.with_peaks, limits.to_rest);
    Reason reason = Reason::PAUSED;
    while (reason == Reason::PAUSED && !stops()) reason = motion.move(limits.duration, batch.most[b], limits.passes, nullptr);
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
    using Clock = std::chrono::steady_clock;
    std::atomic<size_t> next = 0;
    std::atomic<int> active = 0;
    std::atomic<bool> ends = false;
    std::exception_ptr error;
    std::mutex guard;
    const auto work = [&](const std::function<bool()>& stops) {
        try {
            for (size_t k = next++; k < batch.rows.size() && !stops(); k = next++) run_one(modes, limits, batch, batch.rows[k], stops);
        } catch (...) {
            const std::lock_guard held(guard);
            error = std::current_exception();
            ends = true;
        }
    };
    Clock::time_point asked = Clock::now();
    const auto ask = [&] {
        // A question costs more than a motion.
        if (!ends && Clock::now() - asked >= std::chrono::milliseconds(100)) {
            if (interrupted()) ends = true;
            asked = Clock::now();
        }
        return ends.load();
    };
    std::vector<std::thread> others;
    const size_t wanted = std::min({size_t(std::max(threads, 1)), batch.rows.size(), size_t(std::max(1u, std::thread::hardware_concurrency()))});
    while (others.size() + 1 < wanted) {
        ++active;
        try {
            others.emplace_back([&] {
                work([&ends] { return ends.load(); });
                --active;
            });
        } catch (const std::system_error&) {  // the system gives no more
            --active;
            break;
        }
    }
    work(ask);
    while (active > 0) {
        ask();
        std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
    for (std::thread& other : others) other.join();
    if (error) std::rethrow_exception(error);
}

}  // namespace saltus
