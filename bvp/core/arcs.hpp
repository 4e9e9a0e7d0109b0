/// Arcs: the images of intervals of starts on the section of the impacts.
///
/// A state after an impact is given by its position s along the stop, its velocity v along the stop, and the speed n at
/// which it leaves the stop. At one energy, two of them give the size of the third one. Starts of an interval whose
/// flights are decided arrive on a smooth arc (s, v, n). It is known from both ends and the middle of the interval, as
/// the flights are. Each arc is a function of u, from -1 to 1 over its interval. With odd symmetry the mirror image of
/// an impact at the lower stop stands for it.
///
/// A motion reversed in time leaves an impact with the opposite velocity along the stop: the mirror image of (s, v, n)
/// is (s, -v, n). Arcs are compared in two of the three coordinates, a chart: the two in which their directions differ
/// most. Slow impacts, for example, differ in n. In s and v they are all next to the curve n = 0 and have its
/// direction.
#pragma once

#include "shooting.hpp"

namespace saltus {

/// How much the samples of an interval may disagree, relative to the state: rounding errors grow with the instability
/// of the motion, and what moves a state by less has impacts slower than this.
inline constexpr double SLACK = 1e-10;

/// A bound of the change of a quantity over an interval, from its values at both ends and in the middle.
inline double deviation(double first, double middle, double second) {
    return 0.5 * std::fabs(second - first) + std::fabs(0.5 * (first + second) - middle);
}

/// The map of x in [0, 1] to the parameter of starts: quadratic at an end where everything depends on the square root
/// of the distance to it.
struct StartMap {
    double low = 0.0, high = 1.0;
    bool root_low = false, root_high = false;

    Varied place(double x) const;
    double unplace(double theta) const;
};

/// A point (s, v, n) of an arc and its derivative by u.
struct ArcPoint {
    std::array<double, 3> value, rate;
};

struct Arc {
    /// How far an arc goes on beyond its ends at least, in u.
    static constexpr double NEAREST = 1e-9;

    int impacts = 0;   // on the way to it
    int curve = 0;     // number of the curve of starts
    double side = 1.0;  // of the stop
    StartMap map;
    double first = 0.0, last = 1.0;  // ends of the interval in x
    double before = NEAREST, after = NEAREST;  // how far it goes on beyond each end, in u
    std::array<ArcPoint, 3> points{};  // at both ends and in the middle: low end, middle, high end
    double arrived[2] = {0.0, 0.0};  // first and last time of arrival,
    double left[2] = {0.0, 0.0};     // and of the start of the flight that arrives
    // bounds: of the differences of the derivatives from the parabola through theirs, and of the values from cubics
    double error[3] = {}, miss[3] = {};
    double box[3][2] = {};  // lowest and highest s, v and n
    bool modelled = false;  // the points are those of a longer arc's cubics
    double grain = 0.0;  // rounding of the starts, in u

    /// Fill in the bounds from the points.
    void bound();
    /// Fill in the box alone.
    void enclose();
    /// The point at u by the cubics on both halves.
    ArcPoint model(double u) const;
};

/// The point of a state after an impact at a contact. rate: the parameter's by u. fold: whether a mirror image stands
/// for the lower stop.
ArcPoint arc_point(const PlanarSystem& system, int contact, bool fold, const Moving& state, double rate);

/// The starts at a stop between two parameters as an arc: they are states after an impact, without a velocity along the
/// stop.
Arc stop_arc(const Starts& starts, double low, double high, bool fold);

/// Two of the coordinates s, v and n.
using Chart = std::array<int, 2>;

/// The sign of a coordinate in a reversed motion.
inline double mirrored(int c) { return c == 1 ? -1.0 : 1.0; }

inline double cross_product(double a0, double a1, double b0, double b1) { return a0 * b1 - a1 * b0; }

/// All directions of an arc in a chart: the Bezier points of the parabola through its derivatives, and their errors.
struct Hull {
    double point[3][2], error[2];
    Hull(const Arc& arc, const Chart& chart, bool is_mirrored);
    /// How much the derivative changes along the arc.
    double bend() const;
};

/// Whether the box of an arc and the mirror image of another's are apart.
bool boxes_apart(const Arc& a, const Arc& b);
/// The chart in which the directions of two arcs in their middles differ most.
Chart choose_chart(const Arc& a, const Arc& b);
/// Whether the Bezier points of an arc and of the mirror image of another are apart, seen along the chord of either.
bool are_apart(const Arc& a, const Arc& b, const Chart& chart);
/// The sign of the cross products of all directions of two hulls, 0 if it is not certain. Where it is certain, equation
/// (36) has one solution at most.
double turn_between(const Hull& a, const Hull& b);
/// The sign of the cross products of a vector, known up to noise, with all directions of a hull; 0 if it is not
/// certain.
double side_of(const double f[2], const double noise[2], const Hull& b);

}  // namespace saltus
