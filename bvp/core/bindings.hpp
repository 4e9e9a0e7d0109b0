/// What the bindings of all topics share: arrays of numpy as views, with their sizes checked once.
#pragma once

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include "array.hpp"

namespace saltus {

namespace nb = nanobind;

using InVector = nb::ndarray<const double, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using InMatrix = nb::ndarray<const double, nb::ndim<2>, nb::c_contig, nb::device::cpu>;
using InIndices = nb::ndarray<const int64_t, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using InPairs = nb::ndarray<const int64_t, nb::ndim<2>, nb::c_contig, nb::device::cpu>;
using OutVector = nb::ndarray<double, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using OutMatrix = nb::ndarray<double, nb::ndim<2>, nb::c_contig, nb::device::cpu>;
using OutCube = nb::ndarray<double, nb::ndim<3>, nb::c_contig, nb::device::cpu>;
using NewVector = nb::ndarray<nb::numpy, double, nb::ndim<1>>;
using NewMatrix = nb::ndarray<nb::numpy, double, nb::ndim<2>>;

inline Values view(const InVector& a) { return {a.data(), a.shape(0)}; }
inline Matrix<const double> view(const InMatrix& a) { return {a.data(), int(a.shape(0)), int(a.shape(1))}; }
inline Vector<double> view(OutVector& a) { return {a.data(), a.shape(0)}; }
inline Matrix<double> view(OutMatrix& a) { return {a.data(), int(a.shape(0)), int(a.shape(1))}; }
inline std::vector<double> own(const InVector& a) { return {a.data(), a.data() + a.shape(0)}; }
inline Array<> own(const InMatrix& a) {
    Array<> out(int(a.shape(0)), int(a.shape(1)));
    std::copy(a.data(), a.data() + a.size(), out.data());
    return out;
}

/// A new array of numpy.
inline NewVector new_vector(int size) {
    double* data = new double[size > 0 ? size : 1];
    return NewVector(data, {size_t(size)}, nb::capsule(data, [](void* p) noexcept { delete[] static_cast<double*>(p); }));
}
inline NewMatrix new_matrix(int rows, int columns) {
    double* data = new double[rows * columns > 0 ? rows * columns : 1];
    nb::capsule owner(data, [](void* p) noexcept { delete[] static_cast<double*>(p); });
    return NewMatrix(data, {size_t(rows), size_t(columns)}, owner);
}
inline NewVector numpy_of(Values values) {
    NewVector out = new_vector(int(values.size()));
    std::copy(values.begin(), values.end(), out.data());
    return out;
}

/// Refuse an array of another size than expected, with both in the message.
inline void require_size(const char* name, size_t size, size_t expected) {
    if (size != expected)
        throw nb::value_error(("received " + std::to_string(size) + " entries of " + name + "; expected " + std::to_string(expected)).c_str());
}

void bind_flight(nb::module_& m);
void bind_elimination(nb::module_& m);
void bind_orbit(nb::module_& m);
void bind_family(nb::module_& m);
void bind_events(nb::module_& m);
void bind_multipliers(nb::module_& m);
void bind_search(nb::module_& m);
void bind_motion(nb::module_& m);

}  // namespace saltus
