#include "smooth_flight.hpp"

namespace saltus {

SmoothTrack::SmoothTrack(const TaylorPath& path, Values row, double duration)
    : times_(path.times), coefficients_(path.steps(), ORDER + 1), duration_(duration) {
    for (int s = 0; s < path.steps(); ++s) {
        bounds_.push_back(path.project(row, s, coefficients_[s]));
        level_ = std::max(level_, bounds_[s].level);
    }
    if (path.complete && path.steps() > 0) return;
    // A search along it comes forward in the shortest steps, until it gives up.
    times_ = {0.0, 0.0};
    coefficients_ = Array<>(1, ORDER + 1, NOT_A_NUMBER);
    bounds_.assign(1, {NOT_A_NUMBER, 0.0, 0.0});
}

int SmoothTrack::place(double t) const {
    int s = 0;
    while (s < int(bounds_.size()) - 1 && times_[s + 1] <= t) ++s;
    return s;
}

}  // namespace saltus
