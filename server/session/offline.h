#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>

#include <tl/expected.hpp>

#include "server/engine/ingest.h"
#include "server/engine/render.h"
#include "sound_db/pack/library.h"

namespace rustle::session {

/// What an offline render reads from and hands to. Calls come from the thread that calls render_offline, except
/// `next`, `observed` and `refused`, which come from the analysis worker when there are two workers; never two at once of a
/// kind.
struct OfflineEnds {
  /// The next stream item; nothing at the end.
  std::function<std::optional<engine::StreamItem>()> next;
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
  double analysis_s = 0;   ///< spent in analysis
  double synthesis_s = 0;  ///< spent in synthesis
};

/// Drives one engine from a source to a sink as fast as it goes, on the simulation clock. With two workers or more,
/// analysis runs ahead of synthesis in a thread of its own; the samples are the same.
OfflineSummary render_offline(const engine::Options& options, std::shared_ptr<pack::PackLibrary> packs, int workers,
                              const OfflineEnds& ends);

}  // namespace rustle::session
