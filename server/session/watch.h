#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <variant>
#include <vector>

#include "server/engine/ingest.h"
#include "server/observation/observation.h"
#include "server/session/clock.h"
#include "server/session/spsc_ring.h"
#include "server/sheet/mesh_frame.h"

namespace rustle::session {

/// A sheet as a frame showed it. `place`: the sheet's in engine::Surroundings::sheets, here and below.
struct SeenFrame {
  std::uint32_t place = 0;
  sheet::MeshFrame frame;
};
/// What happened in a frame.
struct SeenEvents {
  struct Crumple {
    sheet::Vec3d position_m;
    double amplitude_m = 0, area_m2 = 0;
  };
  struct Contact {
    sheet::Vec3d position_m;
    double slip_m_per_s = 0, area_m2 = 0;
  };
  struct Tear {
    sheet::Vec3d position_m;
    double speed_m_per_s = 0;
  };
  std::uint32_t place = 0;
  double time_s = 0;
  std::vector<Crumple> crumples;
  std::vector<Contact> contacts;
  std::vector<Tear> tears;
};
using Seen = std::variant<SeenFrame, SeenEvents, engine::Surroundings>;

/// What somebody who watches a session sees: handed over by the analysis worker, which never waits for it. A sheet's frames
/// come at most kFramesPerSecond a second; of who looks too seldom, what does not fit is left out and counted.
///
///   analysis ── frames, events, surroundings ──► viewer
class Watch {
 public:
  static constexpr int kFramesPerSecond = 30;

  // ---- [viewer], one thread

  /// The next thing seen, at first everything as it is; false: nothing new.
  bool next(Seen& seen);

  // ---- [any thread]

  std::uint64_t frames_taken() const { return frames_taken_.load(std::memory_order_relaxed); }
  std::uint64_t left_out() const { return left_out_.load(std::memory_order_relaxed); }

  // ---- [analysis worker]

  /// A frame was analysed, and is not needed any more.
  void saw(const engine::Ingest& ingest, sheet::MeshFrame&& frame, const observation::Observation& observed,
           WallClock::Duration now);
  /// Something else was taken in, or there was a turn.
  void look(const engine::Ingest& ingest);

 private:
  static constexpr std::size_t kWaiting = 256;  // a fifth of a second of 64 sheets is left out of more

  bool is_due(sheet::SheetId sheet, WallClock::Duration now);
  void put(Seen seen);

  SpscRing<std::unique_ptr<Seen>> seen_{kWaiting};
  std::atomic<std::uint64_t> frames_taken_{0}, left_out_{0};
  std::map<sheet::SheetId, WallClock::Duration> due_;  // analysis worker, as below
  bool begun_ = false;
  std::shared_ptr<const scene::SceneState> scene_;
  std::uint64_t scene_changes_ = 0, changes_ = 0;
};

}  // namespace rustle::session
