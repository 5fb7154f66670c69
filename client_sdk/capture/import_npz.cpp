#include "client_sdk/capture/import_npz.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstring>
#include <limits>
#include <map>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include <fmt/format.h>

#include "client_sdk/capture/npy_array.h"
#include "client_sdk/capture/obstacle_plane.h"
#include "client_sdk/capture/sheet_recorder.h"
#include "client_sdk/capture/zip_archive.h"

namespace rustle::capture {
namespace {

template <typename Value>
using Expected = tl::expected<Value, ImportError>;

constexpr std::uint64_t kMaxObstacles = 10'000;
constexpr std::size_t kMaxFrames = 10'000'000;
const char* const kLayout = "see `rustle import --help` for the arrays";

/// The arrays of the archive; what is never asked for is remarked on at the end.
class Arrays {
 public:
  static Expected<Arrays> open(const std::filesystem::path& path) {
    auto archive = ZipArchive::open(path);
    if (!archive)
      return tl::unexpected(ImportError{path.string(), "", archive.error(), "give a file written by numpy.savez"});
    Arrays arrays(path.string(), std::move(*archive));
    for (const ZipArchive::Entry& entry : arrays.archive_.entries()) {
      if (entry.name.ends_with(".npy")) arrays.unused_.emplace(entry.name.substr(0, entry.name.size() - 4), &entry);
    }
    arrays.known_ = arrays.unused_;
    return arrays;
  }

  bool has(const std::string& name) const { return known_.contains(name); }

  Expected<NpyArray> read(const std::string& name) {
    const auto found = known_.find(name);
    if (found == known_.end()) return fail(name, "is missing", kLayout);
    unused_.erase(name);
    auto bytes = archive_.read(*found->second);
    if (!bytes) return fail(name, bytes.error(), "save the file again");
    auto array = parse_npy(std::move(*bytes));
    if (!array) return fail(name, array.error(), "");
    return std::move(*array);
  }

  Expected<NpyArray> read_real(const std::string& name) {
    auto array = read(name);
    if (array && !array->is_real()) return fail(name, "holds whole numbers where lengths are needed", "save it as float32");
    return array;
  }

  /// Rows of three vertex numbers each, u32.
  Expected<std::vector<std::uint32_t>> read_triangles(const std::string& name) {
    const auto array = read(name);
    if (!array) return tl::unexpected(array.error());
    if (array->shape.size() != 2 || array->shape[1] != 3) {
      return fail(name, fmt::format("has the shape {} instead of (T, 3)", array->shape_text()), kLayout);
    }
    auto indices = to_indices(name, *array);
    if (!indices) return tl::unexpected(indices.error());
    return std::vector<std::uint32_t>(indices->begin(), indices->end());
  }

  /// F+1 rising offsets from 0 to `rows`.
  Expected<std::vector<std::size_t>> read_offsets(const std::string& name, std::size_t frames, std::size_t rows) {
    const auto array = read(name);
    if (!array) return tl::unexpected(array.error());
    auto indices = to_indices(name, *array);
    if (!indices) return tl::unexpected(indices.error());
    if (array->shape.size() != 1 || indices->size() != frames + 1) {
      return fail(
          name, fmt::format("has the shape {} instead of ({},), one more than the frames", array->shape_text(), frames + 1),
          kLayout);
    }
    if (indices->front() != 0 || indices->back() != rows || !std::ranges::is_sorted(*indices)) {
      return fail(name, fmt::format("does not rise from 0 to {}", rows), kLayout);
    }
    return std::vector<std::size_t>(indices->begin(), indices->end());
  }

  tl::unexpected<ImportError> fail(const std::string& name, std::string message, std::string remedy) const {
    return tl::unexpected(ImportError{file_, name, std::move(message), std::move(remedy)});
  }

  std::vector<std::uint64_t> obstacle_numbers() const {
    std::vector<std::uint64_t> numbers;
    constexpr std::string_view kStart = "obstacle";
    constexpr std::string_view kEnd = "_vertices";
    for (const auto& [name, entry] : known_) {
      if (!name.starts_with(kStart) || !name.ends_with(kEnd)) continue;
      const char* first = name.data() + kStart.size();
      const char* last = name.data() + name.size() - kEnd.size();
      std::uint64_t number = 0;
      const auto [end, error] = std::from_chars(first, last, number);
      if (error == std::errc() && end == last && number < kMaxObstacles) numbers.push_back(number);
    }
    std::ranges::sort(numbers);
    return numbers;
  }

  std::vector<std::string> unused() const {
    std::vector<std::string> names;
    for (const auto& [name, entry] : unused_) names.push_back(name);
    return names;
  }

 private:
  Arrays(std::string file, ZipArchive archive) : file_(std::move(file)), archive_(std::move(archive)) {}

  Expected<std::vector<std::uint32_t>> to_indices(const std::string& name, const NpyArray& array) const {
    if (array.is_real()) return fail(name, "holds real numbers where indices are needed", "save it as int32");
    const std::vector<std::int64_t> wide = array.as_i64();
    std::vector<std::uint32_t> indices(wide.size());
    for (std::size_t i = 0; i < wide.size(); ++i) {
      if (wide[i] < 0 || wide[i] > std::numeric_limits<std::uint32_t>::max()) {
        return fail(name, fmt::format("entry {} is {}", i, wide[i]), "indices count from 0; save it again");
      }
      indices[i] = static_cast<std::uint32_t>(wide[i]);
    }
    return indices;
  }

  std::string file_;
  ZipArchive archive_;
  std::map<std::string, const ZipArchive::Entry*> known_;
  std::map<std::string, const ZipArchive::Entry*> unused_;
};

/// All frames one after the other; vertex_start and triangle_start have F+1 entries, triangle_start only when the topology
/// changes.
struct Motion {
  bool changing = false;
  std::vector<double> times_s;
  std::vector<float> positions;
  std::vector<std::uint32_t> triangles;
  std::vector<float> material_coordinates;
  std::vector<std::uint8_t> anchored;
  bool anchored_per_frame = false;
  std::vector<std::size_t> vertex_start;
  std::vector<std::size_t> triangle_start;

  std::size_t frame_count() const { return times_s.size(); }

  SheetFrame frame(std::size_t f) const {
    const std::size_t first = vertex_start[f];
    const std::size_t count = vertex_start[f + 1] - first;
    SheetFrame out;
    out.time_s = times_s[f];
    out.positions = std::span(positions).subspan(3 * first, 3 * count);
    out.triangles = triangles;
    if (changing) {
      out.triangles = out.triangles.subspan(3 * triangle_start[f], 3 * (triangle_start[f + 1] - triangle_start[f]));
    }
    out.material_coordinates = material_coordinates;
    if (changing && !material_coordinates.empty()) {
      out.material_coordinates = out.material_coordinates.subspan(2 * first, 2 * count);
    }
    out.anchored = anchored;
    if (anchored_per_frame) out.anchored = out.anchored.subspan(first, count);
    return out;
  }
};

Expected<std::vector<double>> read_times(Arrays& arrays, std::size_t frames, double frames_per_s) {
  std::vector<double> times_s(frames);
  if (frames_per_s > 0) {
    if (arrays.has("times")) (void)arrays.read("times");
    for (std::size_t f = 0; f < frames; ++f) times_s[f] = static_cast<double>(f) / frames_per_s;
    return times_s;
  }
  if (!arrays.has("times")) return arrays.fail("times", "is missing", "add it (seconds), or give the rate with --fps");
  const auto array = arrays.read("times");
  if (!array) return tl::unexpected(array.error());
  if (array->shape.size() != 1 || array->shape[0] != frames) {
    return arrays.fail("times", fmt::format("has the shape {} for {} frames", array->shape_text(), frames), kLayout);
  }
  return array->as_f64();
}

Expected<Motion> read_motion(Arrays& arrays, const ImportOptions& options) {
  Motion motion;
  motion.changing = arrays.has("vertex_offsets") || arrays.has("triangle_offsets");
  const auto positions = arrays.read_real("positions");
  if (!positions) return tl::unexpected(positions.error());
  const std::vector<std::size_t>& shape = positions->shape;
  if (shape.size() != (motion.changing ? 2u : 3u) || shape.back() != 3) {
    return arrays.fail("positions",
                       fmt::format("has the shape {} instead of {}", positions->shape_text(),
                                   motion.changing ? "(all vertices of all frames, 3)" : "(frames, vertices, 3)"),
                       kLayout);
  }
  std::size_t frames = shape[0];
  if (motion.changing) {
    const auto offsets = arrays.read("vertex_offsets");
    if (!offsets) return tl::unexpected(offsets.error());
    frames = offsets->element_count() == 0 ? 0 : offsets->element_count() - 1;
  }
  if (frames == 0) return arrays.fail("positions", "has no frames", "export at least one");
  if (frames > kMaxFrames)
    return arrays.fail("positions", fmt::format("has {} frames; at most {}", frames, kMaxFrames), "split it");
  motion.positions = positions->as_f32();

  auto triangles = arrays.read_triangles("triangles");
  if (!triangles) return tl::unexpected(triangles.error());
  motion.triangles = std::move(*triangles);
  const std::size_t rows = motion.positions.size() / 3;
  if (motion.changing) {
    auto vertex_start = arrays.read_offsets("vertex_offsets", frames, rows);
    if (!vertex_start) return tl::unexpected(vertex_start.error());
    auto triangle_start = arrays.read_offsets("triangle_offsets", frames, motion.triangles.size() / 3);
    if (!triangle_start) return tl::unexpected(triangle_start.error());
    motion.vertex_start = std::move(*vertex_start);
    motion.triangle_start = std::move(*triangle_start);
  } else {
    motion.vertex_start.resize(frames + 1);
    for (std::size_t f = 0; f <= frames; ++f) motion.vertex_start[f] = f * shape[1];
  }
  auto times_s = read_times(arrays, frames, options.frames_per_s);
  if (!times_s) return tl::unexpected(times_s.error());
  motion.times_s = std::move(*times_s);

  const std::size_t described = motion.changing ? rows : shape[1];
  if (arrays.has("material_coordinates")) {
    const auto array = arrays.read_real("material_coordinates");
    if (!array) return tl::unexpected(array.error());
    if (array->shape != std::vector<std::size_t>{described, 2}) {
      return arrays.fail("material_coordinates",
                         fmt::format("has the shape {} instead of ({}, 2)", array->shape_text(), described), kLayout);
    }
    motion.material_coordinates = array->as_f32();
  }
  if (arrays.has("pinned")) {
    const auto array = arrays.read("pinned");
    if (!array) return tl::unexpected(array.error());
    const std::size_t count = array->element_count();
    motion.anchored_per_frame = motion.changing || array->shape.size() == 2;
    if (array->is_real() || count != (motion.anchored_per_frame ? rows : described)) {
      return arrays.fail("pinned", fmt::format("has the shape {} or type of another sheet", array->shape_text()),
                         "save a bool for each vertex");
    }
    for (const std::int64_t pinned : array->as_i64()) motion.anchored.push_back(pinned != 0 ? 1 : 0);
  }
  return motion;
}

struct ObstacleMotion {
  std::uint32_t id = 0;
  std::string name;
  std::vector<std::uint32_t> triangles;
  std::vector<float> vertices;  ///< of one frame when fixed, else of all
  std::size_t vertex_count = 0;
  bool moving = false;
  std::optional<FittedPlane> plane;

  std::span<const float> vertices_at(std::size_t f) const {
    return std::span(vertices).subspan(moving ? 3 * vertex_count * f : 0, 3 * vertex_count);
  }
};

Expected<ObstacleMotion> read_obstacle(Arrays& arrays, std::uint64_t number, std::size_t frames) {
  ObstacleMotion obstacle;
  obstacle.id = static_cast<std::uint32_t>(number + 1);
  obstacle.name = fmt::format("obstacle{}", number);
  const std::string field = obstacle.name + "_vertices";
  auto triangles = arrays.read_triangles(obstacle.name + "_triangles");
  if (!triangles) return tl::unexpected(triangles.error());
  const auto array = arrays.read_real(field);
  if (!array) return tl::unexpected(array.error());
  const std::vector<std::size_t>& shape = array->shape;
  const bool per_frame = shape.size() == 3;
  if ((shape.size() != 2 && !per_frame) || shape.back() != 3 || (per_frame && shape[0] != frames)) {
    return arrays.fail(field, fmt::format("has the shape {} instead of (V, 3) or ({}, V, 3)", array->shape_text(), frames),
                       kLayout);
  }
  obstacle.triangles = std::move(*triangles);
  obstacle.vertices = array->as_f32();
  obstacle.vertex_count = shape[shape.size() - 2];
  for (std::size_t i = 0; i < obstacle.vertices.size(); ++i) {
    if (!std::isfinite(obstacle.vertices[i])) {
      const std::size_t vertex = i / 3;
      return arrays.fail(
          field,
          fmt::format("frame {}, vertex {} is not finite", vertex / obstacle.vertex_count, vertex % obstacle.vertex_count),
          "mend it or leave the obstacle out");
    }
  }
  for (std::size_t i = 0; i < obstacle.triangles.size(); ++i) {
    if (obstacle.triangles[i] >= obstacle.vertex_count) {
      return arrays.fail(
          obstacle.name + "_triangles",
          fmt::format("triangle {} asks for vertex {} of {}", i / 3, obstacle.triangles[i], obstacle.vertex_count),
          "indices count from 0; save it again");
    }
  }
  const std::size_t floats = 3 * obstacle.vertex_count;
  for (std::size_t f = 1; per_frame && f < frames && !obstacle.moving; ++f) {
    obstacle.moving =
        std::memcmp(obstacle.vertices.data(), obstacle.vertices.data() + f * floats, floats * sizeof(float)) != 0;
  }
  if (!obstacle.moving) obstacle.vertices.resize(floats);
  return obstacle;
}

void fill(v1::Vector3& out, const std::array<double, 3>& value) {
  out.set_x(value[0]);
  out.set_y(value[1]);
  out.set_z(value[2]);
}

v1::SceneUpdate first_scene(const std::vector<ObstacleMotion>& obstacles, const ImportOptions& options, double time_s) {
  v1::SceneUpdate update;
  update.set_time_s(time_s);
  for (const ObstacleMotion& each : obstacles) {
    v1::Obstacle& obstacle = *update.add_obstacles();
    obstacle.set_obstacle_id(each.id);
    obstacle.set_name(each.name);
    obstacle.set_surface_material(options.obstacle_surface);
    if (each.plane) {
      obstacle.set_reflecting(true);
      fill(*obstacle.mutable_plane()->mutable_point(), each.plane->point);
      fill(*obstacle.mutable_plane()->mutable_normal(), each.plane->normal);
    } else {
      obstacle.mutable_mesh()->set_triangles(wire_bytes(std::span<const std::uint32_t>(each.triangles)));
      obstacle.mutable_mesh()->set_vertices(wire_bytes(each.vertices_at(0)));
    }
  }
  return update;
}

void choose_plane(ObstacleMotion& obstacle, const Motion& motion, ImportSummary& summary) {
  if (obstacle.moving) {
    summary.remarks.push_back(fmt::format("{} stays a mesh: it moves", obstacle.name));
    return;
  }
  auto plane = reflecting_plane(obstacle.vertices, obstacle.triangles, motion.positions);
  if (plane) {
    obstacle.plane = *plane;
    ++summary.reflecting_planes;
    summary.remarks.push_back(fmt::format("{} becomes a reflecting plane", obstacle.name));
  } else {
    summary.remarks.push_back(fmt::format("{} stays a mesh, without reflections: {}", obstacle.name, plane.error()));
  }
}

}  // namespace

ImportResult import_npz(const std::filesystem::path& input, const std::filesystem::path& output,
                        const ImportOptions& options, const ImportProgress& progress) {
  if (auto checked = check_options(options); !checked) return tl::unexpected(checked.error());
  auto arrays = Arrays::open(input);
  if (!arrays) return tl::unexpected(arrays.error());
  const auto motion = read_motion(*arrays, options);
  if (!motion) return tl::unexpected(motion.error());

  ImportSummary summary;
  std::vector<ObstacleMotion> obstacles;
  for (const std::uint64_t number : arrays->obstacle_numbers()) {
    auto obstacle = read_obstacle(*arrays, number, motion->frame_count());
    if (!obstacle) return tl::unexpected(obstacle.error());
    if (options.reflecting) choose_plane(*obstacle, *motion, summary);
    obstacles.push_back(std::move(*obstacle));
  }
  summary.obstacles = obstacles.size();
  for (const std::string& name : arrays->unused()) {
    summary.remarks.push_back(fmt::format("array \"{}\" is not known and was passed over", name));
  }

  auto recorder = SheetRecorder::create(output, input.string(), options, motion->times_s.front());
  if (!recorder) return tl::unexpected(recorder.error());
  if (!obstacles.empty()) {
    const auto sent = recorder->scene(first_scene(obstacles, options, motion->times_s.front()), "frame 0");
    if (!sent) return tl::unexpected(sent.error());
  }
  const std::size_t frames = motion->frame_count();
  for (std::size_t f = 0; f < frames; ++f) {
    v1::SceneUpdate update;
    update.set_time_s(motion->times_s[f]);
    for (const ObstacleMotion& obstacle : obstacles) {
      if (!obstacle.moving || f == 0) continue;
      v1::ObstacleVertices& vertices = *update.add_vertices();
      vertices.set_obstacle_id(obstacle.id);
      vertices.set_vertices(wire_bytes(obstacle.vertices_at(f)));
    }
    const std::string name = fmt::format("frame {}", f);
    if (update.vertices_size() > 0) {
      if (auto sent = recorder->scene(update, name); !sent) return tl::unexpected(sent.error());
    }
    if (auto sent = recorder->frame(motion->frame(f), name); !sent) return tl::unexpected(sent.error());
    if (progress) progress(static_cast<double>(f + 1) / static_cast<double>(frames));
  }
  return recorder->finish(std::move(summary));
}

}  // namespace rustle::capture
