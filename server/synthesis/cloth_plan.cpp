#include "server/synthesis/cloth_plan.h"

#include <algorithm>
#include <limits>
#include <list>
#include <map>
#include <utility>
#include <vector>

#include "server/sheet/transfer.h"
#include "server/synthesis/cloth_stream.h"
#include "sound_db/dsp/random.h"

namespace rustle::synthesis {
namespace {

class ClothPlan final : public PlanModel {
 public:
  explicit ClothPlan(const PlanOptions& options) : options_(options) {}

  void plan(const SheetPlan& sheet, const observation::Observation& observation, SampleTime,
            std::vector<Cue>& out) override {
    const auto known = sheets_.find(sheet.id);
    if (known == sheets_.end() && !sheet.material->corpus()) return;
    State& state = sheets_[sheet.id];
    follow(state, observation);
    Touches touches;
    if (sheet.material->corpus()) touches_of(*sheet.material, touches);
    for (const observation::FrictionContact& contact : observation.friction) {
      const Material& own = sheet.on(contact.touched_surface);
      const Material* partner = sheet.partner(contact.touched_surface);
      const bool mixed = partner != nullptr && own.corpus() && partner->corpus() != own.corpus();
      if (own.corpus()) touches_of(own, touches).push_back({&contact, mixed ? 0.5 : 1});
      if (mixed) touches_of(*partner, touches).push_back({&contact, 0.5});
    }
    end_unused(sheet, state, out);
    for (const auto& [material, list] : touches) begin(sheet, *material, observation, state);
    for (auto& [material, stream] : state.streams)
      stream.add(observation, touches_of(*material, touches), material == sheet.material, ears_, out);
  }

  void release(SampleTime, std::vector<Cue>&) override {}

  void place(const spatial::Listener& listener, std::span<const spatial::Plane> planes) override {
    ears_.listener = listener;
    ears_.planes.assign(planes.begin(), planes.end());
  }

  SampleTime settled(sheet::SheetId id) const override {
    SampleTime settled = std::numeric_limits<SampleTime>::max();
    const auto found = sheets_.find(id);
    if (found == sheets_.end()) return settled;
    for (const auto& [material, stream] : found->second.streams) settled = std::min(settled, stream.settled());
    return settled;
  }

  void complete(SampleTime until, std::vector<Cue>& out) override {
    for (auto& [id, state] : sheets_) {
      for (auto& [material, stream] : state.streams) stream.complete(until, out);
    }
  }

  void end_sheet(const SheetPlan& sheet, SampleTime, std::vector<Cue>& out) override {
    const auto found = sheets_.find(sheet.id);
    if (found == sheets_.end()) return;
    for (auto& [material, stream] : found->second.streams) stream.end(out);
    found->second.streams.clear();
  }

  void add_counters(PlanCounters&) const override {}

  void forget(const Material& material) override {
    for (auto& [id, state] : sheets_) std::erase_if(state.streams, [&](const auto& s) { return s.first == &material; });
  }

 private:
  // Both in the order in which they came, so that nothing depends on where materials lie in memory.
  using Streams = std::list<std::pair<const Material*, ClothStream>>;
  using Touches = std::list<std::pair<const Material*, std::vector<ClothTouch>>>;
  struct State {
    Streams streams;
    std::uint64_t begun = 0;  ///< streams so far
    std::shared_ptr<const sheet::Topology> topology;
  };

  static std::vector<ClothTouch>& touches_of(const Material& material, Touches& touches) {
    const auto found = std::ranges::find(touches, &material, &Touches::value_type::first);
    if (found != touches.end()) return found->second;
    return touches.emplace_back(&material, std::vector<ClothTouch>()).second;
  }

  /// Contacts go along with the material where the mesh is made anew (C1).
  static void follow(State& state, const observation::Observation& observation) {
    const auto before = std::exchange(state.topology, observation.topology);
    const auto& now = state.topology;
    if (!before || !now || before == now || sheet::same_structure(*before, *now)) return;
    for (auto& [material, stream] : state.streams) {
      if (observation.origins.empty()) {
        stream.forget_vertices();
      } else {
        stream.renumber(observation.origins);
      }
    }
  }

  /// The sheet has other packs than before.
  static void end_unused(const SheetPlan& sheet, State& state, std::vector<Cue>& out) {
    const auto used = [&](const Material* material) {
      const auto in = [&](const auto& others) {
        return std::ranges::any_of(others, [&](const auto& other) { return other.second == material; });
      };
      return material == sheet.material || in(sheet.by_surface) || in(sheet.partners);
    };
    for (auto& [material, stream] : state.streams) {
      if (!used(material)) stream.end(out);
    }
    std::erase_if(state.streams, [&](const auto& s) { return !used(s.first); });
  }

  void begin(const SheetPlan& sheet, const Material& material, const observation::Observation& observation, State& state) {
    if (std::ranges::find(state.streams, &material, &Streams::value_type::first) != state.streams.end()) return;
    const std::uint64_t seed = dsp::hash(options_.seed, sheet.id, state.begun++);
    state.streams.emplace_back(&material, ClothStream(material.corpus(), options_, bus_of(sheet.index, SoundKind::kFriction),
                                                      seed, to_sample(options_, observation.previous_time_s)));
  }

  PlanOptions options_;
  ClothEars ears_;
  std::map<sheet::SheetId, State> sheets_;
};

}  // namespace

std::unique_ptr<PlanModel> make_cloth_plan(const PlanOptions& options) {
  return std::make_unique<ClothPlan>(options);
}

}  // namespace rustle::synthesis
