#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <tl/expected.hpp>

#include "client_sdk/capture/capture_writer.h"
#include "client_sdk/capture/import.h"

namespace rustle::capture {

/// One frame of a sheet as an importer has it, in the input's units. Shapes: positions f32 [V,3], triangles u32 [T,3],
/// material_coordinates f32 [V,2] or empty, anchored u8 [V] or empty.
struct SheetFrame {
  double time_s = 0;
  std::span<const float> positions;
  std::span<const std::uint32_t> triangles;
  std::span<const float> material_coordinates;
  std::span<const std::uint8_t> anchored;
};

/// Writes one sheet's motion as the session that a simulator would have sent: announcement with the simulation clock,
/// sheet, scene, topologies whenever they change, frames, end. Session sequence numbers count from 1; log times are
/// simulation times (shifted to begin at 0 when the first is negative). Writes beside `output` and takes its name in
/// finish(); when it ends without, nothing is left. One thread at a time.
class SheetRecorder {
 public:
  using Result = tl::expected<void, ImportError>;

  static tl::expected<SheetRecorder, ImportError> create(const std::filesystem::path& output, const std::string& source,
                                                         const ImportOptions& options, double first_time_s);
  SheetRecorder(SheetRecorder&& other) noexcept;
  SheetRecorder& operator=(SheetRecorder&&) = delete;
  ~SheetRecorder();

  /// Before the frame of the same time.
  Result scene(const v1::SceneUpdate& update, const std::string& name);
  /// Sends the topology first when it is another than the last frame's. `name` says in errors which frame it is.
  /// Error: sizes, counts beyond the limits, an index beyond the vertices, a number that is not finite, a time that does
  /// not rise.
  Result frame(const SheetFrame& frame, const std::string& name);
  /// Ends the session and gives the file its name. Fills in what the recorder knows of the summary.
  ImportResult finish(ImportSummary summary);

 private:
  SheetRecorder(CaptureWriter writer, std::filesystem::path output, std::filesystem::path partial)
      : writer_(std::move(writer)), output_(std::move(output)), partial_(std::move(partial)) {}
  Result send(v1::StreamMessage& message, double time_s);
  Result check(const SheetFrame& frame, bool new_topology, const std::string& name) const;

  CaptureWriter writer_;
  std::filesystem::path output_;
  std::filesystem::path partial_;  ///< empty once finished or moved from
  std::string source_;
  std::string session_id_;
  double first_time_s_ = 0;
  double shift_s_ = 0;
  std::uint64_t sequence_ = 0;
  std::uint64_t topology_id_ = 0;
  std::vector<std::uint32_t> triangles_;
  std::vector<float> material_coordinates_;
  std::size_t vertex_count_ = 0;
  std::optional<double> last_time_s_;
  ImportSummary summary_;
};

/// Little-endian bytes of an array, as the wire holds them.
template <typename Value>
std::string wire_bytes(std::span<const Value> values) {
  return std::string(reinterpret_cast<const char*>(values.data()), values.size_bytes());
}

}  // namespace rustle::capture
