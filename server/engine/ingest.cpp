#include "server/engine/ingest.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <set>
#include <string>
#include <tuple>
#include <utility>

#include "server/engine/economy.h"
#include "server/spatial/listener.h"

namespace rustle::engine {
namespace {

using synthesis::kQuantum;
using synthesis::SampleTime;

constexpr double kMostSilence_s = 600;  // between frames of the simulation clock
constexpr double kLiveDue_s = 0.02;     // a live session's next frame has come by then
constexpr double kDefaultDistance_m = 1.0;
constexpr double kDefaultElevation_rad = 30.0 * 3.14159265358979323846 / 180.0;

synthesis::PlanOptions plan_options(const Options& options) {
  synthesis::PlanOptions out;
  out.seed = options.seed;
  out.mode = options.mode == Mode::kPublished ? synthesis::Mode::kPublished : synthesis::Mode::kCorrected;
  out.rate_hz = static_cast<std::uint32_t>(options.rate_hz);
  out.origin_s = 0;
  out.friction_fft_size = options.friction_fft_size;
  out.cloth_search = options.cloth_search;
  out.layout = spatial_layout(options.layout);
  out.hrtf = options.hrtf;
  return out;
}

sheet::Vec3d centroid_of(const sheet::MeshFrame& frame) {
  sheet::Vec3d sum = sheet::Vec3d::Zero();
  for (const auto& p : frame.positions_m) sum += p.cast<double>();
  return frame.positions_m.empty() ? sum : sheet::Vec3d(sum / static_cast<double>(frame.positions_m.size()));
}

}  // namespace

struct Ingest::SheetState {
  SheetState(const SheetDescription& described, int place)
      : description(described), index(place), analyzer(described.id, analysis::Parameters{}) {}

  SheetDescription description;  ///< material and touched surface as in force
  int index;
  analysis::SheetAnalyzer analyzer;
  std::optional<sheet::MeshFrame> newest, previous;
  std::set<std::string> partners;        ///< touched surfaces that were looked for among the packs of cloth
  std::vector<sheet::SentTearTip> tips;  ///< sent between frames: judged with the next one
  bool quiet = true;                     ///< no contact of it sounds
};

Ingest::Ingest(Options options, std::shared_ptr<pack::PackLibrary> packs)
    : options_(std::move(options)),
      packs_(std::move(packs)),
      planner_(plan_options(options_)),
      mapping_{options_.time_origin_s, 0, static_cast<double>(options_.rate_hz), 0},
      advanced_s_(-std::numeric_limits<double>::infinity()),
      newest_s_(options_.time_origin_s) {
  std::vector<synthesis::Cue> none;  // there is no sheet yet
  planner_.gains(options_.gains, 0, none);
}

Ingest::~Ingest() = default;

SampleTime Ingest::sample_of(double time_s) const {
  return static_cast<SampleTime>(std::llround(mapping_.position(time_s)));
}

double Ingest::on_sample_axis(double time_s) const {
  // A rate of exactly 1 leaves simulation time as it is, bit for bit.
  const double rate = mapping_.samples_per_s / options_.rate_hz;
  return static_cast<double>(mapping_.first_sample) / options_.rate_hz + (time_s - mapping_.first_time_s) * rate;
}

Ingest::Taken Ingest::accept(const StreamItem& item, CueBatch& batch) {
  auto taken = std::visit([&](const auto& it) { return take(it, batch); }, item);
  settle_horizon(batch);
  return taken;
}

// ------------------------------------------------------------------------------------------------------------- sheets

Ingest::Taken Ingest::take(const SheetDescription& description, CueBatch& batch) {
  const bool known = sheets_.contains(description.id);
  if (!known && static_cast<int>(sheets_.size()) >= options_.max_sheets) {
    return tl::unexpected(Refusal{Refusal::Cause::kTooMany, "sheet",
                                  fmt::format("The session has {} sheets, as many as it may have.", sheets_.size()),
                                  "Open another session for more sheets."});
  }
  SheetDescription settled = description;
  if (settled.material.empty()) settled.material = options_.default_material;
  if (options_.every_material) settled.material = *options_.every_material;
  if (settled.touched_surface.empty()) settled.touched_surface = options_.default_surface;
  auto setup = sounds_of(settled, "sheet.material");
  if (!setup) return tl::unexpected(std::move(setup.error()));
  auto& state = sheets_[description.id];
  if (!known) {
    state = std::make_unique<SheetState>(description, static_cast<int>(sheets_.size()) - 1);
    batch.new_sheet = description.id;
  }
  state->description = std::move(settled);
  state->partners.clear();
  ++changes_;
  setup->index = state->index;
  planner_.add_sheet(*setup, earliest_, batch.cues);
  return std::nullopt;
}

tl::expected<synthesis::SheetSetup, Refusal> Ingest::sounds_of(const SheetDescription& settled, std::string field) {
  const std::string& material = settled.material;
  const auto rate = static_cast<std::uint32_t>(options_.rate_hz);
  auto pack = packs_->load(material, settled.touched_surface, rate);
  if (!pack) {
    return tl::unexpected(
        Refusal{Refusal::Cause::kUnknownMaterial, std::move(field), pack.error().message + ".", pack.error().remedy});
  }
  synthesis::SheetSetup setup{settled.id, 0, *pack, {}};
  for (const auto& entry : packs_->entries()) {
    if (entry.material != material || entry.touched_surface == (*pack)->touched_surface) continue;
    if (auto other = packs_->load(material, entry.touched_surface, rate)) setup.by_surface[entry.touched_surface] = *other;
  }
  setup.fine_events = options_.fine_events.value_or(settled.kind == SheetKind::kPaper);
  setup.grammage_kg_per_m2 = settled.grammage_kg_per_m2;
  return setup;
}

Ingest::Taken Ingest::take(const sheet::MeshFrame& sent, CueBatch& batch) {
  const auto found = sheets_.find(sent.sheet);
  if (found == sheets_.end()) {
    return tl::unexpected(Refusal{Refusal::Cause::kUnknownSheet, "frame.sheet_id",
                                  fmt::format("Sheet {} was not accepted.", sent.sheet),
                                  "Describe the sheet with a material that a sound pack has."});
  }
  SheetState& state = *found->second;
  if (state.newest && sent.time_s <= state.newest->time_s) {
    return tl::unexpected(Refusal{
        Refusal::Cause::kTimeOrder, "frame.time_s",
        fmt::format("Sheet {} has been at {} s already; {} s is not later.", sent.sheet, state.newest->time_s, sent.time_s),
        "Send each sheet's frames in order of time."});
  }
  if (!live_ && sent.time_s > newest_s_ + kMostSilence_s) {
    return tl::unexpected(Refusal{Refusal::Cause::kTimeOrder, "frame.time_s",
                                  fmt::format("A frame at {} s, after {} s, would mean {:.0f} s of silence.", sent.time_s,
                                              newest_s_, sent.time_s - newest_s_),
                                  "Send times in seconds, and begin the session at its first frame (time_origin_s)."});
  }
  sheet::MeshFrame frame = sent;
  if (frame.tear_tips.empty()) frame.tear_tips = std::exchange(state.tips, {});
  sheets_centre_m_ = centroid_of(frame);
  if (!listener_) {
    place_default_listener(frame, batch);
  } else if (!listener_->forward) {
    plan_listener(*listener_, frame.time_s, batch);
  }
  plan_planes(frame.time_s, batch);

  std::vector<analysis::NeighbourSheet> others;
  for (const auto& [id, other] : sheets_) {
    if (id == frame.sheet || !other->newest) continue;
    const bool comparable = other->previous && other->previous->topology == other->newest->topology;
    others.push_back({id, &*other->newest, comparable ? &*other->previous : nullptr, other->description.material});
  }
  const analysis::SheetSurroundings surroundings{&scene_, others, state.description.touched_surface,
                                                 state.description.material};
  auto observed = state.analyzer.analyze(frame, surroundings, next_event_id_, economy_at(load_level_).effort);
  state.quiet = observed.friction.empty() && observed.tears.empty();

  meet_partners(state, observed);
  plan(observed, batch);
  state.previous = std::move(state.newest);
  state.newest = std::move(frame);
  newest_s_ = std::max(newest_s_, state.newest->time_s);
  return observed;
}

void Ingest::meet_partners(SheetState& state, const observation::Observation& observed) {
  if (planner_.latency() == 0) return;  // no sheet is of cloth
  const auto& description = state.description;
  for (const auto& contact : observed.friction) {
    const std::string& surface = contact.touched_surface;
    if (surface.empty() || surface == description.material || !state.partners.insert(surface).second) continue;
    if (!packs_->find(surface)) continue;
    const auto pack = packs_->load(surface, description.material, static_cast<std::uint32_t>(options_.rate_hz));
    if (pack && (*pack)->cloth) planner_.add_partner(description.id, surface, *pack);
  }
}

void Ingest::plan(observation::Observation& observed, CueBatch& batch) {
  const double time_s = observed.time_s, previous_s = observed.previous_time_s;
  std::vector<std::pair<double, double>> events;
  for (auto& event : observed.crumpling) {
    events.emplace_back(event.time_s, event.confirmed_s);
    event.time_s = on_sample_axis(event.time_s);
    event.confirmed_s = on_sample_axis(event.confirmed_s);
  }
  observed.time_s = on_sample_axis(time_s);
  observed.previous_time_s = on_sample_axis(previous_s);
  planner_.plan(observed, earliest_, batch.cues);
  observed.time_s = time_s;
  observed.previous_time_s = previous_s;
  for (std::size_t k = 0; k < events.size(); ++k)
    std::tie(observed.crumpling[k].time_s, observed.crumpling[k].confirmed_s) = events[k];
}

Ingest::Taken Ingest::take(const TearTips& tips, CueBatch&) {
  const auto found = sheets_.find(tips.sheet);
  if (found == sheets_.end()) {
    return tl::unexpected(Refusal{Refusal::Cause::kUnknownSheet, "tear_tips.sheet_id",
                                  fmt::format("Sheet {} was not accepted.", tips.sheet),
                                  "Describe the sheet before its tear tips."});
  }
  found->second->tips = tips.tips;
  return std::nullopt;
}

// ------------------------------------------------------------------------------------------------------------ control

Ingest::Taken Ingest::take(const GainChange& change, CueBatch& batch) {
  std::vector<synthesis::Gain> gains = options_.gains;
  gains.insert(gains.end(), change.gains.begin(), change.gains.end());
  planner_.gains(std::move(gains), earliest_, batch.cues);
  return std::nullopt;
}

Ingest::Taken Ingest::take(const PackChange& change, CueBatch& batch) {
  const auto found = sheets_.find(change.sheet);
  if (found == sheets_.end()) {
    return tl::unexpected(Refusal{Refusal::Cause::kUnknownSheet, "change_pack.sheet_id",
                                  fmt::format("Sheet {} was not accepted.", change.sheet),
                                  "Describe the sheet before its pack is changed."});
  }
  SheetDescription settled = found->second->description;
  if (!change.material.empty() && !options_.every_material) settled.material = change.material;
  if (!change.touched_surface.empty()) settled.touched_surface = change.touched_surface;
  auto setup = sounds_of(settled, "change_pack.material");
  if (!setup) return tl::unexpected(std::move(setup.error()));
  setup->index = found->second->index;
  found->second->description = std::move(settled);
  found->second->partners.clear();
  ++changes_;
  planner_.add_sheet(*setup, earliest_, batch.cues);
  return std::nullopt;
}

Ingest::Taken Ingest::take(const PackReload&, CueBatch& batch) {
  std::optional<Refusal> first;
  for (const auto& [id, state] : sheets_) {
    auto setup = sounds_of(state->description, "reload_pack.name");
    if (!setup) {  // keeps what it has
      if (!first) first = std::move(setup.error());
      continue;
    }
    setup->index = state->index;
    state->partners.clear();
    planner_.add_sheet(*setup, earliest_, batch.cues);
  }
  if (first) return tl::unexpected(std::move(*first));
  return std::nullopt;
}

Ingest::Taken Ingest::take(const LoadLevel& load, CueBatch& batch) {
  load_level_ = std::min(load.level, kMostLoadLevel);
  const Economy economy = economy_at(load_level_);
  planner_.economize(economy.joined_slots, economy.most_voices, earliest_, batch.cues);
  return std::nullopt;
}

// -------------------------------------------------------------------------------------------------------------- scene

Ingest::Taken Ingest::take(const scene::SceneUpdate& update, CueBatch& batch) {
  if (auto applied = scene_.apply(update); !applied) {
    return tl::unexpected(Refusal{Refusal::Cause::kScene, "scene", applied.error(), {}});
  }
  planes_known_ = false;
  ++scene_changes_;
  ++changes_;
  plan_planes(update.time_s, batch);
  return std::nullopt;
}

void Ingest::plan_planes(double time_s, CueBatch& batch) {
  std::vector<synthesis::IdentifiedPlane> planes;
  for (const auto& plane : scene_.reflecting_planes(time_s)) {
    planes.push_back({plane.id, {plane.point_m, plane.normal, plane.reflection_coefficient}});
  }
  if (planes.empty() && planes_known_) return;
  planes_known_ = true;
  planner_.planes(planes, on_sample_axis(time_s), earliest_, batch.cues);
}

Ingest::Taken Ingest::take(const scene::Listener& listener, CueBatch& batch) {
  listener_ = listener;
  listener_told_ = true;
  plan_listener(listener, listener.time_s, batch);
  return std::nullopt;
}

Ingest::Taken Ingest::take(const ListenerMove& move, CueBatch& batch) {
  scene::Listener listener = listener_.value_or(scene::Listener{});
  if (!listener_told_) listener.forward.reset();
  listener.position_m = move.position_m;
  listener.time_s = std::isfinite(newest_s_) ? newest_s_ : mapping_.first_time_s;
  listener_ = listener;
  plan_listener(listener, listener.time_s, batch);
  return std::nullopt;
}

void Ingest::place_default_listener(const sheet::MeshFrame& frame, CueBatch& batch) {
  const sheet::Vec3d away(0, -std::cos(kDefaultElevation_rad), std::sin(kDefaultElevation_rad));
  scene::Listener listener;
  listener.time_s = frame.time_s;
  listener.position_m = sheets_centre_m_ + kDefaultDistance_m * away;
  listener.forward = -away;
  listener_ = listener;
  plan_listener(listener, frame.time_s, batch);
}

void Ingest::plan_listener(const scene::Listener& listener, double time_s, CueBatch& batch) {
  ++changes_;
  sheet::Vec3d forward = listener.forward.value_or(sheets_centre_m_ - listener.position_m);
  if (forward.norm() < 1e-9) forward = sheet::Vec3d::UnitY();
  planner_.listener({listener.position_m, sheet::Vec3d(forward.normalized()), listener.up}, on_sample_axis(time_s),
                    earliest_, batch.cues);
}

// --------------------------------------------------------------------------------------------------------------- time

Ingest::Taken Ingest::take(const Advance& advance, CueBatch&) {
  advanced_s_ = std::max(advanced_s_, std::min(advance.time_s, newest_s_ + kMostSilence_s));
  return std::nullopt;
}

Ingest::Taken Ingest::take(const End& end, CueBatch& batch) {
  advanced_s_ = std::max({advanced_s_, newest_s_, std::min(end.time_s.value_or(newest_s_), newest_s_ + kMostSilence_s)});
  for (const auto& [id, state] : sheets_) planner_.end_sheet(id, std::max(earliest_, sample_of(newest_s_)), batch.cues);
  planner_.release(std::numeric_limits<SampleTime>::max(), batch.cues);
  batch.end = true;
  return std::nullopt;
}

void Ingest::fall_quiet(CueBatch& batch) {
  for (const auto& [id, state] : sheets_) {
    if (state->quiet) continue;
    planner_.quieten(id, earliest_, batch.cues);
    state->quiet = true;
  }
  settle_horizon(batch);
}

Surroundings Ingest::surroundings(std::shared_ptr<const scene::SceneState> scene) const {
  if (!scene) scene = std::make_shared<const scene::SceneState>(scene_);
  Surroundings out{std::move(scene), listener_, std::vector<SheetDescription>(sheets_.size()),
                   std::isfinite(newest_s_) ? newest_s_ : mapping_.first_time_s};
  for (const auto& [id, state] : sheets_) out.sheets[static_cast<std::size_t>(state->index)] = state->description;
  return out;
}

std::optional<std::uint32_t> Ingest::place_of(sheet::SheetId sheet) const {
  const auto found = sheets_.find(sheet);
  if (found == sheets_.end()) return std::nullopt;
  return static_cast<std::uint32_t>(found->second->index);
}

std::vector<const sheet::MeshFrame*> Ingest::newest_frames() const {
  std::vector<const sheet::MeshFrame*> out;
  for (const auto& [id, state] : sheets_)
    if (state->newest) out.push_back(&*state->newest);
  return out;
}

void Ingest::start_again(CueBatch& batch) {
  fall_quiet(batch);
  newest_s_ = advanced_s_ = -std::numeric_limits<double>::infinity();
  scene_.start_again();
  for (const auto& [id, state] : sheets_) {
    state->newest.reset();  // its analyzer sees by itself that time has stepped back
    state->previous.reset();
    state->tips.clear();
  }
}

void Ingest::settle_horizon(CueBatch& batch) {
  if (live_) {
    planner_.complete(earliest_ + static_cast<SampleTime>(kLiveDue_s * options_.rate_hz), batch.cues);
    planner_.release(std::numeric_limits<SampleTime>::max(), batch.cues);
    return;
  }
  double complete_s = std::numeric_limits<double>::infinity();
  SampleTime settled = std::numeric_limits<SampleTime>::max();
  for (const auto& [id, state] : sheets_) {
    settled = std::min(settled, planner_.settled(id));
    complete_s = std::min(complete_s, state->newest ? state->newest->time_s - options_.look_ahead_s
                                                    : -std::numeric_limits<double>::infinity());
  }
  if (sheets_.empty()) complete_s = -std::numeric_limits<double>::infinity();
  const auto quantum_before = [](SampleTime sample) { return sample / kQuantum * kQuantum; };
  const auto reached = [&](double time_s) { return std::isfinite(time_s) ? quantum_before(sample_of(time_s)) : 0; };
  horizon_ = std::max({horizon_, std::min(reached(complete_s), quantum_before(settled)), reached(advanced_s_)});
  planner_.complete(horizon_, batch.cues);
  earliest_ = horizon_;
  planner_.release(horizon_, batch.cues);
  batch.horizon = horizon_;
}

}  // namespace rustle::engine
