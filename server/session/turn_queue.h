#pragma once

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <optional>
#include <utility>
#include <vector>

namespace rustle::session {

/// What somebody has had of the workers' time.
struct TurnAccount {
  std::chrono::nanoseconds spent{};  ///< and what it was given for coming late
  std::chrono::nanoseconds last_turn{};
};

/// Who is next among those that have work, so that everyone gets the same share of time however much each wants: the one
/// that has had least is next, among equals the one that has waited longest. Who comes back from doing nothing has no claim
/// to what it did not use.
///
/// A turn is long when it took more than kLongTurn; who last took a long one is kept from those that ask for short turns
/// only. `Member` points to something whose `turns` is a TurnAccount, the queue's own. Not thread-safe. O(waiting).
template <typename Member>
class TurnQueue {
 public:
  static constexpr std::chrono::nanoseconds kLongTurn{std::chrono::milliseconds(4)};

  /// \pre it neither waits nor has a turn
  void want(Member member) {
    member->turns.spent = std::max(member->turns.spent, least_);
    waiting_.push_back({std::move(member), ++order_});
  }

  /// Absent: nobody waits, or nobody whose turns are short.
  std::optional<Member> take(bool short_only = false) {
    auto next = waiting_.end();
    for (auto one = waiting_.begin(); one != waiting_.end(); ++one) {
      if (short_only && is_long(*one)) continue;
      if (next == waiting_.end() || before(*one, *next)) next = one;
    }
    if (next == waiting_.end()) return std::nullopt;
    if (!short_only) least_ = std::max(least_, next->member->turns.spent);
    Member member = std::move(next->member);
    *next = std::move(waiting_.back());
    waiting_.pop_back();
    return member;
  }

  /// It has used so much in the turn it took, and may want() again.
  void done(const Member& member, std::chrono::nanoseconds turn) {
    member->turns.spent += turn;
    member->turns.last_turn = turn;
  }

  /// Someone whose turns are short waits.
  bool short_waits() const {
    return std::any_of(waiting_.begin(), waiting_.end(), [](const Waiting& one) { return !is_long(one); });
  }

 private:
  struct Waiting {
    Member member;
    std::uint64_t order;
  };
  static bool is_long(const Waiting& one) { return one.member->turns.last_turn > kLongTurn; }
  static bool before(const Waiting& a, const Waiting& b) {
    return std::pair(a.member->turns.spent, a.order) < std::pair(b.member->turns.spent, b.order);
  }

  std::vector<Waiting> waiting_;
  std::chrono::nanoseconds least_{};  ///< what everyone has had
  std::uint64_t order_ = 0;
};

}  // namespace rustle::session
