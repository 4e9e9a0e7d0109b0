// Operations on sums of four doubles.
#include "quad_double.hpp"

namespace saltus {
namespace {

/// Terms of a sum by their size: those of level k are about 2^-53k of the first. What rounding leaves of a level goes
/// to the next one.
class Levels {
public:
    void add(int level, double x) { terms_[level][counts_[level]++] = x; }

    /// The sum of all levels.
    QuadDouble sum() {
        std::array<double, 5> x{};
        for (int level = 0; level < 5; ++level) {
            double total = counts_[level] ? terms_[level][0] : 0.0;
            for (int i = 1; i < counts_[level]; ++i) {
                const DoubleDouble s = two_sum(total, terms_[level][i]);
                total = s.high;
                if (level < 4) add(level + 1, s.low);
            }
            x[level] = total;
        }
        for (int i = 3; i >= 0; --i) {
            const DoubleDouble s = two_sum(x[i], x[i + 1]);
            x[i] = s.high;
            x[i + 1] = s.low;
        }
        // From the top: a part that is 0 gives its place to the next one.
        QuadDouble out(0.0);
        double carry = x[0];
        int place = 0;
        for (int i = 1; i < 5 && place < 4; ++i) {
            const DoubleDouble s = two_sum(carry, x[i]);
            carry = s.high;
            if (s.low != 0.0) {
                out.part[place++] = carry;
                carry = s.low;
            }
        }
        if (place < 4) out.part[place] = carry;
        return out;
    }

private:
    std::array<std::array<double, 20>, 5> terms_;  // a product fills 19 places of the last level
    std::array<int, 5> counts_{};
};

}  // namespace

QuadDouble operator+(const QuadDouble& a, const QuadDouble& b) {
    Levels levels;
    for (int i = 0; i < 4; ++i) {
        levels.add(i, a.part[i]);
        levels.add(i, b.part[i]);
    }
    return levels.sum();
}

QuadDouble operator*(const QuadDouble& a, const QuadDouble& b) {
    Levels levels;
    for (int i = 0; i < 4; ++i) {
        for (int j = 0; i + j < 4; ++j) {
            const DoubleDouble p = two_product(a.part[i], b.part[j]);
            levels.add(i + j, p.high);
            levels.add(i + j + 1, p.low);
        }
    }
    for (int i = 1; i < 4; ++i) levels.add(4, a.part[i] * b.part[4 - i]);
    return levels.sum();
}

QuadDouble operator/(const QuadDouble& a, const QuadDouble& b) {
    QuadDouble rest = a;
    Levels levels;
    for (int i = 0; i < 5; ++i) {
        const double quotient = rest.part[0] / b.part[0];
        levels.add(i, quotient);
        if (i < 4) rest = rest - b * quotient;
    }
    return levels.sum();
}

QuadDouble sqrt(const QuadDouble& a) {
    const double near = std::sqrt(a.part[0]);
    if (!(a.part[0] > 0.0)) return near;
    // Newton's method doubles the digits of a root.
    QuadDouble root = near;
    for (int i = 0; i < 2; ++i) root = 0.5 * (root + a / root);
    return root;
}

}  // namespace saltus
