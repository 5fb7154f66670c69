#include "server/apps/strangers.h"

#include <cassert>
#include <utility>

namespace rustle::apps {

Stranger* Strangers::meet(const std::string& id, session::WallClock::Duration now) {
  const auto known = strangers_.find(id);
  if (known != strangers_.end()) return &known->second;
  if (strangers_.size() >= limits_.publishers) return nullptr;
  Stranger& met = strangers_[id];
  met.since = now;
  return &met;
}

void Strangers::keep(Stranger& stranger, wire::StreamEnvelope envelope) {
  const std::size_t bytes = envelope.bytes();
  if (stranger.said.size() >= limits_.messages || stranger.bytes + bytes > limits_.bytes ||
      bytes_together_ + bytes > limits_.bytes_together) {
    ++stranger.left_out;
    return;
  }
  stranger.bytes += bytes;
  bytes_together_ += bytes;
  stranger.said.push_back(std::move(envelope));
}

Stranger Strangers::take(const std::string& id) {
  auto taken = strangers_.extract(id);
  assert(!taken.empty());
  bytes_together_ -= taken.mapped().bytes;
  return std::move(taken.mapped());
}

std::uint64_t Strangers::forget_before(session::WallClock::Duration time) {
  std::uint64_t lost = 0;
  std::erase_if(strangers_, [&](const auto& entry) {
    const Stranger& stranger = entry.second;
    if (stranger.since >= time) return false;
    bytes_together_ -= stranger.bytes;
    lost += stranger.said.size() + stranger.left_out + stranger.frames;
    return true;
  });
  return lost;
}

}  // namespace rustle::apps
