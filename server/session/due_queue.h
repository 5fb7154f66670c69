#pragma once

#include <cassert>
#include <cstddef>
#include <limits>
#include <optional>
#include <utility>
#include <vector>

#include "server/session/clock.h"

namespace rustle::session {

/// Work with deadlines, the earliest first. Members are added and removed by the control side, which may allocate; the
/// others do not. One worker at a time has a member; what falls due meanwhile is not lost. `Member` is compared by identity.
/// Not thread-safe. add, remove and call O(n), the others O(log n).
template <typename Member>
class DueQueue {
 public:
  using Duration = WallClock::Duration;
  /// A member that was taken, by which it is given back.
  using Ticket = std::size_t;

  /// Due at once.
  void add(Member member) {
    sweep();
    std::size_t slot = 0;
    while (slot < entries_.size() && entries_[slot].member) ++slot;
    if (slot == entries_.size()) {
      entries_.emplace_back();
      heap_.reserve(entries_.capacity());
    }
    entries_[slot] = Entry{std::move(member), Duration::min()};
    push(slot);
  }

  /// What is being worked on is kept until a later add() or remove(): no worker is left to destroy it.
  void remove(const Member& member) {
    const std::size_t slot = slot_of(member);
    if (slot == kNowhere) return;
    if (entries_[slot].place != kNowhere) take_out(slot);
    entries_[slot].removed = true;
    sweep();
  }

  /// It is due now, whatever was said.
  void call(const Member& member) {
    const std::size_t slot = slot_of(member);
    if (slot == kNowhere) return;
    Entry& entry = entries_[slot];
    entry.due = Duration::min();
    if (entry.taken) {
      entry.called = true;
    } else if (entry.place == kNowhere) {
      push(slot);
    } else {
      rise(entry.place);
    }
  }

  /// The earliest that is due by `now` and that nobody works on.
  std::optional<Ticket> take(Duration now) {
    if (heap_.empty() || entries_[heap_.front()].due > now) return std::nullopt;
    const std::size_t slot = heap_.front();
    take_out(slot);
    entries_[slot].taken = true;
    entries_[slot].called = false;
    return slot;
  }
  /// \pre taken
  const Member& member(Ticket ticket) const { return *entries_[ticket].member; }

  /// It is next due then; absent: when it is called.
  void give_back(Ticket ticket, std::optional<Duration> due) {
    Entry& entry = entries_[ticket];
    entry.taken = false;
    if (entry.removed) return;
    if (entry.called) {
      entry.due = Duration::min();
    } else if (due) {
      entry.due = *due;
    } else {
      return;
    }
    push(ticket);
  }

  /// When the next falls due.
  std::optional<Duration> next_due() const {
    if (heap_.empty()) return std::nullopt;
    return entries_[heap_.front()].due;
  }

 private:
  static constexpr std::size_t kNowhere = std::numeric_limits<std::size_t>::max();
  struct Entry {
    std::optional<Member> member;
    Duration due{};
    std::size_t place = kNowhere;  ///< in the heap
    bool taken = false, called = false, removed = false;
  };

  void sweep() {
    for (Entry& entry : entries_)
      if (entry.removed && !entry.taken) entry = Entry{};
  }

  std::size_t slot_of(const Member& member) const {
    for (std::size_t slot = 0; slot < entries_.size(); ++slot)
      if (entries_[slot].member == member && !entries_[slot].removed) return slot;
    return kNowhere;
  }
  bool before(std::size_t a, std::size_t b) const { return entries_[heap_[a]].due < entries_[heap_[b]].due; }
  void swap(std::size_t a, std::size_t b) {
    std::swap(heap_[a], heap_[b]);
    entries_[heap_[a]].place = a;
    entries_[heap_[b]].place = b;
  }
  void push(std::size_t slot) {
    assert(entries_[slot].place == kNowhere && heap_.size() < heap_.capacity());
    heap_.push_back(slot);
    entries_[slot].place = heap_.size() - 1;
    rise(heap_.size() - 1);
  }
  void take_out(std::size_t slot) {
    const std::size_t place = entries_[slot].place;
    swap(place, heap_.size() - 1);
    heap_.pop_back();
    entries_[slot].place = kNowhere;
    if (place == heap_.size()) return;
    rise(place);
    sink(place);
  }
  void rise(std::size_t place) {
    for (; place > 0 && before(place, (place - 1) / 2); place = (place - 1) / 2) swap(place, (place - 1) / 2);
  }
  void sink(std::size_t place) {
    while (true) {
      std::size_t least = place;
      for (std::size_t child = 2 * place + 1; child < 2 * place + 3; ++child)
        if (child < heap_.size() && before(child, least)) least = child;
      if (least == place) return;
      swap(place, least);
      place = least;
    }
  }

  std::vector<Entry> entries_;
  std::vector<std::size_t> heap_;  ///< slots, the earliest due first
};

}  // namespace rustle::session
