/// Programs as Python gives them.
#pragma once

#include <algorithm>

#include "bindings.hpp"
#include "program.hpp"

namespace saltus {

/// An index that Python gives, checked.
inline int index(int64_t i, int count, const char* what) {
    if (i < 0 || i >= count)
        throw nb::value_error((std::string("a program has no ") + what + " " + std::to_string(i)).c_str());
    return int(i);
}

/// The arrays of `bvp.kernels.expressions.Program`.
inline Formulas formulas(int parameters, InPairs code, InVector constants, InIndices outputs) {
    using Code = Formulas::Code;
    require_size("an operation", code.shape(1), 3);
    Formulas out;
    out.parameters = parameters;
    out.constants = own(constants);
    const int first = parameters + int(constants.shape(0)), registers = first + int(code.shape(0));
    for (size_t i = 0; i < code.shape(0); ++i) {
        const int64_t* entry = code.data() + 3 * i;
        const Code operation = Code(index(entry[0], Code::SIGN + 1, "operation"));
        const int known = first + int(i);
        const bool has_two = operation < Code::INTEGER_POWER;
        const int second = has_two ? index(entry[2], known, "register") : int(entry[2]);  // an exponent, or of no use
        out.operations.push_back({operation, index(entry[1], known, "register"), second});
    }
    for (size_t k = 0; k < outputs.shape(0); ++k) out.outputs.push_back(index(outputs.data()[k], registers, "register"));
    return out;
}

/// The arrays of `bvp.kernels.jets.JetProgram`.
inline ForceProgram force_program(int inputs, InPairs code, InVector numbers, InIndices forces, InPairs slopes, int registers) {
    using Code = ForceProgram::Code;
    require_size("an operation", code.shape(1), 4);
    require_size("a derivative", slopes.shape(1), 3);
    ForceProgram out;
    out.inputs = inputs, out.registers = registers;
    out.numbers = own(numbers);
    for (size_t i = 0; i < code.shape(0); ++i) {
        const int64_t* entry = code.data() + 4 * i;
        const Code operation = Code(index(entry[0], Code::SINH + 1, "operation"));
        const bool by_number = operation >= Code::SCALE && operation <= Code::EVEN_POWER;
        const bool writes_two = operation == Code::SIN || operation == Code::SINH;
        const int second = by_number ? index(entry[3], int(out.numbers.size()), "number") : index(entry[3], registers, "register");
        out.operations.push_back({operation, index(entry[1], registers - writes_two, "register"),
                                  index(entry[2], registers, "register"), second});
    }
    for (size_t f = 0; f < forces.shape(0); ++f) out.forces.push_back(index(forces.data()[f], registers, "register"));
    for (size_t d = 0; d < slopes.shape(0); ++d) {
        const int64_t* entry = slopes.data() + 3 * d;
        out.slopes.push_back({index(entry[0], int(out.forces.size()), "force"), index(entry[1], inputs, "input"),
                              index(entry[2], registers, "register")});
    }
    std::stable_sort(out.slopes.begin(), out.slopes.end(), [](const auto& a, const auto& b) { return a.input < b.input; });
    return out;
}

/// Refuse numbers of kept flights, and of steps, that would take all memory.
inline void require_flights(int keep, int most_steps) {
    if (keep < 1 || keep > 100'000) throw nb::value_error("from 1 to 100000 flights are kept");
    if (most_steps < 1 || most_steps > 1'000'000) throw nb::value_error("a flight has from 1 to a million steps");
}

inline void require_registers(int registers, int inputs) {
    if (registers < inputs || registers > 1'000'000)
        throw nb::value_error("a program has a register for each input, and a million at most");
}

}  // namespace saltus
