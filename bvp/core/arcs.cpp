/// Arcs, and whether an arc and the mirror image of another one are apart, or meet once at most.
#include "arcs.hpp"

#include <algorithm>

namespace saltus {

Varied StartMap::place(double x) const {
    const double span = high - low;
    if (root_low && root_high) {
        const double s = sin(0.5 * pi * x);
        return {low + span * s * s, 0.5 * pi * span * sin(pi * x)};
    }
    if (root_low) return {low + span * x * x, 2.0 * span * x};
    if (root_high) return {high - span * (1.0 - x) * (1.0 - x), 2.0 * span * (1.0 - x)};
    return {low + span * x, span};
}

double StartMap::unplace(double theta) const {
    const double part = std::max((theta - low) / (high - low), 0.0);
    const double rest = std::max((high - theta) / (high - low), 0.0);
    if (root_low && root_high)
        return part < 0.5 ? 2.0 / pi * asin(std::sqrt(part)) : 1.0 - 2.0 / pi * asin(std::sqrt(rest));
    if (root_low) return std::sqrt(part);
    if (root_high) return 1.0 - std::sqrt(rest);
    return (theta - low) / (high - low);
}

ArcPoint arc_point(const PlanarSystem& system, int contact, bool fold, const Moving& state, double rate) {
    const double side = system.contacts().side[contact], sign = fold ? side : 1.0;
    const auto [a0, a1] = system.across();
    const double g0 = system.gap(0)[0], g1 = system.gap(0)[1], size = hypot(g0, g1);
    const State4 &z = state.z, &dz = state.dz;
    return {{sign * (a0 * z[0] + a1 * z[1]), sign * (a0 * z[2] + a1 * z[3]), -side * (g0 * z[2] + g1 * z[3]) / size},
            {sign * rate * (a0 * dz[0] + a1 * dz[1]), sign * rate * (a0 * dz[2] + a1 * dz[3]),
             -side * rate * (g0 * dz[2] + g1 * dz[3]) / size}};
}

Arc stop_arc(const Starts& starts, double low, double high, bool fold) {
    Arc arc;
    arc.side = fold ? 1.0 : starts.system->contacts().side[starts.contact];
    arc.map = {low, high};
    for (int i = 0; i < 3; ++i)
        arc.points[i] = arc_point(*starts.system, starts.contact, fold, starts.at(low + 0.5 * i * (high - low)),
                                  0.5 * (high - low));
    arc.bound();
    return arc;
}

void Arc::bound() {
    // The integrals of the parabola through the derivatives are wrong by e and f over both halves. If the derivative
    // were of fourth degree, it would differ from the parabola by less than 0.8 |e - f| + |e + f|. The cubics would be
    // wrong by an eighth of the bound of that. Three times as much is taken, and twice the rounding: one sample in 5000
    // is beyond the single ones, one in 100,000 beyond these.
    for (int c = 0; c < 3; ++c) {
        const double a = points[0].rate[c], m = points[1].rate[c], b = points[2].rate[c];
        const double e = points[1].value[c] - points[0].value[c] - (5.0 * a + 8.0 * m - b) / 12.0;
        const double f = points[2].value[c] - points[1].value[c] - (5.0 * b + 8.0 * m - a) / 12.0;
        error[c] = 4.0 * (std::fabs(e) + std::fabs(f)) + 0.05 * deviation(a, m, b);
        const double steepest = std::max(std::max(std::fabs(a), std::fabs(m)), std::fabs(b));
        miss[c] = 0.4 * error[c] + SLACK * (1.0 + std::fabs(points[1].value[c])) + 2.0 * grain * steepest;
    }
    enclose();
}

void Arc::enclose() {
    for (int c = 0; c < 3; ++c) {
        // The Bezier points of the cubics through both halves.
        double low = INFINITE, high = -INFINITE;
        const auto take = [&](double value) { low = std::min(low, value), high = std::max(high, value); };
        for (const ArcPoint& point : points) take(point.value[c]);
        for (int i = 0; i < 2; ++i) {
            take(points[i].value[c] + points[i].rate[c] / 3.0);
            take(points[i + 1].value[c] - points[i + 1].rate[c] / 3.0);
        }
        const double more = miss[c] + std::max(std::fabs(points[0].rate[c]) * before,
                                               std::fabs(points[2].rate[c]) * after);
        box[c][0] = low - more, box[c][1] = high + more;
    }
}

ArcPoint Arc::model(double u) const {
    const ArcPoint &begin = points[u < 0.0 ? 0 : 1], &end = points[u < 0.0 ? 1 : 2];
    const double t = u < 0.0 ? u + 1.0 : u;
    ArcPoint out;
    for (int c = 0; c < 3; ++c) {
        const double d = end.value[c] - begin.value[c], e = begin.rate[c] - d, f = d - end.rate[c];
        const double g = e * (1.0 - t) + f * t;
        out.value[c] = begin.value[c] + t * d + t * (1.0 - t) * g;
        out.rate[c] = d + (1.0 - 2.0 * t) * g + t * (1.0 - t) * (f - e);
    }
    return out;
}

Hull::Hull(const Arc& arc, const Chart& chart, bool is_mirrored) {
    const double low = -1.0 - arc.before, high = 1.0 + arc.after;
    for (int i = 0; i < 2; ++i) {
        const int c = chart[i];
        const double sign = is_mirrored ? mirrored(c) : 1.0, middle = sign * arc.points[1].rate[c];
        const double slope = sign * 0.5 * (arc.points[2].rate[c] - arc.points[0].rate[c]);
        const double curve = sign * 0.5 * (arc.points[2].rate[c] + arc.points[0].rate[c]) - middle;
        point[0][i] = middle + low * (slope + low * curve);
        point[1][i] = middle + 0.5 * (low + high) * slope + low * high * curve;
        point[2][i] = middle + high * (slope + high * curve);
        error[i] = arc.error[c];
    }
}

double Hull::bend() const { return hypot(point[2][0] - point[0][0], point[2][1] - point[0][1]) + error[0] + error[1]; }

bool boxes_apart(const Arc& a, const Arc& b) {
    return a.box[0][0] > b.box[0][1] || a.box[0][1] < b.box[0][0] || a.box[1][0] > -b.box[1][0] ||
        a.box[1][1] < -b.box[1][1] ||
           a.box[2][0] > b.box[2][1] || a.box[2][1] < b.box[2][0];
}

Chart choose_chart(const Arc& a, const Arc& b) {
    double best = -1.0;
    Chart chart{0, 1};
    const auto &p = a.points[1].rate, &q = b.points[1].rate;
    for (const Chart& each : {Chart{0, 1}, Chart{1, 2}, Chart{0, 2}}) {
        const auto [i, j] = each;
        const double size = std::fabs(cross_product(p[i], p[j], mirrored(i) * q[i], mirrored(j) * q[j]));
        if (size > best) best = size, chart = each;
    }
    return chart;
}

namespace {

/// Least and greatest value of n0 and n1 times two coordinates on an arc.
std::array<double, 2> extent_along(const Arc& arc, const Chart& chart, double n0, double n1) {
    double low = INFINITE, high = -INFINITE, more = 0.0;
    const auto take = [&](double value) { low = std::min(low, value), high = std::max(high, value); };
    for (int i = 0; i < 3; ++i) {
        const ArcPoint& point = arc.points[i];
        const double here = n0 * point.value[chart[0]] + n1 * point.value[chart[1]];
        const double rate = (n0 * point.rate[chart[0]] + n1 * point.rate[chart[1]]) / 3.0;
        take(here);
        if (i > 0) take(here - rate);
        if (i < 2) take(here + rate);
    }
    for (int i = 0; i < 2; ++i) {
        const int c = chart[i];
        const double beyond = std::max(std::fabs(arc.points[0].rate[c]) * arc.before,
                                       std::fabs(arc.points[2].rate[c]) * arc.after);
        more += std::fabs(i == 0 ? n0 : n1) * (arc.miss[c] + beyond);
    }
    return {low - more, high + more};
}

}  // namespace

bool are_apart(const Arc& a, const Arc& b, const Chart& chart) {
    const auto [i, j] = chart;
    const double sign0 = mirrored(i), sign1 = mirrored(j);
    const auto seen_along = [&](double n0, double n1) {
        const auto [low_a, high_a] = extent_along(a, chart, n0, n1);
        const auto [low_b, high_b] = extent_along(b, chart, sign0 * n0, sign1 * n1);
        return low_a > high_b || high_a < low_b;
    };
    const auto &a0 = a.points[0].value, &a2 = a.points[2].value, &b0 = b.points[0].value, &b2 = b.points[2].value;
    return seen_along(a0[j] - a2[j], a2[i] - a0[i]) || seen_along(sign1 * (b0[j] - b2[j]), sign0 * (b2[i] - b0[i]));
}

double turn_between(const Hull& a, const Hull& b) {
    double sign = 0.0;
    for (const auto& p : a.point)
        for (const auto& q : b.point) {
            const double value = cross_product(p[0], p[1], q[0], q[1]);
            double error = std::fabs(p[0]) * b.error[1] + std::fabs(p[1]) * b.error[0] + std::fabs(q[0]) * a.error[1] +
                           std::fabs(q[1]) * a.error[0];
            error += a.error[0] * b.error[1] + a.error[1] * b.error[0];
            if (!(std::fabs(value) > error) || value * sign < 0.0) return 0.0;
            sign = value > 0.0 ? 1.0 : -1.0;
        }
    return sign;
}

double side_of(const double f[2], const double noise[2], const Hull& b) {
    double sign = 0.0;
    for (const auto& q : b.point) {
        const double value = cross_product(f[0], f[1], q[0], q[1]);
        const double bound = std::fabs(f[0]) * b.error[1] + std::fabs(f[1]) * b.error[0] +
            noise[0] * (std::fabs(q[1]) + b.error[1]) +
                             noise[1] * (std::fabs(q[0]) + b.error[0]);
        if (!(std::fabs(value) > bound) || value * sign < 0.0) return 0.0;
        sign = value > 0.0 ? 1.0 : -1.0;
    }
    return sign;
}

}  // namespace saltus
