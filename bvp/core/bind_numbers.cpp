// Bindings of the numbers: functions of doubles, of double-doubles and of complex numbers on arrays, and derivatives
// by jets.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/array.h>
#include <nanobind/stl/complex.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/string.h>

#include <complex>
#include <string>

#include "complex.hpp"
#include "double_double.hpp"
#include "jet.hpp"
#include "quad_double.hpp"

namespace nb = nanobind;

namespace saltus {
namespace {

template <class T>
using Values = nb::ndarray<const T, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using Table = nb::ndarray<const double, nb::ndim<2>, nb::c_contig, nb::device::cpu>;

/// A new array, and where its numbers are.
template <class T>
std::pair<nb::object, T*> new_array(std::initializer_list<size_t> shape) {
    size_t count = 1;
    for (size_t length : shape) count *= length;
    T* data = new T[count];
    nb::capsule owner(data, [](void* p) noexcept { delete[] static_cast<T*>(p); });
    return {nb::cast(nb::ndarray<nb::numpy, T>(data, shape, owner)), data};
}

void same_length(size_t a, size_t b) {
    if (a == b) return;
    std::string text = "the arrays have " + std::to_string(a) + " and " + std::to_string(b) + " numbers";
    text += ", expected as many";
    throw nb::value_error(text.c_str());
}

nb::object apply(double (*function)(double), Values<double> x) {
    auto [out, data] = new_array<double>({x.size()});
    for (size_t i = 0; i < x.size(); ++i) data[i] = function(x(i));
    return out;
}

nb::object apply(double (*function)(double, double), Values<double> x, Values<double> y) {
    same_length(x.size(), y.size());
    auto [out, data] = new_array<double>({x.size()});
    for (size_t i = 0; i < x.size(); ++i) data[i] = function(x(i), y(i));
    return out;
}

/// A wide number in column i of a table of its parts, and back.
template <class T>
T wide(Table x, size_t i) {
    if constexpr (std::same_as<T, DoubleDouble>) return {x(0, i), x(1, i)};
    else return {x(0, i), x(1, i), x(2, i), x(3, i)};
}

void put(double x, double* out, size_t) { out[0] = x; }

void put(DoubleDouble x, double* out, size_t stride) {
    out[0] = x.high;
    out[stride] = x.low;
}

void put(const QuadDouble& x, double* out, size_t stride) {
    for (int k = 0; k < 4; ++k) out[k * stride] = x.part[k];
}

/// A function of wide numbers on tables with a column of parts for each number.
template <class T, class... A>
nb::object apply(T (*function)(A...), Table x, std::same_as<Table> auto... more) {
    constexpr size_t parts = sizeof(T) / sizeof(double);
    const size_t count = x.shape(1);
    for (const Table& table : {x, more...}) {
        same_length(count, table.shape(1));
        if (table.shape(0) != parts) throw nb::value_error("expected one row for each part of the numbers");
    }
    auto [out, data] = new_array<double>({parts, count});
    for (size_t i = 0; i < count; ++i) put(function(wide<T>(x, i), wide<T>(more, i)...), data + i, count);
    return out;
}

using Number = std::complex<double>;
using C = Complex<double>;

nb::object apply(C (*function)(const C&, const C&), Values<Number> x, Values<Number> y) {
    same_length(x.size(), y.size());
    auto [out, data] = new_array<Number>({x.size()});
    for (size_t i = 0; i < x.size(); ++i) {
        const C z = function({x(i).real(), x(i).imag()}, {y(i).real(), y(i).imag()});
        data[i] = Number(z.real, z.imag);
    }
    return out;
}

template <class... Arguments, class R, class... A>
void define(nb::module_& m, const char* name, R (*function)(A...)) {
    m.def(name, [function](Arguments... x) { return apply(function, x...); });
}

/// A number with its first three derivatives in one direction.
using Second = Jet<Jet<double, 1>, 1>;
using Third = Jet<Second, 1>;

/// Value and three derivatives of a function of one variable at each x: an array (4, N).
template <class F>
nb::object derivatives(F function, Values<double> x) {
    const size_t count = x.size();
    auto [out, data] = new_array<double>({4, count});
    for (size_t i = 0; i < count; ++i) {
        const Second inner = Second::variable(Jet<double, 1>::variable(x(i), 0), 0);
        const Third y = function(Third::variable(inner, 0));
        data[i] = value(y);
        data[count + i] = value(y.slopes[0]);
        data[2 * count + i] = value(y.slopes[0].slopes[0]);
        data[3 * count + i] = y.slopes[0].slopes[0].slopes[0];
    }
    return out;
}

/// A free flight of two modes with frequencies 0.7 and 1.3 for a time x[4], and an impact: the displacements and
/// velocities after it.
template <class T>
std::array<T, 4> flight_and_impact(const std::array<T, 5>& x) {
    std::array<T, 4> z;
    for (int k = 0; k < 2; ++k) {
        const double w = k ? 1.3 : 0.7;
        T s, c;
        sincos(w * x[4], s, c);
        z[k] = c * x[k] + s / w * x[k + 2];
        z[k + 2] = c * x[k + 2] - w * s * x[k];
    }
    const T speed = 0.6 * z[2] - 0.8 * z[3];
    z[2] -= 2.0 * 0.6 * speed;
    z[3] -= -2.0 * 0.8 * speed;
    return z;
}

/// A function of two variables with all kinds of operations: of jets, of jets and numbers, with branches.
template <class T>
T mixture(const T& x, const T& y) {
    T sum = 2.0 / (x + 3.0) - (1.0 - x) * (y - 0.5) / 4.0 + power(x, -2) + pow(x, y) + pow(y, 1.5);
    sum += atan2(y, x) * hypot(x, y);
    sum -= fabs(-x) < y ? tanh(x / y) : log1p(x * y) / sqrt(y);
    sum *= 1.0 + 0.25 * cosh(x - y);
    return sum / (x > 0.0 ? exp(-x) + 1.0 : x);
}

/// Values, gradients (2, N) and second derivatives (4, N) of `mixture`, as an array (7, N).
nb::object mixed(Values<double> x, Values<double> y) {
    using First = Jet<double, 2>;
    using Both = Jet<First, 2>;
    same_length(x.size(), y.size());
    const size_t count = x.size();
    auto [out, data] = new_array<double>({7, count});
    for (size_t i = 0; i < count; ++i) {
        const First p = First::variable(x(i), 0), q = First::variable(y(i), 1);
        const Both f = mixture(Both::variable(p, 0), Both::variable(q, 1));
        data[i] = value(f);
        for (int a = 0; a < 2; ++a) {
            data[(1 + a) * count + i] = f.value.slopes[a];
            for (int b = 0; b < 2; ++b) data[(3 + 2 * a + b) * count + i] = f.slopes[a].slopes[b];
        }
    }
    return out;
}

/// The Jacobian of `flight_and_impact`, each part of its numbers apart: an array (parts, 4, 5).
template <class T>
nb::object jacobian(const std::array<double, 5>& x) {
    std::array<Jet<T, 5>, 5> variables;
    for (int i = 0; i < 5; ++i) variables[i] = Jet<T, 5>::variable(T(x[i]), i);
    const auto z = flight_and_impact(variables);
    auto [out, data] = new_array<double>({sizeof(T) / sizeof(double), 4, 5});
    for (int r = 0; r < 4; ++r) {
        for (int i = 0; i < 5; ++i) put(z[r].slopes[i], data + 5 * r + i, 20);
    }
    return out;
}

/// sqrt(z) exp(z)/(1 + z), with its derivative along the real axis: by jets in each part, and by jets of complex
/// numbers.
template <class T>
T analytic(const T& z) {
    return sqrt(z) * exp(z) / (1.0 + z);
}

std::array<Number, 3> complex_derivatives(Number z) {
    using J = Jet<double, 1>;
    const Complex<J> w = analytic(Complex<J>(J::variable(z.real(), 0), J(z.imag())));
    const Jet<C, 1> v = analytic(Jet<C, 1>::variable(C(z.real(), z.imag()), 0));
    return {Number(w.real.value, w.imag.value), Number(w.real.slopes[0], w.imag.slopes[0]),
            Number(v.slopes[0].real, v.slopes[0].imag)};
}

void bind(nb::module_& m) {
    using D = DoubleDouble;
    using Q = const QuadDouble&;
    using One = Values<double>;
    nb::module_ wide = m.def_submodule("double_double");
    nb::module_ wider = m.def_submodule("quad_double");
    nb::module_ jets = m.def_submodule("jets");
    nb::module_ complex = m.def_submodule("complex");

#define SALTUS_FUNCTION(f)                                                                     \
    define<One>(m, #f, +[](double x) { return f(x); });                                        \
    define<Table>(wide, #f, +[](D x) { return f(x); });                                        \
    define<Table>(wider, #f, +[](Q x) { return f(x); });                                       \
    jets.def(#f, [](One x) { return derivatives([](const Third& y) { return f(y); }, x); });
    SALTUS_FUNCTION(sin)
    SALTUS_FUNCTION(cos)
    SALTUS_FUNCTION(tan)
    SALTUS_FUNCTION(exp)
    SALTUS_FUNCTION(expm1)
    SALTUS_FUNCTION(log)
    SALTUS_FUNCTION(log1p)
    SALTUS_FUNCTION(sinh)
    SALTUS_FUNCTION(cosh)
    SALTUS_FUNCTION(tanh)
    SALTUS_FUNCTION(asinh)
    SALTUS_FUNCTION(atan)
    SALTUS_FUNCTION(asin)
    SALTUS_FUNCTION(acos)
    SALTUS_FUNCTION(sqrt)
#undef SALTUS_FUNCTION
#define SALTUS_FUNCTION(f)                                              \
    define<One, One>(m, #f, +[](double x, double y) { return f(x, y); }); \
    define<Table, Table>(wide, #f, +[](D x, D y) { return f(x, y); });    \
    define<Table, Table>(wider, #f, +[](Q x, Q y) { return f(x, y); });
    SALTUS_FUNCTION(pow)
    SALTUS_FUNCTION(hypot)
    SALTUS_FUNCTION(atan2)
#undef SALTUS_FUNCTION

    define<Table, Table>(wide, "add", +[](D x, D y) { return x + y; });
    define<Table, Table>(wider, "add", +[](Q x, Q y) { return x + y; });
    define<Table, Table>(wide, "multiply", +[](D x, D y) { return x * y; });
    define<Table, Table>(wider, "multiply", +[](Q x, Q y) { return x * y; });
    define<Table, Table>(wide, "divide", +[](D x, D y) { return x / y; });
    define<Table, Table>(wider, "divide", +[](Q x, Q y) { return x / y; });
    define<Values<Number>, Values<Number>>(complex, "multiply", +[](const C& x, const C& y) { return x * y; });
    define<Values<Number>, Values<Number>>(complex, "divide", +[](const C& x, const C& y) { return x / y; });
    jets.def("pow", [](One x, double exponent) {
        return derivatives([exponent](const Third& y) { return pow(y, exponent); }, x);
    });
    jets.def("mixture", mixed);
    jets.def("jacobian", jacobian<double>);
    jets.def("jacobian_in_double_double", jacobian<D>);
    jets.def("jacobian_in_quad_double", jacobian<QuadDouble>);
    complex.def("derivatives", complex_derivatives);
    complex.def("sqrt", [](Number x) {
        const C root = sqrt(C(x.real(), x.imag()));
        return Number(root.real, root.imag);
    });
}

}  // namespace
}  // namespace saltus

void bind_numbers(nb::module_& m);

void bind_numbers(nb::module_& m) { saltus::bind(m); }
