/// Impacts found in steps of fixed length, equation (11).
#include "steps.hpp"

#include <algorithm>

namespace saltus {

StepStops::StepStops(const StepTable& table, const Contacts& contacts) : table_(table), contacts_(contacts) {
    const int count = table.count();
    fit_ = count <= MOST_PAIRS;
    rows_.resize(size_t(8) * contacts.count() * count);
    double* rows = rows_.data();
    for (int c = 0; c < contacts.count() && fit_; ++c) {
        const Values gap = contacts.gap[c];
        if (c == 0 || !std::equal(gap.begin(), gap.end(), contacts.gap[c - 1].begin())) {
            fit_ = count_ < MOST;
            if (!fit_) return;
            Stop& stop = stops_[count_];
            stop.value = gap.data(), stop.rate = contacts.rate[c].data();
            stop.acceleration = contacts.acceleration[c].data();
            stop.reaches = rows, stop.sizes = rows + count;
            table.reaches(gap, rows), table.sizes(gap, rows + count);
            rows += 2 * count;
            for (const double** row : {&stop.value, &stop.rate, &stop.acceleration}) {
                if (table.is_split()) break;  // no copy
                table.split(*row, rows);
                *row = rows;
                rows += 2 * count;
            }
            for (int k = 0; k < count; ++k)
                stop.plain = stop.plain && stop.value[count + k] == 0.0 && stop.rate[k] == 0.0;
            ++count_;
        }
        Stop& stop = stops_[count_ - 1];
        const bool high = contacts.side[c] > 0.0;
        fit_ = (high ? stop.high : stop.low) < 0;
        (high ? stop.high : stop.low) = c;
        (high ? stop.upper : stop.lower) = contacts.bound[c];
    }
}

}  // namespace saltus
