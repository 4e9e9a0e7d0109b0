/// Python's view of chains: multipliers of closed orbits, half maps, and the dense algebra beneath them.
#include <complex>
#include <nanobind/stl/array.h>
#include <optional>

#include "bindings.hpp"
#include "pair_tests.hpp"

namespace saltus {

namespace {

using InCube = nb::ndarray<const double, nb::ndim<3>, nb::c_contig, nb::device::cpu>;
using NewComplex = nb::ndarray<nb::numpy, std::complex<double>, nb::ndim<1>>;

NewComplex complex_vector(Values real, Values imaginary) {
    const size_t size = real.size();
    auto* data = new std::complex<double>[size > 0 ? size : 1];
    for (size_t k = 0; k < size; ++k) data[k] = {real[k], imaginary[k]};
    return NewComplex(data, {size},
                      nb::capsule(data, [](void* p) noexcept { delete[] static_cast<std::complex<double>*>(p); }));
}

/// Ends of a half map, as `bvp.closures` numbers them.
enum class End { ORIGIN, REST, STOP };

/// The chains of one system's orbits: what depends on the system alone, and work space.
class SystemChain {
public:
    SystemChain(const LinearFlight<>& flight, const Contacts& contacts, InMatrix free, bool conservative, bool scaled,
                bool given)
        : flight_(flight),
          contacts_(contacts),
          scaled_(scaled),
          modal_(!given && is_modal(flight)),
          chain_(flight.size(), modal_),
          floquet_(flight.size(), checked(flight, contacts, free, conservative), conservative),
          scale_(flight.size(), 1.0) {
        if (flight.size() == 4 && modal_ && conservative && free.shape(0) == 0) pair_.emplace(flight);
    }

    /// (route, values, trivial, pairing, matrix, steps) of a linear system's closed orbit.
    nb::tuple multipliers(InMatrix before, InMatrix after, InVector duration, InIndices contact, bool product) {
        const Nodes nodes = checked(view(before), view(after), view(duration), contact);
        if (scaled_) set_scale(nodes, floquet_.is_conservative() ? flight_.twice_energy(nodes.after[0]) : 0.0, scale_);
        else std::fill(scale_.begin(), scale_.end(), 1.0);
        if (pair_) {
            pair_->chain.set(pair_->flight, contacts_, nodes);
            return found(pair_->chain, pair_->floquet, product);
        }
        chain_.set(flight_, contacts_, nodes);
        return found(chain_, floquet_, product);
    }

    /// The same from the maps of its flights.
    nb::tuple multipliers_of_maps(InCube maps, InMatrix coming, InMatrix leaving, InIndices contact, InVector scale) {
        require_size("maps", maps.shape(0), coming.shape(0));
        if (coming.shape(0) < 1) throw nb::value_error("received an orbit without nodes");
        set_maps(maps, coming, leaving, contact);
        require_size("scale", scale.shape(0), scale_.size());
        copy(view(scale), scale_);
        return found(chain_, floquet_, false);
    }

    /// (phi, magnification) between two ends, for the flights from `states` over `times` to `ends`.
    nb::tuple half_map_of_flights(std::array<int, 2> kinds, InMatrix held, InMatrix states, InVector times,
                                  InMatrix ends, InIndices contact) {
        const Matrix<const double> z = view(states), last = view(ends);
        const int flights = z.rows();
        if (flights < 1) throw nb::value_error("received an orbit without flights");
        require_size("times", times.shape(0), flights);
        require_size("ends", last.rows(), flights);
        require_size("the states", z.columns(), flight_.size());
        require_size("the ends", last.columns(), flight_.size());
        const std::vector<int> hit = contacts_of(contact, flights + 1);
        chain_.begin(flights + 1);
        for (int i = 0; i <= flights; ++i) {
            const Values before = last[i > 0 ? i - 1 : 0];
            chain_.set_node(i, flight_, contacts_, i > 0 && i < flights ? hit[i - 1] : -1, i > 0 ? before : z[0],
                            i < flights ? z[i] : before);
            if (i < flights) chain_.set_flight(i, flight_, z[i], times.data()[i]);
        }
        return half(kinds, held, hit, std::sqrt(flight_.twice_energy(z[0])));
    }

    /// The same from the maps of the flights; coming, leaving: at the start, the inner nodes and the far end.
    nb::tuple half_map_of_maps(std::array<int, 2> kinds, InMatrix held, InCube maps, InMatrix coming, InMatrix leaving,
                               InIndices contact, double reach) {
        const int flights = int(maps.shape(0));
        if (flights < 1) throw nb::value_error("received an orbit without flights");
        const std::vector<int> hit = contacts_of(contact, flights + 1);
        std::vector<int64_t> inner(flights + 1, -1);
        for (int i = 1; i < flights; ++i) inner[i] = hit[i - 1];
        set_maps(maps, coming, leaving, inner);
        return half(kinds, held, hit, reach);
    }

private:
    struct Pair {
        explicit Pair(const LinearFlight<>& from)
            : flight(from), floquet(4, {nullptr, 0, 2}, true) {}
        LinearFlight<4> flight;
        Chain<4> chain;
        Floquet<4, 2> floquet;
    };

    template <class C, class F>
    nb::tuple found(const C& chain, F& floquet, bool product) {
        Route route;
        if (product) {
            route = floquet.multipliers(chain, contacts_, scale_);
        } else {
            floquet.formed(chain, contacts_, scale_);
            route = floquet.factored(chain, contacts_, scale_);
        }
        const auto& spectrum = floquet.found();
        if (route > Route::FACTORED) {  // what is there is of an earlier orbit
            const std::vector<double> unknown(spectrum.count(), NOT_A_NUMBER);
            Array<> nothing(spectrum.count(), spectrum.count(), NOT_A_NUMBER);
            return nb::make_tuple(int(route), complex_vector(unknown, unknown), floquet.trivial(), NOT_A_NUMBER,
                                  numpy_matrix(nothing), floquet.steps());
        }
        return nb::make_tuple(int(route), complex_vector(spectrum.real, spectrum.imaginary), floquet.trivial(),
                              spectrum.pairing, numpy_matrix(spectrum.matrix), floquet.steps());
    }

    nb::tuple half(std::array<int, 2> kinds, InMatrix held, const std::vector<int>& hit, double reach) {
        const int flights = int(hit.size()) - 1, pairs = int(held.shape(0)) - 1;
        for (int kind : kinds)
            if (kind < 0 || kind > 2) throw nb::value_error("an end of a half map is 0 (origin), 1 (rest) or 2 (stop)");
        for (int e = 0; e < 2; ++e)
            if (End(kinds[e]) == End::STOP && hit[e ? flights - 1 : flights] < 0)
                throw nb::value_error("a stop end has a contact");
        require_size("held", held.shape(1), flight_.size() / 2);
        if (pairs < 0 || held.shape(0) > held.shape(1) || (held.shape(1) == 2 && pairs != 1) || flight_.size() % 2 != 0)
            throw nb::value_error("a half map is of one to all motions, and of two if there are two");
        Dense<> phi(2 * pairs);
        const HalfEnd<End> start{End(kinds[0]), hit[flights]}, finish{End(kinds[1]), hit[flights - 1]};
        const double magnified = saltus::half_map(chain_, contacts_, start, finish, view(held), reach, phi);
        return nb::make_tuple(numpy_matrix(phi), magnified);
    }

    /// The free motions, where all sizes agree.
    static Matrix<const double> checked(const LinearFlight<>& flight, const Contacts& contacts, const InMatrix& free,
                                        bool conservative) {
        require_size("a contact's row", contacts.gap.columns(), flight.size());
        require_size("free motions", free.shape(1), flight.size() / 2);
        if (conservative && (flight.size() % 2 != 0 || 2 + 2 * int(free.shape(0)) > flight.size()))
            throw nb::value_error("too many motions are free");
        return view(free);
    }

    void check_contact(int64_t contact) const {
        if (contact < -1 || contact >= contacts_.count())
            throw nb::value_error("received a contact that the system does not have");
    }
    std::vector<int> contacts_of(const InIndices& contact, int size) {
        require_size("contact", contact.shape(0), size);
        for (int k = 0; k < size; ++k) check_contact(contact.data()[k]);
        return {contact.data(), contact.data() + size};
    }

    Nodes checked(Matrix<const double> before, Matrix<const double> after, Values duration, const InIndices& contact) {
        for (const auto* states : {&before, &after}) {
            require_size("a state", states->columns(), flight_.size());
            require_size("states", states->rows(), duration.size());
        }
        hit_ = contacts_of(contact, int(duration.size()));
        if (hit_.empty()) throw nb::value_error("received an orbit without nodes");
        return {before, after, duration, hit_};
    }

    template <class Indices>
    void set_maps(const InCube& maps, const InMatrix& coming, const InMatrix& leaving, const Indices& contact) {
        if (modal_) throw nb::value_error("this chain makes its own maps");
        const int size = flight_.size(), nodes = int(coming.shape(0));
        require_size("a map", maps.shape(1) * maps.shape(2), size_t(size) * size);
        if (maps.shape(0) > coming.shape(0)) throw nb::value_error("received more maps than nodes");
        for (const InMatrix* rows : {&coming, &leaving}) {
            require_size("a row of a node", rows->shape(1), size);
            require_size("rows of nodes", rows->shape(0), nodes);
        }
        require_size("contact", std::size_t(contact.size()), nodes);
        chain_.begin(nodes);
        for (int i = 0; i < nodes; ++i) {
            check_contact(contact.data()[i]);
            chain_.set_node(i, contacts_, int(contact.data()[i]), view(coming)[i], view(leaving)[i]);
            if (i < int(maps.shape(0))) chain_.set_flight(i, {maps.data() + size_t(i) * size * size, size, size});
        }
    }

    LinearFlight<> flight_;
    Contacts contacts_;
    bool scaled_, modal_;
    Chain<> chain_;
    Floquet<> floquet_;
    std::optional<Pair> pair_;
    std::vector<double> scale_;
    std::vector<int> hit_;
};

}  // namespace

void bind_multipliers(nb::module_& m) {
    m.attr("FORMED_LIMIT") = FORMED_LIMIT;
    m.attr("GRADE") = GRADE;
    nb::class_<SystemChain>(m, "Chain", "Linearised orbits of one system: flights and impacts.")
        .def(nb::init<const LinearFlight<>&, const Contacts&, InMatrix, bool, bool, bool>(), nb::arg("flight"),
             nb::arg("contacts"), nb::arg("free"), nb::arg("conservative"), nb::arg("scaled"), nb::arg("given") = false)
        .def("multipliers", &SystemChain::multipliers, nb::arg("before"), nb::arg("after"), nb::arg("duration"),
             nb::arg("contact"), nb::arg("product") = true,
             "(route, values, trivial, pairing, matrix, steps) of a closed orbit.")
        .def("multipliers_of_maps", &SystemChain::multipliers_of_maps, nb::arg("maps"), nb::arg("coming"),
             nb::arg("leaving"), nb::arg("contact"), nb::arg("scale"))
        .def("half_map", &SystemChain::half_map_of_flights, nb::arg("kinds"), nb::arg("held"), nb::arg("states"),
             nb::arg("times"), nb::arg("ends"), nb::arg("contact"),
             "(phi, largest magnification of rounding) between two ends.")
        .def("half_map_of_maps", &SystemChain::half_map_of_maps, nb::arg("kinds"), nb::arg("held"), nb::arg("maps"),
             nb::arg("coming"), nb::arg("leaving"), nb::arg("contact"), nb::arg("reach"));
    m.def(
        "section_basis",
        [](InVector direction, InMatrix held) {
            require_size("the direction", direction.shape(0), held.shape(1));
            if (held.shape(0) < 1 || held.shape(0) > held.shape(1) || (held.shape(1) == 2 && held.shape(0) != 2))
                throw nb::value_error("a section is of one to all motions, and of two if there are two");
            Dense<> out(int(held.shape(0)) - 1, int(held.shape(1)));
            section_basis(view(direction), view(held), out);
            return numpy_matrix(out);
        },
        nb::arg("direction"), nb::arg("held"),
        "Orthonormal rows within those of `held`, perpendicular to a direction.");
    m.def(
        "half_map_multipliers",
        [](InMatrix phi, bool turned) {
            if (phi.shape(0) != phi.shape(1) || phi.shape(0) % 2)
                throw nb::value_error("a half map is square, of an even size");
            Spectrum<> found(int(phi.shape(0)));
            const double defect = half_map_multipliers(view(phi), turned, found);
            if (!found.is_known) throw std::runtime_error("eigenvalues did not converge");
            return nb::make_tuple(complex_vector(found.real, found.imaginary), defect);
        },
        nb::arg("phi"), nb::arg("turned"),
        "(multipliers of the map there and back, how far the half map is from a symplectic one).");
    m.def(
        "half_map_tests",
        [](InMatrix phi, bool start_keeps_velocity, bool finish_keeps_velocity, double rate, int quarters,
           bool collides, double speeds, double pivot, InVector targets) {
            if (phi.shape(0) != phi.shape(1) || phi.shape(0) % 2)
                throw nb::value_error("a half map is square, of an even size");
            NewVector out = new_vector(3 + (quarters == 1) + collides + int(targets.shape(0)));
            half_map_tests(view(phi), start_keeps_velocity, finish_keeps_velocity, rate, quarters, collides,
                           {speeds, pivot, view(targets)}, Vector<double>(out.data(), out.size()));
            return out;
        },
        nb::arg("phi"), nb::arg("start_keeps_velocity"), nb::arg("finish_keeps_velocity"), nb::arg("rate"),
        nb::arg("quarters"), nb::arg("collides"), nb::arg("speeds"), nb::arg("pivot"), nb::arg("targets"),
        "Test functions of an orbit between two ends, equation (35).");
    m.def("determinant", [](InMatrix matrix) { return determinant(own_square(matrix)); }, nb::arg("matrix"));
    m.def(
        "certain_determinant",
        [](InMatrix matrix, double noise) { return certain_determinant(own_square(matrix), noise); }, nb::arg("matrix"),
        nb::arg("noise"), "The determinant; NaN unless the smallest singular value is above the noise.");
    m.def(
        "signed_least_singular",
        [](InMatrix matrix) {
            Array<> factors = own_square(matrix);
            const double value = determinant(factors);
            return std::copysign(least_singular(factors), value);
        },
        nb::arg("matrix"),
        "Lower bound of the smallest singular value, sharp to the root of the size, with the determinant's sign.");
    m.def(
        "eigenvalues",
        [](InMatrix matrix) {
            std::vector<double> real(matrix.shape(0)), imaginary(matrix.shape(0));
            if (!eigenvalues(own_square(matrix), real.data(), imaginary.data()))
                throw std::runtime_error("eigenvalues did not converge");
            return complex_vector(real, imaginary);
        },
        nb::arg("matrix"));
    m.def(
        "eigensystem",
        [](InMatrix given) {
            const Array<> matrix = own_square(given);
            const int size = matrix.rows();
            std::vector<double> real(size), imaginary(size);
            if (!eigenvalues(Array<>(matrix), real.data(), imaginary.data()))
                throw std::runtime_error("eigenvalues did not converge");
            Array<Complex<double>> vectors(size, size, Complex<double>(0.0));
            NewVector condition = new_vector(size);
            NewMatrix real_part = new_matrix(size, size), imaginary_part = new_matrix(size, size);
            eigenvectors(matrix, real, imaginary, vectors, Vector<double>(condition.data(), size));
            for (int k = 0; k < size * size; ++k) {
                real_part.data()[k] = vectors.data()[k].real;
                imaginary_part.data()[k] = vectors.data()[k].imag;
            }
            return nb::make_tuple(complex_vector(real, imaginary), real_part, imaginary_part, condition);
        },
        nb::arg("matrix"),
        "(eigenvalues, real and imaginary parts of unit eigenvectors as columns, conditions of the eigenvalues).");
    m.def(
        "singular_values",
        [](InMatrix matrix) {
            if (matrix.shape(1) < 1) throw nb::value_error("the matrix has no columns");
            Array<> a = own(matrix);
            NewVector out = new_vector(a.rows());
            if (!singular_values(a, Vector<double>(out.data(), a.rows())))
                throw std::runtime_error("singular values did not converge");
            return out;
        },
        nb::arg("matrix"), "Singular values, not sorted, of a matrix with no more rows than columns.");
    m.def(
        "symmetric_eigenvalues",
        [](InMatrix matrix) {
            Array<> a = own_square(matrix), vectors(a.rows(), a.rows());
            if (!symmetric_eigenvalues(a, vectors))
                throw std::runtime_error(
                    ("Jacobi's method did not diagonalise a matrix of size " + std::to_string(a.rows())).c_str());
            NewVector values = new_vector(a.rows());
            for (int k = 0; k < a.rows(); ++k) values.data()[k] = a(k, k);
            NewMatrix columns = new_matrix(a.rows(), a.rows());
            for (int r = 0; r < a.rows(); ++r)
                for (int c = 0; c < a.rows(); ++c) columns.data()[r * a.rows() + c] = vectors(c, r);
            return nb::make_tuple(values, columns);
        },
        nb::arg("matrix"), "(eigenvalues, eigenvectors as columns) of a symmetric matrix, not sorted.");
    m.def(
        "product_eigenvalues",
        [](InCube factors, InIndices inverse) {
            const int count = int(factors.shape(0)), size = int(factors.shape(1));
            require_size("inverse", inverse.shape(0), count);
            require_size("columns", factors.shape(2), size);
            if (size < 1) throw nb::value_error("the factors have no entries");
            if (count == 0 || inverse.data()[count - 1] != 0) throw nb::value_error("the last factor is no inverse");
            ProductChain<> chain(size);
            chain.begin(count);
            for (int k = 0; k < count; ++k) {
                std::copy(factors.data() + size_t(k) * size * size, factors.data() + size_t(k + 1) * size * size,
                          chain.factor(k).data());
                if (inverse.data()[k]) chain.set_inverse(k);
            }
            Dense<> product(size);
            const int steps = chain.eigenvalues(product);
            return nb::make_tuple(steps, complex_vector(chain.real(), chain.imaginary()), numpy_matrix(product));
        },
        nb::arg("factors"), nb::arg("inverse"),
        "(steps, eigenvalues, the product in some frame) of a product of matrices and inverses.");
}

}  // namespace saltus
