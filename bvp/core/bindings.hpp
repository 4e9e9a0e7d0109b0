/// What the bindings of all topics share: arrays of numpy as views, with their sizes checked once.
#pragma once

#include <atomic>

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

/// An array that is filled. One of another type or order is refused: results in a copy of it would be lost.
template <class T, int D>
struct Out : nb::ndarray<T, nb::ndim<D>, nb::c_contig, nb::device::cpu> {
    using Array = nb::ndarray<T, nb::ndim<D>, nb::c_contig, nb::device::cpu>;
    Out() = default;
    Out(const Array& array) : Array(array) {}
};
using OutVector = Out<double, 1>;
using OutMatrix = Out<double, 2>;
using OutCube = Out<double, 3>;
using OutIndices = Out<int64_t, 2>;
using NewVector = nb::ndarray<nb::numpy, double, nb::ndim<1>>;
using NewMatrix = nb::ndarray<nb::numpy, double, nb::ndim<2>>;
using NewCube = nb::ndarray<nb::numpy, double, nb::ndim<3>>;

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
    const size_t size = size_t(rows) * size_t(columns);
    double* data = new double[size > 0 ? size : 1];
    nb::capsule owner(data, [](void* p) noexcept { delete[] static_cast<double*>(p); });
    return NewMatrix(data, {size_t(rows), size_t(columns)}, owner);
}
inline NewCube new_cube(Values values, int layers, int rows, int columns) {
    double* data = new double[values.size() > 0 ? values.size() : 1];
    std::copy(values.begin(), values.end(), data);
    nb::capsule owner(data, [](void* p) noexcept { delete[] static_cast<double*>(p); });
    return NewCube(data, {size_t(layers), size_t(rows), size_t(columns)}, owner);
}
inline NewVector numpy_of(Values values) {
    NewVector out = new_vector(int(values.size()));
    std::copy(values.begin(), values.end(), out.data());
    return out;
}

template <class M>
NewMatrix numpy_matrix(const M& matrix) {
    NewMatrix out = new_matrix(matrix.rows(), matrix.columns());
    for (int r = 0; r < matrix.rows(); ++r)
        for (int c = 0; c < matrix.columns(); ++c) out.data()[r * matrix.columns() + c] = matrix(r, c);
    return out;
}

/// Refuse an array of another size than expected, with both in the message.
inline void require_size(const char* name, size_t size, size_t expected) {
    if (size != expected)
        throw nb::value_error(("received " + std::to_string(size) + " entries of " + name + "; expected " + std::to_string(expected)).c_str());
}

/// Refuse a matrix that is not square.
inline void require_square(const InMatrix& matrix) {
    if (matrix.shape(0) != matrix.shape(1)) throw nb::value_error("the matrix is not square");
}
inline Array<> own_square(const InMatrix& matrix) {
    require_square(matrix);
    return own(matrix);
}

/// Refuse a number outside 0 .. count - 1.
inline void require_index(const char* name, int64_t index, int64_t count) {
    if (index < 0 || index >= count)
        throw nb::value_error(("received " + std::to_string(index) + " as " + name + "; expected one of " + std::to_string(count) +
                               ", counted from 0").c_str());
}

/// An object with work space of its own, for Python: a thread that calls it while another one computes with it without
/// the interpreter's lock is refused.
template <class T>
class Exclusive : public T {
public:
    using T::T;

    /// Call use() alone.
    template <class Use>
    auto alone(Use&& use) {
        if (busy_.test_and_set()) throw std::runtime_error("another thread is at work with this search");
        struct Leave {
            std::atomic_flag& busy;
            ~Leave() { busy.clear(); }
        } leave{busy_};
        return use();
    }

private:
    std::atomic_flag busy_ = ATOMIC_FLAG_INIT;
};

void bind_flight(nb::module_& m);
void bind_dense(nb::module_& m);
void bind_elimination(nb::module_& m);
void bind_orbit(nb::module_& m);
void bind_forced(nb::module_& m);
void bind_family(nb::module_& m);
void bind_events(nb::module_& m);
void bind_multipliers(nb::module_& m);
void bind_search(nb::module_& m);
void bind_smooth(nb::module_& m);
void bind_paths(nb::module_& m);
void bind_motion(nb::module_& m);

}  // namespace saltus

namespace nanobind::detail {

template <class T, int D>
struct type_caster<saltus::Out<T, D>> {
    using Base = make_caster<typename saltus::Out<T, D>::Array>;
    using Type = saltus::Out<T, D>;
    NB_TYPE_CASTER(Type, Base::Name)

    bool from_python(handle source, uint32_t flags, cleanup_list* cleanup) noexcept {
        Base base;
        if (!base.from_python(source, flags & ~uint32_t(cast_flags::convert), cleanup)) return false;
        value = Type(base.value);
        return true;
    }
};

}  // namespace nanobind::detail
