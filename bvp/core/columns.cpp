#include "columns.hpp"

#include <algorithm>

#include "lanes.hpp"

namespace saltus {

Columns::Columns(const SmoothEquations& equations)
    : equations_(equations), size_(equations.size()), inputs_(size_t(ORDER) * equations.inputs.rows() * LANES),
      sums_(equations.program.slopes.size() * 2 * LANES), forces_(equations.program.forces.size() * LANES) {
    size_t place = 0;
    for (int first = 0; first < size_; first += LANES) {
        const int width = std::min(size_ - first, LANES);  // even, as the number of states
        groups_.push_back({first, width, place});
        place += size_t(ORDER + 1) * size_ * width;
    }
    coefficients_.resize(place);
    for (int f = 0; f < int(equations.program.forces.size()); ++f) {
        begins_.push_back(int(lines_.size()));
        for (const auto& slope : equations.program.slopes)
            if (slope.force == f) lines_.push_back({slope.input, slope.result});
    }
    begins_.push_back(int(lines_.size()));
}

void Columns::begin() {
    for (const Group& group : groups_) {
        double* now = coefficients_.data() + group.place;
        std::fill(now, now + size_ * group.width, 0.0);
        for (int e = 0; e < group.width; ++e) now[(group.first + e) * group.width + e] = 1.0;
    }
}

void Columns::write(Matrix<double> map) const {
    for (const Group& group : groups_) {
        const double* now = coefficients_.data() + group.place;
        for (int r = 0; r < size_; ++r)
            for (int e = 0; e < group.width; ++e) map(r, group.first + e) = now[r * group.width + e];
    }
}

template <int L, bool NARROW>
void Columns::expand_group(const Group& group, Matrix<const double> series) {
    using Some = Lanes<L>;
    const SparseRows &linear = equations_.linear, &rows = equations_.inputs, &push = equations_.push;
    const int size = NARROW ? 4 : size_, n = size / 2;
    const int inputs = rows.rows(), lines = int(lines_.size()), forces = int(begins_.size()) - 1;
    auto input = [&](int i, int k) { return &inputs_[(i * ORDER + k) * L]; };
    const double* now = coefficients_.data() + group.place;
    for (int k = 0; k < ORDER; ++k) {
        double* after = const_cast<double*>(now) + size * L;
        // Of two orders at once, the sums over the inputs that are known at the first of them: they share what they read.
        if (k % 2 == 0)
            for (int line = 0; line < lines; ++line) {
                const double *slope = series[lines_[line].result].data() + k, *w = input(lines_[line].input, 0);
                Some first = Some::all(0.0), second = first;
                for (int j = 0; j < k; ++j, --slope, w += L) {
                    const Some x = Some::read(w);
                    first.add(slope[0], x);
                    second.add(slope[1], x);
                }
                first.write(&sums_[2 * line * L]);
                second.write(&sums_[(2 * line + 1) * L]);
            }
        for (int i = 0; i < inputs; ++i) {
            Some w = Some::all(0.0);
            rows.each<NARROW>(i, [&](double factor, int column) { w.add(factor, Some::read(now + column * L)); });
            w.write(input(i, k));
        }
        for (int f = 0, line = 0; f < forces; ++f) {
            Some force = Some::all(0.0);
            for (; line < begins_[f + 1]; ++line) {
                const double *slope = series[lines_[line].result].data(), *w = input(lines_[line].input, k);
                // The input that is known last comes last.
                Some total = Some::read(&sums_[(2 * line + k % 2) * L]);
                if (k % 2 == 1) total.add(slope[1], Some::read(w - L));
                total.add(slope[0], Some::read(w));
                force.add(1.0, total);
            }
            force.write(&forces_[f * L]);
        }
        const double part = 1.0 / (k + 1.0);
        for (int r = 0; r < n; ++r) {
            Some::read(now + (n + r) * L).times(part).write(after + r * L);
            Some total = Some::all(0.0);
            linear.each<NARROW>(r, [&](double factor, int column) { total.add(factor, Some::read(now + column * L)); });
            for (const auto& entry : push[r]) total.add(entry.value, Some::read(&forces_[entry.column * L]));
            total.times(part).write(after + (n + r) * L);
        }
        now = after;
    }
}

void Columns::expand(Matrix<const double> series) {
    for (const Group& group : groups_)
        switch (group.width) {
        case 2: expand_group<2, false>(group, series); break;
        case 4:
            if (equations_.is_narrow()) expand_group<4, true>(group, series);
            else expand_group<4, false>(group, series);
            break;
        case 6: expand_group<6, false>(group, series); break;
        default: expand_group<LANES, false>(group, series);
        }
}

double Columns::room(double length) const {
    double least = INFINITE;
    for (const Group& group : groups_) {
        const double* now = coefficients_.data() + group.place;
        const int stride = size_ * group.width;
        for (int e = 0; e < group.width; ++e) {
            double first = 0.0, last = 0.0;
            for (int r = size_ / 2; r < size_; ++r) {
                const double* place = now + r * group.width + e;
                first = std::max(first, std::max(std::fabs(place[0]), std::fabs(place[stride]) * length));
                last = std::max(last, std::fabs(place[(ORDER - 1) * stride]));
            }
            if (first > 0.0 && first < least * last) least = first / last;
        }
    }
    return least;
}

/// c_0 + h (odd + h even), with two polynomials of h^2 that do not wait for each other.
template <int L>
void Columns::advance_group(const Group& group, double h) {
    const double square = h * h;
    double* now = coefficients_.data() + group.place;
    for (int r = 0; r < size_; ++r) {
        auto coefficient = [&](int k) { return Lanes<L>::read(now + (size_t(k) * size_ + r) * L); };
        Lanes<L> even = coefficient(ORDER), odd = coefficient(ORDER - 1);
        for (int k = ORDER - 2; k > 0; k -= 2) {
            even = coefficient(k).add(square, even);
            odd = coefficient(k - 1).add(square, odd);
        }
        coefficient(0).add(h, odd.add(h, even)).write(now + r * L);
    }
}

void Columns::advance(double h) {
    for (const Group& group : groups_)
        switch (group.width) {
        case 2: advance_group<2>(group, h); break;
        case 4: advance_group<4>(group, h); break;
        case 6: advance_group<6>(group, h); break;
        default: advance_group<LANES>(group, h);
        }
}

}  // namespace saltus
