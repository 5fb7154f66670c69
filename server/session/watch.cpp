#include "server/session/watch.h"

#include <algorithm>
#include <utility>

namespace rustle::session {
namespace {

constexpr WallClock::Duration kPeriod =
    std::chrono::duration_cast<WallClock::Duration>(std::chrono::seconds(1)) / Watch::kFramesPerSecond;

SeenEvents events_of(const observation::Observation& observed, bool with_contacts) {
  SeenEvents out;
  out.time_s = observed.time_s;
  for (const auto& event : observed.crumpling) out.crumples.push_back({event.position_m, event.amplitude_m, event.area_m2});
  for (const auto& tear : observed.tears)
    if (tear.speed_m_per_s > 0) out.tears.push_back({tear.position_m, tear.speed_m_per_s});
  if (!with_contacts) return out;
  for (const auto& contact : observed.friction)
    out.contacts.push_back({contact.position_m, contact.speed_m_per_s, contact.area_m2});
  return out;
}

}  // namespace

bool Watch::next(Seen& seen) {
  std::unique_ptr<Seen> taken;
  if (!seen_.pop(taken)) return false;
  seen = std::move(*taken);
  return true;
}

bool Watch::is_due(sheet::SheetId sheet, WallClock::Duration now) {
  WallClock::Duration& due = due_.try_emplace(sheet, now).first->second;
  // Frames that come as often as they may are all shown, unsteady as they are.
  if (now + kPeriod / 4 < due) return false;
  due = std::max(due, now - kPeriod / 2) + kPeriod;
  return true;
}

void Watch::put(Seen seen) {
  if (!seen_.push(std::make_unique<Seen>(std::move(seen)))) left_out_.fetch_add(1, std::memory_order_relaxed);
}

void Watch::saw(const engine::Ingest& ingest, sheet::MeshFrame&& frame, const observation::Observation& observed,
                WallClock::Duration now) {
  look(ingest);
  const auto place = ingest.place_of(frame.sheet);
  if (!place) return;
  const bool due = is_due(frame.sheet, now);
  if (due) {
    frames_taken_.fetch_add(1, std::memory_order_relaxed);
    put(SeenFrame{*place, std::move(frame)});
  }
  SeenEvents events = events_of(observed, due);
  if (events.crumples.empty() && events.contacts.empty() && events.tears.empty()) return;
  events.place = *place;
  put(std::move(events));
}

void Watch::look(const engine::Ingest& ingest) {
  const bool all = !std::exchange(begun_, true);
  if (!all && changes_ == ingest.changes()) return;
  if (scene_changes_ != ingest.scene_changes()) scene_ = nullptr;
  engine::Surroundings around = ingest.surroundings(std::move(scene_));
  scene_ = around.scene;
  scene_changes_ = ingest.scene_changes();
  changes_ = ingest.changes();
  put(std::move(around));
  if (!all) return;
  for (const sheet::MeshFrame* frame : ingest.newest_frames()) {
    frames_taken_.fetch_add(1, std::memory_order_relaxed);
    put(SeenFrame{*ingest.place_of(frame->sheet), *frame});
  }
}

}  // namespace rustle::session
