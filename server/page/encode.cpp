#include "server/page/encode.h"

#include <bit>
#include <cmath>
#include <cstring>
#include <nlohmann/json.hpp>
#include <type_traits>
#include <utility>

#include "server/engine/economy.h"
#include "server/wire/topics.h"

namespace rustle::page {
namespace {

using Json = nlohmann::ordered_json;

static_assert(std::endian::native == std::endian::little, "what is sent is copied as it lies in memory");

constexpr double kSilent_db = -120;

std::string text_of(const Json& json) {
  return json.dump(-1, ' ', false, Json::error_handler_t::replace);
}

Json array_of(const sheet::Vec3d& v) {
  return {v.x(), v.y(), v.z()};
}

Json decibels_of(double amplitude) {
  const double db = amplitude > 0 ? 20 * std::log10(amplitude) : -std::numeric_limits<double>::infinity();
  return db < kSilent_db ? Json(nullptr) : Json(db);
}

Json milliseconds_of(const std::optional<double>& s) {
  return s ? Json(1000 * *s) : Json(nullptr);
}

Json json_of(const Rights& rights) {
  return {{"listen", rights.listen}, {"change", rights.change}};
}

/// Those that concern the whole session, or all sounds of a kind; those of single sheets and materials have other places.
Json gains_of(const std::vector<synthesis::Gain>& gains) {
  Json out = {{"master", 0.0}};
  for (const auto& gain : gains) {
    if (gain.sheet_id || !gain.material.empty()) continue;
    out[std::string(gain.kind ? wire::kind_name(*gain.kind) : "master")] =
        std::isfinite(gain.gain_db) ? Json(gain.gain_db) : Json(nullptr);
  }
  return out;
}

Json json_of(const SessionFigures& session, const Rights& rights) {
  Json dropped = Json::object();
  for (const auto& [cause, frames] : session.frames_dropped)
    if (frames > 0) dropped[cause] = frames;
  const auto& level = session.level;
  const double mean_square = level.samples > 0 ? level.squares / static_cast<double>(level.samples) : 0;
  Json out;
  out["id"] = session.id;
  out["name"] = session.name;
  out["clock"] = session.live ? "live" : "simulation";
  out["ended"] = session.ended;
  out["sample_rate"] = session.rate_hz;
  out["channels"] = session.channels;
  out["rights"] = json_of(rights);
  out["sheets"] = session.sheets;
  out["voices"] = session.voices;
  out["frames"] = {{"received", session.frames_received}, {"analysed", session.frames_analysed}, {"dropped", dropped}};
  out["playout_delay_ms"] = 1000 * session.playout_delay_s;
  out["peak_db"] = decibels_of(level.peak);
  out["rms_db"] = decibels_of(std::sqrt(mean_square));
  out["gains_db"] = gains_of(session.gains);
  return out;
}

// ---- obstacles

struct DescribeShape {
  Json& out;
  void operator()(const scene::PlaneShape&) const { out["kind"] = "plane"; }
  void operator()(const scene::BoxShape& box) const {
    out["kind"] = "box";
    out["half_extents"] = array_of(box.half_extents_m);
  }
  void operator()(const scene::SphereShape& sphere) const {
    out["kind"] = "sphere";
    out["radius"] = sphere.radius_m;
  }
  void operator()(const scene::CapsuleShape& capsule) const {
    out["kind"] = "capsule";
    out["radius"] = capsule.radius_m;
    out["half_length"] = capsule.half_length_m;
  }
  void operator()(const scene::MeshShape&) const {
    out["kind"] = "mesh";
    out["mesh"] = true;
  }
};

// ---- binary

class Bytes {
 public:
  Bytes(std::uint32_t kind, std::uint32_t place, std::size_t size) {
    out_.reserve(size);
    *this << kind << place;
  }
  template <class Number>
  requires std::is_arithmetic_v<Number> Bytes& operator<<(Number number) {
    out_.append(reinterpret_cast<const char*>(&number), sizeof number);
    return *this;
  }
  template <class Each>
  Bytes& operator<<(std::span<const Each> values) {
    out_.append(reinterpret_cast<const char*>(values.data()), values.size_bytes());
    return *this;
  }
  void pad_to(std::size_t multiple) { out_.resize((out_.size() + multiple - 1) / multiple * multiple); }
  std::string take() { return std::move(out_); }

 private:
  std::string out_;
};

static_assert(sizeof(sheet::Vec3f) == 3 * sizeof(float) && sizeof(Segment) == 6 * sizeof(float));

std::uint32_t count_of(std::size_t size) {
  return static_cast<std::uint32_t>(size);
}

}  // namespace

std::string hello_text(const Hello& hello) {
  return text_of({{"type", "hello"},
                  {"version", kVersion},
                  {"daemon", hello.daemon},
                  {"machine", hello.machine},
                  {"sample_rate", hello.rate_hz},
                  {"channels", hello.channels},
                  {"rights", json_of(hello.rights)},
                  {"needs_key", hello.needs_key}});
}

std::string notice_text(const std::string& text, NoticeLevel level) {
  const char* name = level == NoticeLevel::kInfo ? "info" : level == NoticeLevel::kWarning ? "warning" : "error";
  return text_of({{"type", "notice"}, {"text", text}, {"level", name}});
}

std::string figures_text(const Figures& figures, const OwnFigures& own, std::span<const Rights> rights) {
  Json out;
  out["type"] = "figures";
  out["time_s"] = own.unix_s;
  out["uptime_s"] = figures.up_s;
  out["load_level"] = figures.load_level;
  out["load_level_name"] = engine::meaning_of(figures.load_level);
  out["cpu_share"] = own.cpu_share;
  out["latency_ms"] = {{"p50", milliseconds_of(own.latency_p50_s)}, {"p99", milliseconds_of(own.latency_p99_s)}};
  out["pcm_gaps"] = figures.pcm_gaps;
  out["viewers"] = own.viewers;
  out["sessions"] = Json::array();
  for (std::size_t k = 0; k < figures.sessions.size(); ++k)
    out["sessions"].push_back(json_of(figures.sessions[k], k < rights.size() ? rights[k] : Rights{}));
  return text_of(out);
}

std::optional<double> quantile_s(const session::DurationHistogram::Counts& counts, double share) {
  constexpr auto& kUpTo_s = session::DurationHistogram::kUpTo_s;
  const double wanted = share * static_cast<double>(counts.all());
  if (counts.all() == 0) return std::nullopt;
  double below = 0;
  for (std::size_t k = 0; k < kUpTo_s.size(); ++k) {
    const auto here = static_cast<double>(counts.in_range[k]);
    if (here > 0 && below + here >= wanted) {
      const double from_s = k == 0 ? 0 : kUpTo_s[k - 1];
      return from_s + (kUpTo_s[k] - from_s) * (wanted - below) / here;
    }
    below += here;
  }
  return kUpTo_s.back();
}

std::string scene_text(const std::string& session, const engine::Surroundings& around, std::span<const SheetSize> sizes) {
  Json out;
  out["type"] = "scene";
  out["session"] = session;
  out["listener"] = nullptr;
  if (const auto& listener = around.listener) {
    out["listener"] = {{"position", array_of(listener->position_m)},
                       {"forward", listener->forward ? array_of(*listener->forward) : Json(nullptr)},
                       {"up", array_of(listener->up)}};
  }
  out["obstacles"] = Json::array();
  for (const auto& [id, track] : around.scene->obstacles()) {
    const scene::Pose pose = track.pose(around.time_s);
    const auto& turn = pose.orientation;
    Json each = {{"id", id}, {"name", track.description().name}};
    std::visit(DescribeShape{each}, track.description().shape);
    each["position"] = array_of(pose.position_m);
    each["orientation"] = {turn.w(), turn.x(), turn.y(), turn.z()};
    out["obstacles"].push_back(std::move(each));
  }
  out["sheets"] = Json::array();
  for (std::size_t k = 0; k < around.sheets.size(); ++k) {
    const auto& sheet = around.sheets[k];
    const SheetSize size = k < sizes.size() ? sizes[k] : SheetSize{};
    out["sheets"].push_back({{"index", k},
                             {"id", sheet.id},
                             {"name", sheet.name},
                             {"material", sheet.material},
                             {"vertices", size.vertices},
                             {"triangles", size.triangles}});
  }
  return text_of(out);
}

std::string events_text(const std::string& session, const session::SeenEvents& events) {
  Json out;
  out["type"] = "events";
  out["session"] = session;
  out["sheet"] = events.place;
  out["time_s"] = events.time_s;
  out["crumples"] = Json::array();
  for (const auto& crumple : events.crumples)
    out["crumples"].push_back(
        {{"position", array_of(crumple.position_m)}, {"amplitude_m", crumple.amplitude_m}, {"area_m2", crumple.area_m2}});
  out["contacts"] = Json::array();
  for (const auto& contact : events.contacts)
    out["contacts"].push_back(
        {{"position", array_of(contact.position_m)}, {"slip_m_s", contact.slip_m_per_s}, {"area", contact.area_m2}});
  out["tears"] = Json::array();
  for (const auto& tear : events.tears)
    out["tears"].push_back({{"position", array_of(tear.position_m)}, {"speed_m_s", tear.speed_m_per_s}});
  return text_of(out);
}

std::string topology_bytes(std::uint32_t place, const sheet::Topology& topology) {
  const auto triangles = topology.triangles();
  Bytes out(1, place, 16 + triangles.size_bytes());
  out << count_of(topology.vertex_count()) << count_of(triangles.size()) << triangles;
  return out.take();
}

std::string frame_bytes(std::uint32_t place, const sheet::MeshFrame& frame, std::span<const std::uint16_t> regions,
                        std::span<const Segment> ridges, std::span<const Segment> rulings) {
  const std::span<const sheet::Vec3f> positions_m(frame.positions_m);
  Bytes out(2, place, 32 + positions_m.size_bytes() + regions.size_bytes() + ridges.size_bytes() + rulings.size_bytes());
  out << frame.time_s << count_of(positions_m.size()) << count_of(ridges.size()) << count_of(rulings.size()) << positions_m
      << regions;
  out.pad_to(4);
  out << ridges << rulings;
  return out.take();
}

std::string pcm_bytes(std::int64_t first_sample, int channels, std::span<const float> interleaved) {
  Bytes out(3, 0, 24 + interleaved.size_bytes());
  out << static_cast<std::uint64_t>(first_sample) << static_cast<std::uint32_t>(channels)
      << count_of(interleaved.size() / static_cast<std::size_t>(channels)) << interleaved;
  return out.take();
}

std::string obstacle_bytes(std::uint32_t place, std::span<const sheet::Vec3f> vertices_m,
                           std::span<const sheet::Triangle> triangles) {
  Bytes out(4, place, 16 + vertices_m.size_bytes() + triangles.size_bytes());
  out << count_of(vertices_m.size()) << count_of(triangles.size()) << vertices_m << triangles;
  return out.take();
}

}  // namespace rustle::page
