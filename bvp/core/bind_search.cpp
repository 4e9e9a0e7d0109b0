/// Python's view of the searches for orbits of two degrees of freedom and one stop.
#include <nanobind/stl/array.h>
#include <nanobind/stl/shared_ptr.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/map.h>

#include "bindings.hpp"
#include "intervals.hpp"
#include "meetings.hpp"

namespace saltus {

namespace {

using Unlocked = nb::call_guard<nb::gil_scoped_release>;
using Numbers = std::map<std::string, int>;

struct Arcs {
    std::vector<Arc> list;
};

/// A search and what it is of, for Python.
using BoundScan = Exclusive<IntervalScan>;
using BoundMeetings = Exclusive<MeetingSearch>;

NewMatrix matrix_of(const std::array<ArcPoint, 3>& points, std::array<double, 3> ArcPoint::* member) {
    NewMatrix out = new_matrix(3, 3);
    for (int i = 0; i < 3; ++i)
        for (int c = 0; c < 3; ++c) out.data()[3 * i + c] = (points[i].*member)[c];
    return out;
}

void bind_shooting(nb::module_& m) {
    nb::enum_<FarEnd>(m, "FarEnd", "What a search looks for.", nb::is_arithmetic())
        .value("ORIGIN", ORIGIN).value("REST", REST).value("STOP", STOP).value("MIDDLE", MIDDLE);
    nb::enum_<Curve>(m, "Curve", "Functions of the parameter of a curve of starts.")
        .value("TRIGONOMETRIC", Curve::TRIGONOMETRIC).value("LINEAR", Curve::LINEAR)
        .value("HYPERBOLIC", Curve::HYPERBOLIC).value("QUADRATIC", Curve::QUADRATIC);
    auto flight = nb::class_<FlightRecord>(m, "FlightRecord",
                                           "One flight of a motion. FREE, STUCK, AHEAD: contacts without an impact.");
    flight.attr("FREE") = FREE, flight.attr("STUCK") = STUCK, flight.attr("AHEAD") = AHEAD;
    flight.def(nb::init<>())
        .def_prop_rw("state", [](const FlightRecord& r) { return numpy_of(r.begin.z); },
                     [](FlightRecord& r, const State4& z) { r.begin.z = z; }, nb::for_getter(nb::rv_policy::move))
        .def_prop_rw("derivative", [](const FlightRecord& r) { return numpy_of(r.begin.dz); },
                     [](FlightRecord& r, const State4& dz) { r.begin.dz = dz; }, nb::for_getter(nb::rv_policy::move))
        .def_rw("contact", &FlightRecord::contact)
        .def_rw("acceleration", &FlightRecord::acceleration)
        .def_ro("second", &FlightRecord::second)
        .def_ro("turn", &FlightRecord::turn)
        .def_ro("turning_points", &FlightRecord::turning_points);
    const std::pair<const char*, Varied FlightRecord::*> numbers[] = {
        {"time", &FlightRecord::time}, {"duration", &FlightRecord::duration}, {"speed", &FlightRecord::speed},
        {"residual", &FlightRecord::residual}, {"clearance", &FlightRecord::clearance}};
    for (const auto& [name, member] : numbers) {
        flight.def_prop_rw(name, [member](const FlightRecord& r) { return (r.*member).value; },
                           [member](FlightRecord& r, double value) { (r.*member).value = value; });
        flight.def_prop_rw((std::string(name) + "_rate").c_str(),
                           [member](const FlightRecord& r) { return (r.*member).rate; },
                           [member](FlightRecord& r, double value) { (r.*member).rate = value; });
    }
    nb::class_<PlanarSystem>(m, "PlanarSystem", "A system of two degrees of freedom without damping, and one stop.")
        .def("__init__",
             [](PlanarSystem* self, std::array<double, 2> squares, const Contacts& contacts, double lower,
                double upper) {
                 require_size("a contact's row", contacts.gap.columns(), 4);
                 if (contacts.count() < 1) throw nb::value_error("a search needs a stop");
                 new (self) PlanarSystem(squares, contacts, lower, upper);
             },
             nb::arg("squares"), nb::arg("contacts"), nb::arg("lower"), nb::arg("upper"))
        .def("amplitude", [](const PlanarSystem& self, int mode, const State4& z, double horizon, int order) {
                 if (mode < 0 || mode > 1) throw nb::value_error("there are two modes");
                 return self.amplitude(mode, z, horizon, order);
             }, nb::arg("mode"), nb::arg("z"), nb::arg("horizon"), nb::arg("order"))
        .def("scan",
             [](const PlanarSystem& self, FarEnd kind, InMatrix starts, const std::vector<bool>& wanted, double longest,
                OutIndices contacts, OutMatrix times, OutMatrix residuals, OutMatrix nodes, OutMatrix instants) {
                 const int count = int(starts.shape(0)), flights = int(wanted.size()), inner = flights - 1;
                 require_size("a start", starts.shape(1), 4);
                 if (wanted.empty() || times.shape(1) < 1 || kind == MIDDLE)
                     throw nb::value_error("a scan is of a far end, with room for its crossings");
                 require_size("contacts", contacts.size(), size_t(count) * flights);
                 for (const OutMatrix* each : {&times, &residuals}) {
                     require_size("rows", each->shape(0), size_t(count) * flights);
                     require_size("columns", each->shape(1), times.shape(1));
                 }
                 const bool keeps = nodes.shape(0) > 0;
                 require_size("nodes", nodes.size(), keeps ? size_t(count) * inner * 4 : 0);
                 require_size("instants", instants.size(), keeps ? size_t(count) * inner : 0);
                 nb::gil_scoped_release release;
                 const StartScan scan{kind, wanted, longest};
                 for (int i = 0; i < count; ++i) {
                     const int kept = keeps ? inner : 0;
                     scan.follow(self, view(starts)[i],
                                 {{contacts.data() + size_t(i) * flights, size_t(flights)},
                                     view(times).rows(i * flights, flights),
                                  view(residuals).rows(i * flights, flights),
                                      {nodes.data() + size_t(i) * kept * 4, kept, 4},
                                  {instants.data() + size_t(i) * kept, size_t(kept)}});
                 }
             },
             nb::arg("kind"), nb::arg("starts"), nb::arg("wanted"), nb::arg("longest"), nb::arg("contacts"),
                 nb::arg("times"),
             nb::arg("residuals"), nb::arg("nodes"), nb::arg("instants"),
                 "Follow starts, and fill in the crossings of a far end.");
    nb::class_<Starts>(m, "Starts", "A curve of starts.")
        .def("__init__",
             [](Starts* self, std::shared_ptr<const PlanarSystem> system, const std::array<State4, 3>& coefficients,
                Curve shape, int contact) {
                 if (contact < -1 || contact >= system->contacts().count())
                     throw nb::value_error("there is no such contact");
                 new (self) Starts{std::move(system), coefficients, shape, contact};
             },
             nb::arg("system"), nb::arg("coefficients"), nb::arg("shape"), nb::arg("contact"))
        .def_prop_ro("system", [](const Starts& self) { return self.system; })
        .def_ro("contact", &Starts::contact)
        .def("follow",
             [](const Starts& self, double theta, double longest, double latest, int most) {
                 Followed out;
                 follow(self, theta, longest, latest, most, out);
                 out.flights.resize(out.count);
                 return out.flights;
             },
             nb::arg("theta"), nb::arg("longest"), nb::arg("latest"), nb::arg("most"), "The flights of one start.")
        .def("find_clearance",
             [](const Starts& self, FlightRecord& flight, double longest) {
                 find_clearance(*self.system, flight, longest);
             },
             nb::arg("flight"), nb::arg("longest"), "Fill in the turning points of a flight.");
}

void bind_intervals(nb::module_& m) {
    nb::enum_<Verdict> verdict(m, "Verdict", "Verdicts on a flight of an interval of starts.");
    const std::pair<const char*, Verdict> verdicts[] = {
        {"CLOSED", Verdict::CLOSED}, {"SPLIT", Verdict::SPLIT}, {"JUMP", Verdict::JUMP}, {"DONE", Verdict::DONE},
        {"ENDLESS", Verdict::ENDLESS}, {"GRAZED", Verdict::GRAZED}, {"ENDED", Verdict::ENDED},
        {"PRESSED", Verdict::PRESSED}, {"LATE", Verdict::LATE}, {"DIFFERENT", Verdict::DIFFERENT},
        {"COARSE", Verdict::COARSE}, {"UNEVEN", Verdict::UNEVEN}, {"TOUCHES", Verdict::TOUCHES},
        {"SLOW", Verdict::SLOW}, {"SKIMS", Verdict::SKIMS}, {"NEAR_ORIGIN", Verdict::NEAR_ORIGIN},
        {"NEAR_REST", Verdict::NEAR_REST}, {"NEAR_STOP", Verdict::NEAR_STOP}};
    for (const auto& [name, value] : verdicts) verdict.value(name, value);
    m.attr("TUBE_MARGIN") = TUBE_MARGIN;
    nb::class_<StartMap>(m, "StartMap", "A map of [0, 1] to the parameter of starts.")
        .def("__init__", [](StartMap* self, double low, double high, bool root_low, bool root_high) {
                 new (self) StartMap{low, high, root_low, root_high};
             }, nb::arg("low"), nb::arg("high"), nb::arg("root_low"), nb::arg("root_high"))
        .def("place",
             [](const StartMap& self, double x) {
                 const Varied theta = self.place(x);
                 return std::make_pair(theta.value, theta.rate);
             })
        .def("unplace", &StartMap::unplace);
    m.def("positive_between",
          [](double a, double a_rate, double m_, double m_rate, double b, double b_rate, double r, double noise) {
              return positive_between({a, a_rate}, {m_, m_rate}, {b, b_rate}, r, noise);
          });
    m.def("crossing",
          [](std::array<double, 2> squares, FarEnd kind, const State4& z, const State4& along, double r, double width,
             const std::array<double, 3>& visit) {
              Contacts contacts{Array<>(1, 4, 1.0), Array<>(1, 4), Array<>(1, 4), Array<>(1, 4), {1.0}, {1.0}, {1.0}};
              const PlanarSystem system(squares, std::move(contacts), -1.0, 1.0);
              return crossing(system, kind, {{z, along}, 0.0, r, width}, {visit[0], visit[1], visit[2]});
          },
          "Whether a crossing can hold an orbit, and its time. visit: begin, end and time of the least distance.");
    nb::class_<EndCrossing>(m, "EndCrossing")
        .def_ro("kind", &EndCrossing::kind).def_ro("impacts", &EndCrossing::impacts)
        .def_ro("theta", &EndCrossing::theta)
        .def_ro("flight", &EndCrossing::flight).def_ro("residual", &EndCrossing::residual)
        .def_ro("converged", &EndCrossing::converged).def_ro("low", &EndCrossing::low)
        .def_ro("high", &EndCrossing::high);
    nb::class_<Opening>(m, "Opening")
        .def_ro("theta", &Opening::theta).def_ro("width", &Opening::width).def_ro("flight", &Opening::flight)
        .def_ro("reason", &Opening::reason);
    nb::class_<BoundScan>(m, "IntervalScan", "An adaptive scan of a curve of starts.")
        .def("__init__",
             [](BoundScan* self, const Starts& starts, const std::array<double, 4>& times,
                const std::array<int, 4>& impacts, bool fold, double longest, double latest, int most) {
                 if (most < 0) throw nb::value_error("the most impacts are negative");
                 new (self) BoundScan(StartSearch{starts, times, impacts, fold, longest, latest, most});
             },
             nb::arg("starts"), nb::arg("times"), nb::arg("impacts"), nb::arg("fold"), nb::arg("longest"),
             nb::arg("latest"), nb::arg("most"))
        .def("begin",
             [](BoundScan& self, double low, double high, const StartMap& map, int budget) {
                 self.alone([&] { self.begin(low, high, map, budget); });
             },
             nb::arg("low"), nb::arg("high"), nb::arg("map"), nb::arg("budget"), Unlocked())
        .def("go", [](BoundScan& self, int passes) { return self.alone([&] { return self.go(passes); }); },
             nb::arg("passes"), Unlocked(), "Scan on for about so many flights. Returns whether it is done.")
        .def_prop_ro("crossings", [](BoundScan& self) { return self.alone([&] { return self.crossings; }); })
        .def_prop_ro("openings", [](BoundScan& self) { return self.alone([&] { return self.openings; }); })
        .def("take_arcs",
             [](BoundScan& self, int curve, int gone, double since) {
                 Arcs out{self.alone([&] { return std::exchange(self.arcs, {}); })};
                 for (Arc& arc : out.list) {
                     arc.curve = curve;
                     arc.impacts += gone;
                     for (int i = 0; i < 2; ++i) arc.arrived[i] += since, arc.left[i] += since;
                 }
                 return out;
             },
             nb::arg("curve"), nb::arg("gone"), nb::arg("since"),
             "The arcs found, as those of a numbered curve with impacts and time before its starts.")
        .def_prop_ro("counts",
                     [](BoundScan& self) {
                         const IntervalCounts c = self.alone([&] { return self.counts; });
                         return Numbers{{"starts", c.starts},     {"split", c.split}, {"closed", c.closed},
                                        {"grazings", c.grazings}, {"open", c.open},   {"at_grazing", c.at_grazing},
                                        {"budget", c.budget}};
                     })
        .def("verdict",
             [](const BoundScan& self, int k, const std::vector<FlightRecord>& a,
                const std::vector<FlightRecord>& middle, const std::vector<FlightRecord>& b, double r, double grain) {
                 if (k < 0) throw nb::value_error("the flights count from 0");
                 Followed one{a, int(a.size()), {}}, two{middle, int(middle.size()), {}}, three{b, int(b.size()), {}};
                 Crossings found;
                 return flight_verdict(self.search(), k, {{&one, 1.0}, {&two, 1.0}, {&three, 1.0}, r, grain}, found);
             },
             nb::arg("k"), nb::arg("a"), nb::arg("middle"), nb::arg("b"), nb::arg("r"), nb::arg("grain"),
             "The verdict on flight k of an interval of half width r, from its ends and its middle.");
}

/// Refuse an arc of a curve that a search does not have.
void check_arc(const MeetingSearch& search, const Arc& arc) {
    require_index("the number of a curve", arc.curve, search.curves());
    const int after = arc.impacts - search.gone(arc.curve);
    if (after < 0 || (after == 0 && search.contact(arc.curve) < 0))
        throw nb::value_error("an arc has fewer impacts than are before its curve");
}

void bind_meetings(nb::module_& m) {
    nb::class_<Arc>(m, "Arc", "The image of an interval of starts on the section of the impacts.")
        .def("__init__",
             [](Arc* self, const std::array<std::array<double, 3>, 3>& values, 
                const std::array<std::array<double, 3>, 3>& rates) {
                 new (self) Arc();
                 for (int i = 0; i < 3; ++i) self->points[i] = {values[i], rates[i]};
                 self->bound();
             },
             nb::arg("values"), nb::arg("rates"),
                 "From the points (s, v, n) at both ends and in the middle, and their derivatives.")
        .def_ro("impacts", &Arc::impacts)
        .def_ro("curve", &Arc::curve)
        .def_prop_ro("arrived", [](const Arc& self) { return std::make_pair(self.arrived[0], self.arrived[1]); })
        .def_prop_ro("left", [](const Arc& self) { return std::make_pair(self.left[0], self.left[1]); })
        .def_prop_ro("values", [](const Arc& self) { return matrix_of(self.points, &ArcPoint::value); },
                     nb::rv_policy::move)
        .def_prop_ro("rates", [](const Arc& self) { return matrix_of(self.points, &ArcPoint::rate); },
                     nb::rv_policy::move)
        .def_prop_ro("error", [](const Arc& self) { return numpy_of({self.error, 3}); }, nb::rv_policy::move)
        .def_prop_ro("miss", [](const Arc& self) { return numpy_of({self.miss, 3}); }, nb::rv_policy::move)
        .def_prop_ro("box", [](const Arc& self) {
            NewMatrix out = new_matrix(3, 2);
            std::copy(&self.box[0][0], &self.box[0][0] + 6, out.data());
            return out;
        }, nb::rv_policy::move)
        .def("model", [](const Arc& self, double u) {
            const ArcPoint point = self.model(u);
            return std::make_pair(point.value, point.rate);
        });
    nb::class_<Arcs>(m, "Arcs", "Arcs of one curve of starts.")
        .def("__len__", [](const Arcs& self) { return self.list.size(); })
        .def("__getitem__", [](const Arcs& self, size_t i) {
            if (i >= self.list.size()) throw nb::index_error();
            return self.list[i];
        });
    m.def("stop_arcs",
          [](const Starts& starts, const std::vector<double>& edges, bool fold, int curve) {
              if (starts.contact < 0) throw nb::value_error("these starts are at no stop");
              Arcs out;
              for (size_t i = 1; i < edges.size(); ++i) {
                  out.list.push_back(stop_arc(starts, edges[i - 1], edges[i], fold));
                  out.list.back().curve = curve;
              }
              return out;
          },
          nb::arg("starts"), nb::arg("edges"), nb::arg("fold"), nb::arg("curve"), "The starts at a stop as arcs.");
    m.def("boxes_apart", &boxes_apart);
    const auto checked = [](const Chart& chart) {
        for (int c : chart) require_index("a coordinate", c, 3);
    };
    m.def("are_apart", [checked](const Arc& a, const Arc& b, const Chart& chart) {
        checked(chart);
        return are_apart(a, b, chart);
    });
    m.def("turn_between", [checked](const Arc& a, const Arc& b, const Chart& chart) {
        checked(chart);
        return turn_between(Hull(a, chart, false), Hull(b, chart, true));
    });
    nb::class_<BoundMeetings>(m, "MeetingSearch", "Meetings of arcs with mirror images of arcs.")
        .def("__init__",
             [](BoundMeetings* self, std::vector<Starts> curves, std::vector<int> gone, InMatrix times,
                InPairs impacts, bool fold, int room) {
                 const size_t count = curves.size();
                 require_size("gone", gone.size(), count);
                 require_size("times", times.size(), count * count);
                 require_size("impacts", impacts.size(), count * count);
                 for (int each : gone)
                     if (each < 0) throw nb::value_error("a number of impacts is negative");
                 Array<int> inner{int(count), int(count)};
                 std::copy(impacts.data(), impacts.data() + impacts.size(), inner.data());
                 new (self) BoundMeetings(std::move(curves), std::move(gone), own(times), std::move(inner), fold, room);
             },
             nb::arg("curves"), nb::arg("gone"), nb::arg("times"), nb::arg("impacts"), nb::arg("fold"), nb::arg("room"))
        .def("run",
             [](BoundMeetings& self, const std::vector<const Arcs*>& lists) {
                 std::vector<Arc> all;
                 for (const Arcs* arcs : lists) {
                     if (!arcs) throw nb::value_error("received None in the place of arcs");
                     all.insert(all.end(), arcs->list.begin(), arcs->list.end());
                 }
                 for (const Arc& arc : all) check_arc(self, arc);
                 nb::gil_scoped_release release;
                 self.alone([&] { self.run(all); });
             },
             nb::arg("arcs"))
        .def("follow_arc",
             [](const BoundMeetings& self, const Arc& arc, double u) {
                 check_arc(self, arc);
                 Followed record;
                 const MeetingSearch::FollowedPoint found = self.follow_arc(arc, u, record);
                 record.flights.resize(record.count);
                 return std::make_tuple(found.arrives, found.point.value, found.point.rate, record.flights);
             },
             nb::arg("arc"), nb::arg("u"),
                 "(whether it arrives in the box, the point, its derivative, the flights) of the start at u.")
        .def_prop_ro("counts",
                     [](BoundMeetings& self) {
                         const auto [c, met] = self.alone([&] { return std::pair(self.counts, self.meetings.size()); });
                         return Numbers{{"met", int(met)}, {"pairs", c.pairs}, {"halved", c.halved},
                                        {"undecided", c.undecided}, {"tried", c.tried}};
                     })
        .def("meetings",
             [](BoundMeetings& self) {
                 const std::vector<Meeting> meetings = self.alone([&] { return self.meetings; });
                 const int count = int(meetings.size());
                 size_t most = 0;
                 for (const Meeting& each : meetings)
                     most = std::max(most, each[0].durations.size() + each[1].durations.size());
                 NewMatrix theta = new_matrix(count, 2), impacts = new_matrix(count, 2), curves = new_matrix(count, 2);
                 NewMatrix durations = new_matrix(count, int(most)), contacts = new_matrix(count, int(most));
                 std::fill(durations.data(), durations.data() + count * most, 0.0);
                 std::fill(contacts.data(), contacts.data() + count * most, 0.0);
                 for (int i = 0; i < count; ++i) {
                     size_t at = i * most;
                     for (int side = 0; side < 2; ++side) {
                         const MeetingHalf& half = meetings[i][side];
                         theta.data()[2 * i + side] = half.theta;
                         impacts.data()[2 * i + side] = half.impacts;
                         curves.data()[2 * i + side] = half.curve;
                         for (size_t n = 0; n < half.durations.size(); ++n, ++at)
                             durations.data()[at] = half.durations[n], contacts.data()[at] = half.contacts[n];
                     }
                 }
                 return std::make_tuple(theta, impacts, curves, durations, contacts);
             },
             "Of all meetings, from both curves: parameters, impacts, numbers of the curves; flight times and contacts "
             "of the first curve's impacts, then of the second's.");
}

}  // namespace

void bind_search(nb::module_& m) {
    bind_shooting(m);
    bind_intervals(m);
    bind_meetings(m);
}

}  // namespace saltus
