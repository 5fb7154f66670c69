#include "client_sdk/c/rustle.h"

#include <algorithm>
#include <cstddef>
#include <cstring>
#include <optional>
#include <string>
#include <vector>

#include "client_sdk/c/from_plain.h"
#include "client_sdk/c/handles.h"
#include "client_sdk/c/status.h"
#include "client_sdk/cpp/certificate.h"
#include "client_sdk/cpp/connection.h"
#include "client_sdk/cpp/pcm_reader.h"
#include "client_sdk/cpp/session.h"

namespace client = rustle::client;
using namespace rustle::capi;

namespace {

rustle_status status_of_sent(client::SendResult sent) {
  if (!sent) return fail(std::move(sent.error()));
  return *sent == client::Sent::kDropped ? RUSTLE_DROPPED : RUSTLE_OK;
}

/// What the answer holds is not told.
template <typename T>
rustle_status done(const tl::expected<T, client::Error>& result) {
  return result ? RUSTLE_OK : fail(result.error());
}

template <typename T, typename Make>
rustle_status make(tl::expected<T, client::Error> result, const Make& out) {
  if (!result) return fail(std::move(result.error()));
  out(std::move(*result));
  return RUSTLE_OK;
}

tl::expected<client::Endpoints, client::Error> endpoints_of(const rustle_endpoints& given) {
  client::Endpoints out;
  if (given.control != nullptr) out.control = given.control;
  out.stream = text(given.stream);
  out.out = text(given.out);
  if (given.keys != nullptr) {
    out.keys = client::Keys{.public_key = text(given.keys->public_key),
                            .secret_key = text(given.keys->secret_key),
                            .server_key = text(given.keys->server_key)};
  } else if (given.keys_folder != nullptr) {
    auto keys = client::read_keys(given.keys_folder);
    if (!keys) return tl::unexpected(std::move(keys.error()));
    out.keys = std::move(*keys);
  }
  return out;
}

rustle_emitter plain(const client::EmitterState& emitter) {
  rustle_emitter out{};
  out.id = emitter.emitter_id;
  out.sheet_id = emitter.sheet_id;
  out.kind = emitter.kind == client::SoundKind::kFriction  ? RUSTLE_FRICTION
             : emitter.kind == client::SoundKind::kTearing ? RUSTLE_TEARING
                                                           : RUSTLE_CRUMPLING;
  std::ranges::copy(emitter.position, out.position);
  std::ranges::copy(emitter.normal, out.normal);
  out.last = emitter.last ? 1 : 0;
  return out;
}

rustle_notice_level plain(client::NoticeLevel level) {
  if (level == client::NoticeLevel::kError) return RUSTLE_ERROR;
  return level == client::NoticeLevel::kWarning ? RUSTLE_WARNING : RUSTLE_INFO;
}

/// The figures in words that the session keeps.
void list(const client::Statistics& statistics, rustle_session& session) {
  session.figure_names.clear();
  session.figures.clear();
  std::vector<double> values;
  for (const client::Figure& figure : client::figures(statistics)) {
    session.figure_names.push_back(figure.name);
    values.push_back(std::visit([](auto value) { return static_cast<double>(value); }, figure.value));
  }
  for (const auto& [cause, count] : statistics.frames_dropped) {
    session.figure_names.push_back("frames_dropped." + cause);
    values.push_back(static_cast<double>(count));
  }
  for (std::size_t k = 0; k < values.size(); ++k) session.figures.push_back({session.figure_names[k].c_str(), values[k]});
}

rustle_status change_scene(rustle_session* session, client::SceneUpdate update) {
  return status_of_sent(session->session.scene(update));
}

}  // namespace

const char* rustle_version(void) {
  return RUSTLE_VERSION;
}

// ---- connections

rustle_status rustle_connect(const rustle_endpoints* endpoints, rustle_connection** connection) {
  if (connection == nullptr) return missing("connection");
  return guarded([&] {
    const rustle_endpoints given = endpoints == nullptr ? rustle_endpoints{} : *endpoints;
    const auto places = endpoints_of(given);
    if (!places) return fail(places.error());
    return make(client::Connection::connect(*places, milliseconds(given.timeout_s == 0 ? 5 : given.timeout_s)),
                [&](client::Connection made) { *connection = new rustle_connection{std::move(made)}; });
  });
}

void rustle_disconnect(rustle_connection* connection) {
  delete connection;
}

rustle_status rustle_check(rustle_connection* connection) {
  if (connection == nullptr) return missing("connection");
  return guarded([&] { return done(connection->connection.check()); });
}

rustle_status rustle_get_server(rustle_connection* connection, rustle_server* server) {
  if (connection == nullptr) return missing("connection");
  if (server == nullptr) return missing("server");
  return guarded([&] {
    const client::ServerInfo info = connection->connection.server();
    *server = {.name = {}, .rate_hz = info.rate_hz, .block_size = info.block_size};
    info.server.copy(server->name, sizeof(server->name) - 1);
    return RUSTLE_OK;
  });
}

// ---- sessions

rustle_status rustle_attach(rustle_connection* connection, const rustle_session_options* options, rustle_session** session) {
  if (connection == nullptr) return missing("connection");
  if (session == nullptr) return missing("session");
  return guarded([&] {
    const rustle_session_options given = options == nullptr ? rustle_session_options{} : *options;
    const auto wanted = read(given);
    if (!wanted) return fail(wanted.error());
    client::AttachOptions how;
    if (given.reconnect != RUSTLE_RECONNECT_AS_CLOCK) how.reconnect = given.reconnect == RUSTLE_RECONNECT_ALWAYS;
    return make(client::Session::attach(connection->connection, *wanted, how),
                [&](client::Session made) { *session = new rustle_session{std::move(made)}; });
  });
}

void rustle_free_session(rustle_session* session) {
  delete session;
}

rustle_status rustle_detach(rustle_session* session, int32_t discard) {
  if (session == nullptr) return missing("session");
  return guarded([&] {
    return make(session->session.detach(discard != 0), [&](client::Statistics last) { session->last = std::move(last); });
  });
}

const char* rustle_session_id(const rustle_session* session) {
  return session == nullptr ? "" : session->session.id().c_str();
}

uint32_t rustle_session_rate_hz(const rustle_session* session) {
  return session == nullptr ? 0 : session->session.options().rate_hz;
}

rustle_status rustle_set_send_timeout(rustle_session* session, double timeout_s) {
  if (session == nullptr) return missing("session");
  session->session.set_send_timeout(milliseconds(timeout_s));
  return RUSTLE_OK;
}

rustle_status rustle_add_sheet(rustle_session* session, const rustle_sheet* sheet) {
  if (session == nullptr) return missing("session");
  if (sheet == nullptr) return missing("sheet");
  return guarded([&] {
    const auto given = read(*sheet);
    return given ? status_of_sent(session->session.add_sheet(*given)) : fail(given.error());
  });
}

rustle_status rustle_add_topology(rustle_session* session, const rustle_topology* topology) {
  if (session == nullptr) return missing("session");
  if (topology == nullptr) return missing("topology");
  return guarded([&] {
    const auto given = read(*topology);
    return given ? status_of_sent(session->session.add_topology(*given)) : fail(given.error());
  });
}

rustle_status rustle_frame(rustle_session* session, const rustle_mesh_frame* frame) {
  if (session == nullptr) return missing("session");
  if (frame == nullptr) return missing("frame");
  if (frame->positions == nullptr) return missing("frame.positions");
  return guarded([&] {
    const std::size_t vertices = session->session.vertex_count(frame->topology_id);
    client::FrameExtras extras;
    std::vector<client::TearTip> tips;
    if (auto taken = read(*frame, vertices, extras, tips); !taken) return fail(std::move(taken.error()));
    return status_of_sent(session->session.frame(frame->sheet_id, frame->topology_id, frame->time_s,
                                                 std::span(frame->positions, 3 * vertices), extras));
  });
}

rustle_status rustle_set_obstacles(rustle_session* session, double time_s, const rustle_obstacle* obstacles, size_t count) {
  if (session == nullptr) return missing("session");
  if (obstacles == nullptr && count > 0) return missing("obstacles");
  return guarded([&] {
    client::SceneUpdate update{.time_s = time_s};
    for (std::size_t k = 0; k < count; ++k) {
      auto obstacle = read(obstacles[k]);
      if (!obstacle) return fail(std::move(obstacle.error()));
      update.obstacles.push_back(std::move(*obstacle));
    }
    return change_scene(session, std::move(update));
  });
}

rustle_status rustle_move_obstacle(rustle_session* session, double time_s, uint32_t id, const rustle_pose* pose) {
  if (session == nullptr) return missing("session");
  if (pose == nullptr) return missing("pose");
  return guarded([&] { return change_scene(session, {.time_s = time_s, .poses = {{id, read(*pose)}}}); });
}

rustle_status rustle_deform_obstacle(rustle_session* session, double time_s, uint32_t id, const float* vertices,
                                     size_t vertex_count) {
  if (session == nullptr) return missing("session");
  if (vertices == nullptr) return missing("vertices");
  return guarded([&] {
    return change_scene(session, {.time_s = time_s, .vertices = {{id, std::span(vertices, 3 * vertex_count)}}});
  });
}

rustle_status rustle_remove_obstacle(rustle_session* session, double time_s, uint32_t id) {
  if (session == nullptr) return missing("session");
  return guarded([&] { return change_scene(session, {.time_s = time_s, .removed = {id}}); });
}

rustle_status rustle_set_listener(rustle_session* session, double time_s, const double position[3], const double forward[3],
                                  const double up[3]) {
  if (session == nullptr) return missing("session");
  if (position == nullptr) return missing("position");
  return guarded([&] {
    client::Listener listener{.time_s = time_s, .position = read(position)};
    if (forward != nullptr) listener.forward = read(forward);
    if (up != nullptr) listener.up = read(up);
    return status_of_sent(session->session.listener(listener));
  });
}

rustle_status rustle_tear_tips(rustle_session* session, uint32_t sheet_id, double time_s, const rustle_tear_tip* tips,
                               size_t count) {
  if (session == nullptr) return missing("session");
  if (tips == nullptr && count > 0) return missing("tips");
  return guarded([&] {
    std::vector<client::TearTip> given;
    for (std::size_t k = 0; k < count; ++k) given.push_back(read(tips[k]));
    return status_of_sent(session->session.tear_tips(sheet_id, time_s, given));
  });
}

rustle_status rustle_advance(rustle_session* session, double time_s) {
  if (session == nullptr) return missing("session");
  return guarded([&] { return status_of_sent(session->session.advance(time_s)); });
}

rustle_status rustle_end(rustle_session* session, const double* time_s) {
  if (session == nullptr) return missing("session");
  return guarded(
      [&] { return status_of_sent(session->session.end(time_s == nullptr ? std::nullopt : std::optional(*time_s))); });
}

rustle_status rustle_send_raw(rustle_session* session, const void* message, size_t bytes) {
  if (session == nullptr) return missing("session");
  if (message == nullptr) return missing("message");
  return guarded(
      [&] { return status_of_sent(session->session.raw(std::span(static_cast<const std::byte*>(message), bytes))); });
}

rustle_status rustle_drain(rustle_session* session, double timeout_s) {
  if (session == nullptr) return missing("session");
  return guarded([&] { return done(session->session.drain(milliseconds(timeout_s))); });
}

rustle_status rustle_next_notice(rustle_session* session, rustle_notice* notice) {
  if (session == nullptr) return missing("session");
  if (notice == nullptr) return missing("notice");
  return guarded([&] {
    for (client::Notice& heard : session->session.poll_notices()) session->notices.push_back(std::move(heard));
    if (session->notices.empty()) return RUSTLE_NOTHING;
    session->told = std::move(session->notices.front());
    session->notices.pop_front();
    const client::Notice& told = session->told;
    *notice = {.level = plain(told.level),
               .code = told.code.c_str(),
               .field = told.field.c_str(),
               .message = told.message.c_str(),
               .remedy = told.remedy.c_str(),
               .sequence = told.sequence,
               .count = told.count};
    return RUSTLE_OK;
  });
}

rustle_status rustle_get_progress(const rustle_session* session, rustle_progress* progress) {
  if (session == nullptr) return missing("session");
  if (progress == nullptr) return missing("progress");
  const client::Session& known = session->session;
  *progress = {.sent_messages = known.sent_messages(),
               .dropped_messages = known.dropped_messages(),
               .next_sequence = known.next_sequence(),
               .acknowledged_sequence = known.acknowledged_sequence(),
               .stored_sequence = known.stored_sequence(),
               .reattached = known.reattached(),
               .connected = known.connected() ? 1 : 0};
  return RUSTLE_OK;
}

rustle_status rustle_statistics(rustle_session* session, const rustle_figure** figures, size_t* count) {
  if (session == nullptr) return missing("session");
  if (figures == nullptr) return missing("figures");
  if (count == nullptr) return missing("count");
  return guarded([&] {
    if (session->last) {
      list(*session->last, *session);
    } else {
      const auto now = session->session.statistics();
      if (!now) return fail(now.error());
      list(*now, *session);
    }
    *figures = session->figures.data();
    *count = session->figures.size();
    return RUSTLE_OK;
  });
}

double rustle_figure_named(const rustle_figure* figures, size_t count, const char* name) {
  if (figures == nullptr || name == nullptr) return 0;
  const auto* found =
      std::find_if(figures, figures + count, [&](const rustle_figure& figure) { return !std::strcmp(figure.name, name); });
  return found == figures + count ? 0 : found->value;
}

rustle_status rustle_set_gains(rustle_session* session, const rustle_gain* gains, size_t count) {
  if (session == nullptr) return missing("session");
  if (gains == nullptr && count > 0) return missing("gains");
  return guarded([&] {
    std::vector<client::Gain> wanted;
    for (std::size_t k = 0; k < count; ++k) {
      auto gain = read(gains[k]);
      if (!gain) return fail(std::move(gain.error()));
      wanted.push_back(std::move(*gain));
    }
    return done(session->session.set_gains(wanted));
  });
}

rustle_status rustle_change_pack(rustle_session* session, uint32_t sheet_id, const char* material,
                                 const char* touched_surface) {
  if (session == nullptr) return missing("session");
  return guarded([&] { return done(session->session.change_pack(sheet_id, text(material), text(touched_surface))); });
}

rustle_status rustle_start_recording(rustle_session* session, const char* file_name) {
  if (session == nullptr) return missing("session");
  return guarded([&] { return done(session->session.start_recording(text(file_name))); });
}

rustle_status rustle_stop_recording(rustle_session* session) {
  if (session == nullptr) return missing("session");
  return guarded([&] { return done(session->session.stop_recording()); });
}

const char* rustle_recording_file_name(const rustle_session* session) {
  return session == nullptr ? "" : session->session.recording_file_name().c_str();
}

// ---- sound

rustle_status rustle_listen(rustle_session* session, const rustle_listen_options* options, rustle_reader** reader) {
  if (session == nullptr) return missing("session");
  if (reader == nullptr) return missing("reader");
  return guarded([&] {
    const auto wanted = read(options);
    if (!wanted) return fail(wanted.error());
    return make(session->session.listen(*wanted),
                [&](client::PcmReader made) { *reader = new rustle_reader{std::move(made)}; });
  });
}

rustle_status rustle_listen_to(rustle_connection* connection, const char* session_id, const rustle_listen_options* options,
                               int32_t reconnect, rustle_reader** reader) {
  if (connection == nullptr) return missing("connection");
  if (session_id == nullptr) return missing("session_id");
  if (reader == nullptr) return missing("reader");
  return guarded([&] {
    const auto wanted = read(options);
    if (!wanted) return fail(wanted.error());
    return make(client::PcmReader::listen(connection->connection, session_id, *wanted, reconnect != 0),
                [&](client::PcmReader made) { *reader = new rustle_reader{std::move(made)}; });
  });
}

void rustle_free_reader(rustle_reader* reader) {
  delete reader;
}

rustle_status rustle_next_block(rustle_reader* reader, double timeout_s, rustle_block* block) {
  if (reader == nullptr) return missing("reader");
  if (block == nullptr) return missing("block");
  return guarded([&] {
    auto came = reader->reader.next(milliseconds(timeout_s));
    if (!came) {
      auto there = reader->reader.check();
      return there ? RUSTLE_NOTHING : fail(std::move(there.error()));
    }
    reader->block = std::move(*came);
    const client::PcmBlock& read = reader->block;
    *block = {.interleaved = read.interleaved.data(),
              .samples = read.samples,
              .channels = read.channels,
              .rate_hz = read.rate_hz,
              .restarted = read.restarted ? 1 : 0,
              .first_sample = read.first_sample,
              .missing_samples = read.missing_samples,
              .time_s = read.time_s,
              .has_emitter = read.emitter ? 1 : 0,
              .emitter = read.emitter ? plain(*read.emitter) : rustle_emitter{}};
    return read.end ? RUSTLE_COMPLETE : RUSTLE_OK;
  });
}

rustle_status rustle_read_all(rustle_reader* reader, double timeout_s, rustle_sound* sound) {
  if (reader == nullptr) return missing("reader");
  if (sound == nullptr) return missing("sound");
  return guarded([&] {
    auto all = reader->reader.read_all(milliseconds(timeout_s));
    if (!all) return fail(std::move(all.error()));
    reader->sound = std::move(*all);
    reader->gaps.clear();
    for (const client::Gap& gap : reader->sound.gaps) reader->gaps.push_back({gap.first, gap.samples});
    const client::Sound& read = reader->sound;
    *sound = {.interleaved = read.interleaved.data(),
              .samples = read.channels == 0 ? 0 : read.interleaved.size() / read.channels,
              .channels = read.channels,
              .rate_hz = read.rate_hz,
              .first_sample = read.first_sample,
              .gaps = reader->gaps.data(),
              .gap_count = reader->gaps.size()};
    return RUSTLE_OK;
  });
}

uint64_t rustle_missing_samples(const rustle_reader* reader) {
  return reader == nullptr ? 0 : reader->reader.missing_samples();
}
