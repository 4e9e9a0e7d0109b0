// Times of the elementary functions of the core and of the system's library, in the same run: name, low, high, and
// four times in ns. The first two are of independent calls, the last two of calls that wait for the one before. Then
// flights with derivatives by jets.
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <vector>

#include "jet.hpp"

namespace saltus {
namespace {

constexpr int count = 2000;
int repeats = 15;
volatile double sink;

/// The least time of a call of `loop` over several, divided by `calls`, in nanoseconds.
template <class Loop>
double nanoseconds(Loop loop, int calls) {
    double best = infinity;
    for (int r = 0; r < repeats; ++r) {
        const auto start = std::chrono::steady_clock::now();
        sink = loop();
        const std::chrono::duration<double, std::nano> passed = std::chrono::steady_clock::now() - start;
        best = passed.count() < best ? passed.count() : best;
    }
    return best / calls;
}

template <class Function>
void measure(const std::vector<double>& x, Function function) {
    for (const double feedback : {0.0, 1e-300}) {
        std::printf(" %.1f", nanoseconds([&] {
            double sum = 0.0;
            for (double v : x) sum = feedback == 0.0 ? sum + function(v) : function(v + feedback * sum);
            return sum;
        }, count));
    }
}

template <class Own, class System>
void compare(const char* name, double low, double high, Own own, System system) {
    std::vector<double> x(count);
    unsigned long long state = 1;
    for (double& v : x) {
        state = state * 6364136223846793005ull + 1442695040888963407ull;
        v = low + (high - low) * (static_cast<double>(state >> 11) * 0x1p-53);
    }
    std::printf("%s %g %g", name, low, high);
    measure(x, own);
    measure(x, system);
    std::printf("\n");
}

double last(double x) { return x; }
template <class T, int N>
double last(const Jet<T, N>& x) {
    return last(x.slopes[N - 1]);
}

/// A free flight of n modes and an impact, for any type of number: equations (2) and (4) of docs/theory.md.
template <int n, class T>
void flight(const char* name, T (*variable)(double, int)) {
    constexpr int calls = 20000;
    const double time = nanoseconds([&] {
        double sum = 0.0;
        for (int i = 0; i < calls; ++i) {
            std::array<T, 2 * n> z;
            for (int r = 0; r < 2 * n; ++r) z[r] = variable(0.3 + 0.01 * r + 1e-9 * i, r);
            const T t = variable(1.3 + 1e-9 * i, 2 * n);
            T speed(0.0);
            for (int k = 0; k < n; ++k) {
                const double w = 0.7 + 0.45 * k;
                T s, c;
                sincos(w * t, s, c);
                const T place = c * z[k] + 1.0 / w * (s * z[n + k]);
                z[n + k] = c * z[n + k] - w * (s * z[k]);
                z[k] = place;
                speed += 1.0 / (1.0 + k) * z[n + k];
            }
            for (int k = 0; k < n; ++k) z[n + k] -= 0.5 / (1.0 + k) * speed;
            for (const T& x : z) sum += last(x);
        }
        return sum;
    }, calls);
    std::printf("flight %d %s %.0f\n", n, name, time);
}

template <int N>
Jet<double, N> first(double x, int r) {
    return Jet<double, N>::variable(x, r);
}

template <int N>
Jet<Jet<double, 1>, N> second(double x, int r) {
    return Jet<Jet<double, 1>, N>::variable(Jet<double, 1>::variable(x, 0), r);
}

template <int n>
void flights() {
    flight<n, double>("values", [](double x, int) { return x; });
    flight<n, Jet<double, 2 * n + 1>>("jacobian", first<2 * n + 1>);
    flight<n, Jet<Jet<double, 1>, 2 * n + 1>>("second", second<2 * n + 1>);
}

void run() {
    const auto both = [](double x) {
        double s, c;
        sincos(x, s, c);
        return s + c;
    };
    const auto pair = [](double x) { return std::sin(x) + std::cos(x); };
    compare("sincos", -5.0, 5.0, both, pair);
    compare("sincos", -1e5, 1e5, both, pair);
    compare("sincos", 1e10, 1e300, both, pair);
#define SALTUS_COMPARE(f, low, high) \
    compare(#f, low, high, [](double x) { return saltus::f(x); }, [](double x) { return std::f(x); });
    SALTUS_COMPARE(tan, -5.0, 5.0)
    SALTUS_COMPARE(exp, -5.0, 5.0)
    SALTUS_COMPARE(expm1, -5.0, 5.0)
    SALTUS_COMPARE(log, 0.01, 100.0)
    SALTUS_COMPARE(log1p, -0.9, 5.0)
    SALTUS_COMPARE(sinh, -5.0, 5.0)
    SALTUS_COMPARE(cosh, -5.0, 5.0)
    SALTUS_COMPARE(tanh, -5.0, 5.0)
    SALTUS_COMPARE(asinh, -5.0, 5.0)
    SALTUS_COMPARE(atan, -5.0, 5.0)
    SALTUS_COMPARE(asin, -1.0, 1.0)
#define SALTUS_COMPARE_TWO(f, low, high) \
    compare(#f, low, high, [](double x) { return saltus::f(x, 1.3); }, [](double x) { return std::f(x, 1.3); });
    SALTUS_COMPARE_TWO(pow, 0.01, 100.0)
    SALTUS_COMPARE_TWO(hypot, -5.0, 5.0)
    SALTUS_COMPARE_TWO(atan2, -5.0, 5.0)
    flights<2>();
    flights<3>();
    flights<5>();
    flights<12>();
}

}  // namespace
}  // namespace saltus

/// An argument is the number of repeats, of which the fastest counts.
int main(int count, char** words) {
    if (count > 1) saltus::repeats = std::atoi(words[1]);
    saltus::run();
}
