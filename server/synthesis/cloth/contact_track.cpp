#include "server/synthesis/cloth/contact_track.h"

#include <algorithm>
#include <array>
#include <cassert>

#include "server/synthesis/cloth/monotone_cubic.h"

namespace rustle::cloth {
namespace {

/// Walks along samples by rising vertex.
class Walk {
 public:
  explicit Walk(const std::vector<ContactSample>* samples) : samples_(samples) {}
  bool done() const { return samples_ == nullptr || next_ == samples_->size(); }
  std::uint32_t vertex() const { return (*samples_)[next_].vertex; }
  /// The vertex's sample, null without one. \pre vertices rise from call to call
  const ContactSample* find(std::uint32_t vertex) {
    while (!done() && this->vertex() < vertex) ++next_;
    return !done() && this->vertex() == vertex ? &(*samples_)[next_] : nullptr;
  }
  void pass() { ++next_; }

 private:
  const std::vector<ContactSample>* samples_;
  std::size_t next_ = 0;
};

double speed_of(const ContactSample* sample) {
  return sample ? static_cast<double>(sample->speed_m_per_s) : 0.0;
}

}  // namespace

void ContactTrack::add(std::int64_t at, std::vector<ContactSample> contacts) {
  assert(frames_.empty() || at > frames_.back().at);
  std::ranges::sort(contacts, {}, &ContactSample::vertex);
  for (ContactSample& sample : contacts) {
    if (sample.vertex >= moved_.size()) moved_.resize(sample.vertex + std::size_t{1});
    if (static_cast<double>(sample.speed_m_per_s) > threshold_m_per_s_) moved_[sample.vertex] = 1;
    if (!moved_[sample.vertex]) sample.speed_m_per_s = 0;
  }
  if (held_back_ && !frames_.empty()) frames_.back().contacts = contacts;
  held_back_ = false;
  frames_.push_back({at, std::move(contacts)});
}

void ContactTrack::renumber(std::span<const std::uint32_t> origins) {
  std::vector<std::uint8_t> moved(origins.size());
  for (std::size_t v = 0; v < origins.size(); ++v) moved[v] = origins[v] < moved_.size() ? moved_[origins[v]] : 0;
  moved_ = std::move(moved);
  for (Frame& frame : frames_) {
    std::vector<ContactSample> renumbered;
    for (std::size_t v = 0; v < origins.size(); ++v) {
      const auto found = std::ranges::lower_bound(frame.contacts, origins[v], {}, &ContactSample::vertex);
      if (found == frame.contacts.end() || found->vertex != origins[v]) continue;
      renumbered.push_back({static_cast<std::uint32_t>(v), found->speed_m_per_s, kNoArea, found->patch});
    }
    frame.contacts = std::move(renumbered);
  }
}

void ContactTrack::forget_vertices() {
  moved_.clear();
  for (Frame& frame : frames_) frame.contacts.clear();
  held_back_ = true;
}

bool ContactTrack::at(std::int64_t time, const std::function<void(const ContactSample&)>& visit) const {
  if (frames_.empty()) return false;
  const auto after = std::ranges::upper_bound(frames_, time, {}, &Frame::at);
  const auto to = after == frames_.end() ? frames_.size() - 1 : static_cast<std::size_t>(after - frames_.begin());
  const std::size_t from = to == 0 ? 0 : to - 1;
  TrackInterval interval;
  interval.before = from > 0;
  interval.after = to + 1 < frames_.size() && from < to;
  const std::array<const Frame*, 4> around{interval.before ? &frames_[from - 1] : nullptr, &frames_[from], &frames_[to],
                                           interval.after ? &frames_[to + 1] : nullptr};
  std::array<Walk, 4> walks{Walk(nullptr), Walk(nullptr), Walk(nullptr), Walk(nullptr)};
  for (std::size_t k = 0; k < around.size(); ++k) {
    if (around[k] == nullptr) continue;
    interval.at[k] = static_cast<double>(around[k]->at);
    walks[k] = Walk(&around[k]->contacts);
  }
  const double share =
      from == to ? 1
                 : std::clamp((static_cast<double>(time) - interval.at[1]) / (interval.at[2] - interval.at[1]), 0.0, 1.0);
  bool any = false;
  while (!walks[1].done() || !walks[2].done()) {
    const std::uint32_t vertex = walks[1].done()   ? walks[2].vertex()
                                 : walks[2].done() ? walks[1].vertex()
                                                   : std::min(walks[1].vertex(), walks[2].vertex());
    std::array<const ContactSample*, 4> samples{};
    for (std::size_t k = 0; k < samples.size(); ++k) {
      samples[k] = walks[k].find(vertex);
      interval.value[k] = speed_of(samples[k]);
    }
    const ContactSample *a = samples[1], *b = samples[2];
    if (a) walks[1].pass();
    if (b && from != to) walks[2].pass();
    if (from == to) walks[2].find(vertex + 1);
    const double speed = from == to ? interval.value[1] : monotone_cubic(interval, static_cast<double>(time));
    const float area_a = a && a->area_m2 != kNoArea ? a->area_m2 : b ? b->area_m2 : kNoArea;
    const float area_b = b && b->area_m2 != kNoArea ? b->area_m2 : area_a;
    if (!(speed > 0) || area_a == kNoArea) continue;
    any = true;
    visit(
        {vertex, static_cast<float>(speed), static_cast<float>((1 - share) * area_a + share * area_b), (b ? b : a)->patch});
  }
  return any;
}

void ContactTrack::forget(std::int64_t before) {
  // The interval that holds `before` needs the sample ahead of it.
  while (frames_.size() > 3 && frames_[2].at <= before) frames_.pop_front();
}

}  // namespace rustle::cloth
