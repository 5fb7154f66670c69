#pragma once

#include <bitset>
#include <cstddef>
#include <cstdint>

namespace rustle::session {

/// Which numbers of a stream's sequence have come, over the newest kWidth of them. Numbers start anywhere and grow by 1.
/// A number further back than the window belongs to a sender that has started again: counting begins anew with it.
/// Allocates nothing. One thread at a time.
class SequenceWindow {
 public:
  static constexpr std::uint64_t kWidth = 1024;

  enum class Arrival : std::uint8_t {
    kNext,      ///< the greatest so far; those it skipped are missing
    kLate,      ///< one that was missing
    kRepeated,  ///< has come before
  };
  /// \pre sequence != 0
  Arrival add(std::uint64_t sequence);

  std::uint64_t newest() const { return newest_; }    ///< 0: none
  std::uint64_t missing() const { return missing_; }  ///< that have not come, all told
  /// Whether all numbers below `sequence` have come or been given up.
  bool complete_before(std::uint64_t sequence) const;
  /// What is missing below `sequence` is waited for no more; it may still come.
  void give_up_before(std::uint64_t sequence);

 private:
  bool come(std::uint64_t sequence) const { return come_[static_cast<std::size_t>(sequence % kWidth)]; }

  std::uint64_t newest_ = 0;
  std::uint64_t first_ = 0;        ///< the least number that can be missing
  std::uint64_t waited_from_ = 0;  ///< everything below has come or been given up
  std::uint64_t missing_ = 0;
  std::bitset<kWidth> come_;
};

}  // namespace rustle::session
