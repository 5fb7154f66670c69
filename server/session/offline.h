#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <variant>

#include <tl/expected.hpp>

#include "server/engine/ingest.h"
#include "server/engine/render.h"
#include "server/session/decision.h"
#include "sound_db/pack/library.h"

namespace rustle::session {

/// A step of a recorded session, to be taken again exactly as it was: see Step in decision.h.
struct DirectedItem {
  std::variant<engine::StreamItem, FellQuiet, RenderedTo> what;
  std::optional<engine::TimeMapping> mapping;
  std::optional<synthesis::SampleTime> earliest;
  synthesis::SampleTime accepted_at = 0;  ///< sound before it does not know of the step; does not decrease
  bool start_again = false;               ///< simulation time steps back here
};

/// What an offline render reads from and hands to. Calls come from the thread that calls render_offline, except
/// `next`, `next_directed`, `observed` and `refused`, which come from the analysis worker when there are two workers; never
/// two at once of a kind.
struct OfflineEnds {
  /// The next stream item; nothing at the end.
  std::function<std::optional<engine::StreamItem>()> next;
  /// Where given it takes the place of `next`: the steps of a recorded session. Rendering stops where the recording does.
  std::function<std::optional<DirectedItem>()> next_directed;
  std::function<void(const observation::Observation&)> observed;
  std::function<void(const engine::Refusal&)> refused;
  /// Finished sound. False stops the render.
  std::function<bool(const engine::AudioQuantum&)> audio;
};

struct OfflineSummary {
  std::int64_t samples = 0;
  std::uint64_t frames = 0;
  std::uint64_t refused = 0;
  synthesis::PlanCounters plan;
  engine::RenderCounters render;
  std::uint64_t emitter_samples_left_out = 0;
  double analysis_s = 0;   ///< spent in analysis
  double synthesis_s = 0;  ///< spent in synthesis
};

/// Drives one engine from a source to a sink as fast as it goes: on the simulation clock, or as a recording directs. With
/// two workers or more, analysis runs ahead of synthesis in a thread of its own; the samples are the same.
OfflineSummary render_offline(const engine::Options& options, std::shared_ptr<pack::PackLibrary> packs, int workers,
                              const OfflineEnds& ends);

}  // namespace rustle::session
