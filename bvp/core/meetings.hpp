/// Meetings of arcs with mirror images of arcs, which are segments between two ends.
///
/// If the arc A of one curve of starts meets the mirror image of the arc B of another one, a motion leads from a start
/// of the first curve to one of the second one. It is an orbit between both ends. With odd symmetry both are seen at
/// the same stop.
///
/// A pair of arcs is decided if their boxes or their Bezier points are apart, or if no direction of the one is a
/// direction of the other: then they meet once at most, and Newton's method finds the meeting or leaves the pair. Else
/// the arc whose direction changes more is halved.
#pragma once

#include "arcs.hpp"

namespace saltus {

/// A motion from a start to a meeting: for each impact the flight time before it and its contact, as far as they are
/// not gone before the starts of the curve.
struct MeetingHalf {
    int curve = 0, impacts = 0;
    double theta = 0.0;
    std::vector<double> durations;
    std::vector<int> contacts;
};

using Meeting = std::array<MeetingHalf, 2>;

/// Pairs whose boxes meet; halvings; pairs that are not decided; pairs that meet once at most.
struct MeetingCounts {
    int pairs = 0, halved = 0, undecided = 0, tried = 0;
};

class MeetingSearch {
public:
    /// curves (C): with `gone` impacts before their starts. times (C, C): longest time of a segment. impacts (C, C):
    /// most inner impacts; negative where no segment is looked for. fold: whether a mirror image stands for the states
    /// at the lower stop. room: for meetings; a pair is undecided, too, if there is none left.
    MeetingSearch(std::vector<Starts> curves, std::vector<int> gone, Array<> times, Array<int> impacts, bool fold,
                  int room)
        : curves_(std::move(curves)), gone_(std::move(gone)), times_(std::move(times)), impacts_(std::move(impacts)),
            fold_(fold),
          room_(room) {}

    /// Find all meetings of arcs with mirror images of arcs.
    void run(const std::vector<Arc>& arcs);

    /// The point of an arc at u, found by following its start, which is left in a record; and the start.
    struct FollowedPoint {
        bool arrives;  // in the arc's box; a start beyond a grazing arrives elsewhere
        ArcPoint point;
        Varied theta;  // by u
    };
    FollowedPoint follow_arc(const Arc& arc, double u, Followed& record) const;

    int curves() const { return int(curves_.size()); }
    /// Impacts before the starts of a curve, and the contact that these leave.
    int gone(int curve) const { return gone_[curve]; }
    int contact(int curve) const { return curves_[curve].contact; }

    std::vector<Meeting> meetings;
    MeetingCounts counts;

private:
    struct Pair {
        Arc a, b;
    };
    enum Outcome { APART, ONE, UNDECIDED };

    bool may_meet(const Arc& a, const Arc& b) const;
    bool meet_pair(const Arc& a, const Arc& b);
    Outcome meet_once(const Pair& pair, const Chart& chart, const Hull& hull_a, const Hull& hull_b, double sign);
    bool halve(Arc arc, Arc& one, Arc& two);
    void collect(const Pair& pair, const Varied theta[2], const double change[2]);

    std::vector<Starts> curves_;
    std::vector<int> gone_;
    Array<> times_;
    Array<int> impacts_;
    bool fold_;
    int room_;
    Followed records_[2];
    std::vector<Pair> stack_;
};

}  // namespace saltus
