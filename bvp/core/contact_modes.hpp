/// Contact modes of a system: the free motion, and the motion while some of the contacts stick. All have the same seam,
/// and a motion goes from one to the other through modal coordinates (section 7 of docs/theory.md).
///
/// While a contact sticks, its row is the contact force: the next impact and the next release are found alike.
#pragma once

#include <memory>
#include <vector>

#include "budget.hpp"
#include "impact.hpp"
#include "peaks.hpp"

namespace saltus {

/// What all contact modes of a system have in common: n coordinates, D dampers, S stops, m contacts, R products, G loads.
struct ContactFrame {
    int coordinates, dampers, stops;
    std::vector<double> contact_mass;  // (m,) 1/(c M^-1 c)
    std::vector<int> contact_stop;     // (m,)
    std::vector<int> part;             // (R,) of the energy budget
    std::vector<double> frequency;     // (G,) 0: a level and a slope
    std::vector<double> breaks;        // (K,) times at which the loads without frequency are set anew
    Array<> levels, slopes;            // (K, G)
    int parts() const { return dampers + stops + 1; }
    int loads() const { return int(frequency.size()); }
};

/// One contact mode, of N states z. (u, v) = leave z; z = enter (u, v, y) with the states y of the loads. `to_modes`
/// and `from_modes` are the same for modal coordinates in place of (u, v).
class ContactMode {
public:
    ContactMode(int64_t sticking, LinearFlight<> flight, Contacts contacts, Array<> push_rest, Array<> leave, Array<> enter,
                Array<> to_modes, Array<> from_modes, Products products)
        : sticking(sticking), flight(std::move(flight)), contacts(std::move(contacts)), push_rest(std::move(push_rest)),
          leave(std::move(leave)), enter(std::move(enter)), to_modes(std::move(to_modes)),
          from_modes(std::move(from_modes)), products(std::move(products)), integrals(this->flight, this->products) {
        if (!this->flight.steps().is_usable()) return;
        stops = std::make_unique<StepStops>(this->flight.steps(), this->contacts);
        peak_rows = std::make_unique<PeakRows>(this->flight.steps(), displacements());
    }
    /// The same mode with another restitution of all contacts.
    ContactMode(const ContactMode& other, double restitution)
        : ContactMode(other.sticking, other.flight, changed(other.contacts, restitution), other.push_rest, other.leave,
                      other.enter, other.to_modes, other.from_modes, other.products) {}
    ContactMode(const ContactMode&) = delete;
    ContactMode& operator=(const ContactMode&) = delete;

    Displacements displacements() const {
        const int n = leave.rows() / 2;
        const Matrix<const double> rows = leave;
        return {rows.rows(0, n), rows.rows(n, n)};
    }
    int size() const { return flight.size(); }

    const int64_t sticking;  // bits of the sticking contacts
    const LinearFlight<> flight;
    const Contacts contacts;
    const Array<> push_rest;  // rounding errors of the doubles of contacts.push
    const Array<> leave, enter, to_modes, from_modes;
    const Products products;  // what the dampers and the loads do
    const FlightIntegrals integrals;
    std::unique_ptr<StepStops> stops;      // of flights in steps of fixed length
    std::unique_ptr<PeakRows> peak_rows;

private:
    static Contacts changed(Contacts contacts, double restitution) {
        std::fill(contacts.restitution.begin(), contacts.restitution.end(), restitution);
        return contacts;
    }
};

/// The contact modes that motions have met so far. The first is the free one.
class ContactModes {
public:
    explicit ContactModes(ContactFrame frame) : frame_(std::move(frame)) {}
    ContactModes(ContactModes&&) = default;
    ContactModes(const ContactModes&) = delete;

    const ContactFrame& frame() const { return frame_; }
    int count() const { return int(modes_.size()); }
    int contacts() const { return int(frame_.contact_stop.size()); }
    const ContactMode& operator[](int f) const { return *modes_[f]; }
    template <class... Parts>
    void add(Parts&&... parts) { modes_.push_back(std::make_unique<ContactMode>(std::forward<Parts>(parts)...)); }
    /// Index of the contact mode in which exactly these contacts stick, or -1.
    int find(int64_t sticking) const {
        for (int f = 0; f < count(); ++f)
            if (modes_[f]->sticking == sticking) return f;
        return -1;
    }
    /// The same modes with another restitution of all contacts.
    ContactModes with_restitution(double restitution) const {
        ContactModes out(frame_);
        for (const auto& mode : modes_) out.add(*mode, restitution);
        return out;
    }

private:
    ContactFrame frame_;
    std::vector<std::unique_ptr<ContactMode>> modes_;
};

}  // namespace saltus
