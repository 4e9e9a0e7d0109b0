/// Arrays of the core: views of vectors and matrices, and local arrays that need no allocation while they are small.
#pragma once

#include <cassert>
#include <memory>
#include <span>
#include <type_traits>
#include <vector>

namespace saltus {

/// A size that is known when the program runs.
inline constexpr int DYNAMIC = -1;

template <class T>
using Vector = std::span<T>;  // a view
using Values = std::span<const double>;

/// A view of a matrix, row after row without gaps.
template <class T>
class Matrix {
public:
    Matrix() = default;
    Matrix(T* data, int rows, int columns) : data_(data), rows_(rows), columns_(columns) {}
    template <class U>
        requires std::is_same_v<const U, T>
    Matrix(const Matrix<U>& other) : data_(other.data()), rows_(other.rows()), columns_(other.columns()) {}

    T& operator()(int r, int c) const { return data_[static_cast<std::ptrdiff_t>(r) * columns_ + c]; }
    Vector<T> operator[](int r) const { return {data_ + static_cast<std::ptrdiff_t>(r) * columns_, size_t(columns_)}; }
    T* data() const { return data_; }
    int rows() const { return rows_; }
    int columns() const { return columns_; }
    /// The first rows and columns of each, as a matrix of rows `count` long that follow each other.
    Matrix rows(int first, int count) const { return {data_ + static_cast<std::ptrdiff_t>(first) * columns_, count, columns_}; }

private:
    T* data_ = nullptr;
    int rows_ = 0, columns_ = 0;
};

/// A matrix that owns its entries.
template <class T = double>
class Array {
public:
    Array() = default;
    Array(int rows, int columns, T value = T(0.0))
        : data_(static_cast<size_t>(rows) * columns, value), rows_(rows), columns_(columns) {}
    operator Matrix<T>() { return {data_.data(), rows_, columns_}; }
    operator Matrix<const T>() const { return {data_.data(), rows_, columns_}; }
    T& operator()(int r, int c) { return data_[static_cast<size_t>(r) * columns_ + c]; }
    const T& operator()(int r, int c) const { return data_[static_cast<size_t>(r) * columns_ + c]; }
    Vector<T> operator[](int r) { return {data_.data() + static_cast<size_t>(r) * columns_, size_t(columns_)}; }
    Vector<const T> operator[](int r) const { return {data_.data() + static_cast<size_t>(r) * columns_, size_t(columns_)}; }
    int rows() const { return rows_; }
    int columns() const { return columns_; }
    T* data() { return data_.data(); }
    const T* data() const { return data_.data(); }

private:
    std::vector<T> data_;
    int rows_ = 0, columns_ = 0;
};

/// Scratch for a vector of N entries inside a function; its entries are not set. N may be DYNAMIC: up to LIMIT entries need no allocation.
template <class T, int N = DYNAMIC, int LIMIT = 32>
class Local {
public:
    explicit Local(int size = N) : size_(size) {
        if constexpr (N == DYNAMIC)
            if (size > LIMIT) heap_.reset(new T[size]);
    }
    Local(const Local&) = delete;
    Local& operator=(const Local&) = delete;
    constexpr int size() const {
        if constexpr (N != DYNAMIC) return N;
        return size_;
    }
    T* data() { return N == DYNAMIC && heap_ ? heap_.get() : buffer_; }
    const T* data() const { return N == DYNAMIC && heap_ ? heap_.get() : buffer_; }
    T& operator[](int r) { return data()[r]; }
    const T& operator[](int r) const { return data()[r]; }
    T* begin() { return data(); }
    T* end() { return data() + size(); }
    operator Vector<T>() { return {data(), size_t(size())}; }
    operator Vector<const T>() const { return {data(), size_t(size())}; }

private:
    T buffer_[N == DYNAMIC ? LIMIT : N];
    std::unique_ptr<T[]> heap_;
    int size_;
};

/// The same for a square matrix of N rows.
template <class T, int N = DYNAMIC, int LIMIT = 12>
class LocalSquare {
public:
    explicit LocalSquare(int size = N)
        : entries_(N == DYNAMIC ? size * size : N * N), size_(size) {}
    int size() const { return size_; }
    T& operator()(int r, int c) { return entries_[r * size_ + c]; }
    const T& operator()(int r, int c) const { return entries_[r * size_ + c]; }
    operator Matrix<T>() { return {entries_.data(), size_, size_}; }
    operator Matrix<const T>() { return {entries_.data(), size_, size_}; }
    Vector<T> operator[](int r) { return {entries_.data() + r * size_, size_t(size_)}; }

private:
    Local<T, N == DYNAMIC ? DYNAMIC : N * N, LIMIT * LIMIT> entries_;
    int size_;
};

template <class A, class B>
void copy(const A& from, B&& to) {
    const int size = int(to.size());
    for (int r = 0; r < size; ++r) to[r] = from[r];
}

inline Array<> copy_of(Matrix<const double> matrix) {
    Array<> out(matrix.rows(), matrix.columns());
    std::copy(matrix.data(), matrix.data() + size_t(matrix.rows()) * matrix.columns(), out.data());
    return out;
}

/// a . b, in the order of the entries.
template <class A, class B>
auto dot(const A& a, const B& b) {
    auto total = a[0] * b[0];
    const int size = int(b.size());
    for (int r = 1; r < size; ++r) total += a[r] * b[r];
    return total;
}

/// out = matrix x.
template <class M, class X, class O>
void multiply(const M& matrix, const X& x, O&& out) {
    for (int r = 0; r < int(out.size()); ++r) out[r] = dot(matrix[r], x);
}

}  // namespace saltus
