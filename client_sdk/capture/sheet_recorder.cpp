#include "client_sdk/capture/sheet_recorder.h"

#include <algorithm>
#include <cmath>
#include <system_error>
#include <utility>

#include <fmt/format.h>

namespace rustle::capture {
namespace {

constexpr std::uint32_t kSheetId = 1;
// What a daemon and a render take.
constexpr std::size_t kMaxVertices = 200'000;
constexpr std::size_t kMaxTriangles = 200'000;
constexpr double kMaxTime_s = 1e10;

ImportError from_storage(const StorageError& error) {
  return {error.file_name, "", error.message, error.remedy};
}

tl::expected<void, ImportError> check_time(const std::string& file, double time_s, std::optional<double> last_time_s,
                                           const std::string& name) {
  if (!std::isfinite(time_s) || std::abs(time_s) > kMaxTime_s) {
    return tl::unexpected(ImportError{file, "times", fmt::format("{}: {} s is no usable time", name, time_s),
                                      "give the times with --fps instead"});
  }
  if (last_time_s && time_s <= *last_time_s) {
    return tl::unexpected(ImportError{file, "times",
                                      fmt::format("{}: time {} s does not come after {} s", name, time_s, *last_time_s),
                                      "sort the frames by time, or give the times with --fps instead"});
  }
  return {};
}

}  // namespace

tl::expected<SheetRecorder, ImportError> SheetRecorder::create(const std::filesystem::path& output,
                                                               const std::string& source, const ImportOptions& options,
                                                               double first_time_s) {
  if (auto checked = check_options(options); !checked) return tl::unexpected(checked.error());
  if (auto checked = check_time(source, first_time_s, std::nullopt, "frame 0"); !checked) {
    return tl::unexpected(checked.error());
  }
  if (std::filesystem::is_directory(output)) {
    return tl::unexpected(ImportError{output.string(), "", "is a folder", "give the capture's file name"});
  }
  std::filesystem::path partial = output;
  partial += ".partial";
  CaptureWriterOptions writer_options;
  writer_options.mcap = options.mcap;
  writer_options.notes["source"] = std::filesystem::path(source).filename().string();
  auto writer = CaptureWriter::create(partial, std::move(writer_options));
  if (!writer) return tl::unexpected(from_storage(writer.error()));
  SheetRecorder recorder(std::move(*writer), output, std::move(partial));
  recorder.source_ = source;
  recorder.session_id_ = options.session_id.empty() ? output.stem().string() : options.session_id;
  recorder.first_time_s_ = first_time_s;
  recorder.shift_s_ = first_time_s < 0 ? -first_time_s : 0;

  v1::StreamMessage announcement;
  announcement.mutable_announcement()->set_protocol_version(kWireVersion);
  announcement.mutable_announcement()->set_name(recorder.session_id_);
  v1::SessionOptions& session = *announcement.mutable_announcement()->mutable_options();
  session.set_clock(v1::CLOCK_SIMULATION);
  session.set_time_origin_s(first_time_s);
  session.set_metres_per_unit(options.metres_per_unit);
  session.set_up_axis(options.up_axis);
  if (Result sent = recorder.send(announcement, first_time_s); !sent) return tl::unexpected(sent.error());

  v1::StreamMessage sheet;
  sheet.mutable_sheet()->set_sheet_id(kSheetId);
  sheet.mutable_sheet()->set_name("sheet");
  sheet.mutable_sheet()->set_kind(options.sheet_kind);
  sheet.mutable_sheet()->set_material(options.material);
  sheet.mutable_sheet()->set_touched_surface(options.touched_surface);
  if (Result sent = recorder.send(sheet, first_time_s); !sent) return tl::unexpected(sent.error());
  return recorder;
}

SheetRecorder::SheetRecorder(SheetRecorder&& other) noexcept
    : writer_(std::move(other.writer_)),
      output_(std::move(other.output_)),
      partial_(std::exchange(other.partial_, {})),
      source_(std::move(other.source_)),
      session_id_(std::move(other.session_id_)),
      first_time_s_(other.first_time_s_),
      shift_s_(other.shift_s_),
      sequence_(other.sequence_),
      topology_id_(other.topology_id_),
      triangles_(std::move(other.triangles_)),
      material_coordinates_(std::move(other.material_coordinates_)),
      vertex_count_(other.vertex_count_),
      last_time_s_(other.last_time_s_),
      summary_(std::move(other.summary_)) {}

SheetRecorder::~SheetRecorder() {
  std::error_code ignored;
  if (!partial_.empty()) std::filesystem::remove(partial_, ignored);
}

SheetRecorder::Result SheetRecorder::send(v1::StreamMessage& message, double time_s) {
  message.set_session_id(session_id_);
  message.set_sequence(++sequence_);
  const auto log_time_ns = static_cast<std::uint64_t>(std::llround(std::max(0.0, time_s + shift_s_) * 1e9));
  if (auto written = writer_.write(record_of(message, log_time_ns, log_time_ns)); !written) {
    return tl::unexpected(from_storage(written.error()));
  }
  return {};
}

SheetRecorder::Result SheetRecorder::scene(const v1::SceneUpdate& update, const std::string& name) {
  if (Result checked = check_time(source_, update.time_s(), last_time_s_, name); !checked) return checked;
  v1::StreamMessage message;
  *message.mutable_scene() = update;
  return send(message, update.time_s());
}

SheetRecorder::Result SheetRecorder::check(const SheetFrame& frame, bool new_topology, const std::string& name) const {
  const auto refuse = [&](std::string field, std::string message, std::string remedy) -> Result {
    return tl::unexpected(ImportError{source_, std::move(field), fmt::format("{}: {}", name, message), std::move(remedy)});
  };
  const std::size_t vertex_count = frame.positions.size() / 3;
  if (vertex_count == 0 || frame.triangles.empty()) {
    return refuse("positions", "has no vertices or no triangles", "export the sheet as a triangle mesh");
  }
  if (vertex_count > kMaxVertices || frame.triangles.size() / 3 > kMaxTriangles) {
    return refuse("positions",
                  fmt::format("{} vertices and {} triangles; at most {} and {} are taken", vertex_count,
                              frame.triangles.size() / 3, kMaxVertices, kMaxTriangles),
                  "simplify the mesh");
  }
  if (Result checked = check_time(source_, frame.time_s, last_time_s_, name); !checked) return checked;
  for (std::size_t i = 0; i < frame.positions.size(); ++i) {
    if (!std::isfinite(frame.positions[i])) {
      return refuse("positions", fmt::format("vertex {} is at {}, which is no position", i / 3, frame.positions[i]),
                    "the simulation went astray there; export fewer frames or mend it");
    }
  }
  if (!new_topology) return {};
  for (std::size_t i = 0; i < frame.triangles.size(); ++i) {
    if (frame.triangles[i] >= vertex_count) {
      return refuse("triangles",
                    fmt::format("triangle {} asks for vertex {} of {}", i / 3, frame.triangles[i], vertex_count),
                    "indices count from 0 within their frame; export again");
    }
  }
  for (std::size_t i = 0; i < frame.material_coordinates.size(); ++i) {
    if (!std::isfinite(frame.material_coordinates[i])) {
      return refuse("material_coordinates", fmt::format("vertex {} is not finite", i / 2), "leave them out or mend them");
    }
  }
  return {};
}

SheetRecorder::Result SheetRecorder::frame(const SheetFrame& frame, const std::string& name) {
  const std::size_t vertex_count = frame.positions.size() / 3;
  const bool new_topology = topology_id_ == 0 || vertex_count != vertex_count_ ||
                            !std::ranges::equal(frame.triangles, triangles_) ||
                            !std::ranges::equal(frame.material_coordinates, material_coordinates_);
  if (Result checked = check(frame, new_topology, name); !checked) return checked;

  if (new_topology) {
    v1::StreamMessage message;
    v1::Topology& topology = *message.mutable_topology();
    topology.set_topology_id(++topology_id_);
    topology.set_vertex_count(static_cast<std::uint32_t>(vertex_count));
    topology.set_triangles(wire_bytes(frame.triangles));
    topology.set_material_coordinates(wire_bytes(frame.material_coordinates));
    if (Result sent = send(message, frame.time_s); !sent) return sent;
    triangles_.assign(frame.triangles.begin(), frame.triangles.end());
    material_coordinates_.assign(frame.material_coordinates.begin(), frame.material_coordinates.end());
    vertex_count_ = vertex_count;
    summary_.material_coordinates = !frame.material_coordinates.empty();
  }
  v1::StreamMessage message;
  v1::MeshFrame& mesh = *message.mutable_frame();
  mesh.set_sheet_id(kSheetId);
  mesh.set_topology_id(topology_id_);
  mesh.set_time_s(frame.time_s);
  mesh.set_positions(wire_bytes(frame.positions));
  mesh.set_anchored(wire_bytes(frame.anchored));
  if (Result sent = send(message, frame.time_s); !sent) return sent;
  last_time_s_ = frame.time_s;

  const std::uint64_t triangle_count = frame.triangles.size() / 3;
  const bool first = summary_.frames++ == 0;
  summary_.min_vertices = first ? vertex_count : std::min<std::uint64_t>(summary_.min_vertices, vertex_count);
  summary_.max_vertices = std::max<std::uint64_t>(summary_.max_vertices, vertex_count);
  summary_.min_triangles = first ? triangle_count : std::min(summary_.min_triangles, triangle_count);
  summary_.max_triangles = std::max(summary_.max_triangles, triangle_count);
  return {};
}

ImportResult SheetRecorder::finish(ImportSummary summary) {
  const double last_time_s = last_time_s_.value_or(first_time_s_);
  v1::StreamMessage end;
  end.mutable_end()->set_time_s(last_time_s);
  if (Result sent = send(end, last_time_s); !sent) return tl::unexpected(sent.error());
  const auto totals = writer_.close();
  if (!totals) return tl::unexpected(from_storage(totals.error()));
  std::error_code cause;
  std::filesystem::rename(partial_, output_, cause);
  if (cause) return tl::unexpected(from_storage(storage_error(output_.string(), "take the file's name", cause)));
  partial_.clear();

  summary.frames = summary_.frames;
  summary.topologies = topology_id_;
  summary.min_vertices = summary_.min_vertices;
  summary.max_vertices = summary_.max_vertices;
  summary.min_triangles = summary_.min_triangles;
  summary.max_triangles = summary_.max_triangles;
  summary.material_coordinates = summary_.material_coordinates;
  summary.first_time_s = first_time_s_;
  summary.last_time_s = last_time_s;
  summary.messages = totals->messages;
  summary.bytes = totals->bytes;
  return summary;
}

}  // namespace rustle::capture
