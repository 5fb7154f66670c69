#include "client_sdk/cpp/observation_reader.h"

#include <deque>
#include <utility>

#include "client_sdk/cpp/transport.h"

namespace rustle::client {
namespace {

Vector3 from_wire(const v1::Vector3& v) {
  return {v.x(), v.y(), v.z()};
}

template <typename Resonators>
std::vector<ObservedResonator> resonators_from_wire(const Resonators& sent) {
  std::vector<ObservedResonator> out;
  for (const v1::Resonator& r : sent) {
    out.push_back({r.constrained(), r.coarse(), r.ruling_length_m(), r.free_border_length_m(), r.area_m2()});
  }
  return out;
}

Observation from_wire(const v1::Observation& sent) {
  Observation out{sent.sheet_id(), sent.time_s(), {}, {}};
  for (const auto& event : sent.crumpling()) {
    out.crumpling.push_back({event.event_id(), event.continues_event_id(), event.time_s(), event.amplitude_m(),
                             event.area_m2(), from_wire(event.position()), resonators_from_wire(event.resonators())});
  }
  for (const auto& contact : sent.friction()) {
    out.friction.push_back({contact.event_id(), contact.speed_m_per_s(), contact.area_m2(), from_wire(contact.position()),
                            contact.touched_surface(), resonators_from_wire(contact.resonators())});
  }
  return out;
}

}  // namespace

struct ObservationReader::Impl {
  internal::Socket socket;
  std::deque<std::vector<std::string>> waiting;
};

ObservationReader::ObservationReader(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
ObservationReader::ObservationReader(ObservationReader&&) noexcept = default;
ObservationReader& ObservationReader::operator=(ObservationReader&&) noexcept = default;
ObservationReader::~ObservationReader() = default;

tl::expected<ObservationReader, Error> ObservationReader::listen(const Connection& connection,
                                                                 const std::string& session_id) {
  internal::Link& link = *connection.link();
  const std::string endpoint = link.out_endpoint();
  if (endpoint.empty()) {
    return tl::unexpected(
        internal::local_error("unreachable", "The daemon names no endpoint to listen at.", "Give Endpoints::out."));
  }
  auto socket =
      internal::Socket::connect(link.context(), internal::Socket::Role::kListener, endpoint, {.send = 0, .receive = 0});
  if (!socket) return tl::unexpected(std::move(socket.error()));
  auto impl = std::make_unique<Impl>(Impl{std::move(*socket), {}});
  impl->socket.subscribe(session_id + "/observations");
  std::vector<std::vector<std::string>> early;
  if (!impl->socket.wait_subscribed(link.timeout(), early)) {
    return tl::unexpected(internal::local_error("timeout",
                                                "The daemon did not confirm the subscription at " + endpoint + " in time.",
                                                "Check that the out endpoint can be reached from here."));
  }
  impl->waiting.assign(std::make_move_iterator(early.begin()), std::make_move_iterator(early.end()));
  return ObservationReader(std::move(impl));
}

std::optional<Observation> ObservationReader::next(std::chrono::milliseconds timeout) {
  const auto deadline = internal::Clock::now() + timeout;
  for (;;) {
    std::vector<std::string> parts;
    if (!impl_->waiting.empty()) {
      parts = std::move(impl_->waiting.front());
      impl_->waiting.pop_front();
    } else {
      parts = impl_->socket.receive_until(deadline);
      if (parts.empty()) return std::nullopt;
    }
    v1::OutMessage message;
    if (parts.size() == 2 && message.ParseFromString(parts[1]) && message.has_observation())
      return from_wire(message.observation());
  }
}

}  // namespace rustle::client
