/// The nodes of an orbit over its period, from a segment between two ends: each reversal maps the segment to the part
/// that follows it.
#pragma once

#include "chain.hpp"

namespace saltus {

/// The nodes of an orbit, impacts and cuts, in order of time.
class Period {
public:
    /// Unfold the orbit y of a problem. ends (k + 1, N): states at the end of each flight. half: of a segment that is a
    /// quarter of its period, only the half that is followed by its mirror image.
    template <class Problem, class Ends>
    void unfold(const Problem& problem, Values y, const Ends& ends, bool half = false) {
        const int size = problem.size(), k = problem.inner();
        begin(4 * (k + 1), size);
        Local<double, Problem::SIZE> start(size), mirror(size);
        problem.start_state(y, start);
        const auto node = [&](int i) { return i == 0 ? Values(start) : y.subspan(problem.begin(i), size); };
        if (problem.periodic()) {
            for (int i = 0; i <= k; ++i)
                append(y[problem.time(i)], ends[i > 0 ? i - 1 : k], node(i), i > 0 ? i - 1 : k, 1.0, 1.0, problem);
            for (int i = 0; i <= k; ++i) duration_[i] = y[problem.time(i)];
            lead_ = 0.0;
            return;
        }
        using End = std::remove_cvref_t<decltype(problem.closure().start)>;
        const auto reversed = [&](const auto& z) {
            for (int r = 0; r < size; ++r) mirror[r] = r < size / 2 ? z[r] : -z[r];
            return Values(mirror);
        };
        const double reflect = problem.closure().finish == End::ORIGIN ? -1.0 : 1.0;
        double sign = 1.0, ahead = 0.0;
        for (int leg = 0; leg < (problem.closure().quarters == 1 && !half ? 4 : 2); ++leg) {
            const bool forwards = leg % 2 == 0;
            for (int step = 0; step <= k; ++step) {
                const int i = forwards ? step : k - step;
                ahead += y[problem.time(i)];
                if (step == k) break;
                if (forwards) append(ahead, ends[i], node(i + 1), i, sign, sign, problem);
                else append(ahead, node(i), ends[i - 1], i - 1, sign * reflect, -sign * reflect, problem);
                ahead = 0.0;
            }
            if (!forwards && problem.closure().quarters == 1) sign = -sign;
            if ((forwards ? problem.closure().finish : problem.closure().start) == End::STOP) {
                if (forwards) append(ahead, ends[k], reversed(ends[k]), k, sign, sign, problem);
                else append(ahead, reversed(start), Values(start), k + 1, sign, sign, problem);
                ahead = 0.0;
            }
        }
        if (count_ > 0) duration_[count_ - 1] = ahead + lead_;
    }

    int count() const { return count_; }
    /// Time from the orbit's start to the first node.
    double lead() const { return lead_; }
    /// Node of the problem that each is an image of.
    Vector<const int> node() const { return {node_.data(), size_t(count_)}; }
    /// The first `count` of them.
    Nodes nodes(int count) const {
        const int size = before_.columns();
        return {{before_.data(), count, size},
                {after_.data(), count, size},
                {duration_.data(), size_t(count)},
                {contact_.data(), size_t(count)}};
    }
    Nodes nodes() const { return nodes(count_); }

private:
    void begin(int most, int size) {
        count_ = 0, lead_ = 0.0;
        if (before_.rows() >= most && before_.columns() == size) return;
        before_ = Array<>(most, size), after_ = Array<>(most, size);
        duration_.resize(most), node_.resize(most), contact_.resize(most);
    }

    /// Append the image of a node's states, their displacements times sign_q and velocities times sign_p. ahead: time
    /// since the last one.
    template <class Before, class After, class Problem>
    void append(double ahead, const Before& before, const After& after, int node, double sign_q, double sign_p,
                const Problem& problem) {
        for (int r = 0; r < before_.columns(); ++r) {
            const double sign = r < before_.columns() / 2 ? sign_q : sign_p;
            before_(count_, r) = sign * before[r];
            after_(count_, r) = sign * after[r];
        }
        node_[count_] = node;
        contact_[count_] = problem.contact(node);
        (count_ == 0 ? lead_ : duration_[count_ - 1]) = ahead;
        ++count_;
    }

    Array<> before_, after_;
    std::vector<double> duration_;
    std::vector<int> node_, contact_;
    int count_ = 0;
    double lead_ = 0.0;
};

}  // namespace saltus
