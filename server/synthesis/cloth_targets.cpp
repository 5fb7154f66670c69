#include "server/synthesis/cloth_targets.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <utility>

#include "server/synthesis/cloth_patches.h"
#include "sound_db/dsp/random.h"

namespace rustle::synthesis {
namespace {

using cloth::ContactSample;
using observation::CrumplingEvent;
using observation::FrictionContact;
using observation::Observation;

constexpr double kEndRamp_s = 0.02;  ///< contacts that end without a frame without them
constexpr double kPublishedJitter_s = 1 / 30.0;
constexpr double kCreep_m_per_s = 1e-3;  ///< so that resting contacts have a place, too
constexpr double kReach_m = 0.25;        ///< an event this near to a patch that sounds belongs to it

/// A patch radiates alike in all directions.
spatial::Emitter emitter_at_point(const sheet::Vec3d& position_m, const sheet::Vec3d& normal) {
  spatial::Emitter emitter;
  emitter.position_m = position_m;
  emitter.normal = spatial::normalized(normal, {0, 0, 1});
  emitter.cosine_floor = 1;
  return emitter;
}

sheet::Vec3d normal_of(const std::vector<observation::Resonator>& resonators) {
  const auto largest = std::ranges::max_element(resonators, {}, &observation::Resonator::area_m2);
  return largest == resonators.end() ? sheet::Vec3d(sheet::Vec3d::UnitZ()) : largest->normal;
}

double distance_m(const spatial::Vec3& a, const sheet::Vec3d& b) {
  return spatial::norm(a - spatial::Vec3(b));
}

}  // namespace

ClothTargets::ClothTargets(std::shared_ptr<const cloth::PreparedCorpus> corpus, const PlanOptions& options,
                           std::uint64_t seed, SampleTime begin)
    : corpus_(std::move(corpus)),
      options_(options),
      seed_(seed),
      begin_(begin),
      track_(corpus_->corpus().friction.speed_threshold_m_per_s),
      target_(corpus_, seed, kClothPatches, heard() ? corpus_->channels() : 0),
      patches_(kClothPatches) {}

// ------------------------------------------------------------------------------------------------------------ patches

bool ClothTargets::rests(const Patch& patch) const noexcept {
  const auto memory = static_cast<std::int64_t>(corpus_->memory_units() + 1) * corpus_->unit_samples();
  return patch.episodes.empty() && newest_ > patch.sounds_until + memory;
}

std::optional<std::size_t> ClothTargets::free_patch() const {
  for (std::size_t p = 0; p < patches_.size(); ++p) {
    if (patches_[p].places.empty() || rests(patches_[p])) return p;
  }
  return std::nullopt;
}

std::size_t ClothTargets::nearest(const sheet::Vec3d& position_m) const {
  std::size_t best = 0;
  double least_m = std::numeric_limits<double>::infinity();
  for (std::size_t p = 0; p < patches_.size(); ++p) {
    if (patches_[p].places.empty()) continue;
    const double d = distance_m(patches_[p].places.back().emitter.position_m, position_m);
    if (d < least_m) {
      least_m = d;
      best = p;
    }
  }
  return best;
}

std::size_t ClothTargets::patch_of(const FrictionContact& contact) {
  for (std::size_t p = 0; p < patches_.size(); ++p) {
    if (std::ranges::find(patches_[p].episodes, contact.id) != patches_[p].episodes.end()) return p;
  }
  const auto free = free_patch();
  const std::size_t p = free ? *free : nearest(contact.position_m);
  if (free) patches_[p].places.clear();
  if (patches_[p].places.empty()) move(p, emitter_at_point(contact.position_m, normal_of(contact.resonators)));
  patches_[p].episodes.push_back(contact.id);
  return p;
}

/// The nearest patch that sounds within reach, else a free one.
std::size_t ClothTargets::patch_near(const sheet::Vec3d& position_m) const {
  const std::size_t near = nearest(position_m);
  const Patch& patch = patches_[near];
  const bool within =
      !patch.places.empty() && !rests(patch) && distance_m(patch.places.back().emitter.position_m, position_m) < kReach_m;
  return within ? near : free_patch().value_or(near);
}

void ClothTargets::move(std::size_t patch, const spatial::Emitter& emitter) {
  auto& places = patches_[patch].places;
  if (!places.empty() && places.back().at >= newest_) {
    places.back().emitter = emitter;
  } else {
    places.push_back({newest_, emitter});
  }
}

spatial::Emitter ClothTargets::emitter_at(std::size_t patch, std::int64_t at) const {
  const auto& places = patches_[patch].places;
  if (places.empty()) return {};
  const auto after = std::ranges::upper_bound(places, at, {}, &Place::at);
  if (after == places.begin()) return places.front().emitter;
  if (after == places.end()) return places.back().emitter;
  const Place &a = *(after - 1), &b = *after;
  return between(a.emitter, b.emitter, static_cast<double>(at - a.at) / static_cast<double>(b.at - a.at));
}

// ------------------------------------------------------------------------------------------------------------- targets

void ClothTargets::add(const Observation& observation, std::span<const ClothTouch> touches, bool crumples,
                       const ClothEars& ears) {
  const std::int64_t to = to_sample(options_, observation.time_s) - begin_;
  const std::int64_t from = std::min(to, to_sample(options_, observation.previous_time_s) - begin_);
  newest_ = std::max(newest_, to);
  for (Patch& patch : patches_) {
    std::erase_if(patch.episodes, [&](std::uint64_t id) {
      return std::ranges::none_of(touches, [&](const ClothTouch& touch) { return touch.contact->id == id; });
    });
  }
  auto samples = place_contacts(touches);
  if (crumples) add_events(observation);
  if (heard()) listen(ears);
  // A speed is the mean of its interval: it is that of the interval's middle.
  const std::int64_t middle = from + (to - from) / 2;
  if (to > from && (track_.empty() || middle > track_.newest())) track_.add(middle, std::move(samples));
  while (track_.settled_at(target_.next_clip())) go_on();
}

/// The vertices in contact; patches go to where those slide.
std::vector<ContactSample> ClothTargets::place_contacts(std::span<const ClothTouch> touches) {
  struct Centre {
    double weight = 0, heaviest = 0;
    sheet::Vec3d sum = sheet::Vec3d::Zero(), normal = sheet::Vec3d::UnitZ();
  };
  std::vector<Centre> centres(patches_.size());
  std::map<std::uint32_t, ContactSample> samples;
  for (const auto& [contact, area_share] : touches) {
    const std::size_t patch = patch_of(*contact);
    const double weight = contact->area_m2 * std::pow(contact->speed_m_per_s + kCreep_m_per_s, 2);
    Centre& centre = centres[patch];
    centre.sum += weight * contact->position_m;
    centre.weight += weight;
    if (weight > centre.heaviest) {
      centre.heaviest = weight;
      centre.normal = normal_of(contact->resonators);
    }
    if (contact->speed_m_per_s > 0) patches_[patch].sounds_until = newest_ + target_.hop();
    for (const observation::VertexContact& vertex : contact->vertices) {
      const auto area = static_cast<float>(area_share * static_cast<double>(vertex.area_m2));
      const ContactSample sample{vertex.vertex, vertex.slip_velocity_m_per_s.norm(), area,
                                 static_cast<std::uint32_t>(patch)};
      if (!std::isfinite(sample.speed_m_per_s) || !(sample.area_m2 > 0)) continue;
      const auto [known, fresh] = samples.try_emplace(vertex.vertex, sample);
      if (!fresh && sample.area_m2 > known->second.area_m2) known->second = sample;
    }
  }
  for (std::size_t p = 0; p < patches_.size(); ++p) {
    if (centres[p].weight > 0) move(p, emitter_at_point(centres[p].sum / centres[p].weight, centres[p].normal));
  }
  std::vector<ContactSample> out;
  out.reserve(samples.size());
  for (const auto& [vertex, sample] : samples) out.push_back(sample);
  return out;
}

void ClothTargets::add_events(const Observation& observation) {
  const auto& crumpling = corpus_->corpus().crumpling;
  if (!crumpling) return;
  for (const CrumplingEvent& event : observation.crumpling) {
    const auto unit = pack::crumpling_unit_for(*crumpling, event.amplitude_m);
    if (!unit) continue;
    std::int64_t onset = to_sample(options_, event.time_s) - begin_;
    if (options_.mode == Mode::kPublished) {
      const double late_s = kPublishedJitter_s * dsp::to_uniform(dsp::hash(seed_, event.id));
      onset += std::llround(late_s * options_.rate_hz);
    }
    const std::size_t index = patch_near(event.position_m);
    Patch& patch = patches_[index];
    if (patch.episodes.empty()) {
      if (rests(patch)) patch.places.clear();
      move(index, emitter_at_point(event.position_m, normal_of(event.resonators)));
    }
    target_.pop(onset, index, *unit);
    const auto length = static_cast<std::int64_t>(crumpling->units[*unit].samples.size());
    patch.sounds_until = std::max(patch.sounds_until, std::max(onset, settled()) + length);
  }
}

void ClothTargets::listen(const ClothEars& ears) {
  for (std::size_t p = 0; p < patches_.size(); ++p) {
    if (patches_[p].places.empty()) continue;
    target_.hear_through(p, heard_filters(patches_[p].places.back().emitter, ears.listener, ears.planes, options_));
  }
}

void ClothTargets::end() {
  const std::int64_t over =
      (track_.empty() ? newest_ : std::max(newest_, track_.newest())) + std::llround(kEndRamp_s * options_.rate_hz);
  if (!track_.empty()) track_.add(over, {});
  std::int64_t last = over;
  for (const Patch& patch : patches_) last = std::max(last, patch.sounds_until);
  while (settled() < last + target_.hop()) go_on();
}

void ClothTargets::forget(std::int64_t before) {
  target_.forget(before);
  track_.forget(target_.next_clip());
  for (Patch& patch : patches_) {
    while (patch.places.size() > 1 && patch.places[1].at <= before) patch.places.pop_front();
  }
}

}  // namespace rustle::synthesis
