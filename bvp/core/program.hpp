/// Expressions of parameters as lists of operations, in any number type. Python's `bvp.programs` writes them.
#pragma once

#include <vector>

#include "array.hpp"
#include "jet.hpp"

namespace saltus {

/// Operations, in the order of Python's list. The second operand of INTEGER_POWER is an integer itself, those up to
/// POWER have two registers, the others one.
enum class Operation {
    ADD, SUBTRACT, MULTIPLY, DIVIDE, POWER, INTEGER_POWER, SQRT, EXP, LOG, SIN, COS, TAN, SINH, COSH, TANH, ABS, SIGN
};

/// Expressions of N parameters. The registers hold these, then the constants, then the result of each operation.
class Program {
public:
    struct Step {
        Operation operation;
        int first, second;
    };

    Program() = default;
    Program(std::vector<Step> steps, std::vector<double> constants, std::vector<int> outputs)
        : steps_(std::move(steps)), constants_(std::move(constants)), outputs_(std::move(outputs)) {}

    int outputs() const { return int(outputs_.size()); }

    /// Call take(k, value) for each expression k at values of the parameters (N,).
    template <class T, class Take>
    void run(Vector<const T> parameters, Take&& take) const {
        if (outputs_.empty()) return;
        const int count = int(parameters.size()), first = count + int(constants_.size());
        Local<T, DYNAMIC, 64> registers(first + int(steps_.size()));
        copy(parameters, Vector<T>(registers.data(), count));
        for (int i = count; i < first; ++i) registers[i] = T(constants_[i - count]);
        for (int i = 0; i < int(steps_.size()); ++i) {
            const Step& step = steps_[i];
            const T& x = registers[step.first];
            const bool constant = step.second >= count && step.second < first;
            registers[first + i] = step.operation == Operation::INTEGER_POWER ? power(x, step.second)
                : step.operation <= Operation::POWER ? of_two(step.operation, x, registers[step.second], constant)
                                                     : of_one(step.operation, x);
        }
        for (int k = 0; k < outputs(); ++k) take(k, registers[outputs_[k]]);
    }

private:
    template <class T>
    static T of_two(Operation operation, const T& x, const T& y, bool constant) {
        switch (operation) {
            case Operation::ADD: return x + y;
            case Operation::SUBTRACT: return x - y;
            case Operation::MULTIPLY: return x * y;
            case Operation::DIVIDE: return x / y;
            // The logarithm of the base, for the derivative by the exponent, need not exist.
            default: return constant ? pow(x, value(y)) : pow(x, y);
        }
    }

    template <class T>
    static T of_one(Operation operation, const T& x) {
        switch (operation) {
            case Operation::SQRT: return sqrt(x);
            case Operation::EXP: return exp(x);
            case Operation::LOG: return log(x);
            case Operation::SIN: return sin(x);
            case Operation::COS: return cos(x);
            case Operation::TAN: return tan(x);
            case Operation::SINH: return sinh(x);
            case Operation::COSH: return cosh(x);
            case Operation::TANH: return tanh(x);
            case Operation::ABS: return fabs(x);
            default: return T(value(x) > 0.0 ? 1.0 : value(x) < 0.0 ? -1.0 : 0.0);
        }
    }

    std::vector<Step> steps_;
    std::vector<double> constants_;
    std::vector<int> outputs_;
};

}  // namespace saltus
