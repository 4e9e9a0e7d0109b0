/// Programs as Python gives them.
#pragma once

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

}  // namespace saltus
