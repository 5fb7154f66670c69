#include <fmt/format.h>
#include <catch2/catch.hpp>

#include <fstream>
#include <functional>
#include <limits>
#include <optional>
#include <regex>

#include "client_sdk/cpp/certificate.h"
#include "server/apps/configuration.h"
#include "server/apps/daemon.h"
#include "server/apps/strangers.h"
#include "server/monitor/http_server.h"
#include "server/page/page.h"
#include "server/session/inbox.h"
#include "server/wire/control.h"
#include "server/wire/listeners.h"
#include "server/wire/socket.h"
#include "tests/unit/wire/messages.h"

namespace limits_test {

/// The tables of client_sdk/guides/limits.md against the code: every row is tried at its limit and beyond it, and there is
/// no row that is not tried.
namespace {

using namespace rustle;
using namespace rustle::wire;
using namespace rustle::wire::test;
using Outcome = std::optional<Error>;

constexpr Limits kLimits;
constexpr double kBeyond = 1 + 1e-6;

struct Row {
  std::string field, limit;
  std::string code;
  bool operator==(const Row&) const = default;
};

struct Probe {
  Row row;
  std::function<Outcome()> at;      ///< must not be refused with the row's code
  std::function<Outcome()> beyond;  ///< must be
};

Outcome outcome(const tl::expected<Decoded, Error>& decoded) {
  return decoded ? std::nullopt : Outcome(decoded.error());
}

/// One message to a decoder that knows sheet 1, topology 7 and obstacle 5.
Outcome streamed(const v1::StreamMessage& message) {
  Decoder decoder = ready();
  static_cast<void>(decode(decoder, mesh_obstacle_message(5)));
  return outcome(decode(decoder, message));
}

Outcome asked(const v1::ControlRequest& request) {
  const auto read = decode_control(as_bytes(request.SerializeAsString()));
  return read ? std::nullopt : Outcome(read.error().error);
}

std::string text(std::size_t count) {
  return std::string(count, 'x');
}

std::string zeros(std::size_t rows, std::size_t row_bytes) {
  return std::string(rows * row_bytes, '\0');
}

/// A number that may not be greater.
template <class Try>
Probe count(std::string field, std::size_t limit, Try&& attempt, const char* code = "too_large") {
  return {{std::move(field), fmt::format("{}", limit), code},
          [=] { return attempt(limit); },
          [=] { return attempt(limit + 1); }};
}

/// A real number within [low, high].
template <class Try>
Probe range(std::string field, double low, double high, const char* unit, Try&& attempt) {
  return {{std::move(field), fmt::format("{:g} to {:g}{}", low, high, unit), "out_of_range"},
          [=]() -> Outcome {
            if (auto error = attempt(low)) return error;
            return attempt(high);
          },
          [=]() -> Outcome {
            const double below = low > 0 ? low / kBeyond / kBeyond : low * kBeyond - 1e-6;
            if (auto error = attempt(below); !error || error->code != ErrorCode::kOutOfRange) return error;
            return attempt(high * kBeyond + 1e-9);
          }};
}

/// A symmetric range: |value|.
template <class Try>
Probe magnitude(std::string field, double most, const char* unit, Try&& attempt) {
  auto probe = range(std::move(field), -most, most, unit, std::forward<Try>(attempt));
  probe.row.limit = fmt::format("±{:g}{}", most, unit);
  return probe;
}

template <class Fill>
auto option(Fill fill) {
  return [fill](double value) {
    v1::ControlRequest request;
    fill(*request.mutable_attach()->mutable_options(), value);
    return asked(request);
  };
}

template <class Fill>
auto described(Fill fill) {
  return [fill](double value) {
    auto message = sheet_message(2);
    fill(*message.mutable_sheet(), value);
    return streamed(message);
  };
}

template <class Fill>
auto framed(Fill fill) {
  return [fill](auto value) {
    auto message = frame_message(1);
    fill(*message.mutable_frame(), value);
    return streamed(message);
  };
}

std::vector<Probe> sizes() {
  return {
      {{"a stream message", fmt::format("{} bytes", kLimits.message_bytes), "too_large"},
       [] {
         const auto read = StreamEnvelope::parse(as_bytes(zeros(kLimits.message_bytes, 1)), "s");
         return read ? std::nullopt : Outcome(read.error());
       },
       [] {
         const auto read = StreamEnvelope::parse(as_bytes(zeros(kLimits.message_bytes + 1, 1)), "s");
         return read ? std::nullopt : Outcome(read.error());
       }},
      {{"a control request", fmt::format("{} bytes", kLimits.control_bytes), "too_large"},
       [] { return Outcome(decode_control(as_bytes(zeros(kLimits.control_bytes, 1))).error().error); },
       [] { return Outcome(decode_control(as_bytes(zeros(kLimits.control_bytes + 1, 1))).error().error); }},
      {{"a text", fmt::format("{} bytes", kLimits.string_bytes), "too_large"},
       [] { return described([](v1::Sheet& s, double) { s.set_name(text(kLimits.string_bytes)); })(0); },
       [] { return described([](v1::Sheet& s, double) { s.set_name(text(kLimits.string_bytes + 1)); })(0); }},
      {{"a session's id", "128 characters", "malformed"},
       [] {
         const auto read = StreamEnvelope::parse(as_bytes(frame_message().SerializeAsString()), {});
         auto message = frame_message();
         message.set_session_id(text(128));
         const auto longest = StreamEnvelope::parse(as_bytes(message.SerializeAsString()), {});
         return read && longest ? std::nullopt : Outcome(longest.error());
       },
       [] {
         auto message = frame_message();
         message.set_session_id(text(129));
         return Outcome(StreamEnvelope::parse(as_bytes(message.SerializeAsString()), {}).error());
       }},
  };
}

std::vector<Probe> counts() {
  return {
      count("attach.sheets", kLimits.sheets,
            [](std::size_t n) {
              v1::ControlRequest request;
              for (std::size_t k = 0; k < n; ++k)
                request.mutable_attach()->add_sheets()->set_sheet_id(static_cast<std::uint32_t>(k));
              return asked(request);
            }),
      count("sheet", kLimits.sheets,
            [](std::size_t n) {
              Decoder decoder({}, {});
              Outcome last;
              for (std::size_t k = 0; k < n && !last; ++k)
                last = outcome(decode(decoder, sheet_message(static_cast<std::uint32_t>(k + 1))));
              return last;
            }),
      count("topology.vertex_count", kLimits.vertices,
            [](std::size_t n) {
              auto message = topology_message(8);
              message.mutable_topology()->set_vertex_count(static_cast<std::uint32_t>(n));
              return streamed(message);
            }),
      count("topology.triangles", kLimits.triangles,
            [](std::size_t n) {
              auto message = topology_message(8);
              message.mutable_topology()->set_triangles(zeros(n, 12));
              return streamed(message);
            }),
      count("frame.contacts.vertices", kLimits.contacts, framed([](v1::MeshFrame& frame, std::size_t n) {
              auto* contacts = frame.mutable_contacts();
              contacts->set_vertices(zeros(n, 4));
              contacts->set_partners(zeros(n, 4));
              contacts->add_partner_table()->set_obstacle_id(5);
            })),
      count("frame.contacts.partner_table", kLimits.contact_partners, framed([](v1::MeshFrame& frame, std::size_t n) {
              for (std::size_t k = 0; k < n; ++k) frame.mutable_contacts()->add_partner_table()->set_obstacle_id(5);
            })),
      count("frame.tear_tips", kLimits.tear_tips, framed([](v1::MeshFrame& frame, std::size_t n) {
              for (std::size_t k = 0; k < n; ++k) set(frame.add_tear_tips()->mutable_position(), 0, 0, 0);
            })),
      count("frame.partition.region_curved", kLimits.regions, framed([](v1::MeshFrame& frame, std::size_t n) {
              frame.mutable_partition()->set_region_curved(zeros(n, 1));
              frame.mutable_partition()->set_triangle_regions(zeros(2, 4));
            })),
      count("frame.partition.rulings", kLimits.rulings, framed([](v1::MeshFrame& frame, std::size_t n) {
              frame.mutable_partition()->set_region_curved(zeros(1, 1));
              frame.mutable_partition()->set_triangle_regions(zeros(2, 4));
              frame.mutable_partition()->set_rulings(zeros(n, 24));
              frame.mutable_partition()->set_ruling_regions(zeros(n, 4));
            })),
      count("frame.partition.singular_points", kLimits.singular_points, framed([](v1::MeshFrame& frame, std::size_t n) {
              frame.mutable_partition()->set_region_curved(zeros(1, 1));
              frame.mutable_partition()->set_triangle_regions(zeros(2, 4));
              frame.mutable_partition()->set_singular_points(zeros(n, 12));
            })),
      count("scene.obstacles", kLimits.obstacles,
            [](std::size_t n) {
              auto message = wire::test::message();
              for (std::size_t k = 0; k < n; ++k)
                add_obstacle(message, static_cast<std::uint32_t>(k + 1))->mutable_sphere()->set_radius(1);
              Decoder decoder = ready();
              return outcome(decode(decoder, message));
            }),
      count("scene.obstacles[].mesh.triangles", kLimits.triangles,
            [](std::size_t n) {
              auto message = mesh_obstacle_message(5);
              message.mutable_scene()->mutable_obstacles(0)->mutable_mesh()->set_triangles(zeros(n, 12));
              return streamed(message);
            }),
      count("scene: triangles of all obstacles", kLimits.obstacle_triangles,
            [](std::size_t n) {
              auto message = wire::test::message();
              for (std::uint32_t k = 0; n > 0; ++k) {
                const std::size_t part = std::min(n, kLimits.triangles);
                auto* mesh = add_obstacle(message, k)->mutable_mesh();
                mesh->set_triangles(zeros(part, 12));
                mesh->set_vertices(wire::test::pack(kPositions));
                n -= part;
              }
              Decoder decoder = ready();
              return outcome(decode(decoder, message));
            }),
      count("set_gains.gains", kLimits.gains,
            [](std::size_t n) {
              v1::ControlRequest request;
              for (std::size_t k = 0; k < n; ++k) request.mutable_set_gains()->add_gains();
              return asked(request);
            }),
  };
}

std::vector<Probe> numbers() {
  return {
      magnitude("frame.time_s", kLimits.time_s, " s", framed([](v1::MeshFrame& f, double t) { f.set_time_s(t); })),
      magnitude("scene.time_s", kLimits.time_s, " s",
                [](double t) {
                  auto message = mesh_obstacle_message(6);
                  message.mutable_scene()->set_time_s(t);
                  Decoder decoder = ready();
                  return outcome(decode(decoder, message));
                }),
      magnitude("advance.time_s", kLimits.time_s, " s",
                [](double t) {
                  auto message = wire::test::message();
                  message.mutable_advance()->set_time_s(t);
                  return streamed(message);
                }),
      magnitude("frame.positions", kLimits.position_m, " m", framed([](v1::MeshFrame& f, double x) {
                  auto positions = kPositions;
                  positions[4] = static_cast<float>(x * (std::abs(x) > kLimits.position_m ? kBeyond : 1));
                  f.set_positions(wire::test::pack(positions));
                })),
      magnitude("frame.velocities", kLimits.speed_m_per_s, " m/s", framed([](v1::MeshFrame& f, double x) {
                  std::vector<float> velocities(kPositions.size());
                  velocities[4] = static_cast<float>(x * (std::abs(x) > kLimits.speed_m_per_s ? kBeyond : 1));
                  f.set_velocities(wire::test::pack(velocities));
                })),
      range("frame.contacts.normal_forces", 0, kLimits.normal_force_n, " N", framed([](v1::MeshFrame& f, double x) {
              auto* contacts = f.mutable_contacts();
              contacts->set_vertices(zeros(1, 4));
              contacts->set_partners(zeros(1, 4));
              contacts->add_partner_table()->set_obstacle_id(5);
              contacts->set_normal_forces(
                  wire::test::pack(std::vector<float>{static_cast<float>(x * (x > kLimits.normal_force_n ? kBeyond : 1))}));
            })),
      range("frame.tear_tips[].speed", 0, kLimits.speed_m_per_s, " m/s", framed([](v1::MeshFrame& f, double x) {
              auto* tip = f.add_tear_tips();
              set(tip->mutable_position(), 0, 0, 0);
              tip->set_speed(x);
            })),
      magnitude("listener.position", kLimits.position_m, " m",
                [](double x) {
                  auto message = wire::test::message();
                  set(message.mutable_listener()->mutable_position(), x, 0, 0);
                  return streamed(message);
                }),
      range("sheet.grammage_kg_per_m2", 1e-4, 100, " kg/m²",
            described([](v1::Sheet& s, double x) { s.set_grammage_kg_per_m2(x); })),
      range("sheet.thickness_m", 1e-7, 0.1, " m", described([](v1::Sheet& s, double x) { s.set_thickness_m(x); })),
      range("scene.obstacles[].reflection_coefficient", 0, 1, "",
            [](double x) {
              auto message = mesh_obstacle_message(6);
              message.mutable_scene()->mutable_obstacles(0)->set_reflection_coefficient(x);
              return streamed(message);
            }),
      range("scene.obstacles[].sphere.radius", 1e-6, kLimits.position_m, " m",
            [](double x) {
              auto message = wire::test::message();
              add_obstacle(message, 6)->mutable_sphere()->set_radius(x);
              return streamed(message);
            }),
      range("set_gains.gains[].gain_db", -200, synthesis::kMostGain_db, " dB, or -inf",
            [](double x) {
              v1::ControlRequest request;
              request.mutable_set_gains()->add_gains()->set_gain_db(x);
              return asked(request);
            }),
      magnitude("options.time_origin_s", kLimits.time_s, " s",
                option([](v1::SessionOptions& o, double x) { o.set_time_origin_s(x); })),
      range("options.metres_per_unit", kLimits.metres_per_unit_min, kLimits.metres_per_unit_max, " m",
            option([](v1::SessionOptions& o, double x) { o.set_metres_per_unit(x); })),
      range("options.playout_delay_s", 0, 10, " s",
            option([](v1::SessionOptions& o, double x) { o.set_playout_delay_s(x); })),
  };
}

/// Whole numbers within [low, high]; 0 leaves the choice to the daemon.
Probe whole(std::string field, std::uint32_t low, std::uint32_t high, void (v1::SessionOptions::*member)(std::uint32_t)) {
  const auto attempt = [member](std::uint32_t value) {
    v1::ControlRequest request;
    (request.mutable_attach()->mutable_options()->*member)(value);
    return asked(request);
  };
  return {{std::move(field), fmt::format("{} to {}", low, high), "out_of_range"},
          [=]() -> Outcome {
            if (auto error = attempt(low)) return error;
            return attempt(high);
          },
          [=]() -> Outcome {
            if (low > 1)
              if (auto error = attempt(low - 1); !error) return error;
            return attempt(high + 1);
          }};
}

std::vector<Probe> probes() {
  std::vector<Probe> all = sizes();
  for (auto&& more : {counts(), numbers()}) all.insert(all.end(), more.begin(), more.end());
  all.push_back(whole("options.rate_hz", 8'000, 192'000, &v1::SessionOptions::set_rate_hz));
  all.push_back(whole("options.block_size", 16, 8'192, &v1::SessionOptions::set_block_size));
  all.push_back(whole("options.friction_fft_size", 128, 8'192, &v1::SessionOptions::set_friction_fft_size));
  all.push_back(whole("options.most_voices", 1, 512, &v1::SessionOptions::set_most_voices));
  return all;
}

std::string mib(std::size_t bytes) {
  return fmt::format("{} MiB", bytes >> 20);
}

/// What no single field says.
std::vector<Row> standing() {
  const apps::Strangers::Limits strangers;
  const Sockets::Options sockets;
  return {
      {"a session: messages that wait", fmt::format("{}", session::Inbox::kMessages), "overloaded"},
      {"a session: bytes that wait", mib(session::Inbox::kBytes), "overloaded"},
      {"a live session: frames that wait", fmt::format("{}", session::Inbox::kBacklogFrames), "dropped: backlog"},
      {"a session: meshes that others replaced", fmt::format("{}", kLimits.replaced_topologies), "the longest unused go"},
      {"a session: meshes sent ahead", fmt::format("{}", kLimits.waiting_topologies), "the oldest go"},
      {"a session: triangles of both", fmt::format("{}", kLimits.kept_triangles), "replaced ones go first"},
      {"sessions", fmt::format("{}", apps::DaemonOptions{}.max_sessions), "quota_exceeded"},
      {"a publisher not yet announced: messages kept", fmt::format("{}", strangers.messages), "too_large"},
      {"a publisher not yet announced: bytes kept", mib(strangers.bytes), "too_large"},
      {"all of those together", mib(strangers.bytes_together), "too_large"},
      {"a publisher's queue here", fmt::format("{} messages", sockets.stream_queue_messages), "it waits, or drops"},
      {"a listener's queue here", fmt::format("{} messages", sockets.out_queue_messages), "it loses messages, counted"},
      {"topics with a subscription, with keys", fmt::format("{}", Listeners::kMostTopics), "not granted"},
      {"a connection without a handshake", fmt::format("{} s", wire::Socket::kHandshakeMs / 1000), "closed"},
      {"the page: viewers", fmt::format("{}", apps::Configuration{}.viewers), "503"},
      {"the page: a viewer's message", fmt::format("{} bytes", page::kRequestBytes), "closed (1009)"},
      {"the page: frames of a sheet", fmt::format("{} a second", session::Watch::kFramesPerSecond), "left out"},
      {"the page: frames of a sheet that wait for a viewer", fmt::format("{}", page::Outbox::kPictures), "the older goes"},
      {"the page: sound that waits for a viewer", fmt::format("{:.0f} s", page::Outbox::kPcm_s), "it has a gap"},
      {"the page: requests of a viewer not yet answered", fmt::format("{}", page::Page::kMostAsked), "an error notice"},
      {"HTTP: connections, viewers among them", fmt::format("{}", monitor::HttpServer::Options{}.connections), "503"},
      {"connections not yet accepted, each endpoint", fmt::format("{}", wire::Socket::kBacklog), "the system refuses"},
  };
}

/// Rows of three cells, the first and last of which are in backquotes or not.
std::vector<Row> rows_of_guide() {
  std::ifstream in(std::string(RUSTLE_SOURCE_DIR) + "/client_sdk/guides/limits.md");
  REQUIRE(in);
  static const std::regex kRow(R"(^\| `?([^|`]+)`? \| ([^|]+) \| `?([^|`]+)`? \|$)");
  std::vector<Row> rows;
  std::string line;
  std::smatch cells;
  while (std::getline(in, line))
    if (std::regex_match(line, cells, kRow) && cells[1] != "what" && cells[1] != "---")
      rows.push_back({cells[1], cells[2], cells[3]});
  return rows;
}

}  // namespace

TEST_CASE("the guide's tables of limits are the code's", "[limits]") {
  std::vector<Row> expected;
  for (const Probe& probe : probes()) expected.push_back(probe.row);
  for (const Row& row : standing()) expected.push_back(row);
  const auto told = rows_of_guide();
  for (const Row& row : expected) {
    INFO("| `" << row.field << "` | " << row.limit << " | `" << row.code << "` |");
    CHECK(std::find(told.begin(), told.end(), row) != told.end());
  }
  CHECK(told.size() == expected.size());
}

TEST_CASE("every limit is taken, and refused beyond with the error that the guide tells", "[limits]") {
  for (const Probe& probe : probes()) {
    INFO(probe.row.field);
    const auto at = probe.at();
    if (at) {
      INFO(to_string(*at));
      CHECK(code_name(at->code) != probe.row.code);
    }
    const auto beyond = probe.beyond();
    REQUIRE(beyond.has_value());
    INFO(to_string(*beyond));
    CHECK(code_name(beyond->code) == probe.row.code);
    CHECK_FALSE(beyond->remedy.empty());
  }
}

TEST_CASE("what is no number is refused as that wherever numbers are taken", "[limits]") {
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN(), kInfinity = std::numeric_limits<double>::infinity();
  const std::vector<std::function<Outcome(double)>> fields{
      framed([](v1::MeshFrame& f, double x) { f.set_time_s(x); }),
      framed([](v1::MeshFrame& f, double x) {
        auto positions = kPositions;
        positions[7] = static_cast<float>(x);
        f.set_positions(wire::test::pack(positions));
      }),
      framed([](v1::MeshFrame& f, double x) {
        auto* tip = f.add_tear_tips();
        set(tip->mutable_position(), 0, 0, x);
      }),
      described([](v1::Sheet& s, double x) { s.set_thickness_m(x); }),
      option([](v1::SessionOptions& o, double x) { o.set_metres_per_unit(x); }),
      option([](v1::SessionOptions& o, double x) { o.set_playout_delay_s(x); }),
      option([](v1::SessionOptions& o, double x) { o.set_time_origin_s(x); }),
  };
  for (const auto& field : fields)
    for (const double value : {kNan, kInfinity, -kInfinity}) {
      const auto error = field(value);
      REQUIRE(error.has_value());
      CHECK(code_name(error->code) == "not_finite");
    }
}

}  // namespace limits_test
