#include "server/session/sequence_window.h"

#include <algorithm>

namespace rustle::session {

SequenceWindow::Arrival SequenceWindow::add(std::uint64_t sequence) {
  const auto mark = [this](std::uint64_t number, bool has_come) {
    come_[static_cast<std::size_t>(number % kWidth)] = has_come;
  };
  if (newest_ == 0 || sequence + kWidth <= newest_) {
    first_ = waited_from_ = newest_ = sequence;
    mark(sequence, true);
    return Arrival::kNext;
  }
  if (sequence > newest_) {
    missing_ += sequence - newest_ - 1;
    for (std::uint64_t k = std::max(newest_ + 1, sequence - std::min(sequence, kWidth - 1)); k < sequence; ++k)
      mark(k, false);
    mark(sequence, true);
    newest_ = sequence;
    if (newest_ >= kWidth) waited_from_ = std::max(waited_from_, newest_ - kWidth + 1);
  } else {
    if (sequence < first_ || come(sequence)) return Arrival::kRepeated;
    mark(sequence, true);
    --missing_;
  }
  while (waited_from_ <= newest_ && come(waited_from_)) ++waited_from_;
  return sequence == newest_ ? Arrival::kNext : Arrival::kLate;
}

bool SequenceWindow::complete_before(std::uint64_t sequence) const {
  return sequence <= waited_from_ || newest_ == 0;
}

void SequenceWindow::give_up_before(std::uint64_t sequence) {
  waited_from_ = std::max(waited_from_, std::min(sequence, newest_ + 1));
  while (waited_from_ <= newest_ && come(waited_from_)) ++waited_from_;
}

}  // namespace rustle::session
