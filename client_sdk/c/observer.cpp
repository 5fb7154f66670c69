#include <algorithm>
#include <utility>

#include "client_sdk/c/from_plain.h"
#include "client_sdk/c/handles.h"
#include "client_sdk/c/status.h"

namespace client = rustle::client;
using namespace rustle::capi;

namespace {

const std::vector<rustle_resonator>& plain(const std::vector<client::ObservedResonator>& resonators,
                                           rustle_observer& observer) {
  std::vector<rustle_resonator>& out = observer.resonators.emplace_back();
  for (const client::ObservedResonator& r : resonators)
    out.push_back({.constrained = r.constrained ? 1 : 0,
                   .coarse = r.coarse ? 1 : 0,
                   .ruling_length_m = r.ruling_length_m,
                   .free_border_length_m = r.free_border_length_m,
                   .area_m2 = r.area_m2});
  return out;
}

rustle_crumpling_event plain(const client::ObservedCrumpling& event, rustle_observer& observer) {
  const auto& resonators = plain(event.resonators, observer);
  rustle_crumpling_event out{.event_id = event.event_id,
                             .continues_event_id = event.continues_event_id,
                             .time_s = event.time_s,
                             .amplitude_m = event.amplitude_m,
                             .area_m2 = event.area_m2,
                             .position = {},
                             .resonators = resonators.data(),
                             .resonator_count = resonators.size()};
  std::ranges::copy(event.position, out.position);
  return out;
}

rustle_friction_contact plain(const client::ObservedFriction& contact, rustle_observer& observer) {
  const auto& resonators = plain(contact.resonators, observer);
  rustle_friction_contact out{.event_id = contact.event_id,
                              .speed_m_per_s = contact.speed_m_per_s,
                              .area_m2 = contact.area_m2,
                              .position = {},
                              .touched_surface = contact.touched_surface.c_str(),
                              .resonators = resonators.data(),
                              .resonator_count = resonators.size()};
  std::ranges::copy(contact.position, out.position);
  return out;
}

}  // namespace

rustle_status rustle_observe(rustle_session* session, rustle_observer** observer) {
  if (session == nullptr) return missing("session");
  if (observer == nullptr) return missing("observer");
  return guarded([&] {
    auto made = session->session.observe();
    if (!made) return fail(std::move(made.error()));
    *observer = new rustle_observer{std::move(*made)};
    return RUSTLE_OK;
  });
}

void rustle_free_observer(rustle_observer* observer) {
  delete observer;
}

rustle_status rustle_next_observation(rustle_observer* observer, double timeout_s, rustle_observation* observation) {
  if (observer == nullptr) return missing("observer");
  if (observation == nullptr) return missing("observation");
  return guarded([&] {
    auto came = observer->reader.next(milliseconds(timeout_s));
    if (!came) {
      auto there = observer->reader.check();
      return there ? RUSTLE_NOTHING : fail(std::move(there.error()));
    }
    observer->observation = std::move(*came);
    observer->resonators.clear();
    observer->crumpling.clear();
    observer->friction.clear();
    const client::Observation& seen = observer->observation;
    for (const auto& event : seen.crumpling) observer->crumpling.push_back(plain(event, *observer));
    for (const auto& contact : seen.friction) observer->friction.push_back(plain(contact, *observer));
    *observation = {.sheet_id = seen.sheet_id,
                    .time_s = seen.time_s,
                    .crumpling = observer->crumpling.data(),
                    .crumpling_count = observer->crumpling.size(),
                    .friction = observer->friction.data(),
                    .friction_count = observer->friction.size()};
    return RUSTLE_OK;
  });
}
