#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <tl/expected.hpp>

#include "server/report/charts.h"
#include "server/report/sound_event.h"

namespace rustle::report {

struct ReportSheet {
  std::uint32_t id = 0;
  std::string name;
  std::string kind;            ///< "paper", "cloth"
  std::string material;        ///< "printer-paper"
  std::uint64_t vertices = 0;  ///< of the last frame
  std::uint64_t triangles = 0;
};

/// Everything the page of one render says. Any part may be empty.
struct RenderReport {
  std::string title;
  std::string capture;    ///< what was rendered, as it was named
  double duration_s = 0;  ///< of the simulation
  std::uint64_t mesh_frames = 0;
  std::vector<ReportSheet> sheets;
  std::uint64_t seed = 0;
  std::string mode;                ///< "corrected", "published"
  std::optional<double> load_s;    ///< to read the capture
  std::optional<double> render_s;  ///< to analyse and synthesize it
  Sound sound;
  std::uint64_t limited_samples = 0;
  double limit_db = 0;  ///< the limiter's threshold in dBFS; 0: no line
  std::vector<EventMark> events;
  std::vector<PackGridPoint> pack_grid;
  std::vector<std::pair<std::string, std::string>> facts;  ///< further ones: label, value
  std::vector<std::string> notices;                        ///< what the reader should know before trusting the sound
};

/// One HTML page that needs nothing else: style inline, drawings as inline SVG, pictures as data URIs, no script, no link.
/// Light or dark as the reader's machine prefers; readable from 320 pixels on. Same report, same bytes. Pure.
std::string html_report(const RenderReport& report);

/// Error: the path and what to do about it.
[[nodiscard]] tl::expected<void, std::string> write_html_report(const std::filesystem::path& path,
                                                                const RenderReport& report);

}  // namespace rustle::report
