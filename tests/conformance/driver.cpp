// The C++ SDK, driven line by line: driver.py says how.
#include <algorithm>
#include <cstdio>
#include <deque>
#include <iterator>
#include <map>
#include <optional>
#include <sstream>
#include <string>
#include <vector>

#include "client_sdk/cpp/certificate.h"
#include "client_sdk/cpp/connection.h"
#include "client_sdk/cpp/session.h"
#include "tests/conformance/command.h"

namespace {

using namespace rustle::client;
using std::chrono::milliseconds;

milliseconds duration(const command& given, const char* name, double otherwise_s) {
  return milliseconds(static_cast<std::int64_t>(1000 * number(&given, name, otherwise_s)));
}
std::string text(const command& given, const char* name) {
  const char* found = word(&given, name);
  return found == nullptr ? "" : found;
}
template <typename Whole>
Whole whole(const command& given, const char* name) {
  return static_cast<Whole>(number(&given, name, 0));
}
template <typename T>
std::span<const T> array(const command& given, const char* name) {
  std::size_t bytes = 0;
  const auto* data = static_cast<const T*>(file(&given, name, &bytes));
  return {data, bytes / sizeof(T)};
}
Vector3 place(const command& given, const char* name) {
  Vector3 out{};
  vector(&given, name, out.data());
  return out;
}
SoundKind sound_kind(const command& given) {
  if (is_word(&given, "kind", "friction")) return SoundKind::kFriction;
  return is_word(&given, "kind", "tearing") ? SoundKind::kTearing : SoundKind::kCrumpling;
}
const char* kind_name(SoundKind kind) {
  if (kind == SoundKind::kFriction) return "friction";
  return kind == SoundKind::kTearing ? "tearing" : "crumpling";
}

void say(const Error& error) {
  constexpr const char* kStatus[] = {"invalid_argument", "unreachable", "timed_out", "refused",
                                     "session_lost",     "closed",      "other"};
  begin_answer(kStatus[static_cast<int>(kind_of(error))]);
  answer_number("code", error.code);
  answer_text("code_name", error.code_name.c_str());
  answer_text("field", error.field.c_str());
  answer_text("message", error.message.c_str());
  answer_text("remedy", error.remedy.c_str());
}
void say(const SendResult& sent) {
  if (!sent) return say(sent.error());
  begin_answer(*sent == Sent::kDropped ? "dropped" : "ok");
}
template <typename T>
bool good(const tl::expected<T, Error>& result) {
  if (result) {
    begin_answer("ok");
  } else {
    say(result.error());
  }
  return result.has_value();
}

void tell(const Vector3& position, const std::vector<ObservedResonator>& resonators, std::ostream& line) {
  for (const double x : position) line << " " << x;
  for (const ObservedResonator& r : resonators)
    line << " " << r.constrained << " " << r.coarse << " " << r.ruling_length_m << " " << r.free_border_length_m << " "
         << r.area_m2;
  line << "\n";
}

/// Those that are asked for; 0 where there is none.
void answer_figures(const command& given, const std::map<std::string, double>& known) {
  std::istringstream names(text(given, "figures"));
  for (std::string name; std::getline(names, name, ',');) {
    const auto found = known.find(name);
    answer_number(name.c_str(), found == known.end() ? 0 : found->second);
  }
}

class Driver {
 public:
  void connect(const command& given) {
    Endpoints endpoints{.control = text(given, "control")};
    if (word(&given, "keys") != nullptr) {
      auto keys = read_keys(text(given, "keys"));
      if (!keys) return say(keys.error());
      endpoints.keys = *keys;
    }
    auto made = Connection::connect(endpoints, duration(given, "timeout", 30));
    if (good(made)) connection_ = std::move(*made);
  }

  void check(const command& given) {
    const bool gone = word(&given, "gone") != nullptr;
    const double until = now_s() + number(&given, "timeout", 30);
    auto there = connection_->check();
    for (; there.has_value() == gone && now_s() < until; there = connection_->check()) wait_s(0.01);
    good(there);
  }

  void attach(const command& given) {
    SessionOptions options{.name = text(given, "name"),
                           .clock = is_word(&given, "clock", "simulation") ? Clock::kSimulation : Clock::kLive,
                           .seed = whole<std::uint64_t>(given, "seed"),
                           .channels = is_word(&given, "channels", "mono") ? Channels::kMono : Channels::kStereo,
                           .default_material = text(given, "material")};
    for (std::uint32_t id = 1; id <= whole<std::uint32_t>(given, "sheets"); ++id) options.sheets.push_back({.id = id});
    AttachOptions how;
    if (word(&given, "reconnect") != nullptr) how.reconnect = is_word(&given, "reconnect", "always");
    auto made = Session::attach(*connection_, options, how);
    if (!good(made)) return;
    session_.emplace(std::move(*made));
    answer_text("session", session_->id().c_str());
    answer_number("rate_hz", session_->options().rate_hz);
  }

  void add_sheet(const command& given) {
    say(session_->add_sheet({.id = whole<std::uint32_t>(given, "id"), .material = text(given, "material")}));
  }

  void add_topology(const command& given) {
    say(session_->add_topology({.id = whole<std::uint64_t>(given, "id"),
                                .vertex_count = whole<std::uint32_t>(given, "vertices"),
                                .triangles = array<std::uint32_t>(given, "triangles"),
                                .material_coordinates = array<float>(given, "material")}));
  }

  void frames(const command& given) {
    const auto positions = array<float>(given, "positions");
    const std::size_t floats = 3 * whole<std::size_t>(given, "vertices"), first = whole<std::size_t>(given, "first");
    const double start = number(&given, "start", 0), fps = number(&given, "fps", 60);
    FrameExtras extras;
    const auto vertices = array<std::uint32_t>(given, "contacts");
    const std::vector<std::uint32_t> partners(vertices.size());
    std::vector<float> slips, forces(vertices.size(), static_cast<float>(number(&given, "force", 0)));
    for (std::size_t k = 0; k < vertices.size(); ++k)
      for (const double x : place(given, "slip")) slips.push_back(static_cast<float>(x));
    if (!vertices.empty())
      extras.contacts = Contacts{.vertices = vertices,
                                 .partners = partners,
                                 .partner_table = {{.is_sheet = false, .id = whole<std::uint32_t>(given, "partner")}},
                                 .slip_velocities = slips,
                                 .normal_forces = forces};
    constexpr std::uint8_t kCurved = 1;
    constexpr std::uint32_t kRegion = 0;
    constexpr float kRuling[] = {0, 0, 0, 1, 0, 0}, kPoint[] = {0, 0, 0};
    if (const auto regions = array<std::uint32_t>(given, "regions"); !regions.empty())
      extras.partition = Partition{.triangle_regions = regions,
                                   .region_curved = {&kCurved, 1},
                                   .rulings = kRuling,
                                   .ruling_regions = {&kRegion, 1},
                                   .singular_points = kPoint};
    const auto count =
        static_cast<std::size_t>(number(&given, "count", static_cast<double>(positions.size() / floats - first)));
    const std::size_t messages = count * static_cast<std::size_t>(number(&given, "repeat", 1));
    SendResult sent = Sent::kQueued;
    for (std::size_t k = 0; k < messages && sent; ++k)
      sent = session_->frame(whole<std::uint32_t>(given, "sheet"), whole<std::uint64_t>(given, "topology"),
                             start + static_cast<double>(k) / fps, positions.subspan((first + k % count) * floats, floats),
                             extras);
    say(sent);
  }

  void frames_until_reattached(const command& given) {
    const auto positions = array<float>(given, "positions");
    const std::size_t floats = 3 * whole<std::size_t>(given, "vertices");
    const double until = now_s() + number(&given, "timeout", 30);
    for (std::size_t k = 0; session_->reattached() == 0 || !session_->connected();
         k = (k + 1) % (positions.size() / floats)) {
      if (now_s() > until) return begin_answer("nothing");
      const auto sent = session_->frame(whole<std::uint32_t>(given, "sheet"), whole<std::uint64_t>(given, "topology"),
                                        now_s(), positions.subspan(k * floats, floats));
      if (!sent) return say(sent.error());
      wait_s(0.01);
    }
    begin_answer("ok");
  }

  void obstacle(const command& given) {
    const double size = number(&given, "size", 1);
    Obstacle obstacle{.id = whole<std::uint32_t>(given, "id"), .pose = {.position = place(given, "position")}};
    const std::string shape = text(given, "shape");
    if (shape == "box") obstacle.shape = Box{{size, size, size}};
    if (shape == "sphere") obstacle.shape = Sphere{size};
    if (shape == "capsule") obstacle.shape = Capsule{.radius = size, .half_length = number(&given, "length", 1)};
    if (shape == "mesh")
      obstacle.shape =
          Mesh{.triangles = array<std::uint32_t>(given, "triangles"), .vertices = array<float>(given, "vertices")};
    say(session_->scene({.time_s = number(&given, "time", 0), .obstacles = {obstacle}}));
  }

  void move_obstacle(const command& given) {
    const Pose pose{.position = place(given, "position")};
    say(session_->scene({.time_s = number(&given, "time", 0), .poses = {{whole<std::uint32_t>(given, "id"), pose}}}));
  }

  void remove_obstacle(const command& given) {
    say(session_->scene({.time_s = number(&given, "time", 0), .removed = {whole<std::uint32_t>(given, "id")}}));
  }

  void listener(const command& given) {
    Listener listener{.time_s = number(&given, "time", 0), .position = place(given, "position")};
    if (word(&given, "forward") != nullptr) listener.forward = place(given, "forward");
    say(session_->listener(listener));
  }

  void tear_tips(const command& given) {
    const TearTip tip{.id = 1, .position = place(given, "position"), .speed = number(&given, "speed", 0)};
    say(session_->tear_tips(whole<std::uint32_t>(given, "sheet"), number(&given, "time", 0), {&tip, 1}));
  }

  void advance(const command& given) { say(session_->advance(number(&given, "time", 0))); }

  void end(const command& given) {
    say(session_->end(word(&given, "time") == nullptr ? std::nullopt : std::optional(number(&given, "time", 0))));
  }

  void raw(const command& given) { say(session_->raw(std::as_bytes(array<char>(given, "message")))); }
  void drain(const command& given) { good(session_->drain(duration(given, "timeout", 0))); }

  void send_timeout(const command& given) {
    session_->set_send_timeout(duration(given, "seconds", 0));
    begin_answer("ok");
  }

  void notice(const command& given) {
    for (const double until = now_s() + number(&given, "timeout", 20);; wait_s(0.005)) {
      for (Notice& heard : session_->poll_notices()) notices_.push_back(std::move(heard));
      if (!notices_.empty()) break;
      if (now_s() > until) return begin_answer("nothing");
    }
    const Notice notice = std::move(notices_.front());
    notices_.pop_front();
    constexpr const char* kLevels[] = {"info", "warning", "error"};
    begin_answer("ok");
    answer_text("level", kLevels[static_cast<int>(notice.level)]);
    answer_text("code", notice.code.c_str());
    answer_text("field", notice.field.c_str());
    answer_text("message", notice.message.c_str());
    answer_text("remedy", notice.remedy.c_str());
    answer_number("sequence", static_cast<double>(notice.sequence));
  }

  void progress(const command& given) {
    begin_answer("ok");
    answer_figures(given, {{"sent", static_cast<double>(session_->sent_messages())},
                           {"dropped", static_cast<double>(session_->dropped_messages())},
                           {"next", static_cast<double>(session_->next_sequence())},
                           {"acknowledged", static_cast<double>(session_->acknowledged_sequence())},
                           {"reattached", static_cast<double>(session_->reattached())},
                           {"connected", session_->connected() ? 1.0 : 0.0}});
  }

  void statistics(const command& given) {
    const tl::expected<Statistics, Error> known = last_ ? *last_ : session_->statistics();
    if (!good(known)) return;
    std::map<std::string, double> all;
    for (const Figure& figure : figures(*known))
      all[figure.name] = std::visit([](auto value) { return static_cast<double>(value); }, figure.value);
    for (const auto& [cause, count] : known->frames_dropped) all["frames_dropped." + cause] = static_cast<double>(count);
    answer_figures(given, all);
  }

  void gain(const command& given) {
    Gain gain{.gain_db = number(&given, "db", 0)};
    if (word(&given, "sheet") != nullptr) gain.sheet_id = whole<std::uint32_t>(given, "sheet");
    if (word(&given, "kind") != nullptr) gain.kind = sound_kind(given);
    good(session_->set_gains({gain}));
  }

  void listen(const command& given) {
    ListenOptions options;
    if (is_word(&given, "content", "stem"))
      options.content = StemContent{whole<std::uint32_t>(given, "sheet"), sound_kind(given)};
    if (is_word(&given, "content", "emitters")) options.content = EmitterContent{};
    if (is_word(&given, "format", "s16")) options.format = SampleFormat::kS16;
    if (is_word(&given, "format", "opus")) options.format = SampleFormat::kOpus;
    options.blocks = static_cast<int>(number(&given, "blocks", 4));
    auto made = session_->listen(options);
    if (good(made)) reader_.emplace(std::move(*made));
  }

  void read_all(const command& given) {
    const auto sound = reader_->read_all(duration(given, "timeout", 60));
    if (!good(sound)) return;
    write_file(&given, "to", sound->interleaved.data(), sizeof(float) * sound->interleaved.size(), true);
    answer_number("samples", static_cast<double>(sound->interleaved.size() / sound->channels));
    answer_number("channels", sound->channels);
    answer_number("rate_hz", sound->rate_hz);
    answer_number("first_sample", static_cast<double>(sound->first_sample));
    answer_number("gaps", static_cast<double>(sound->gaps.size()));
  }

  void blocks(const command& given) {
    const double until = now_s() + number(&given, "timeout", 60);
    for (bool fresh = true; now_s() < until;) {
      const auto block = reader_->next(milliseconds(200));
      if (!block) {
        if (auto there = reader_->check(); !there) return say(there.error());
        continue;
      }
      if (block->end) {
        begin_answer("complete");
        answer_number("missing", static_cast<double>(reader_->missing_samples()));
        return;
      }
      write_file(&given, "to", block->interleaved.data(), sizeof(float) * block->interleaved.size(), fresh);
      char place[256] = "";
      if (block->emitter) {
        const EmitterState& e = *block->emitter;
        std::snprintf(place, sizeof(place), "%llu %u %s %d %.9g %.9g %.9g %.9g %.9g %.9g",
                      static_cast<unsigned long long>(e.emitter_id), e.sheet_id, kind_name(e.kind), e.last ? 1 : 0,
                      e.position[0], e.position[1], e.position[2], e.normal[0], e.normal[1], e.normal[2]);
      }
      const std::string line =
          std::to_string(block->first_sample) + " " + std::to_string(block->samples) + " " + place + "\n";
      write_file(&given, "places", line.data(), line.size(), fresh);
      fresh = false;
    }
    begin_answer("nothing");
  }

  void block(const command& given) {
    const bool any = word(&given, "restarted") == nullptr;
    for (const double until = now_s() + number(&given, "timeout", 30); now_s() < until;) {
      const auto block = reader_->next(milliseconds(200));
      if (block && (any || block->restarted)) return begin_answer("ok");
    }
    begin_answer("nothing");
  }

  void observe(const command&) {
    auto made = session_->observe();
    if (good(made)) observer_.emplace(std::move(*made));
  }

  void observations(const command& given) {
    const double until = now_s() + number(&given, "timeout", 60);
    std::ostringstream lines;
    lines.precision(9);
    for (std::size_t k = 0; k < whole<std::size_t>(given, "count"); ++k) {
      const auto seen = observer_->next(milliseconds(static_cast<std::int64_t>(1000 * std::max(0.0, until - now_s()))));
      if (!seen) return begin_answer("nothing");
      lines << "sheet " << seen->sheet_id << " " << seen->time_s << "\n";
      for (const ObservedCrumpling& e : seen->crumpling) {
        lines << "crumpling " << e.event_id << " " << e.continues_event_id << " " << e.time_s << " " << e.amplitude_m << " "
              << e.area_m2;
        tell(e.position, e.resonators, lines);
      }
      for (const ObservedFriction& c : seen->friction) {
        lines << "friction " << c.event_id << " " << c.touched_surface << " " << c.speed_m_per_s << " " << c.area_m2;
        tell(c.position, c.resonators, lines);
      }
    }
    const std::string text = lines.str();
    write_file(&given, "to", text.data(), text.size(), true);
    begin_answer("ok");
  }

  void detach(const command&) {
    auto last = session_->detach();
    if (good(last)) last_ = std::move(*last);
  }

  void close(const command&) {
    reader_.reset();
    observer_.reset();
    session_.reset();
    connection_.reset();
    last_.reset();
    notices_.clear();
    begin_answer("ok");
  }

 private:
  std::optional<Connection> connection_{};
  std::optional<Session> session_{};
  std::optional<PcmReader> reader_{};
  std::optional<ObservationReader> observer_{};
  std::optional<Statistics> last_{};
  std::deque<Notice> notices_{};
};

struct Verb {
  const char* name;
  void (Driver::*act)(const command&);
};

constexpr Verb kVerbs[] = {
    {"connect", &Driver::connect},
    {"check", &Driver::check},
    {"attach", &Driver::attach},
    {"add_sheet", &Driver::add_sheet},
    {"add_topology", &Driver::add_topology},
    {"frames", &Driver::frames},
    {"frames_until_reattached", &Driver::frames_until_reattached},
    {"obstacle", &Driver::obstacle},
    {"move_obstacle", &Driver::move_obstacle},
    {"remove_obstacle", &Driver::remove_obstacle},
    {"listener", &Driver::listener},
    {"tear_tips", &Driver::tear_tips},
    {"advance", &Driver::advance},
    {"end", &Driver::end},
    {"raw", &Driver::raw},
    {"drain", &Driver::drain},
    {"send_timeout", &Driver::send_timeout},
    {"notice", &Driver::notice},
    {"progress", &Driver::progress},
    {"statistics", &Driver::statistics},
    {"gain", &Driver::gain},
    {"listen", &Driver::listen},
    {"read_all", &Driver::read_all},
    {"blocks", &Driver::blocks},
    {"block", &Driver::block},
    {"observe", &Driver::observe},
    {"observations", &Driver::observations},
    {"detach", &Driver::detach},
    {"close", &Driver::close},
};

}  // namespace

int main() {
  Driver driver;
  for (command given; read_command(&given);) {
    const auto* verb = std::ranges::find_if(kVerbs, [&](const Verb& each) { return is_verb(&given, each.name); });
    if (verb == std::end(kVerbs)) give_up(&given, "no such command");
    (driver.*verb->act)(given);
    end_answer();
  }
}
