/// Expressions as lists of operations: the series of smooth forces along a motion, and values of a potential.
///
/// Python writes the lists (`bvp.jet_programs`, `bvp.programs`). They are evaluated in any number type.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

#include "array.hpp"
#include "functions.hpp"
#include "jet.hpp"

namespace saltus {

/// Taylor coefficients in time of F forces, and of their derivatives by the I inputs w.
///
/// Each register is a row of coefficients. The first I registers are those of the inputs. Each operation adds the
/// coefficient of order k of its result, from those of its operands up to the order k and of its own up to the order
/// k - 1 (Jorba & Zou, Experimental Mathematics 14 (2005) 99, section 2).
class ForceProgram {
public:
    /// On registers: a + b, a - b, a b, a/b, a^2; on a register and a number: s a, a + s, a^s, |a|^s sign a, |a|^s;
    /// functions of a register. SIN and SINH write the cosine, or the hyperbolic cosine, to the register behind theirs.
    enum Code { ADD, SUBTRACT, MULTIPLY, DIVIDE, SQUARE, SCALE, SHIFT, POWER, SIGNED_POWER, EVEN_POWER, EXP, LOG, SIN, SINH };

    struct Operation {
        Code code;
        int result, first, second;  // registers; second: of a number where the operation has one
    };
    /// A force, an input, and the register of the derivative of one by the other, where that is not zero.
    struct Slope {
        int force, input, result;
    };

    std::vector<Operation> operations;
    std::vector<double> numbers;
    std::vector<int> forces;    // (F,) the register of each force
    std::vector<Slope> slopes;  // in order of the inputs
    int inputs = 0, registers = 0;

    /// Add the coefficients of order k to `series` (registers, > k); those of the inputs are there.
    ///
    /// A power of |a| is zero where a is 0, or where it is not above `least` in size: there it has no expansion. numbers: in
    /// place of the program's.
    template <class T, class C>
    void extend(Matrix<T> series, int k, double least, const std::vector<C>& numbers) const {
        for (const Operation& operation : operations) {
            T* c = series[operation.result].data();
            const T* a = series[operation.first].data();
            switch (operation.code) {
            case ADD: c[k] = a[k] + series(operation.second, k); break;
            case SUBTRACT: c[k] = a[k] - series(operation.second, k); break;
            case MULTIPLY: {
                const T* b = series[operation.second].data();
                if (k == 0) c[0] = a[0] * b[0];
                else c[k] = middle(a, b, k, k - 1) + (a[0] * b[k] + a[k] * b[0]);
                break;
            }
            case SQUARE:
                if (k == 0) {
                    c[0] = a[0] * a[0];
                } else {
                    T total = 2.0 * middle(a, a, k, (k - 1) / 2);
                    if (k % 2 == 0) total += a[k / 2] * a[k / 2];
                    c[k] = total + 2.0 * a[0] * a[k];
                }
                break;
            case DIVIDE: {
                const T* b = series[operation.second].data();
                if (k == 0) c[0] = a[0] / b[0];
                else c[k] = (a[k] - middle(b, c, k, k - 1) - b[k] * c[0]) / b[0];
                break;
            }
            case SCALE: c[k] = numbers[operation.second] * a[k]; break;
            case SHIFT: c[k] = k == 0 ? a[0] + numbers[operation.second] : a[k]; break;
            case POWER:
            case SIGNED_POWER:
            case EVEN_POWER: raise(operation.code, numbers[operation.second], a, c, k, least); break;
            case EXP: c[k] = k == 0 ? T(exp(a[0])) : weighted(a, c, k) / double(k); break;
            case LOG: c[k] = k == 0 ? T(log(a[0])) : logarithm(a, c, k); break;
            case SIN:
            case SINH: turn(operation.code, a, c, series[operation.result + 1].data(), k); break;
            }
        }
    }

    /// The largest power of an argument that passes 0 within a time `room`; 0 where none does.
    template <class T>
    double nearly_zero(Matrix<T> series, double room) const {
        double largest = 0.0;
        for (const Operation& operation : operations)
            if (is_modulus(operation.code) &&
                std::fabs(value(series(operation.first, 0))) <= room * std::fabs(value(series(operation.first, 1))))
                largest = std::max(largest, std::fabs(value(series(operation.result, 0))));
        return largest;
    }

    /// Whether a power of |a| is zero where a only passes 0: there it has no expansion.
    template <class T>
    bool is_left_out(Matrix<T> series) const {
        for (const Operation& operation : operations)
            if (is_modulus(operation.code) && value(series(operation.result, 0)) == 0.0 &&
                (value(series(operation.first, 0)) != 0.0 || value(series(operation.first, 1)) != 0.0))
                return true;
        return false;
    }

    /// Whether a force that has no derivatives of so high an order at 0 has passed it. sides: of the arguments of its powers
    /// before, and now. Forces have the factor a beside |a|^s.
    template <class T, class C>
    bool is_rough(Matrix<T> series, const std::vector<C>& numbers, int order, std::vector<double>& sides) const {
        bool rough = false;
        sides.resize(operations.size(), 0.0);
        for (size_t k = 0; k < operations.size(); ++k) {
            const Operation& operation = operations[k];
            if (!is_modulus(operation.code)) continue;
            const double now = value(series(operation.first, 0)), s = value(numbers[operation.second]);
            rough = rough || (now * sides[k] < 0.0 && s + 1.0 < order &&
                              std::fabs(std::remainder(s, 2.0)) != (operation.code == EVEN_POWER ? 0.0 : 1.0));
            sides[k] = now;
        }
        return rough;
    }

private:
    static bool is_modulus(Code code) { return code == SIGNED_POWER || code == EVEN_POWER; }

    /// Sum of a[j] b[k - j] for j = 1 .. last, as two sums that do not wait for each other.
    template <class T>
    static T middle(const T* a, const T* b, int k, int last) {
        T even(0.0), odd(0.0);
        int j = 1;
        for (; j < last; j += 2) {
            even += a[j] * b[k - j];
            odd += a[j + 1] * b[k - j - 1];
        }
        if (j == last) even += a[j] * b[k - j];
        return even + odd;
    }

    /// Sum of j a[j] b[k - j] for j = 1 .. k.
    template <class T>
    static T weighted(const T* a, const T* b, int k) {
        T total(0.0);
        for (int j = 1; j < k; ++j) total += double(j) * a[j] * b[k - j];
        return total + double(k) * a[k] * b[0];
    }

    template <class T, class C>
    static void raise(Code code, const C& s, const T* a, T* c, int k, double least) {
        if (k > 0) {
            if (value(c[0]) == 0.0) {
                c[k] = T(0.0);
                return;
            }
            // From a c' = s a' c.
            T total(0.0);
            for (int j = 1; j < k; ++j) total += (s * double(j) - double(k - j)) * a[j] * c[k - j];
            c[k] = (total + s * double(k) * a[k] * c[0]) / (double(k) * a[0]);
        } else if (code == POWER) {
            c[0] = pow(a[0], s);
        } else if (value(a[0]) == 0.0) {
            c[0] = T(0.0);
        } else {
            c[0] = pow(fabs(a[0]), s);
            if (value(c[0]) <= least) c[0] = T(0.0);
            else if (code == SIGNED_POWER && value(a[0]) < 0.0) c[0] = -c[0];
        }
    }

    template <class T>
    static T logarithm(const T* a, const T* c, int k) {
        T total(0.0);
        for (int j = 1; j < k; ++j) total += double(j) * c[j] * a[k - j];
        return (a[k] - total / double(k)) / a[0];
    }

    template <class T>
    static void turn(Code code, const T* a, T* sine, T* cosine, int k) {
        if (k == 0) {
            if (code == SIN) sincos(a[0], sine[0], cosine[0]);
            else sinhcosh(a[0], sine[0], cosine[0]);
            return;
        }
        const T turned = weighted(a, sine, k) / double(k);
        sine[k] = weighted(a, cosine, k) / double(k);
        cosine[k] = code == SIN ? -turned : turned;
    }
};

/// Values of expressions of N parameters. The registers are the N parameters, the constants, then the result of each
/// operation.
class Formulas {
public:
    /// Of two operands; the second one of INTEGER_POWER is the exponent itself. Then functions of one operand, of which
    /// SIGN is the derivative of ABS: 0 at 0.
    enum Code { ADD, SUBTRACT, MULTIPLY, DIVIDE, POWER, INTEGER_POWER, SQRT, EXP, LOG, SIN, COS, TAN, SINH, COSH, TANH, ABS, SIGN };

    struct Operation {
        Code code;
        int first, second;
    };

    std::vector<Operation> operations;
    std::vector<double> constants;
    std::vector<int> outputs;  // the register of each expression
    int parameters = 0;

    /// Call take(k, value) for each expression k at values of the parameters.
    template <class T, class At, class Take>
    void evaluate(const At& at, Take&& take) const {
        if (outputs.empty()) return;
        const int first = parameters + int(constants.size());
        Local<T, DYNAMIC, 64> registers(first + int(operations.size()));
        for (int i = 0; i < parameters; ++i) registers[i] = at[i];
        for (size_t i = 0; i < constants.size(); ++i) registers[parameters + int(i)] = T(constants[i]);
        for (size_t i = 0; i < operations.size(); ++i) {
            const Operation& operation = operations[i];
            const T& x = registers[operation.first];
            T& result = registers[first + int(i)];
            if (operation.code == INTEGER_POWER) result = power(x, operation.second);
            else if (operation.code > INTEGER_POWER) result = apply(operation.code, x);
            else if (operation.code < POWER) result = combine(operation.code, x, registers[operation.second]);
            else if (is_constant(operation.second)) result = pow(x, value(registers[operation.second]));
            else result = pow(x, registers[operation.second]);
        }
        for (size_t k = 0; k < outputs.size(); ++k) take(int(k), registers[outputs[k]]);
    }

private:
    bool is_constant(int place) const { return place >= parameters && place < parameters + int(constants.size()); }

    template <class T>
    static T combine(Code code, const T& x, const T& y) {
        switch (code) {
        case ADD: return x + y;
        case SUBTRACT: return x - y;
        case MULTIPLY: return x * y;
        default: return x / y;
        }
    }

    template <class T>
    static T apply(Code code, const T& x) {
        switch (code) {
        case SQRT: return sqrt(x);
        case EXP: return exp(x);
        case LOG: return log(x);
        case SIN: return sin(x);
        case COS: return cos(x);
        case TAN: return tan(x);
        case SINH: return sinh(x);
        case COSH: return cosh(x);
        case TANH: return tanh(x);
        case ABS: return fabs(x);
        default: return T(value(x) > 0.0 ? 1.0 : value(x) < 0.0 ? -1.0 : value(x));
        }
    }
};

}  // namespace saltus
