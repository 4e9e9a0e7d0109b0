/// Steps of fixed length along a linear flight.
#include "step_table.hpp"

#include <algorithm>

namespace saltus {

StepTable::StepTable(const std::vector<Block>& blocks) : usable_(true), count_(int(blocks.size())), blocks_(blocks) {
    double fastest = 0.0;
    for (const Block& b : blocks) {
        const bool single = b.is_single(), rigid = b.is_pair() && b.mean == 0.0 && b.delta == 0.0;
        usable_ = usable_ && (single || rigid || (b.is_pair() && b.delta < 0.0)) && b.mean <= 0.0;
        if (!usable_) return;
        steady_ = steady_ && b.mean == 0.0;
        const double w = single || rigid ? 1.0 : std::sqrt(-b.delta);
        const double square = single || rigid ? b.mean * b.mean : b.mean * b.mean - b.delta;
        Shape shape{0.0, 0.0, 0.0, 0.0, square, std::sqrt(square), 0.0, 0.0, rigid};
        if (b.is_pair()) {
            shape.c11 = (b.b11 - b.mean) / w, shape.c12 = b.b12 / w, shape.c21 = b.b21 / w;
            shape.c22 = (b.b22 - b.mean) / w;
            const double larger = std::max(std::sqrt(std::fabs(b.b12 * b.b21)), std::fabs(b.mean));
            const double pace = b.b12 != 0.0 && b.b21 != 0.0 ? larger : INFINITE;
            shape.up = std::fabs(b.b12) / pace, shape.down = std::fabs(b.b21) / pace;
            fastest = std::max(fastest, shape.rate);
        }
        split_ = split_ && b.first == int(shapes_.size()) && b.second == count_ + b.first;
        shapes_.push_back(shape);
        frequencies_.push_back(single || rigid ? 0.0 : w);
    }
    usable_ = count_ > 0 && fastest > 0.0;
    if (!usable_) return;
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

StepTable::Amplitudes StepTable::amplitudes(Values row, Values z, double horizon) const {
    Amplitudes out{0.0, 0.0, 0.0, 0.0, 0.0};
    for (int k = 0; k < count_; ++k) {
        const Shape& shape = shapes_[k];
        const int i = blocks_[k].first, j = blocks_[k].is_pair() ? blocks_[k].second : i;
        const double a = row[i], b = j == i ? 0.0 : row[j], x = z[i], y = z[j];
        const double alpha = a * x + b * y, beta = a * (shape.c11 * x + shape.c12 * y) +
            b * (shape.c21 * x + shape.c22 * y);
        const double level = shape.rigid ? std::fabs(alpha) + std::fabs(beta) * horizon
            : std::sqrt(alpha * alpha + beta * beta);
        const double second = shape.square * level;
        out.level += level;
        out.second += second;
        out.third += shape.rate * second;
        out.fourth += shape.square * second;
        out.size += std::fabs(a) * (std::fabs(x) + shape.up * std::fabs(y)) +
            std::fabs(b) * (std::fabs(y) + shape.down * std::fabs(x));
    }
    return out;
}

}  // namespace saltus
