#include "server/session/inbox.h"

#include <algorithm>
#include <utility>

namespace rustle::session {

Offer Inbox::offer(Waiting incoming) {
  auto arrival = SequenceWindow::Arrival::kNext;
  if (incoming.sequence != 0) arrival = sequence_.add(incoming.sequence);
  const sheet::MeshFrame* frame = frame_of(incoming);
  const auto refuse = [&](const char* cause) {
    lost_.push_back({incoming.arrival, incoming.sequence, frame != nullptr, cause, incoming.frame});
  };
  if (ended_) {
    refuse("ended");
    return Offer::kEnded;
  }
  if (live_ && frame != nullptr) {
    if (came_before(*frame, arrival)) {
      refuse("duplicate");
      return Offer::kTaken;
    }
    make_room(incoming);
  }
  const bool is_end = std::holds_alternative<engine::End>(incoming.item);
  // A message larger than the inbox goes alone.
  const bool too_many_bytes = !waiting_.empty() && bytes_ + incoming.bytes > kBytes;
  if (!is_end && (waiting_.size() >= kMessages || too_many_bytes)) {
    refuse("inbox");
    return Offer::kFull;
  }
  ended_ = is_end;
  bytes_ += incoming.bytes;
  auto place = waiting_.end();
  if (live_ && arrival == SequenceWindow::Arrival::kLate)
    while (place != waiting_.begin() && std::prev(place)->sequence > incoming.sequence) --place;
  waiting_.insert(place, std::move(incoming));
  return Offer::kTaken;
}

void Inbox::pass_over(std::uint64_t sequence) {
  if (sequence != 0) sequence_.add(sequence);
}

bool Inbox::came_before(const sheet::MeshFrame& frame, SequenceWindow::Arrival arrival) const {
  const auto newest = taken_s_.find(frame.sheet);
  if (newest != taken_s_.end()) {
    if (frame.time_s == newest->second) return true;
    if (frame.time_s < newest->second && arrival == SequenceWindow::Arrival::kRepeated) return true;
  }
  return std::any_of(waiting_.begin(), waiting_.end(), [&](const Waiting& w) {
    const auto* other = frame_of(w);
    return other != nullptr && other->sheet == frame.sheet && other->time_s == frame.time_s;
  });
}

void Inbox::make_room(const Waiting& incoming) {
  const sheet::SheetId sheet = frame_of(incoming)->sheet;
  const auto of_sheet = [&](const Waiting& w) { return frame_of(w) != nullptr && frame_of(w)->sheet == sheet; };
  const auto is_frame = [](const Waiting& w) { return frame_of(w) != nullptr; };
  auto frames = static_cast<std::size_t>(std::count_if(waiting_.begin(), waiting_.end(), of_sheet));
  for (; frames >= kBacklogFrames; --frames) drop(std::find_if(waiting_.begin(), waiting_.end(), of_sheet), "backlog");
  while (bytes_ + incoming.bytes > kBytes) {
    const auto oldest = std::find_if(waiting_.begin(), waiting_.end(), is_frame);
    if (oldest == waiting_.end()) return;
    drop(oldest, "backlog");
  }
}

void Inbox::drop(std::deque<Waiting>::iterator waiting, const char* cause) {
  lost_.push_back({waiting->arrival, waiting->sequence, frame_of(*waiting) != nullptr, cause, waiting->frame});
  bytes_ -= waiting->bytes;
  waiting_.erase(waiting);
}

std::optional<WallClock::Duration> Inbox::ready_at(WallClock::Duration reorder_wait) const {
  if (waiting_.empty()) return std::nullopt;
  const Waiting& next = waiting_.front();
  const bool in_sequence = !live_ || ended_ || next.sequence == 0 || sequence_.complete_before(next.sequence);
  return in_sequence ? WallClock::Duration{} : next.arrived + reorder_wait;
}

std::optional<Inbox::Moment> Inbox::moment_of(const Waiting& waiting) {
  if (const auto* frame = frame_of(waiting)) return Moment{static_cast<Track>(frame->sheet), frame->time_s};
  if (const auto* scene = std::get_if<scene::SceneUpdate>(&waiting.item)) return Moment{kScene, scene->time_s};
  return std::nullopt;
}

std::optional<Inbox::Waiting> Inbox::take(WallClock::Duration now, WallClock::Duration reorder_wait) {
  while (true) {
    const auto ready = ready_at(reorder_wait);
    if (!ready || now < *ready) return std::nullopt;
    Waiting& next = waiting_.front();
    if (next.sequence != 0) sequence_.give_up_before(next.sequence);
    const bool in_sequence = next.sequence > taken_sequence_;
    if (const auto moment = live_ ? moment_of(next) : std::nullopt) {
      const auto newest = taken_s_.find(moment->track);
      if (newest != taken_s_.end() && moment->time_s < newest->second) {
        next.steps_back = (in_sequence || next.sequence == 0) && moment->time_s < newest->second - kStepBack_s;
        if (next.steps_back) {
          taken_s_.clear();
        } else if (!in_sequence && frame_of(next) != nullptr) {
          drop(waiting_.begin(), "reordered");
          continue;
        }
      }
      // What goes back in sequence, but not so far, is refused further on, with a word to the sender.
      auto& taken_s = taken_s_.try_emplace(moment->track, moment->time_s).first->second;
      taken_s = std::max(taken_s, moment->time_s);
    }
    taken_sequence_ = std::max(taken_sequence_, next.sequence);
    Waiting taken = std::move(next);
    waiting_.pop_front();
    bytes_ -= taken.bytes;
    return taken;
  }
}

void Inbox::discard() {
  while (!waiting_.empty()) drop(waiting_.begin(), "discarded");
}

std::vector<Inbox::Lost> Inbox::take_lost() {
  return std::exchange(lost_, {});
}

}  // namespace rustle::session
