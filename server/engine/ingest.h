#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <tl/expected.hpp>

#include "server/analysis/sheet_analyzer.h"
#include "server/engine/cue_batch.h"
#include "server/engine/options.h"
#include "server/engine/stream_item.h"
#include "server/engine/time_mapping.h"
#include "server/scene/scene_state.h"
#include "server/synthesis/planner.h"
#include "sound_db/pack/library.h"

namespace rustle::engine {

/// Why an item was not taken. The session goes on without it.
struct Refusal {
  enum class Cause { kUnknownSheet, kUnknownMaterial, kTimeOrder, kTooMany, kScene, kFailed };
  Cause cause;
  std::string field, message, remedy;
};

/// What is around the sheets, for who looks on.
struct Surroundings {
  std::shared_ptr<const scene::SceneState> scene;
  std::optional<scene::Listener> listener;  ///< without forward: it looks toward the sheets
  std::vector<SheetDescription> sheets;     ///< in the order in which they were described
  double time_s = 0;                        ///< where obstacles move, they are shown as they are then
};

/// The first half of the engine: stream items in, batches of cues out, observations on the way.
///
///   item ─► scene, listener ─────────────────────────┐
///        └► frame ─► sheet analyzer ─► observation ─► planner ─► cue batch
///
/// Owns no thread, socket, file or clock. [analysis worker]
class Ingest {
 public:
  Ingest(Options options, std::shared_ptr<pack::PackLibrary> packs);
  ~Ingest();

  /// Takes the next item, appends its cues to `batch` and sets the batch's horizon. The observation is of a mesh frame.
  [[nodiscard]] tl::expected<std::optional<observation::Observation>, Refusal> accept(const StreamItem& item,
                                                                                      CueBatch& batch);

  // ---- live sessions, whose sample axis follows the audio clock

  /// From now on simulation time lies on the sample axis so.
  void map_time(const TimeMapping& mapping) { mapping_ = mapping; }
  /// Simulation time has stepped back: sheets are met anew, what sustains of them ends.
  void start_again(CueBatch& batch);
  /// Everything before `sample` has been rendered: what is planned from now on starts there or later.
  void set_rendered(synthesis::SampleTime sample) {
    earliest_ = sample;
    live_ = true;
  }
  /// Frames have stopped coming: contacts end instead of sounding on.
  void fall_quiet(CueBatch& batch);

  /// Every batch so far has been accepted by the render side, and sound before `sample` been rendered: packs that nothing
  /// plays any more can go.
  void settle(synthesis::SampleTime sample) { planner_.forget_silent(sample); }

  synthesis::SampleTime sample_of(double time_s) const;
  /// How much later than frames' own time cloth's sound is settled: see Planner.
  synthesis::SampleTime latency() const { return planner_.latency(); }
  synthesis::PlanCounters counters() const { return planner_.counters(); }

  // ---- for who looks on

  /// They grow with every change of what Surroundings hold: of the scene alone, and of anything.
  std::uint64_t scene_changes() const { return scene_changes_; }
  std::uint64_t changes() const { return changes_; }
  /// `scene`: the one given before, where it has not changed since; null: a copy is made.
  Surroundings surroundings(std::shared_ptr<const scene::SceneState> scene) const;
  /// The sheet's place in Surroundings::sheets.
  std::optional<std::uint32_t> place_of(sheet::SheetId sheet) const;
  /// Every sheet's newest frame, where it has one.
  std::vector<const sheet::MeshFrame*> newest_frames() const;

 private:
  struct SheetState;
  using Taken = tl::expected<std::optional<observation::Observation>, Refusal>;

  Taken take(const SheetDescription& description, CueBatch& batch);
  Taken take(const sheet::MeshFrame& frame, CueBatch& batch);
  Taken take(const scene::SceneUpdate& update, CueBatch& batch);
  Taken take(const scene::Listener& listener, CueBatch& batch);
  Taken take(const TearTips& tips, CueBatch& batch);
  Taken take(const Advance& advance, CueBatch& batch);
  Taken take(const End& end, CueBatch& batch);
  Taken take(const GainChange& change, CueBatch& batch);
  Taken take(const PackChange& change, CueBatch& batch);
  Taken take(const PackReload& reload, CueBatch& batch);
  Taken take(const LoadLevel& load, CueBatch& batch);
  Taken take(const ListenerMove& move, CueBatch& batch);

  /// The packs of a sheet's material, on its touched surface and on all others; the place among the buses is left open.
  tl::expected<synthesis::SheetSetup, Refusal> sounds_of(const SheetDescription& settled, std::string field);
  /// 1 m from the sheet's centroid, 30 degrees above the horizontal, on the -y side.
  void place_default_listener(const sheet::MeshFrame& frame, CueBatch& batch);
  void plan_listener(const scene::Listener& listener, double time_s, CueBatch& batch);
  /// Obstacles as they are when a frame is taken: planes that move are followed frame by frame.
  void plan_planes(double time_s, CueBatch& batch);
  /// Seconds since sample 0.
  double on_sample_axis(double time_s) const;
  /// Cloth of other materials that the sheet touches for the first time.
  void meet_partners(SheetState& state, const observation::Observation& observed);
  /// The observation's cues; its times are those of the sample axis meanwhile.
  void plan(observation::Observation& observed, CueBatch& batch);
  /// The promise: sound before this sample is complete once the batch has been applied.
  void settle_horizon(CueBatch& batch);

  const Options options_;
  const std::shared_ptr<pack::PackLibrary> packs_;
  scene::SceneState scene_;
  synthesis::Planner planner_;
  std::map<sheet::SheetId, std::unique_ptr<SheetState>> sheets_;
  std::optional<scene::Listener> listener_;
  bool listener_told_ = false;  ///< where it looks is the stream's word
  std::uint32_t load_level_ = 0;
  bool planes_known_ = false;
  sheet::Vec3d sheets_centre_m_ = sheet::Vec3d::Zero();  ///< of the newest frame: where a listener without forward looks
  TimeMapping mapping_;
  double advanced_s_;  ///< as far as an Advance said
  synthesis::SampleTime horizon_ = 0;
  synthesis::SampleTime earliest_ = 0;
  bool live_ = false;
  double newest_s_;
  std::uint64_t next_event_id_ = 1;
  std::uint64_t scene_changes_ = 0, changes_ = 0;
};

}  // namespace rustle::engine
