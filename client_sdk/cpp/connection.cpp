#include "client_sdk/cpp/connection.h"

#include <utility>

#include "client_sdk/cpp/transport.h"

namespace rustle::client {
namespace {

using internal::Link;

Error unexpected_answer() {
  return internal::local_error("malformed", "The daemon's answer is of another kind than what was asked.",
                               "Bring the older of SDK and daemon up to date.");
}

tl::expected<ServerInfo, Error> say_hello(Link& link) {
  v1::ControlRequest request = internal::hello();
  auto reply = link.ask(request);
  if (!reply) return tl::unexpected(std::move(reply.error()));
  return internal::read_welcome(*reply);
}

tl::expected<std::vector<PackInfo>, Error> ask_for_packs(Link& link, v1::ControlRequest& request) {
  auto reply = link.ask(request);
  if (!reply) return tl::unexpected(std::move(reply.error()));
  if (!reply->has_pack_list()) return tl::unexpected(unexpected_answer());
  std::vector<PackInfo> packs;
  for (const v1::PackInfo& pack : reply->pack_list().packs()) packs.push_back(internal::from_wire(pack));
  return packs;
}

}  // namespace

Connection::Connection(std::shared_ptr<internal::Link> link) : link_(std::move(link)) {}

tl::expected<Connection, Error> Connection::connect(const Endpoints& endpoints, std::chrono::milliseconds timeout) {
  auto context = std::make_shared<internal::Context>(endpoints.keys);
  auto monitor = std::make_unique<internal::ConnectionMonitor>();
  auto control = internal::Socket::connect(context, internal::Socket::Role::kControl, endpoints.control,
                                           {.send = 256, .receive = 256}, monitor.get());
  if (!control) return tl::unexpected(std::move(control.error()));
  auto link = std::make_shared<Link>(std::move(context), std::move(*control), std::move(monitor), endpoints, timeout);
  auto server = say_hello(*link);
  if (!server) return tl::unexpected(std::move(server.error()));
  link->set_server(std::move(*server));
  return Connection(std::move(link));
}

ServerInfo Connection::server() const {
  return link_->server();
}

tl::expected<void, Error> Connection::check() const {
  return link_->check();
}

tl::expected<ServerInfo, Error> Connection::ping() const {
  return say_hello(*link_);
}

tl::expected<std::vector<PackInfo>, Error> Connection::list_packs() const {
  v1::ControlRequest request;
  request.mutable_list_packs();
  return ask_for_packs(*link_, request);
}

tl::expected<std::vector<SessionInfo>, Error> Connection::list_sessions() const {
  v1::ControlRequest request;
  request.mutable_list_sessions();
  auto reply = link_->ask(request);
  if (!reply) return tl::unexpected(std::move(reply.error()));
  if (!reply->has_session_list()) return tl::unexpected(unexpected_answer());
  std::vector<SessionInfo> sessions;
  for (const v1::SessionInfo& session : reply->session_list().sessions()) {
    sessions.push_back({.session_id = session.session_id(),
                        .name = session.name(),
                        .clock = session.clock() == v1::CLOCK_SIMULATION ? Clock::kSimulation : Clock::kLive,
                        .sheets = session.sheets(),
                        .newest_time_s = session.newest_time_s()});
    const v1::RecordingProgress& so_far = session.recording();
    if (session.has_recording())
      sessions.back().recording = RecordingInfo{so_far.file_name(), so_far.messages(), so_far.bytes()};
  }
  return sessions;
}

tl::expected<Statistics, Error> Connection::statistics(const std::string& session_id) const {
  v1::ControlRequest request;
  request.set_session_id(session_id);
  request.mutable_get_statistics();
  auto reply = link_->ask(request);
  if (!reply) return tl::unexpected(std::move(reply.error()));
  if (!reply->has_statistics()) return tl::unexpected(unexpected_answer());
  return internal::from_wire(reply->statistics());
}

tl::expected<ServerStatistics, Error> Connection::server_statistics() const {
  v1::ControlRequest request;
  request.mutable_get_statistics();
  auto reply = link_->ask(request);
  if (!reply) return tl::unexpected(std::move(reply.error()));
  if (!reply->has_server_statistics()) return tl::unexpected(unexpected_answer());
  return internal::from_wire(reply->server_statistics());
}

tl::expected<std::vector<Gain>, Error> Connection::set_gains(const std::string& session_id,
                                                             const std::vector<Gain>& gains) const {
  v1::ControlRequest request;
  request.set_session_id(session_id);
  request.mutable_set_gains();
  for (const Gain& gain : gains) internal::to_wire(gain, request.mutable_set_gains()->add_gains());
  auto reply = link_->ask(request);
  if (!reply) return tl::unexpected(std::move(reply.error()));
  if (!reply->has_gains_set()) return tl::unexpected(unexpected_answer());
  std::vector<Gain> in_force;
  for (const v1::Gain& gain : reply->gains_set().gains()) in_force.push_back(internal::from_wire(gain));
  return in_force;
}

tl::expected<PackInfo, Error> Connection::change_pack(const std::string& session_id, std::uint32_t sheet_id,
                                                      const std::string& material,
                                                      const std::string& touched_surface) const {
  v1::ControlRequest request;
  request.set_session_id(session_id);
  request.mutable_change_pack()->set_sheet_id(sheet_id);
  request.mutable_change_pack()->set_material(material);
  request.mutable_change_pack()->set_touched_surface(touched_surface);
  auto reply = link_->ask(request);
  if (!reply) return tl::unexpected(std::move(reply.error()));
  if (!reply->has_pack_changed()) return tl::unexpected(unexpected_answer());
  return internal::from_wire(reply->pack_changed().pack());
}

tl::expected<std::vector<PackInfo>, Error> Connection::reload_pack(const std::string& name) const {
  v1::ControlRequest request;
  request.mutable_reload_pack()->set_name(name);
  return ask_for_packs(*link_, request);
}

tl::expected<std::string, Error> Connection::start_recording(const std::string& session_id,
                                                             const std::string& file_name) const {
  v1::ControlRequest request;
  request.set_session_id(session_id);
  request.mutable_start_recording()->set_file_name(file_name);
  auto reply = link_->ask(request);
  if (!reply) return tl::unexpected(std::move(reply.error()));
  if (!reply->has_recording_started()) return tl::unexpected(unexpected_answer());
  return reply->recording_started().file_name();
}

tl::expected<RecordingInfo, Error> Connection::stop_recording(const std::string& session_id) const {
  v1::ControlRequest request;
  request.set_session_id(session_id);
  request.mutable_stop_recording();
  auto reply = link_->ask(request);
  if (!reply) return tl::unexpected(std::move(reply.error()));
  if (!reply->has_recording_stopped()) return tl::unexpected(unexpected_answer());
  const v1::RecordingStopped& stopped = reply->recording_stopped();
  return RecordingInfo{.file_name = stopped.file_name(), .messages = stopped.messages(), .bytes = stopped.bytes()};
}

tl::expected<Statistics, Error> Connection::detach(const std::string& session_id, bool discard,
                                                   std::uint64_t last_sequence) const {
  v1::ControlRequest request;
  request.set_session_id(session_id);
  request.mutable_detach()->set_discard(discard);
  request.mutable_detach()->set_last_sequence(last_sequence);
  auto reply = link_->ask(request);
  if (!reply) return tl::unexpected(std::move(reply.error()));
  if (!reply->has_detached()) return tl::unexpected(unexpected_answer());
  return internal::from_wire(reply->detached().statistics());
}

}  // namespace rustle::client
