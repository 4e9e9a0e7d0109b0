/// The Python module `saltus_core`: its functions are bound by topic.
#include "bindings.hpp"

namespace nb = nanobind;

void bind_numbers(nb::module_& m);

namespace {

/// The compiler, and the instructions beyond the least of this kind of processor that it was allowed to use.
constexpr const char* compiler =
#if defined(__clang__)
    "clang " __clang_version__
#elif defined(__GNUC__)
    "gcc " __VERSION__
#elif defined(_MSC_VER)
    "MSVC"
#endif
#if defined(__AVX2__)
    " AVX2"
#endif
#if defined(__FMA__)
    " FMA"
#endif
#if defined(__SANITIZE_ADDRESS__)
    " ASan"
#endif
    ;

}  // namespace

NB_MODULE(saltus_core, m) {
    m.doc() = "The compiled core. It holds arithmetic only.";
    m.attr("compiler") = compiler;
    nb::set_leak_warnings(false);  // what a cache keeps until the interpreter ends is no leak
    bind_numbers(m);
    saltus::bind_dense(m);
    saltus::bind_flight(m);
    saltus::bind_elimination(m);
    saltus::bind_orbit(m);
    saltus::bind_forced(m);
    saltus::bind_family(m);
    saltus::bind_events(m);
    saltus::bind_multipliers(m);
    saltus::bind_search(m);
    saltus::bind_smooth(m);
    saltus::bind_paths(m);
    saltus::bind_motion(m);
}
