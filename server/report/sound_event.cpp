#include "server/report/sound_event.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>
#include <string_view>
#include <tuple>

namespace rustle::report {

std::string_view kind_name(EventKind kind) {
  constexpr std::array<std::string_view, kEventKinds> names = {"crumpling", "friction", "tearing"};
  return names[static_cast<std::size_t>(kind)];
}

double reference_amplitude(EventKind kind) {
  return kind == EventKind::kCrumpling ? 0.16 : 0.1;
}

double relative_level_db(const EventMark& event) {
  const double ratio = event.amplitude / reference_amplitude(event.kind);
  return ratio > 1e-6 ? 20 * std::log10(ratio) : -120;
}

std::vector<std::size_t> largest_events(std::span<const EventMark> events, std::size_t most) {
  std::vector<double> level_db(events.size());
  std::transform(events.begin(), events.end(), level_db.begin(), relative_level_db);
  std::vector<std::size_t> order(events.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  const std::size_t kept = std::min(most, order.size());
  std::partial_sort(order.begin(), order.begin() + static_cast<std::ptrdiff_t>(kept), order.end(),
                    [&](std::size_t a, std::size_t b) {
                      return std::tuple(-level_db[a], events[a].id, a) < std::tuple(-level_db[b], events[b].id, b);
                    });
  order.resize(kept);
  return order;
}

}  // namespace rustle::report
