#include "client_sdk/cpp/session.h"

#include <map>
#include <utility>

#include "client_sdk/cpp/session_stream.h"
#include "client_sdk/cpp/stream_messages.h"

namespace rustle::client {

using internal::local_error;
using std::chrono::milliseconds;

struct Session::Impl {
  internal::SessionStream stream;
  std::map<std::uint64_t, std::uint32_t> topology_vertices{};
};

Session::Session(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
Session::Session(Session&&) noexcept = default;

Session& Session::operator=(Session&& other) noexcept {
  std::swap(impl_, other.impl_);
  return *this;
}

Session::~Session() {
  if (impl_ != nullptr && !impl_->stream.detached()) impl_->stream.tell_detach();
}

tl::expected<Session, Error> Session::attach(const Connection& connection, const SessionOptions& options,
                                             const AttachOptions& how) {
  internal::Link& link = *connection.link();
  if (link.stream_endpoint().empty() || link.out_endpoint().empty())
    return tl::unexpected(local_error("invalid", "The daemon takes no streams: it only subscribes to publishers.",
                                      "Start rustled with --stream, or give Endpoints::stream."));

  v1::ControlRequest request;
  v1::Attach* attach = request.mutable_attach();
  attach->set_name(options.name);
  internal::write(options, attach->mutable_options());
  for (const SheetOptions& sheet : options.sheets) internal::write(sheet, attach->add_sheets());
  auto reply = link.ask(request);
  if (!reply) return tl::unexpected(std::move(reply.error()));
  const std::uint64_t breaks = link.connection().breaks;
  const v1::Attached& attached = reply->attached();
  const std::string id = attached.session_id();
  if (id.empty())
    return tl::unexpected(local_error("malformed", "The daemon's answer to attach names no session.",
                                      "Bring the older of SDK and daemon up to date."));
  const auto give_up = [&](Error error) {
    v1::ControlRequest detach;
    detach.set_session_id(id);
    detach.mutable_detach()->set_discard(true);
    link.tell(detach);
    return tl::unexpected(std::move(error));
  };

  SessionOptions in_force = options;
  internal::read(attached.options(), in_force);
  auto opening = internal::StreamOpening::begin(link, id, in_force.clock);
  if (!opening) return give_up(std::move(opening.error()));
  const auto deadline = internal::Clock::now() + link.timeout();
  while (!opening->step()) {
    if (internal::Clock::now() >= deadline)
      return give_up(local_error(
          "timeout",
          "The daemon did not take the stream at " + link.stream_endpoint() + " and " + link.out_endpoint() + " in time.",
          "Check that both endpoints can be reached from here."));
    opening->wait(milliseconds(5));
  }
  return Session(std::unique_ptr<Impl>(
      new Impl{.stream = internal::SessionStream({.connection = connection,
                                                  .id = id,
                                                  .asked = request.attach(),
                                                  .options = in_force,
                                                  .streams = opening->take(),
                                                  .credit = attached.credit(),
                                                  .recording_file_name = attached.recording_file_name(),
                                                  .breaks = breaks,
                                                  .reconnect = how.reconnect.value_or(in_force.clock == Clock::kLive),
                                                  .on_notice = how.on_notice})}));
}

const std::string& Session::id() const {
  return impl_->stream.id();
}
const SessionOptions& Session::options() const {
  return impl_->stream.options();
}

SendResult Session::add_sheet(const SheetOptions& sheet) {
  v1::StreamMessage message;
  internal::write(sheet, message.mutable_sheet());
  return impl_->stream.send(std::move(message));
}

SendResult Session::add_topology(const Topology& topology) {
  if (topology.triangles.size() % 3 != 0)
    return tl::unexpected(local_error("invalid", "The number of indices is no multiple of three.",
                                      "Give three vertices for each triangle.", "topology.triangles"));
  v1::StreamMessage message;
  internal::write(topology, message.mutable_topology());
  const auto sent = impl_->stream.send(std::move(message));
  if (sent) impl_->topology_vertices[topology.id] = topology.vertex_count;
  return sent;
}

SendResult Session::frame(std::uint32_t sheet_id, std::uint64_t topology_id, double time_s, std::span<const float> positions,
                          const FrameExtras& extras) {
  const auto known = impl_->topology_vertices.find(topology_id);
  if (known == impl_->topology_vertices.end())
    return tl::unexpected(local_error("invalid", "Topology " + std::to_string(topology_id) + " was not added.",
                                      "Call add_topology() before the first frame that uses it.", "frame.topology_id"));
  if (positions.size() != std::size_t{3} * known->second)
    return tl::unexpected(local_error("invalid",
                                      std::to_string(positions.size()) + " numbers are given; " +
                                          std::to_string(known->second) + " vertices have " +
                                          std::to_string(std::size_t{3} * known->second) + ".",
                                      "Give x, y and z of every vertex.", "frame.positions"));
  v1::StreamMessage message;
  v1::MeshFrame* frame = message.mutable_frame();
  frame->set_sheet_id(sheet_id);
  frame->set_topology_id(topology_id);
  frame->set_time_s(time_s);
  internal::set_bytes(positions, frame->mutable_positions());
  internal::write(extras, frame);
  return impl_->stream.send(std::move(message));
}

SendResult Session::scene(const SceneUpdate& update) {
  v1::StreamMessage message;
  internal::write(update, message.mutable_scene());
  return impl_->stream.send(std::move(message));
}

SendResult Session::listener(const Listener& listener) {
  v1::StreamMessage message;
  internal::write(listener, message.mutable_listener());
  return impl_->stream.send(std::move(message));
}

SendResult Session::tear_tips(std::uint32_t sheet_id, double time_s, std::span<const TearTip> tips) {
  v1::StreamMessage message;
  v1::TearTips* sent = message.mutable_tear_tips();
  sent->set_sheet_id(sheet_id);
  sent->set_time_s(time_s);
  for (const TearTip& tip : tips) internal::write(tip, sent->add_tips());
  return impl_->stream.send(std::move(message));
}

SendResult Session::advance(double time_s) {
  v1::StreamMessage message;
  message.mutable_advance()->set_time_s(time_s);
  return impl_->stream.send(std::move(message));
}

SendResult Session::end(std::optional<double> time_s) {
  v1::StreamMessage message;
  message.mutable_end()->set_time_s(time_s.value_or(0));
  return impl_->stream.send(std::move(message));
}

SendResult Session::raw(std::span<const std::byte> stream_message, const RawOptions& options) {
  v1::StreamMessage message;
  if (!message.ParseFromArray(stream_message.data(), static_cast<int>(stream_message.size())))
    return tl::unexpected(local_error("invalid", "The bytes are no rustle.v1.StreamMessage.",
                                      "Give a message as a capture's stream channel holds it.", "stream_message"));
  if (message.has_topology()) impl_->topology_vertices[message.topology().topology_id()] = message.topology().vertex_count();
  return impl_->stream.send(std::move(message), options.keep_sequence, !options.wait);
}

tl::expected<PcmReader, Error> Session::listen(const ListenOptions& options) const {
  internal::SessionStream& stream = impl_->stream;
  auto reader = PcmReader::open(stream.connection(), stream.id(), options, stream.reconnects(), stream.simulation());
  if (reader) stream.keep(reader->subscription());
  return reader;
}

tl::expected<ObservationReader, Error> Session::observe() const {
  internal::SessionStream& stream = impl_->stream;
  auto reader = ObservationReader::listen(stream.connection(), stream.id(), stream.reconnects());
  if (reader) stream.keep(reader->subscription());
  return reader;
}

tl::expected<Statistics, Error> Session::statistics() const {
  return impl_->stream.connection().statistics(impl_->stream.id());
}

tl::expected<std::vector<Gain>, Error> Session::set_gains(const std::vector<Gain>& gains) const {
  auto in_force = impl_->stream.connection().set_gains(impl_->stream.id(), gains);
  if (in_force) impl_->stream.keep(*in_force);
  return in_force;
}

tl::expected<PackInfo, Error> Session::change_pack(std::uint32_t sheet_id, const std::string& material,
                                                   const std::string& touched_surface) const {
  auto pack = impl_->stream.connection().change_pack(impl_->stream.id(), sheet_id, material, touched_surface);
  if (pack) impl_->stream.keep_pack(sheet_id, material, touched_surface);
  return pack;
}

tl::expected<std::string, Error> Session::start_recording(const std::string& file_name) {
  auto started = impl_->stream.connection().start_recording(impl_->stream.id(), file_name);
  if (started) impl_->stream.set_recording_file_name(*started);
  return started;
}

tl::expected<RecordingInfo, Error> Session::stop_recording() {
  auto stopped = impl_->stream.connection().stop_recording(impl_->stream.id());
  if (stopped) impl_->stream.set_recording_file_name({});
  return stopped;
}

const std::string& Session::recording_file_name() const {
  return impl_->stream.recording_file_name();
}
std::uint64_t Session::stored_sequence() const {
  return impl_->stream.stored_sequence();
}

std::vector<Notice> Session::poll_notices() {
  return impl_->stream.poll_notices();
}

tl::expected<void, Error> Session::drain(milliseconds timeout) {
  return impl_->stream.drain(timeout);
}

tl::expected<Statistics, Error> Session::detach(bool discard) {
  return impl_->stream.detach(discard);
}

void Session::abandon() noexcept {
  impl_.reset();
}

void Session::set_send_timeout(milliseconds timeout) {
  impl_->stream.send_timeout = timeout;
}
std::uint32_t Session::vertex_count(std::uint64_t topology_id) const {
  const auto known = impl_->topology_vertices.find(topology_id);
  return known == impl_->topology_vertices.end() ? 0 : known->second;
}
std::uint64_t Session::sent_messages() const {
  return impl_->stream.sent_messages();
}
std::uint64_t Session::dropped_messages() const {
  return impl_->stream.dropped_messages();
}
std::uint64_t Session::acknowledged_sequence() const {
  return impl_->stream.acknowledged_sequence();
}
std::uint64_t Session::next_sequence() const {
  return impl_->stream.next_sequence();
}
bool Session::connected() const {
  return impl_->stream.connected();
}
std::uint64_t Session::reattached() const {
  return impl_->stream.reattached();
}

}  // namespace rustle::client
