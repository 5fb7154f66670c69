#include "server/page/outbox.h"

#include <algorithm>
#include <utility>

namespace rustle::page {

bool Outbox::add_text(std::string text) {
  const std::lock_guard lock(mutex_);
  if (count(Kind::kText, 0) >= kTexts) return false;
  put({Kind::kText, 0, {std::make_shared<const std::string>(std::move(text)), false}, {}, 0});
  return true;
}

void Outbox::add_figures(std::string text) {
  const std::lock_guard lock(mutex_);
  add_picture({Kind::kFigures, 0, {std::make_shared<const std::string>(std::move(text)), false}, {}, 0});
}

void Outbox::add_scene(std::shared_ptr<const std::string> text, std::vector<Needed> meshes) {
  const std::lock_guard lock(mutex_);
  add_picture({Kind::kScene, 0, {std::move(text), false}, std::move(meshes), 0});
}

void Outbox::add_frame(std::uint32_t place, std::shared_ptr<const std::string> frame, Needed topology) {
  const std::lock_guard lock(mutex_);
  std::vector<Needed> needed;
  needed.push_back(std::move(topology));
  add_picture({Kind::kFrame, place, {std::move(frame), true}, std::move(needed), 0});
}

void Outbox::add_events(std::shared_ptr<const std::string> text) {
  const std::lock_guard lock(mutex_);
  if (count(Kind::kEvents, 0) >= kEvents) {
    drop_oldest(Kind::kEvents, 0);
    ++lost_.events;
  }
  put({Kind::kEvents, 0, {std::move(text), false}, {}, 0});
}

void Outbox::add_pcm(std::shared_ptr<const std::string> bytes, double length_s) {
  const std::lock_guard lock(mutex_);
  if (pcm_s_ + length_s > kPcm_s || bytes_ > kBytes) {
    ++lost_.pcm;
    return;
  }
  pcm_s_ += length_s;
  put({Kind::kPcm, 0, {std::move(bytes), true}, {}, length_s});
}

void Outbox::forget_pictures() {
  const std::lock_guard lock(mutex_);
  forget([](Kind kind) { return kind == Kind::kScene || kind == Kind::kFrame || kind == Kind::kEvents; });
  has_.clear();
}

void Outbox::forget_pcm() {
  const std::lock_guard lock(mutex_);
  forget([](Kind kind) { return kind == Kind::kPcm; });
  pcm_s_ = 0;
}

std::optional<Message> Outbox::next() {
  const std::lock_guard lock(mutex_);
  if (waiting_.empty()) return std::nullopt;
  Waiting& first = waiting_.front();
  for (const Needed& needed : first.needed) {
    auto& has = has_[needed.place];
    if (has == needed.message.bytes) continue;
    has = needed.message.bytes;
    return needed.message;
  }
  Message message = std::move(first.message);
  bytes_ -= message.bytes->size();
  pcm_s_ = std::max(0.0, pcm_s_ - first.length_s);
  waiting_.pop_front();
  return message;
}

Outbox::Lost Outbox::lost() const {
  const std::lock_guard lock(mutex_);
  return lost_;
}

std::size_t Outbox::count(Kind kind, std::uint32_t place) const {
  return static_cast<std::size_t>(std::count_if(waiting_.begin(), waiting_.end(), [&](const Waiting& waiting) {
    return waiting.kind == kind && waiting.place == place;
  }));
}

void Outbox::drop_oldest(Kind kind, std::uint32_t place) {
  const auto oldest = std::find_if(waiting_.begin(), waiting_.end(),
                                   [&](const Waiting& waiting) { return waiting.kind == kind && waiting.place == place; });
  bytes_ -= oldest->message.bytes->size();
  waiting_.erase(oldest);
}

void Outbox::add_picture(Waiting picture) {
  if (count(picture.kind, picture.place) >= kPictures) {
    drop_oldest(picture.kind, picture.place);
    ++lost_.pictures;
  }
  if (bytes_ > kBytes) {
    ++lost_.pictures;
    return;
  }
  put(std::move(picture));
}

void Outbox::put(Waiting waiting) {
  bytes_ += waiting.message.bytes->size();
  waiting_.push_back(std::move(waiting));
}

void Outbox::forget(bool (*is_one)(Kind kind)) {
  std::erase_if(waiting_, [&](const Waiting& waiting) {
    if (!is_one(waiting.kind)) return false;
    bytes_ -= waiting.message.bytes->size();
    return true;
  });
}

}  // namespace rustle::page
