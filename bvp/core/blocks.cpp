/// Bounds of the motion of one block of a linear flight, equation (24).
#include "blocks.hpp"

namespace saltus {

namespace {

/// Bounds of exp(mean t) |C| and exp(mean t) |S| over 0 <= t <= horizon, which may be infinite for a stable pair.
struct Envelope {
    double cosine, sine;
    Envelope(double mean, double delta, double horizon) {
        const double width = delta > 0.0 ? std::sqrt(delta) : 0.0, slowest = mean + width;
        cosine = slowest > 0.0 ? exp(slowest * horizon) : 1.0;
        sine = horizon * cosine;
        if (slowest < 0.0) sine = std::fmin(sine, 0.36787944117144233 / -slowest);  // the maximum of x exp(-x)
        if (width > 0.0) sine = std::fmin(sine, 0.5 * cosine / width);
        if (delta < 0.0) sine = std::fmin(sine, cosine / std::sqrt(-delta));
    }
};

void add_single(const Block& block, Values row, Values z, double horizon, Bounds& bounds) {
    const double m = block.mean;
    const double size = std::fabs(row[block.first] * z[block.first]) * (m > 0.0 ? exp(m * horizon) : 1.0);
    bounds.add(size, m * m * size, std::fabs(m * m * m) * size);
}

/// Two real rates: f = far exp(fast t) + near exp(slow t). A fast part that is rounding does not move f, but it is in the computed f''.
void add_apart(const Block& b, Values row, Values z, double alpha, double horizon, Bounds& bounds) {
    const int i = b.first, j = b.second;
    const auto [fast, slow] = RealRates(b);
    const double p = row[i] * (b.b11 - slow) * z[i], q = row[i] * b.b12 * z[j];
    const double d = row[j] * b.b21 * z[i], e = row[j] * (b.b22 - slow) * z[j];
    const double far = (p + q + d + e) / (fast - slow);
    const double noise = ROUNDING * (std::fabs(p) + std::fabs(q) + std::fabs(d) + std::fabs(e)) / (slow - fast);
    const double near = std::fabs(alpha - far) * (slow > 0.0 ? exp(slow * horizon) : 1.0);
    const double size = std::fabs(far) > noise ? std::fabs(far) : 0.0;
    bounds.add(size + near, fast * fast * size + slow * slow * near,
               std::fabs(fast * fast * fast) * std::fmax(size, noise) + std::fabs(slow * slow * slow) * near);
}

void add_pair(const Block& b, Values row, Values z, double horizon, Bounds& bounds) {
    // f = exp(m t) (C alpha + S beta); a derivative takes (alpha, beta) to (m alpha + beta, m beta + delta alpha).
    const int i = b.first, j = b.second;
    const double m = b.mean, delta = b.delta;
    double alpha = row[i] * z[i] + row[j] * z[j];
    double beta = row[i] * ((b.b11 - m) * z[i] + b.b12 * z[j]) + row[j] * (b.b21 * z[i] + (b.b22 - m) * z[j]);
    if (m == 0.0 && delta < 0.0) {
        const double size = std::sqrt(alpha * alpha - beta * beta / delta);
        bounds.add(size, -delta * size, -delta * std::sqrt(-delta) * size);
        return;
    }
    if (m < 0.0 && delta > 0.5 * m * m && delta * horizon * horizon > APART_LIMIT)
        return add_apart(b, row, z, alpha, horizon, bounds);
    // A damped pair: both terms of equation (23) by their largest values over the flight.
    const Envelope envelope(m, delta, horizon);
    double sizes[4];
    for (double& size : sizes) {
        size = (alpha != 0.0 ? std::fabs(alpha) * envelope.cosine : 0.0) + (beta != 0.0 ? std::fabs(beta) * envelope.sine : 0.0);
        if (delta < 0.0)
            size = std::fmin(size, std::sqrt(alpha * alpha - beta * beta / delta) * (m > 0.0 ? exp(m * horizon) : 1.0));
        const double next = m * alpha + beta;
        beta = m * beta + delta * alpha;
        alpha = next;
    }
    bounds.add(sizes[0], sizes[2], sizes[3]);
}

/// Bounds of a larger block by Taylor's series with its remainder; `weight`: norm of the row's part. The series of a translation under
/// constant forces ends after a few terms, so these bounds stay sharp for any distance.
Bounds series_bounds(Matrix<const double> matrix, const Block& block, Values row, Values z, double weight, double horizon) {
    constexpr int TERMS = 8;  // steps are at most the block's own time of growth
    const int start = block.first, size = block.size();
    const double growth = growth_of(matrix, block), rest = growth > 0.0 ? exp(growth * horizon) : 1.0;
    Local<double> state(size), other(size);
    copy(z.subspan(start, size), state);
    Bounds found;
    double term = 1.0, term_second = 0.0, term_third = 0.0;
    for (int k = 0; k < TERMS + 4; ++k) {
        double level = 0.0, norm = 0.0;
        for (int r = 0; r < size; ++r) level += row[start + r] * state[r], norm += state[r] * state[r];
        level = k < TERMS ? std::fabs(level) : weight * std::sqrt(norm) * rest;
        if (k <= TERMS) found.level += level * term;
        if (k >= 2 && k <= TERMS + 2) {
            term_second = k == 2 ? 1.0 : term_second * horizon / (k - 2);
            found.second += level * term_second;
        }
        if (k >= 3) {
            term_third = k == 3 ? 1.0 : term_third * horizon / (k - 3);
            found.third += level * term_third;
        }
        term *= horizon / (k + 1);
        for (int r = 0; r < size; ++r) other[r] = dot(matrix[start + r].subspan(start, size), Vector<double>(state));
        std::swap_ranges(state.begin(), state.end(), other.begin());
    }
    return found;
}

/// A larger block: |exp(B t)| <= exp(growth t), or its Taylor series with remainder, whichever is less.
void add_large(Matrix<const double> matrix, const Block& block, Values row, Values z, double horizon, Bounds& bounds) {
    const int first = block.first, last = first + block.size();
    const double growth = growth_of(matrix, block);
    double weight = 0.0, norm = 0.0, square = 0.0;
    for (int r = first; r < last; ++r) {
        weight += row[r] * row[r];
        norm += z[r] * z[r];
        for (int q = first; q < last; ++q) square += matrix(r, q) * matrix(r, q);
    }
    const double size = (growth > 0.0 ? exp(growth * horizon) : 1.0) * std::sqrt(weight * norm);
    Bounds near{size, square * size, square * std::sqrt(square) * size};
    if (weight > 0.0 && horizon < INFINITE) {
        const Bounds series = series_bounds(matrix, block, row, z, std::sqrt(weight), horizon);
        near = {std::fmin(near.level, series.level), std::fmin(near.second, series.second), std::fmin(near.third, series.third)};
    }
    bounds.add(near.level, near.second, near.third);
}

}  // namespace

void add_bounds(Matrix<const double> matrix, const Block& block, Values row, Values z, double horizon, Bounds& bounds) {
    if (block.is_pair()) add_pair(block, row, z, horizon, bounds);
    else if (block.is_single()) add_single(block, row, z, horizon, bounds);
    else add_large(matrix, block, row, z, horizon, bounds);
}

double growth_of(Matrix<const double> matrix, const Block& block) {
    if (!block.is_pair() && !block.is_single()) {
        // The largest eigenvalue of the symmetric part, by Gershgorin's circles.
        double worst = -INFINITE;
        for (int r = block.first; r < block.first + block.size(); ++r) {
            double total = matrix(r, r);
            for (int c = block.first; c < block.first + block.size(); ++c)
                if (c != r) total += 0.5 * std::fabs(matrix(r, c) + matrix(c, r));
            worst = std::fmax(worst, total);
        }
        return worst;
    }
    if (block.mean < 0.0 && block.delta > 0.0) return RealRates(block).slow;
    return block.mean + (block.delta > 0.0 ? std::sqrt(block.delta) : 0.0);
}

double fastest_of(Matrix<const double> matrix, const Block& block) {
    if (block.is_pair()) {
        const double half = 0.5 * (block.b11 - block.b22);
        return 0.5 * std::fabs(block.b11 + block.b22) + std::sqrt(half * half + std::fabs(block.b12 * block.b21));
    }
    double fastest = 0.0;
    for (int r = block.first; r < block.first + block.size(); ++r) {
        double total = 0.0;
        for (int q = block.first; q < block.first + block.size(); ++q) total += std::fabs(matrix(r, q));
        fastest = std::fmax(fastest, total);
    }
    return fastest;
}

}  // namespace saltus
