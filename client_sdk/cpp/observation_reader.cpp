#include "client_sdk/cpp/observation_reader.h"

#include <utility>

#include "client_sdk/cpp/from_wire.h"
#include "client_sdk/cpp/subscription.h"

namespace rustle::client {
namespace {

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
                             event.area_m2(), internal::from_wire(event.position()),
                             resonators_from_wire(event.resonators())});
  }
  for (const auto& contact : sent.friction()) {
    out.friction.push_back({contact.event_id(), contact.speed_m_per_s(), contact.area_m2(),
                            internal::from_wire(contact.position()), contact.touched_surface(),
                            resonators_from_wire(contact.resonators())});
  }
  return out;
}

}  // namespace

struct ObservationReader::Impl {
  std::shared_ptr<internal::Subscription> subscription;
};

ObservationReader::ObservationReader(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
ObservationReader::ObservationReader(ObservationReader&&) noexcept = default;
ObservationReader& ObservationReader::operator=(ObservationReader&&) noexcept = default;
ObservationReader::~ObservationReader() = default;

tl::expected<ObservationReader, Error> ObservationReader::listen(const Connection& connection, const std::string& session_id,
                                                                 bool reconnect) {
  auto subscription =
      internal::Subscription::open(connection.link(), session_id + "/observations", {.queue = 0, .reconnect = reconnect});
  if (!subscription) return tl::unexpected(std::move(subscription.error()));
  return ObservationReader(std::make_unique<Impl>(Impl{std::move(*subscription)}));
}

std::optional<Observation> ObservationReader::next(std::chrono::milliseconds timeout) {
  const auto deadline = internal::Clock::now() + timeout;
  while (const auto body = impl_->subscription->next(deadline)) {
    v1::OutMessage message;
    if (message.ParseFromString(*body) && message.has_observation()) return from_wire(message.observation());
  }
  return std::nullopt;
}

tl::expected<void, Error> ObservationReader::check() const {
  return impl_->subscription->check();
}
bool ObservationReader::is_heard() const {
  return impl_->subscription->is_heard();
}
std::weak_ptr<internal::Subscription> ObservationReader::subscription() const {
  return impl_->subscription;
}

}  // namespace rustle::client
