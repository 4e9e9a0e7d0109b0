/// An adaptive scan of a curve of starts. An interval is split until the scan knows every orbit that it can contain.
///
/// An interval that cannot be closed (`verdict.hpp`) is split. Its halves start with the flight that was open. If the
/// impact sequence changes inside, the grazing is located to rounding and becomes an end of both sides. On the side
/// with the slow impact, everything depends on the square root of the distance to the grazing, so this root is the
/// parameter there.
#pragma once

#include "verdict.hpp"

namespace saltus {

/// A start whose motion crosses a far end.
struct EndCrossing {
    FarEnd kind;
    int impacts;  // inside the segment
    double theta, flight, residual;  // flight: time in the last flight
    bool converged;  // if not, it lies between `low` and `high` if it exists
    double low, high;
};

/// An interval of starts that stays open at a flight. The reason GRAZED means that it is as narrow as rounding about a
/// grazing.
struct Opening {
    double theta, width;
    int flight;
    Verdict reason;
};

struct IntervalCounts {
    int starts = 0, split = 0, closed = 0, grazings = 0, open = 0, at_grazing = 0, budget = 0;
};

class IntervalScan {
public:
    // halvings of one interval, most of them in the square root of the distance to a grazing
    static constexpr int DEPTH = 100;

    explicit IntervalScan(StartSearch search) : search_(std::move(search)), records_(3 * DEPTH + 3) {}

    /// Begin with the starts between two parameters, for about as many starts as `budget` says. map: of x to the
    /// parameter; where the curve of starts itself ends at a stop, its end is one of the map's.
    void begin(double low, double high, const StartMap& map, int budget);
    /// Scan on until about as many flights are followed as `passes` says. Returns whether it is done.
    bool go(int passes);

    const StartSearch& search() const { return search_; }
    std::vector<EndCrossing> crossings;
    std::vector<Arc> arcs;
    std::vector<Opening> openings;
    IntervalCounts counts;

private:
    struct Interval {
        StartMap map;
        double a, b;      // ends in x
        int i_a, i_b;     // their records
        int k;            // the flight that is open
        int depth;
        Verdict verdict;  // why
        bool halfway = false;  // it is closed for some of its flights, and its middle is followed
    };
    /// An interval in work: parameters of its ends and its middle.
    struct Work {
        Interval interval;
        StartInterval starts;
        double theta_a, theta_m, theta_b, grain;
        int i_m;
        bool root_a, root_b;  // everything depends on the square root of the distance to that end
    };
    /// The grazing between two starts: on each side the start nearest to it with a distance above rounding, and the
    /// bracket.
    struct Grazing {
        int one, two;
        double theta_1, theta_2, edge_1, edge_2;
        bool coarse;  // rounding of the starts hides much more of it than the contact tolerance does
        int followed;
    };

    int follow_into(int record, double theta, double latest, int most);
    void split_or_close(Interval interval, int passes);
    Verdict close(Work& work, int passes);
    bool find_orbits(const Work& work, const Crossings& found, Verdict& verdict);
    void add_arc(const Work& work);
    void leave_open(double theta, double width, int flight, Verdict reason);
    void push_between(const StartMap& map, double low, double high, int i_low, int i_high, const Interval& from);
    Grazing grazing_between(const Work& work);
    void split_at_grazing(const Work& work);

    StartSearch search_;
    std::vector<Followed> records_;
    std::vector<Interval> stack_;
    int budget_ = 0, used_ = 0, flights_ = 0;
};

}  // namespace saltus
