#include <cmath>
#include <cstring>
#include <limits>
#include <map>
#include <random>

#include <fmt/format.h>
#include <catch2/catch.hpp>

#include "client_sdk/capture/capture_reader.h"
#include "client_sdk/capture/import.h"
#include "client_sdk/capture/import_mesh_sequence.h"
#include "client_sdk/capture/import_npz.h"
#include "client_sdk/capture/npy_array.h"
#include "client_sdk/capture/obstacle_plane.h"
#include "client_sdk/capture/triangle_mesh.h"
#include "client_sdk/capture/zip_archive.h"
#include "server/wire/limits.h"
#include "tests/unit/capture/npz_builder.h"
#include "tests/unit/capture/scratch_folder.h"

namespace rustle::capture::import_test {
namespace {

using Entries = std::vector<std::pair<std::string, std::string>>;

std::vector<v1::StreamMessage> messages_of(const std::filesystem::path& path) {
  auto reader = CaptureReader::open(path);
  REQUIRE(reader);
  std::vector<v1::StreamMessage> out;
  while (const auto record = reader->next()) {
    CHECK(out.emplace_back().ParseFromString(record->bytes));
    CHECK(out.back().sequence() == out.size());
    CHECK(record->sequence == out.size());
  }
  CHECK(reader->recovery().complete);
  return out;
}

std::vector<float> floats(const std::string& bytes) {
  std::vector<float> out(bytes.size() / sizeof(float));
  std::memcpy(out.data(), bytes.data(), bytes.size());
  return out;
}

/// Two triangles, three frames of 4 vertices, frame f at height f.
std::vector<float> square_positions() {
  std::vector<float> out;
  for (int f = 0; f < 3; ++f) {
    for (const auto& [x, y] : {std::pair{0.f, 0.f}, {1.f, 0.f}, {1.f, 1.f}, {0.f, 1.f}}) {
      out.insert(out.end(), {x, y, static_cast<float>(f)});
    }
  }
  return out;
}

Entries square_entries() {
  return {{"positions.npy", npy("<f4", {3, 4, 3}, square_positions())},
          {"triangles.npy", npy<std::int32_t>("<i4", {2, 3}, {0, 1, 2, 0, 2, 3})},
          {"times.npy", npy<double>("<f8", {3}, {0.5, 0.75, 1.0})},
          {"pinned.npy", npy<std::uint8_t>("|b1", {4}, {1, 0, 0, 1})}};
}

void replace(Entries& entries, const std::string& name, std::string bytes) {
  for (auto& [key, value] : entries) {
    if (key == name + ".npy") {
      value = std::move(bytes);
      return;
    }
  }
  entries.emplace_back(name + ".npy", std::move(bytes));
}

void add_floor(Entries& entries, float half, float z) {
  replace(entries, "obstacle0_vertices",
          npy<float>("<f4", {4, 3}, {-half, -half, z, half, -half, z, half, half, z, -half, half, z}));
  replace(entries, "obstacle0_triangles", npy<std::int32_t>("<i4", {2, 3}, {0, 1, 2, 0, 2, 3}));
}

ImportResult import_entries(const ScratchFolder& folder, const Entries& entries, const ImportOptions& options = {}) {
  return import_capture(folder.write("square.npz", zip_of(entries)).string(), folder / "square.mcap", options);
}

}  // namespace

TEST_CASE("a sheet of constant topology becomes a session") {
  const ScratchFolder folder;
  ImportOptions options;
  options.metres_per_unit = 0.01;
  options.up_axis = v1::UP_AXIS_Y;
  options.material = "tracing-paper";
  const auto summary = import_entries(folder, square_entries(), options);
  REQUIRE(summary);
  CHECK(summary->frames == 3);
  CHECK(summary->topologies == 1);
  CHECK(summary->messages == 7);
  CHECK(summary->first_time_s == 0.5);
  CHECK(summary->last_time_s == 1.0);

  const auto messages = messages_of(folder / "square.mcap");
  REQUIRE(messages.size() == 7);
  REQUIRE(messages[0].has_announcement());
  const v1::SessionOptions& session = messages[0].announcement().options();
  CHECK(messages[0].session_id() == "square");
  CHECK(session.clock() == v1::CLOCK_SIMULATION);
  CHECK(session.time_origin_s() == 0.5);
  CHECK(session.metres_per_unit() == 0.01);
  CHECK(session.up_axis() == v1::UP_AXIS_Y);
  CHECK(messages[1].sheet().material() == "tracing-paper");
  CHECK(messages[2].topology().vertex_count() == 4);
  CHECK(messages[2].topology().triangles().size() == 24);
  CHECK(messages[2].topology().material_coordinates().empty());
  const std::vector<float> all = square_positions();
  for (std::size_t f = 0; f < 3; ++f) {
    const v1::MeshFrame& frame = messages[3 + f].frame();
    CHECK(frame.time_s() == 0.5 + 0.25 * static_cast<double>(f));
    CHECK(frame.topology_id() == messages[2].topology().topology_id());
    CHECK(floats(frame.positions()) == std::vector<float>(all.begin() + 12 * f, all.begin() + 12 * (f + 1)));
    CHECK(frame.anchored() == std::string("\1\0\0\1", 4));
  }
  CHECK(messages[6].end().time_s() == 1.0);
}

TEST_CASE("the frame rate can be given instead of the times") {
  const ScratchFolder folder;
  Entries entries = square_entries();
  entries.erase(entries.begin() + 2);
  const auto refused = import_entries(folder, entries);
  REQUIRE_FALSE(refused);
  CHECK(refused.error().field == "times");
  CHECK(refused.error().remedy.find("--fps") != std::string::npos);
  ImportOptions options;
  options.frames_per_s = 50;
  REQUIRE(import_entries(folder, entries, options));
  CHECK(messages_of(folder / "square.mcap")[4].frame().time_s() == 0.02);
}

TEST_CASE("float64 positions and int64 indices import as float32 and uint32") {
  const ScratchFolder folder;
  Entries entries = square_entries();
  const std::vector<float> single = square_positions();
  replace(entries, "positions", npy("<f8", {3, 4, 3}, std::vector<double>(single.begin(), single.end())));
  replace(entries, "triangles", npy<std::int64_t>("<i8", {2, 3}, {0, 1, 2, 0, 2, 3}));
  REQUIRE(import_entries(folder, entries));
  CHECK(floats(messages_of(folder / "square.mcap")[3].frame().positions()) ==
        std::vector<float>(single.begin(), single.begin() + 12));
}

TEST_CASE("a changing topology is sent when it changes, and only then") {
  const ScratchFolder folder;
  // Frames 0 and 1 have three vertices and one triangle, frame 2 four and two, frame 3 turns the diagonal.
  const std::vector<float> triangle{0, 0, 0, 1, 0, 0, 1, 1, 0};
  const std::vector<float> square{0, 0, 0, 1, 0, 0, 1, 1, 0, 0, 1, 0};
  std::vector<float> positions;
  for (const auto* part : {&triangle, &triangle, &square, &square})
    positions.insert(positions.end(), part->begin(), part->end());
  std::vector<float> material;
  for (std::size_t i = 0; i < positions.size(); i += 3) material.insert(material.end(), {positions[i], positions[i + 1]});
  const Entries entries{
      {"positions.npy", npy("<f4", {14, 3}, positions)},
      {"material_coordinates.npy", npy("<f4", {14, 2}, material)},
      {"vertex_offsets.npy", npy<std::int64_t>("<i8", {5}, {0, 3, 6, 10, 14})},
      {"triangles.npy", npy<std::int32_t>("<i4", {6, 3}, {0, 1, 2, 0, 1, 2, 0, 1, 2, 0, 2, 3, 0, 1, 3, 1, 2, 3})},
      {"triangle_offsets.npy", npy<std::int64_t>("<i8", {5}, {0, 1, 2, 4, 6})},
      {"times.npy", npy<double>("<f8", {4}, {-1, 0, 1, 2})}};
  const auto summary = import_entries(folder, entries);
  REQUIRE(summary);
  CHECK(summary->topologies == 3);
  CHECK(summary->min_vertices == 3);
  CHECK(summary->max_triangles == 2);
  CHECK(summary->material_coordinates);
  std::string order;
  std::uint64_t topology_id = 0;
  for (const auto& message : messages_of(folder / "square.mcap")) {
    if (message.has_topology()) {
      order += 'T';
      CHECK(message.topology().topology_id() > topology_id);
      topology_id = message.topology().topology_id();
      CHECK(message.topology().material_coordinates().size() == 8 * message.topology().vertex_count());
    }
    if (message.has_frame()) {
      order += 'f';
      CHECK(message.frame().topology_id() == topology_id);
    }
  }
  CHECK(order == "TffTfTf");
  auto reader = CaptureReader::open(folder / "square.mcap");
  std::uint64_t last_ns = 0;
  while (const auto record = reader->next()) last_ns = record->log_time_ns;
  CHECK(last_ns == 3'000'000'000);
}

TEST_CASE("a moving obstacle sends its vertices before each frame") {
  const ScratchFolder folder;
  Entries entries = square_entries();
  replace(entries, "obstacle0_triangles", npy<std::int32_t>("<i4", {1, 3}, {0, 1, 2}));
  replace(entries, "obstacle0_vertices", npy<float>("<f4", {3, 3, 3}, std::vector<float>(27, 0.f)));
  std::vector<float> moving(27, 0.f);
  for (std::size_t i = 0; i < 27; ++i) moving[i] = static_cast<float>(i);
  replace(entries, "obstacle1_triangles", npy<std::int32_t>("<i4", {1, 3}, {0, 1, 2}));
  replace(entries, "obstacle1_vertices", npy<float>("<f4", {3, 3, 3}, moving));
  const auto summary = import_entries(folder, entries);
  REQUIRE(summary);
  CHECK(summary->obstacles == 2);
  std::vector<std::string> order;
  for (const auto& message : messages_of(folder / "square.mcap")) {
    if (message.has_frame()) order.push_back(fmt::format("frame {}", message.frame().time_s()));
    if (!message.has_scene()) continue;
    order.push_back(fmt::format("scene {}: {} obstacles, {} vertices", message.scene().time_s(),
                                message.scene().obstacles_size(), message.scene().vertices_size()));
    for (const auto& vertices : message.scene().vertices()) CHECK(vertices.obstacle_id() == 2);
  }
  CHECK(order == std::vector<std::string>{"scene 0.5: 2 obstacles, 0 vertices", "frame 0.5",
                                          "scene 0.75: 0 obstacles, 1 vertices", "frame 0.75",
                                          "scene 1: 0 obstacles, 1 vertices", "frame 1"});
}

TEST_CASE("a floor that reaches beyond the motion becomes a plane, a table's top stays a mesh") {
  const ScratchFolder folder;
  Entries entries = square_entries();
  ImportOptions options;
  options.obstacle_surface = "marble";
  SECTION("floor below") {
    add_floor(entries, 2, -0.5f);
    REQUIRE(import_entries(folder, entries, options)->reflecting_planes == 1);
    const auto message = messages_of(folder / "square.mcap")[2];
    const v1::Obstacle& obstacle = message.scene().obstacles(0);
    REQUIRE(obstacle.has_plane());
    CHECK(obstacle.reflecting());
    CHECK(obstacle.surface_material() == "marble");
    CHECK(obstacle.plane().normal().z() == 1);
    CHECK(obstacle.plane().point().z() == -0.5);
  }
  SECTION("ceiling above") {
    add_floor(entries, 2, 3);
    REQUIRE(import_entries(folder, entries, options));
    CHECK(messages_of(folder / "square.mcap")[2].scene().obstacles(0).plane().normal().z() == -1);
  }
  SECTION("off by option") {
    add_floor(entries, 2, -0.5f);
    options.reflecting = false;
    REQUIRE(import_entries(folder, entries, options)->reflecting_planes == 0);
    CHECK(messages_of(folder / "square.mcap")[2].scene().obstacles(0).mesh().vertices().size() == 48);
  }
  SECTION("too small, passed through, bent or with a notch") {
    const auto kind = GENERATE(0, 1, 2, 3);
    add_floor(entries, kind == 0 ? 0.9f : 2.f, kind == 1 ? 1.f : -0.5f);
    if (kind == 2) {
      replace(entries, "obstacle0_vertices", npy<float>("<f4", {4, 3}, {-2, -2, -1, 2, -2, -1, 2, 2, -1, -2, 2, -1.01f}));
    }
    if (kind == 3) {
      replace(entries, "obstacle0_vertices",
              npy<float>("<f4", {5, 3}, {-2, -2, -1, 2, -2, -1, 2, 2, -1, -2, 2, -1, -1, 1, -1}));
      replace(entries, "obstacle0_triangles", npy<std::int32_t>("<i4", {3, 3}, {0, 1, 4, 1, 2, 4, 2, 3, 4}));
    }
    const auto summary = import_entries(folder, entries, options);
    REQUIRE(summary);
    CHECK(summary->reflecting_planes == 0);
    REQUIRE(summary->remarks.size() == 1);
    CHECK(summary->remarks[0].find("obstacle0 stays a mesh") == 0);
    CHECK(messages_of(folder / "square.mcap")[2].scene().obstacles(0).has_mesh());
  }
}

TEST_CASE("what is wrong with an archive is named by file and array, and leaves no file") {
  struct Case {
    std::string field, text;
    std::function<void(Entries&)> spoil;
  };
  const std::vector<float> square = square_positions();
  std::vector<float> with_nan = square;
  with_nan[12 + 7] = std::numeric_limits<float>::quiet_NaN();
  const std::vector<Case> cases{
      {"positions", "is missing", [](Entries& e) { e.erase(e.begin()); }},
      {"triangles", "is missing", [](Entries& e) { e.erase(e.begin() + 1); }},
      {"positions", "frame 1: vertex 2 is at nan",
       [&](Entries& e) {
         replace(e, "positions", npy("<f4", {3, 4, 3}, with_nan));
       }},
      {"positions", "(36, 1)",
       [&](Entries& e) {
         replace(e, "positions", npy("<f4", {36, 1}, square));
       }},
      {"positions", "whole numbers",
       [&](Entries& e) {
         replace(e, "positions", npy<std::int32_t>("<i4", {3, 4, 3}, std::vector<std::int32_t>(36)));
       }},
      {"positions", "'<f2'",
       [&](Entries& e) {
         replace(e, "positions", npy_bytes("<f2", {3, 4, 3}, std::string(72, '\0')));
       }},
      {"positions", "'>f4'",
       [&](Entries& e) {
         replace(e, "positions", npy_bytes(">f4", {3, 4, 3}, std::string(144, '\0')));
       }},
      {"positions", "Fortran",
       [&](Entries& e) {
         replace(e, "positions", npy_bytes("<f4", {3, 4, 3}, std::string(144, '\0'), true));
       }},
      {"positions", "holds 144 bytes",
       [&](Entries& e) {
         replace(e, "positions", npy_bytes("<f4", {4, 4, 3}, std::string(144, '\0')));
       }},
      {"positions", "too large",
       [&](Entries& e) {
         replace(e, "positions", npy_bytes("<f4", {1u << 31, 1u << 31, 1u << 31}, ""));
       }},
      {"positions", "no frames",
       [&](Entries& e) {
         replace(e, "positions", npy_bytes("<f4", {0, 4, 3}, ""));
       }},
      {"positions", "no vertices",
       [&](Entries& e) {
         replace(e, "positions", npy_bytes("<f4", {3, 0, 3}, ""));
         replace(e, "pinned", npy_bytes("|b1", {0}, ""));
       }},
      {"positions", "no .npy", [&](Entries& e) { replace(e, "positions", "hello"); }},
      {"triangles", "triangle 1 asks for vertex 4 of 4",
       [](Entries& e) {
         replace(e, "triangles", npy<std::int32_t>("<i4", {2, 3}, {0, 1, 2, 0, 2, 4}));
       }},
      {"triangles", "entry 3 is -1",
       [](Entries& e) {
         replace(e, "triangles", npy<std::int32_t>("<i4", {2, 3}, {0, 1, 2, -1, 2, 3}));
       }},
      {"triangles", "real numbers",
       [](Entries& e) {
         replace(e, "triangles", npy<float>("<f4", {2, 3}, {0, 1, 2, 0, 2, 3}));
       }},
      {"times", "frame 2: time 0.75 s does not come after 0.75 s",
       [](Entries& e) {
         replace(e, "times", npy<double>("<f8", {3}, {0, 0.75, 0.75}));
       }},
      {"times", "frame 0: nan s",
       [](Entries& e) {
         replace(e, "times", npy<double>("<f8", {3}, {std::nan(""), 1, 2}));
       }},
      {"times", "for 3 frames",
       [](Entries& e) {
         replace(e, "times", npy<double>("<f8", {2}, {0, 1}));
       }},
      {"pinned", "(3,)",
       [](Entries& e) {
         replace(e, "pinned", npy<std::uint8_t>("|b1", {3}, {1, 0, 1}));
       }},
      {"material_coordinates", "instead of (4, 2)",
       [](Entries& e) {
         replace(e, "material_coordinates", npy<float>("<f4", {3, 2}, {0, 0, 1, 0, 1, 1}));
       }},
      {"vertex_offsets", "is missing",
       [&](Entries& e) {
         replace(e, "triangle_offsets", npy<std::int64_t>("<i8", {2}, {0, 2}));
         replace(e, "positions", npy("<f4", {12, 3}, square));
       }},
      {"vertex_offsets", "does not rise",
       [&](Entries& e) {
         replace(e, "triangle_offsets", npy<std::int64_t>("<i8", {3}, {0, 1, 2}));
         replace(e, "vertex_offsets", npy<std::int64_t>("<i8", {3}, {0, 13, 12}));
         replace(e, "positions", npy("<f4", {12, 3}, square));
       }},
      {"obstacle0_triangles", "is missing",
       [](Entries& e) {
         replace(e, "obstacle0_vertices", npy<float>("<f4", {1, 3}, {0, 0, 0}));
       }},
      {"obstacle0_triangles", "asks for vertex 7",
       [](Entries& e) {
         add_floor(e, 1, 0);
         replace(e, "obstacle0_triangles", npy<std::int32_t>("<i4", {1, 3}, {0, 1, 7}));
       }},
      {"obstacle0_vertices", "frame 0, vertex 0",
       [](Entries& e) { add_floor(e, std::numeric_limits<float>::infinity(), 0); }},
  };
  for (const Case& each : cases) {
    const ScratchFolder folder;
    Entries entries = square_entries();
    each.spoil(entries);
    const auto result = import_entries(folder, entries);
    INFO(each.field << ": " << each.text);
    REQUIRE_FALSE(result);
    CHECK(result.error().field == each.field);
    CHECK(result.error().message.find(each.text) != std::string::npos);
    CHECK(result.error().text().find("square.npz") != std::string::npos);
    CHECK_FALSE(std::filesystem::exists(folder / "square.mcap"));
    CHECK_FALSE(std::filesystem::exists(folder / "square.mcap.partial"));
  }
}

TEST_CASE("unknown arrays are remarked on") {
  const ScratchFolder folder;
  Entries entries = square_entries();
  entries.emplace_back("velocity.npy", npy<float>("<f4", {1}, {0}));
  const auto summary = import_entries(folder, entries);
  REQUIRE(summary);
  REQUIRE(summary->remarks.size() == 1);
  CHECK(summary->remarks[0].find("velocity") != std::string::npos);
}

TEST_CASE("a failed import leaves the capture that was there") {
  const ScratchFolder folder;
  REQUIRE(import_entries(folder, square_entries()));
  Entries spoilt = square_entries();
  replace(spoilt, "times", npy<double>("<f8", {3}, {0, 2, 1}));
  REQUIRE_FALSE(import_entries(folder, spoilt));
  CHECK(messages_of(folder / "square.mcap").size() == 7);
}

TEST_CASE("a mesh that no daemon takes is refused before it is a capture") {
  const ScratchFolder folder;
  const std::size_t limit = rustle::wire::Limits{}.vertices;
  for (const std::size_t vertices : {limit, limit + 1}) {
    Entries entries = square_entries();
    replace(entries, "positions", npy("<f4", {1, vertices, 3}, std::vector<float>(3 * vertices)));
    replace(entries, "times", npy<double>("<f8", {1}, {0.5}));
    replace(entries, "pinned", npy<std::uint8_t>("|b1", {vertices}, std::vector<std::uint8_t>(vertices)));
    const auto result = import_entries(folder, entries);
    CHECK(result.has_value() == (vertices == limit));
    if (!result) CHECK(result.error().remedy == "simplify the mesh");
  }
}

TEST_CASE("options and places that cannot be") {
  const ScratchFolder folder;
  ImportOptions options;
  options.metres_per_unit = 0;
  CHECK(import_entries(folder, square_entries(), options).error().field == "scale");
  const auto missing = import_capture((folder / "missing.npz").string(), folder / "x.mcap", {});
  REQUIRE_FALSE(missing);
  CHECK(missing.error().text().find("missing.npz") != std::string::npos);
  const auto nowhere = import_npz(folder.write("square.npz", zip_of(square_entries())), folder / "no/x.mcap", {});
  REQUIRE_FALSE(nowhere);
  CHECK(nowhere.error().file.find("no/x.mcap") != std::string::npos);
}

TEST_CASE("zip files: stored, deflated and zip64") {
  const ScratchFolder folder;
  const std::string text = fmt::format("{:>5000}", "content");
  for (const ZipOptions options : {ZipOptions{false, false}, ZipOptions{true, false}, ZipOptions{true, true}}) {
    auto archive =
        ZipArchive::open(folder.write("a.zip", zip_of({{"first", text}, {"second", "2"}, {"empty", ""}}, options)));
    REQUIRE(archive);
    REQUIRE(archive->entries().size() == 3);
    CHECK(archive->entries()[1].name == "second");
    CHECK(archive->read(archive->entries()[0]).value() == text);
    CHECK(archive->read(archive->entries()[1]).value() == "2");
    CHECK(archive->read(archive->entries()[2]).value() == "");
  }
}

TEST_CASE("damaged zip files and arrays never crash and never give other data") {
  const ScratchFolder folder;
  const std::string array = npy<double>("<f8", {3}, {1, 2, 3});
  const std::string whole = zip_of({{"times.npy", array}}, {true, true});
  std::mt19937 random(1);
  std::size_t other_data = 0;
  const auto try_reading = [&](const std::string& bytes) {
    auto archive = ZipArchive::open(folder.write("a.zip", bytes));
    if (!archive) return;
    for (const auto& entry : archive->entries()) {
      const auto read = archive->read(entry);
      if (read && *read != array && entry.size != 0) ++other_data;
    }
  };
  for (std::size_t length = 0; length < whole.size(); length += 3) try_reading(whole.substr(0, length));
  for (std::size_t bit = 0; bit < 8 * whole.size(); bit += 5) {
    std::string damaged = whole;
    damaged[bit / 8] = static_cast<char>(damaged[bit / 8] ^ (1 << (bit % 8)));
    try_reading(damaged);
  }
  CHECK(other_data == 0);

  std::size_t parsed = 0;
  for (std::size_t length = 0; length < array.size(); ++length) parsed += parse_npy(array.substr(0, length)) ? 1 : 0;
  CHECK(parsed == 0);
  for (int i = 0; i < 20'000; ++i) {
    std::string damaged = array;
    for (int k = 0; k < 3; ++k) damaged[random() % 80] = static_cast<char>(random());
    const auto result = parse_npy(damaged);
    if (result) CHECK(result->element_count() * 1 <= result->data.size());
  }
}

TEST_CASE("a zip entry cannot claim more than its data can hold") {
  const ScratchFolder folder;
  std::string bytes = zip_of({{"a", "abc"}});
  const std::size_t directory = bytes.find(std::string("PK\x01\x02", 4));
  const std::uint32_t size = 0xf0000000u;
  std::memcpy(bytes.data() + directory + 24, &size, sizeof size);
  auto archive = ZipArchive::open(folder.write("a.zip", bytes));
  REQUIRE(archive);
  const auto read = archive->read(archive->entries()[0]);
  REQUIRE_FALSE(read);
  CHECK(read.error() == "states a size that its data cannot have");
}

TEST_CASE("real simulator output imports whole", "[captures]") {
  struct Case {
    const char* name;
    std::uint64_t frames, topologies, min_vertices, max_vertices, min_triangles, max_triangles, obstacles, planes;
  };
  const Case cases[] = {
      {"arcsim_crumple", 151, 150, 69, 2099, 110, 4034, 1, 0}, {"arcsim_tear", 145, 79, 160, 736, 284, 1362, 0, 0},
      {"blender_cotton", 240, 1, 609, 609, 1120, 1120, 2, 1},  {"blender_crumple", 240, 1, 609, 609, 1120, 1120, 0, 0},
      {"blender_shake", 240, 1, 609, 609, 1120, 1120, 0, 0},   {"blender_table", 240, 1, 609, 609, 1120, 1120, 1, 0}};
  const ScratchFolder folder;
  for (const Case& each : cases) {
    const std::filesystem::path input =
        std::filesystem::path(RUSTLE_SOURCE_DIR) / "../shared/captures" / fmt::format("{}.npz", each.name);
    if (!std::filesystem::exists(input)) {
      WARN(input << " is absent");
      continue;
    }
    INFO(each.name);
    double done = 0;
    const auto summary = import_capture(input.string(), folder / "out.mcap", {}, [&](double fraction) {
      CHECK(fraction > done);
      done = fraction;
    });
    if (!summary) FAIL(summary.error().text());
    CHECK(done == 1.0);
    CHECK(summary->frames == each.frames);
    CHECK(summary->topologies == each.topologies);
    CHECK(summary->min_vertices == each.min_vertices);
    CHECK(summary->max_vertices == each.max_vertices);
    CHECK(summary->min_triangles == each.min_triangles);
    CHECK(summary->max_triangles == each.max_triangles);
    CHECK(summary->obstacles == each.obstacles);
    CHECK(summary->reflecting_planes == each.planes);
    std::uint64_t frames = 0, topologies = 0;
    const auto messages = messages_of(folder / "out.mcap");
    for (const auto& message : messages) {
      frames += message.has_frame() ? 1 : 0;
      topologies += message.has_topology() ? 1 : 0;
    }
    CHECK(frames == each.frames);
    CHECK(topologies == each.topologies);
    CHECK(messages.front().session_id() == "out");
    CHECK(messages.size() == summary->messages);
  }
}

TEST_CASE("OBJ: polygons, negative indices, texture coordinates") {
  const auto mesh = parse_obj(
      "# a square and a triangle\r\no first\nv 0 0 0\nv 1 0 0\nv 1 1 0 \nv 0 1e0 0\nvt 0 0\nvt 2 0\nvt 2 2\nvt 0 2\nvn 0 0 "
      "1\n"
      "f 1/1/1 2/2/1 3/3/1 4/4/1\nv 2 2 +1.5\nvt 9 9\nf -1/-1 -2/4 3\n");
  REQUIRE(mesh);
  CHECK(mesh->positions == std::vector<float>{0, 0, 0, 1, 0, 0, 1, 1, 0, 0, 1, 0, 2, 2, 1.5f});
  CHECK(mesh->triangles == std::vector<std::uint32_t>{0, 1, 2, 0, 2, 3, 4, 3, 2});
  CHECK(mesh->texture_coordinates == std::vector<float>{0, 0, 2, 0, 2, 2, 0, 2, 9, 9});
  const auto seam = parse_obj("v 0 0 0\nv 1 0 0\nv 1 1 0\nvt 0 0\nvt 1 1\nf 1/1 2/1 3/1\nf 1/2 2/1 3/1\n");
  REQUIRE(seam);
  CHECK(seam->texture_coordinates.empty());
}

TEST_CASE("OBJ: what is wrong is named by its line") {
  const auto place = [](const char* text) {
    const auto mesh = parse_obj(text);
    return mesh ? std::string("fine") : mesh.error().place + ": " + mesh.error().message;
  };
  CHECK(place("v 0 0 0\nv 1 zero 0\n").find("line 2: \"zero\"") == 0);
  CHECK(place("v 0 0 0\nf 1 1 2\n").find("line 2: \"2\"") == 0);
  CHECK(place("v 0 0 0\nf 1 1 0\n").find("line 2: \"0\"") == 0);
  CHECK(place("v 0 0 0\nf 1 1 -2\n").find("line 2: \"-2\"") == 0);
  CHECK(place("v 0 0 0\nf 1 1\n").find("line 2: a face") == 0);
  CHECK(place("v 0 0\n").find("line 1") == 0);
}

TEST_CASE("PLY: ascii and binary give the same mesh") {
  const std::string elements =
      "comment made by hand\nelement vertex 4\nproperty float x\nproperty double y\nproperty float z\nproperty uchar red\n"
      "element face 2\nproperty list uchar int vertex_indices\nproperty short mark\nelement edge 0\nproperty int "
      "a\nend_header\n";
  const auto ascii = parse_ply("ply\nformat ascii 1.0\n" + elements +
                               "0 0 0 255\n1 0 0 255\n1 1 0 255\n0 1 0.5 255\n4 0 1 2 3 7\n3 0 1 2 7\n");
  REQUIRE(ascii);
  std::string body;
  for (const auto& [x, y, z] : {std::tuple{0.f, 0., 0.f}, {1.f, 0., 0.f}, {1.f, 1., 0.f}, {0.f, 1., 0.5f}}) {
    append_value(body, x);
    append_value(body, y);
    append_value(body, z);
    append_value(body, std::uint8_t{255});
  }
  for (const std::vector<std::int32_t>& face : {std::vector<std::int32_t>{0, 1, 2, 3}, {0, 1, 2}}) {
    append_value(body, static_cast<std::uint8_t>(face.size()));
    for (const std::int32_t index : face) append_value(body, index);
    append_value(body, std::int16_t{7});
  }
  const std::string binary_file = "ply\nformat binary_little_endian 1.0\n" + elements + body;
  const auto binary = parse_ply(binary_file);
  REQUIRE(binary);
  CHECK(binary->positions == ascii->positions);
  CHECK(binary->triangles == ascii->triangles);
  CHECK(binary->triangles == std::vector<std::uint32_t>{0, 1, 2, 0, 2, 3, 0, 1, 2});
  CHECK(binary->positions == std::vector<float>{0, 0, 0, 1, 0, 0, 1, 1, 0, 0, 1, 0.5f});

  for (std::size_t length = 0; length < binary_file.size(); ++length) CHECK_FALSE(parse_ply(binary_file.substr(0, length)));
  CHECK_FALSE(parse_ply("ply\nformat binary_big_endian 1.0\n" + elements));
  std::string beyond = binary_file;
  beyond[binary_file.size() - 2 - 12] = 9;
  const auto refused = parse_ply(beyond);
  REQUIRE_FALSE(refused);
  CHECK(refused.error().place == "face 1");
}

TEST_CASE("mesh sequences come in natural order and send a topology when faces change") {
  const ScratchFolder folder;
  const auto mesh = [](int height, const char* faces) {
    return fmt::format("v 0 0 {0}\nv 1 0 {0}\nv 1 1 {0}\nv 0 1 {0}\n{1}", height, faces);
  };
  folder.write("frame_1.obj", mesh(1, "f 1 2 3\nf 1 3 4\n"));
  folder.write("frame_2.obj", mesh(2, "f 1 2 3 4\n"));
  folder.write("frame_10.obj", mesh(10, "f 1 2 4\nf 2 3 4\n"));
  folder.write("notes.txt", "not a frame");
  ImportOptions options;
  CHECK(import_capture(folder.path().string(), folder / "out.mcap", options).error().field == "fps");
  options.frames_per_s = 25;
  for (const std::string& input :
       {folder.path().string(), (folder / "frame_*.obj").string(), (folder / "f*_?*.obj").string()}) {
    const auto summary = import_capture(input, folder / "out.mcap", options);
    REQUIRE(summary);
    CHECK(summary->frames == 3);
    CHECK(summary->topologies == 2);
    std::vector<float> heights;
    std::vector<double> times_s;
    for (const auto& message : messages_of(folder / "out.mcap")) {
      if (!message.has_frame()) continue;
      heights.push_back(floats(message.frame().positions())[2]);
      times_s.push_back(message.frame().time_s());
    }
    CHECK(heights == std::vector<float>{1, 2, 10});
    CHECK(times_s == std::vector<double>{0, 0.04, 0.08});
  }
  SECTION("a damaged frame is named") {
    folder.write("frame_3.obj", mesh(3, "f 1 2 9\n"));
    CHECK(import_capture(folder.path().string(), folder / "out.mcap", options).error().text().find("frame_3.obj: line 5") !=
          std::string::npos);
    folder.write("frame_3.obj", "v 0 0 0\nv inf 0 0\nv 0 1 0\nf 1 2 3\n");
    CHECK(
        import_capture(folder.path().string(), folder / "out.mcap", options).error().message.find("frame_3.obj: vertex 1") ==
        0);
  }
  SECTION("two kinds in one folder") {
    folder.write("frame_3.ply", "");
    CHECK(import_capture(folder.path().string(), folder / "out.mcap", options).error().message.find("both") !=
          std::string::npos);
  }
  SECTION("nothing there") {
    CHECK_FALSE(import_capture((folder / "g_*.obj").string(), folder / "out.mcap", options));
    CHECK_FALSE(import_capture((folder / "notes.txt").string(), folder / "out.mcap", options));
    CHECK_FALSE(import_capture((folder / "none").string(), folder / "out.mcap", options));
  }
}

}  // namespace rustle::capture::import_test
