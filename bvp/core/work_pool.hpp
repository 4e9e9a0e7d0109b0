/// Work spaces of one kind: a call borrows one, so that threads can share a problem.
#pragma once

#include <memory>
#include <mutex>
#include <vector>

namespace saltus {

template <class Work>
class WorkPool {
public:
    /// Call use(work) with a work space of its own. make() makes one where none is idle.
    template <class Make, class Use>
    auto with(Make&& make, Use&& use) {
        std::unique_ptr<Work> work = borrow(make);
        struct Return {
            WorkPool& pool;
            std::unique_ptr<Work>& work;
            ~Return() { pool.give_back(std::move(work)); }
        } back{*this, work};
        return use(*work);
    }

private:
    template <class Make>
    std::unique_ptr<Work> borrow(Make&& make) {
        {
            const std::lock_guard lock(mutex_);
            if (!idle_.empty()) {
                std::unique_ptr<Work> work = std::move(idle_.back());
                idle_.pop_back();
                return work;
            }
        }
        return make();
    }
    void give_back(std::unique_ptr<Work> work) {
        const std::lock_guard lock(mutex_);
        idle_.push_back(std::move(work));
    }

    std::mutex mutex_;
    std::vector<std::unique_ptr<Work>> idle_;
};

}  // namespace saltus
