#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "server/engine/ingest.h"
#include "server/page/figures.h"
#include "server/page/partition.h"
#include "server/session/watch.h"
#include "server/sheet/topology.h"

/// What the daemon says to its page: texts are JSON, the rest is binary, little-endian, positions in metres, z up. Pure.
namespace rustle::page {

inline constexpr int kVersion = 1;
inline constexpr const char* kSubprotocol = "rustle.page.1";

// ---- texts

struct Hello {
  std::string daemon;   ///< "rustled 0.1.0"
  std::string machine;  ///< its host's name
  std::uint32_t rate_hz = 0;
  int channels = 2;
  Rights rights;
  bool needs_key = false;  ///< a key would allow more
};
[[nodiscard]] std::string hello_text(const Hello& hello);

enum class NoticeLevel : std::uint8_t { kInfo, kWarning, kError };
[[nodiscard]] std::string notice_text(const std::string& text, NoticeLevel level);

/// What the page's own thread adds to the figures.
struct OwnFigures {
  double unix_s = 0;
  double cpu_share = 0;  ///< of a core, of the whole daemon
  std::optional<double> latency_p50_s, latency_p99_s;
  std::size_t viewers = 0;
};
/// `rights`: of the viewer, for each session.
[[nodiscard]] std::string figures_text(const Figures& figures, const OwnFigures& own, std::span<const Rights> rights);

/// The value below which this share of what was counted lies, by ranges; absent: nothing was counted. What lies beyond the
/// last range is taken to be at its end.
[[nodiscard]] std::optional<double> quantile_s(const session::DurationHistogram::Counts& counts, double share);

/// How large a sheet was when it was seen last.
struct SheetSize {
  std::size_t vertices = 0, triangles = 0;
};
[[nodiscard]] std::string scene_text(const std::string& session, const engine::Surroundings& around,
                                     std::span<const SheetSize> sizes);
[[nodiscard]] std::string events_text(const std::string& session, const session::SeenEvents& events);

// ---- binary

/// u32 1, u32 sheet, u32 vertices, u32 triangles, u32[3 triangles]
[[nodiscard]] std::string topology_bytes(std::uint32_t place, const sheet::Topology& topology);
/// u32 2, u32 sheet, f64 time, u32 vertices, u32 ridges, u32 rulings, f32[3 vertices], u16[vertices] regions padded to 4
/// bytes, f32[6 ridges], f32[6 rulings]. \pre regions.size() == frame.positions_m.size()
[[nodiscard]] std::string frame_bytes(std::uint32_t place, const sheet::MeshFrame& frame,
                                      std::span<const std::uint16_t> regions, std::span<const Segment> ridges,
                                      std::span<const Segment> rulings);
/// u32 3, u32 0, u64 first sample, u32 channels, u32 frames, f32[frames channels]
[[nodiscard]] std::string pcm_bytes(std::int64_t first_sample, int channels, std::span<const float> interleaved);
/// u32 4, u32 obstacle, u32 vertices, u32 triangles, f32[3 vertices], u32[3 triangles]
[[nodiscard]] std::string obstacle_bytes(std::uint32_t place, std::span<const sheet::Vec3f> vertices_m,
                                         std::span<const sheet::Triangle> triangles);

}  // namespace rustle::page
