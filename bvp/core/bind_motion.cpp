/// Python's view of simulated motion.
#include <algorithm>

#include "bindings.hpp"
#include "motions.hpp"

namespace saltus {

namespace {

std::vector<int> indices(const InIndices& a, const char* name, size_t count, int64_t end) {
    require_size(name, a.shape(0), count);
    for (size_t k = 0; k < count; ++k)
        if (a.data()[k] < 0 || a.data()[k] >= end) throw nb::value_error("there is no such part of the energy budget");
    return {a.data(), a.data() + count};
}

Array<> sized(const InMatrix& a, const char* name, size_t rows, size_t columns) {
    require_size(name, a.shape(0), rows);
    require_size(name, a.shape(1), columns);
    return own(a);
}

NewVector rows_of(const std::vector<double>& values) { return numpy_of(values); }

nb::object integers(const std::vector<int64_t>& values) {
    int64_t* data = new int64_t[values.empty() ? 1 : values.size()];
    std::copy(values.begin(), values.end(), data);
    nb::capsule owner(data, [](void* p) noexcept { delete[] static_cast<int64_t*>(p); });
    return nb::cast(nb::ndarray<nb::numpy, int64_t, nb::ndim<1>>(data, {values.size()}, owner));
}

void make_modes(ContactModes* self, int coordinates, int dampers, int stops, InVector contact_mass, InIndices contact_stop,
                InIndices part, InVector frequency, InVector breaks, InMatrix levels, InMatrix slopes) {
    const size_t count = contact_mass.shape(0);
    if (count > 53) throw nb::value_error("a motion has up to 53 contacts");  // a set of them is a number in a summary
    if (frequency.shape(0) > 0 && breaks.shape(0) == 0) throw nb::value_error("loads have a level from one time on");
    constexpr int MOST = 1'000'000;
    if (coordinates < 1 || dampers < 0 || stops < 0 || std::max({coordinates, dampers, stops}) > MOST)
        throw nb::value_error("expected from 1 coordinate, and from no damper and no stop, to a million");
    new (self) ContactModes(ContactFrame{
        coordinates, dampers, stops, own(contact_mass), indices(contact_stop, "contact_stop", count, stops),
        indices(part, "part", part.shape(0), dampers + stops + 1), own(frequency), own(breaks),
        sized(levels, "levels", breaks.shape(0), frequency.shape(0)),
        sized(slopes, "slopes", breaks.shape(0), frequency.shape(0))});
}

void add_mode(ContactModes& self, int64_t sticking, const LinearFlight<>& flight, const Contacts& contacts, InMatrix push_rest,
              InMatrix leave, InMatrix enter, InMatrix to_modes, InMatrix from_modes, InMatrix first, InMatrix second,
              InVector weight) {
    const ContactFrame& frame = self.frame();
    const size_t n = frame.coordinates, size = flight.size(), loads = frame.frequency.size(), products = frame.part.size();
    require_size("contacts", contacts.count(), self.contacts());
    require_size("a contact's row", contacts.gap.columns(), size);
    require_size("weight", weight.shape(0), products);
    self.add(sticking, flight, contacts, sized(push_rest, "push_rest", self.contacts(), size),
             sized(leave, "leave", 2 * n, size), sized(enter, "enter", size, 2 * n + 2 * loads),
             sized(to_modes, "to_modes", 2 * n, size), sized(from_modes, "from_modes", size, 2 * n + 2 * loads),
             Products{sized(first, "first", products, size), sized(second, "second", products, size), own(weight)});
}

/// A motion with its record.
struct RecordedMotion {
    Motion motion;
    Record record;
};

}  // namespace

void bind_motion(nb::module_& m) {
    nb::class_<ContactModes>(m, "ContactModes", "The contact modes of a system that motions have met so far.")
        .def("__init__", &make_modes, nb::arg("coordinates"), nb::arg("dampers"), nb::arg("stops"), nb::arg("contact_mass"),
             nb::arg("contact_stop"), nb::arg("part"), nb::arg("frequency"), nb::arg("breaks"), nb::arg("levels"), nb::arg("slopes"))
        .def("add", &add_mode, nb::arg("sticking"), nb::arg("flight"), nb::arg("contacts"), nb::arg("push_rest"),
             nb::arg("leave"), nb::arg("enter"), nb::arg("to_modes"), nb::arg("from_modes"), nb::arg("first"), nb::arg("second"),
             nb::arg("weight"), "Add a contact mode; the first is the free one.")
        .def("__len__", &ContactModes::count);
    nb::class_<RecordedMotion>(m, "Motion", "A motion with a record of its events.")
        .def("__init__",
             [](RecordedMotion* self, const ContactModes& modes, InVector start, double energy, int leaving, InVector fractions) {
                 if (modes.count() == 0) throw nb::value_error("there is no free contact mode");
                 require_size("the start", start.shape(0), 2 * modes.frame().coordinates);
                 if (leaving < -1 || leaving >= modes.contacts()) throw nb::value_error("there is no such contact");
                 new (self) RecordedMotion{Motion(modes, view(start), energy, leaving, view(fractions), false, false), {}};
             },
             nb::arg("modes"), nb::arg("start"), nb::arg("energy"), nb::arg("leaving"), nb::arg("fractions"), nb::keep_alive<1, 2>())
        .def("move",
             [](RecordedMotion& self, double duration, int64_t most, int64_t passes) {
                 nb::gil_scoped_release release;
                 return int(self.motion.move(duration, most, passes, &self.record));
             },
             nb::arg("duration"), nb::arg("most"), nb::arg("passes"), "Carry the motion on. Returns the reason.")
        .def("record",
             [](RecordedMotion& self) {
                 nb::dict out;
                 const Record& record = self.record;
                 out["kinds"] = integers(record.kinds), out["contacts"] = integers(record.contacts);
                 out["modes"] = integers(record.modes);
                 out["times"] = rows_of(record.times), out["speeds"] = rows_of(record.speeds);
                 out["losses"] = rows_of(record.losses), out["before"] = rows_of(record.before);
                 out["states"] = rows_of(record.states), out["sums"] = rows_of(record.sums);
                 self.record.clear();
                 return out;
             },
             "The events since the last call: rows one after another.")
        .def_prop_ro("wanted", [](const RecordedMotion& self) { return self.motion.wanted(); }, "Sticking contacts of the next mode.")
        .def_prop_ro("time", [](const RecordedMotion& self) { return self.motion.time(); })
        .def_prop_ro("impacts", [](const RecordedMotion& self) { return self.motion.impacts(); })
        .def_prop_ro("touches", [](const RecordedMotion& self) { return self.motion.touches(); })
        .def_prop_ro("last_impact", [](const RecordedMotion& self) { return self.motion.last_impact(); })
        .def_prop_ro("clear_from", [](const RecordedMotion& self) { return self.motion.clear_from(); })
        .def_prop_ro("sticking_time", [](const RecordedMotion& self) { return self.motion.sticking_time(); })
        .def_prop_ro("switch_error", [](const RecordedMotion& self) { return self.motion.switch_error(); })
        .def_prop_ro("mode", [](const RecordedMotion& self) { return self.motion.mode(); })
        .def("state", [](const RecordedMotion& self) { return numpy_of(self.motion.state()); }, "State of the present contact mode.")
        .def("sums", [](const RecordedMotion& self) { return numpy_of(self.motion.sums()); },
             "Dissipated by each damper and stop, and the work of the loads.")
        .def("marks", [](const RecordedMotion& self) {
            std::vector<std::pair<double, std::vector<double>>> out;
            for (const EnergyMark& mark : self.motion.marks()) out.emplace_back(mark.time, mark.sums);
            return out;
        }, "Time and sums of each mark; NaN: not reached.");
    m.def("run_batch",
          [](const ContactModes& modes, InMatrix starts, InVector energies, InVector restitution, InIndices leaving, InIndices most, InIndices rows,
             double duration, InVector fractions, bool with_peaks, bool to_rest, int64_t passes, int threads, OutMatrix summary, OutMatrix final,
             OutMatrix modal) {
              const size_t count = starts.shape(0), width = 2 * size_t(modes.frame().coordinates);
              if (modes.count() == 0) throw nb::value_error("there is no free contact mode");
              for (const InVector* each : {&energies, &restitution}) require_size("a property of motions", each->shape(0), count);
              for (const InIndices* each : {&leaving, &most}) require_size("a property of motions", each->shape(0), count);
              for (size_t k = 0; k < count; ++k)
                  if (leaving.data()[k] < -1 || leaving.data()[k] >= modes.contacts()) throw nb::value_error("there is no such contact");
              require_size("a start", starts.shape(1), width);
              const int peaks = with_peaks ? modes.frame().coordinates : 0;
              for (const OutMatrix* each : {&summary, &final, &modal}) require_size("rows", each->shape(0), count);
              require_size("a summary", summary.shape(1), Summary::columns(modes.frame().parts(), int(fractions.shape(0)), peaks));
              for (const OutMatrix* each : {&final, &modal}) require_size("a final state", each->shape(1), width);
              for (size_t k = 0; k < rows.shape(0); ++k)
                  if (rows.data()[k] < 0 || rows.data()[k] >= int64_t(count)) throw nb::value_error("there is no such motion");
              if (passes < 1 || threads < 1) throw nb::value_error("expected one pass and one thread, or more");
              const BatchLimits limits{duration, own(fractions), with_peaks, to_rest, passes};
              const Batch batch{view(starts), view(energies), view(restitution), {leaving.data(), count}, {most.data(), count},
                                {rows.data(), rows.shape(0)}, view(summary), view(final), view(modal)};
              bool raised = false;
              {
                  nb::gil_scoped_release release;
                  run_batch(modes, limits, batch, threads, [&raised] {
                      nb::gil_scoped_acquire acquire;
                      raised = PyErr_CheckSignals() != 0;
                      return raised;
                  });
              }
              if (raised) throw nb::python_error();
          },
          nb::arg("modes"), nb::arg("starts"), nb::arg("energies"), nb::arg("restitution"), nb::arg("leaving"), nb::arg("most"), nb::arg("rows"),
          nb::arg("duration"), nb::arg("fractions"), nb::arg("with_peaks"), nb::arg("to_rest"), nb::arg("passes"), nb::arg("threads"),
          nb::arg("summary"), nb::arg("final"), nb::arg("modal"), "Run motions without a record of their events.");
}

}  // namespace saltus
