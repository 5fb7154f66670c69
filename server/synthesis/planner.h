#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "server/observation/observation.h"
#include "server/spatial/listener.h"
#include "server/synthesis/cue.h"
#include "server/synthesis/dense_bursts.h"
#include "server/synthesis/gain.h"
#include "server/synthesis/material.h"
#include "server/synthesis/sound_model.h"

namespace rustle::synthesis {

inline constexpr double kGainRamp_s = 0.02;
inline constexpr double kLeastMotion_s = 0.01;  ///< a listener or plane takes at least so long to its new place ...
inline constexpr double kMostMotion_s = 0.1;    ///< ... and at most so long, whatever time the sender let pass

/// A sheet's sounds: the pack of its material on the surface it touches by default, and on others by name.
struct SheetSetup {
  sheet::SheetId id = 0;
  int index = 0;  ///< its place among the buses, 0 .. max_sheets - 1
  std::shared_ptr<const pack::SoundPack> pack;
  std::map<std::string, std::shared_ptr<const pack::SoundPack>> by_surface;
  bool fine_events = true;                     ///< below what the mesh shows (P13)
  std::optional<double> grammage_kg_per_m2{};  ///< absent: the pack's
};

struct IdentifiedPlane {
  std::uint64_t id = 0;
  spatial::Plane plane;
};

/// Observations, listener, planes and gains into cues. Everything here runs on one thread at a time. [analysis worker]
///
/// `earliest` is everywhere the promise already given to the render side: no cue starts before it. Times become samples by
/// round((time - origin) · rate). Random choices are seeded by (session seed, sheet, event), so cues do not depend on when
/// things come. Cues point into packs and into tables made from them: a planner keeps both until forget_silent() lets go of
/// them, and must outlive the mixer that plays its cues.
class Planner {
 public:
  explicit Planner(const PlanOptions& options);
  ~Planner();
  Planner(const Planner&) = delete;
  Planner& operator=(const Planner&) = delete;

  /// Adds a sheet, or gives it another pack; its buses take the gains in force at once. What sounds goes on as it began,
  /// what begins has the new pack, friction goes over to it with the next observation. \pre every pack is loaded at
  /// options.rate_hz
  void add_sheet(const SheetSetup& setup, SampleTime earliest, std::vector<Cue>& out);

  /// The sheet touches cloth of another material, whose sounds are these (C9), until it is added anew. \pre pack is of
  /// cloth, at options.rate_hz
  void add_partner(sheet::SheetId id, const std::string& material, const std::shared_ptr<const pack::SoundPack>& pack);

  /// What the sheet did. Friction becomes cues at once; crumpling waits for `release`, so that what continues an event can
  /// still join it. An unknown sheet is ignored.
  void plan(const observation::Observation& observation, SampleTime earliest, std::vector<Cue>& out);

  /// Hands over the waiting cues that start before `until`, and those of the same 2 ms slots: dense bursts are merged (P9).
  /// To be called before `until` is promised to the render side.
  void release(SampleTime until, std::vector<Cue>& out);

  /// Sound before `until` is about to be promised or rendered, whatever is still to come: cloth, which looks ahead, goes on
  /// as it is as far as is needed for it.
  void complete(SampleTime until, std::vector<Cue>& out);
  /// No cue of the sheet that plan() hands out will start before this sample: cloth looks ahead.
  SampleTime settled(sheet::SheetId id) const;
  /// How much later than its own time the sound of frames at 60 a second or more is settled, for the sheets there are: 0
  /// without cloth (C5). Where sound follows the clock, all sheets are heard so much later.
  SampleTime latency() const;

  /// The listener is there at time_s; it moves there from the time of its last pose.
  void listener(const spatial::Listener& listener, double time_s, SampleTime earliest, std::vector<Cue>& out);

  /// All reflecting planes at time_s, known by their ids; those that are new fade in, those that are missing fade out.
  void planes(std::span<const IdentifiedPlane> planes, double time_s, SampleTime earliest, std::vector<Cue>& out);

  /// All gains in force from `time` on; buses go there within kGainRamp_s.
  void gains(std::vector<Gain> gains, SampleTime time, std::vector<Cue>& out);

  /// From `time` on dense bursts are merged over so many slots as one, and at most so many units sound at a time.
  void economize(int joined_slots, int most_voices, SampleTime time, std::vector<Cue>& out);

  /// Lets go of packs that no sheet has any more, once their last sound has died away. `settled`: all cues that were handed
  /// out have reached the mixer, and sound before this sample has been rendered.
  void forget_silent(SampleTime settled);

  /// What sustains of the sheet ends within 20 ms; its next observation starts it anew.
  void quieten(sheet::SheetId id, SampleTime time, std::vector<Cue>& out);

  /// No observation of the sheet will come. Its waiting events still sound; what sustains ends within 20 ms.
  void end_sheet(sheet::SheetId id, SampleTime time, std::vector<Cue>& out);

  PlanCounters counters() const;

 private:
  struct PlaneSlot {
    bool used = false;
    std::uint64_t id = 0;
    spatial::Plane plane;
    SampleTime free_from = 0;
  };
  struct Motion {
    SampleTime start = 0, end = 0;
  };
  struct KnownMaterial {
    std::shared_ptr<const Material> material;
    bool in_use = true;               ///< some sheet has it
    SampleTime planned_until = 0;     ///< not in use: no cue of it starts later
    std::optional<SampleTime> until;  ///< not in use: the last of it has sounded by then; absent: not all cues are there yet
  };

  const Material* material(const std::shared_ptr<const pack::SoundPack>& pack);
  void see_who_uses_materials();
  void tell_places();
  float bus_gain(const SheetPlan& sheet, SoundKind kind) const;
  void send_gains(const SheetPlan& sheet, SampleTime start, SampleTime end, std::vector<Cue>& out);
  Motion motion(double time_s, SampleTime previous, SampleTime earliest) const;
  SampleTime samples(double duration_s) const;

  PlanOptions options_;
  std::vector<std::unique_ptr<PlanModel>> models_;
  std::vector<KnownMaterial> materials_;
  std::map<sheet::SheetId, SheetPlan> sheets_;
  std::map<Bus, float> sent_gains_;
  std::vector<Gain> gains_;
  SampleTime planned_until_ = 0;  ///< no cue that was handed out or waits starts later
  bool placed_ = false;
  spatial::Listener listener_;
  SampleTime listener_time_ = 0;
  SampleTime planes_time_ = 0;
  std::array<PlaneSlot, spatial::kMaxPlanes> slots_;
  std::uint64_t planes_left_out_ = 0;
  DenseBursts bursts_;
};

}  // namespace rustle::synthesis
