/// Steps of fixed length along a linear flight.
#include "step_table.hpp"

#include <algorithm>

namespace saltus {

StepTable::StepTable(const std::vector<Block>& blocks) : usable_(true), count_(int(blocks.size())), blocks_(blocks) {
    constexpr double SLIGHT = 2e-3;  // radians of the fastest block within which `turn_slightly` holds
    double fastest = 0.0, of_all = 0.0;
    bool oscillates = true;
    for (const Block& b : blocks) {
        const bool single = b.is_single(), rigid = b.is_pair() && b.mean == 0.0 && b.delta == 0.0;
        usable_ = usable_ && (single || rigid || (b.is_pair() && b.delta < 0.0)) && b.mean <= 0.0;
        if (!usable_) return;
        steady_ = steady_ && b.mean == 0.0;
        const double w = single || rigid ? 1.0 : std::sqrt(-b.delta);
        const double square = single || rigid ? b.mean * b.mean : b.mean * b.mean - b.delta;
        Shape shape{0.0, 0.0, 0.0, 0.0, square, std::sqrt(square), b.mean, single || rigid ? 0.0 : w, 0.5 * (b.b11 - b.b22), b.b12,
                    rigid, b.first, b.second};
        if (b.is_pair()) {
            shape.c11 = 0.5 * (b.b11 - b.b22) / w, shape.c12 = b.b12 / w, shape.c21 = b.b21 / w;
            shape.c22 = -shape.c11;
            fastest = std::max(fastest, shape.rate);
        }
        split_ = split_ && b.first == int(shapes_.size()) && b.second == count_ + b.first;
        of_all = std::max(of_all, shape.rate);
        shapes_.push_back(shape);
        oscillates = oscillates && !single && !rigid;
    }
    usable_ = count_ > 0 && fastest > 0.0;
    if (!usable_) return;
    pairs_ = oscillates ? count_ : 0;
    slight_ = SLIGHT / of_all;
    entries_.resize(size_t(4) * LEVELS * count_);
    for (int level = 0; level < LEVELS; ++level) {
        const double h = lengths_[level] = std::ldexp(REACH / fastest, -level);
        double* out = entries_.data() + 4 * size_t(level) * count_;
        for (int k = 0; k < count_; ++k) {
            const Square2<double> e = blocks[k].is_single() ? Square2<double>{exp(blocks[k].mean * h), 0.0, 0.0, 0.0}
                : flow_pair(blocks[k], h);
            out[k] = e.e11, out[count_ + k] = e.e12, out[2 * count_ + k] = e.e21, out[3 * count_ + k] = e.e22;
        }
    }
}

void StepTable::reaches(Values row, double* out) const {
    for (int k = 0; k < count_; ++k) {
        const Block& b = blocks_[k];
        const Shape& shape = shapes_[k];
        if (!b.is_pair()) {
            out[k] = std::fabs(row[b.first]);
        } else if (shape.c12 == 0.0) {
            out[k] = 0.0;  // a rigid pair
        } else {
            // z2 = (z1'/w - c11 z1)/c12 without the decay, and z1'/w follows z1 by a right angle.
            const double real = row[b.first] - row[b.second] * shape.c11 / shape.c12, imaginary = row[b.second] / shape.c12;
            out[k] = std::sqrt(real * real + imaginary * imaginary);
        }
    }
}

void StepTable::rate_row(Values row, Vector<double> out) const {
    for (const Block& b : blocks_) {
        const double x = row[b.first];
        if (!b.is_pair()) {
            out[b.first] = x * b.mean;
            continue;
        }
        const double y = row[b.second];
        out[b.first] = x * b.b11 + y * b.b21, out[b.second] = x * b.b12 + y * b.b22;
    }
}

void StepTable::sizes(Values row, double* out) const {
    for (int k = 0; k < count_; ++k) {
        const Block& b = blocks_[k];
        out[k] = std::fabs(row[b.first]);
        if (!b.is_pair()) continue;
        const double ratio = shapes_[k].rigid ? 1.0 : std::sqrt(std::fabs(shapes_[k].c21 / shapes_[k].c12));
        out[k] += std::fabs(row[b.second]) * ratio;
    }
}

}  // namespace saltus
