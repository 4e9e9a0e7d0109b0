/// Meetings of arcs with mirror images of arcs.
#include "meetings.hpp"

#include <algorithm>
#include <numeric>

namespace saltus {

namespace {

/// Halvings of one pair of arcs: all, and one after the other.
constexpr int SPLITS = 4000, DEPTH = 200;
/// Cells along each axis of the section, to find arcs that are near each other.
constexpr int CELLS = 64;
/// An arc is halved by its points alone if its derivative changes this many times more than its error.
constexpr double MODEL = 3.0;
/// Rounding errors of a followed state, relative to it.
constexpr double FOLLOWED_ROUNDING = 1e-13;
/// Newton's method has converged if its step is smaller, in u: the next one would be as small as its square.
constexpr double SETTLED = 1e-6;
/// A start beyond an end of its arc by less than this, in u, is not followed: a grazing may be between them. Its point
/// is taken from the end and the derivative there, and is wrong by the square of this.
constexpr double CLOSE = 1e-7;
/// Largest difference at a meeting of the coordinate that Newton's method leaves out. A larger one has the other sign
/// on the other arc.
constexpr double COORDINATE = 1e-6;

/// How far a place on an arc is beyond the place whose start is followed instead.
double beyond(double u) {
    const double end = std::min(std::max(u, -1.0), 1.0);
    return std::fabs(u - end) <= CLOSE ? u - end : 0.0;
}

/// Square cells of (s, v), with the arcs in each, or their mirror images.
class Grid {
public:
    struct Item {
        int arc;
        double box[3][2];
    };

    Grid(const std::vector<Arc>& arcs, const std::vector<int>& order, bool is_mirrored)
        : first_(CELLS * CELLS + 1), spans_(arcs.size()) {
        double low = INFINITE, high = -INFINITE, reach = 0.0;
        for (const Arc& arc : arcs) {
            low = std::min(low, arc.box[0][0]), high = std::max(high, arc.box[0][1]);
            reach = std::max(reach, std::max(-arc.box[1][0], arc.box[1][1]));
        }
        const double wider = (1.0 + 1e-9) / CELLS, size_s = (high - low) * wider, size_v = 2.0 * reach * wider;
        for (size_t i = 0; i < arcs.size(); ++i) {
            const Item item = item_of(arcs, int(i), is_mirrored);
            spans_[i] = {cell_of((item.box[0][0] - low) / size_s), cell_of((item.box[0][1] - low) / size_s),
                         cell_of((item.box[1][0] + reach) / size_v), cell_of((item.box[1][1] + reach) / size_v)};
            for_cells(int(i), [&](int cell) { ++first_[cell + 1]; });
        }
        std::partial_sum(first_.begin(), first_.end(), first_.begin());
        items_.resize(first_.back());
        std::vector<int> next(first_.begin(), first_.end() - 1);
        for (const int i : order) {
            const Item item = item_of(arcs, i, is_mirrored);
            for_cells(i, [&](int cell) { items_[next[cell]++] = item; });
        }
    }

    std::span<const Item> in(int cell) const {
        return {items_.data() + first_[cell], size_t(first_[cell + 1] - first_[cell])};
    }
    /// First cells of an arc along s and v.
    int first_s(int arc) const { return spans_[arc][0]; }
    int first_v(int arc) const { return spans_[arc][2]; }

private:
    /// The cell at a place; the first one where the place is no number.
    static int cell_of(double place) { return place >= 0.0 ? int(std::min(place, CELLS - 1.0)) : 0; }
    static Item item_of(const std::vector<Arc>& arcs, int i, bool is_mirrored) {
        Item out{i, {}};
        for (int c = 0; c < 3; ++c) out.box[c][0] = arcs[i].box[c][0], out.box[c][1] = arcs[i].box[c][1];
        if (is_mirrored) out.box[1][0] = -arcs[i].box[1][1], out.box[1][1] = -arcs[i].box[1][0];
        return out;
    }
    template <class Action>
    void for_cells(int arc, Action&& action) const {
        const auto [low_s, high_s, low_v, high_v] = spans_[arc];
        for (int x = low_s; x <= high_s; ++x)
            for (int y = low_v; y <= high_v; ++y) action(x * CELLS + y);
    }

    std::vector<int> first_;
    std::vector<std::array<int, 4>> spans_;
    std::vector<Item> items_;
};

}  // namespace

MeetingSearch::FollowedPoint MeetingSearch::follow_arc(const Arc& arc, double u, Followed& record) const {
    const double half = 0.5 * (arc.last - arc.first);
    FollowedPoint out{false, {}, arc.map.place(0.5 * (arc.first + arc.last) + half * u)};
    out.theta.rate *= half;
    const Starts& starts = curves_[arc.curve];
    const int count = arc.impacts - gone_[arc.curve];
    if (count == 0) {
        out.point = arc_point(*starts.system, starts.contact, fold_, starts.at(out.theta.value), out.theta.rate);
    } else {
        follow(starts, out.theta.value, 2.0 * arc.arrived[1], INFINITE, count - 1, record);
        if (record.count < count || record.flights[count - 1].contact < 0) return out;
        out.point = arc_point(*starts.system, record.flights[count - 1].contact, fold_, record.after, out.theta.rate);
    }
    out.arrives = true;
    for (int c = 0; c < 3; ++c)
        out.arrives = out.arrives && arc.box[c][0] <= out.point.value[c] && out.point.value[c] <= arc.box[c][1];
    return out;
}

bool MeetingSearch::halve(Arc arc, Arc& one, Arc& two) {
    one = two = arc;
    one.last = two.first = 0.5 * (arc.first + arc.last);
    one.grain = two.grain = 2.0 * arc.grain;
    one.before = std::min(2.0 * arc.before, 0.5), one.after = Arc::NEAREST;
    two.before = Arc::NEAREST, two.after = std::min(2.0 * arc.after, 0.5);
    double change = 0.0, error = 0.0;
    for (int c = 0; c < 3; ++c) {
        change += std::fabs(arc.points[2].rate[c] - arc.points[0].rate[c]);
        error += arc.error[c];
    }
    // If their error is small beside the turn of the arc, its points give those of its halves.
    const bool modelled = change > MODEL * error;
    const auto point = [&](double u, ArcPoint& out) {
        const FollowedPoint found = follow_arc(arc, u, records_[0]);
        out = found.point;
        return found.arrives;
    };
    ArcPoint between[2];
    for (int i = 0; i < 2; ++i) {
        if (modelled) between[i] = arc.model(i - 0.5);
        else if (!point(i - 0.5, between[i])) return false;
    }
    if (!modelled && arc.modelled)
        for (int i = 0; i < 3; ++i)
            if (!point(i - 1.0, arc.points[i])) return false;
    one.points = {arc.points[0], between[0], arc.points[1]};
    two.points = {arc.points[1], between[1], arc.points[2]};
    for (Arc* half : {&one, &two}) {
        for (ArcPoint& each : half->points)
            for (double& rate : each.rate) rate *= 0.5;
        half->modelled = modelled;
        if (modelled) {
            for (double& each : half->error) each *= 0.5;
            half->enclose();
        } else {
            half->bound();
        }
    }
    return true;
}

MeetingSearch::Outcome MeetingSearch::meet_once(const Pair& pair, const Chart& chart, const Hull& hull_a,
                                                const Hull& hull_b, double sign) {
    const Arc &a = pair.a, &b = pair.b;
    const double low_u = -1.0 - a.before, high_u = 1.0 + a.after, low_w = -1.0 - b.before, high_w = 1.0 + b.after;
    double u = 0.0, w = 0.0;
    // By the points first, which decides most; then by following both starts.
    for (const bool follows : {false, true}) {
        for (int count = 0;; ++count) {
            if (count == 12) {
                if (follows) return UNDECIDED;
                break;
            }
            const double beyond_u = follows ? beyond(u) : 0.0, beyond_w = follows ? beyond(w) : 0.0;
            ArcPoint p, q;
            Varied theta[2];
            if (follows) {
                const FollowedPoint from_a = follow_arc(a, u - beyond_u, records_[0]);
                if (!from_a.arrives) return UNDECIDED;
                const FollowedPoint from_b = follow_arc(b, w - beyond_w, records_[1]);
                if (!from_b.arrives) return UNDECIDED;
                p = from_a.point, q = from_b.point;
                theta[0] = from_a.theta, theta[1] = from_b.theta;
            } else {
                p = a.model(u), q = b.model(w);
            }
            double f[2], noise[2], along_a[2], along_b[2];
            for (int i = 0; i < 2; ++i) {
                const int c = chart[i];
                along_a[i] = p.rate[c], along_b[i] = mirrored(c) * q.rate[c];
                f[i] = p.value[c] - mirrored(c) * q.value[c] + beyond_u * along_a[i] - beyond_w * along_b[i];
                // Rounding of the difference of a coordinate at two points that are followed, with that of their
                // starts.
                noise[i] = follows ? FOLLOWED_ROUNDING * (1.0 + std::fabs(p.value[c])) +
                    a.grain * std::fabs(p.rate[c]) +
                                         b.grain * std::fabs(q.rate[c])
                                   : a.miss[c] + b.miss[c];
            }
            // A difference f that a du - b dw shall cancel: du is -(f x b)/(a x b), dw is -(f x a)/(a x b).
            const auto leaves = [&](double at, double low, double high, const Hull& other) {
                if (low < at && at < high) return false;
                const double way = -sign * side_of(f, noise, other);
                return (at <= low && way < 0.0) || (at >= high && way > 0.0);
            };
            if (leaves(u, low_u, high_u, hull_b) || leaves(w, low_w, high_w, hull_a)) return APART;
            const double determinant = cross_product(along_a[0], along_a[1], along_b[0], along_b[1]);
            if (determinant == 0.0) {
                if (follows) return UNDECIDED;
                break;
            }
            const auto limited_step = [&](double at, const double along[2], double low, double high) {
                return std::min(std::max(at - cross_product(f[0], f[1], along[0], along[1]) / determinant, low),
                                high) - at;
            };
            const double du = limited_step(u, along_b, low_u, high_u), dw = limited_step(w, along_a, low_w, high_w);
            if (std::fabs(du) < std::max(SETTLED, a.grain) && std::fabs(dw) < std::max(SETTLED, b.grain)) {
                if (!follows) break;
                const int c = 3 - chart[0] - chart[1];
                const double here = p.value[c] - mirrored(c) * q.value[c];
                if (std::fabs(here) > COORDINATE * (1.0 + std::fabs(p.value[c]))) return APART;
                const double change[2] = {theta[0].rate * (beyond_u + du), theta[1].rate * (beyond_w + dw)};
                collect(pair, theta, change);
                return ONE;
            }
            u += du, w += dw;
        }
    }
    return UNDECIDED;
}

/// Add a meeting with what the records say.
void MeetingSearch::collect(const Pair& pair, const Varied theta[2], const double change[2]) {
    Meeting out;
    for (int side = 0; side < 2; ++side) {
        const Arc& arc = side == 0 ? pair.a : pair.b;
        out[side].curve = arc.curve;
        out[side].impacts = arc.impacts;
        out[side].theta = theta[side].value + change[side];
        for (int i = 0; i < arc.impacts - gone_[arc.curve]; ++i) {
            const FlightRecord& flight = records_[side].flights[i];
            out[side].durations.push_back(flight.duration.value + change[side] * flight.duration.rate);
            out[side].contacts.push_back(flight.contact);
        }
    }
    meetings.push_back(std::move(out));
}

/// Whether the numbers of impacts, the stops and the times of two arcs are those of a segment within bounds, and the
/// impact is the last one before the middle of its time, seen from A.
bool MeetingSearch::may_meet(const Arc& a, const Arc& b) const {
    if (b.impacts == 0 || a.impacts + b.impacts - 1 > impacts_(a.curve, b.curve) || a.side != b.side) return false;
    if (a.arrived[0] > b.arrived[1] || a.arrived[1] + b.arrived[1] < 2.0 * b.left[0]) return false;
    return a.arrived[0] + b.arrived[0] <= times_(a.curve, b.curve);
}

/// Add the meetings of one pair of arcs. False: it is not decided.
bool MeetingSearch::meet_pair(const Arc& first, const Arc& second) {
    stack_.assign(1, {first, second});
    int splits = 0;
    while (!stack_.empty()) {
        const Pair pair = stack_.back();
        stack_.pop_back();
        if (boxes_apart(pair.a, pair.b)) continue;
        const Chart chart = choose_chart(pair.a, pair.b);
        if (are_apart(pair.a, pair.b, chart)) continue;
        const Hull hull_a(pair.a, chart, false), hull_b(pair.b, chart, true);
        const double sign = turn_between(hull_a, hull_b);
        if (sign != 0.0 && int(meetings.size()) < room_) {
            ++counts.tried;
            if (meet_once(pair, chart, hull_a, hull_b, sign) != UNDECIDED) continue;
        }
        if (splits == SPLITS || int(stack_.size()) + 3 > DEPTH || int(meetings.size()) == room_) return false;
        ++splits;
        ++counts.halved;
        Pair one = pair, two = pair;
        const bool of_a = hull_a.bend() >= hull_b.bend();
        if (!(of_a ? halve(pair.a, one.a, two.a) : halve(pair.b, one.b, two.b))) return false;
        stack_.push_back(one);
        stack_.push_back(two);
    }
    return true;
}

void MeetingSearch::run(const std::vector<Arc>& arcs) {
    std::vector<int> order(arcs.size());
    std::iota(order.begin(), order.end(), 0);
    std::stable_sort(order.begin(), order.end(), [&](int i, int j) { return arcs[i].box[2][0] < arcs[j].box[2][0]; });
    const Grid plain(arcs, order, false), turned(arcs, order, true);
    for (int cell = 0; cell < CELLS * CELLS; ++cell)
        for (const Grid::Item& one : plain.in(cell))
            for (const Grid::Item& two : turned.in(cell)) {
                // Arcs crowd where they graze: there n excludes most pairs, and with one of them all that follow in its
                // order.
                if (two.box[2][0] > one.box[2][1]) break;
                if (one.box[2][0] > two.box[2][1] || one.box[0][0] > two.box[0][1]) continue;
                if (one.box[0][1] < two.box[0][0]) continue;
                if (one.box[1][0] > two.box[1][1] || one.box[1][1] < two.box[1][0]) continue;
                // Of the cells that both are in, the first has the pair.
                const int s = std::max(plain.first_s(one.arc), turned.first_s(two.arc));
                if (cell != s * CELLS + std::max(plain.first_v(one.arc), turned.first_v(two.arc))) continue;
                if (!may_meet(arcs[one.arc], arcs[two.arc])) continue;
                ++counts.pairs;
                if (!meet_pair(arcs[one.arc], arcs[two.arc])) ++counts.undecided;
            }
}

}  // namespace saltus
