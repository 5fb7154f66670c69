#pragma once

#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include <tl/expected.hpp>

#include "server/engine/options.h"
#include "server/engine/stream_item.h"
#include "server/report/html_report.h"
#include "server/sinks/event_log.h"
#include "sound_db/pack/library.h"

namespace rustle::apps {

/// What a report says of a render besides its sound and events.
struct RenderFacts {
  std::string capture;
  engine::Options options;
  double first_time_s = 0;
  double duration_s = 0;
  double render_s = 0;
  std::uint64_t frames = 0;
  std::uint64_t limited_samples = 0;
  std::vector<std::string> notices;
  std::map<sheet::SheetId, report::ReportSheet> sheets;

  /// Notes what an item says of the sheets.
  void see(const engine::StreamItem& item);
};

/// The event list as the pictures take it.
std::vector<report::EventMark> marks_of(const std::vector<sinks::LoggedEvent>& events);

/// Error: a sentence with the file name and what to do.
[[nodiscard]] tl::expected<void, std::string> write_render_report(const std::filesystem::path& file,
                                                                  const RenderFacts& facts,
                                                                  const std::vector<sinks::LoggedEvent>& events,
                                                                  const std::vector<float>& interleaved,
                                                                  pack::PackLibrary& packs);

}  // namespace rustle::apps
