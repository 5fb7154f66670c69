#include "server/comparison/event_matching.h"

#include <fmt/format.h>

#include <algorithm>
#include <cassert>
#include <cmath>
#include <limits>
#include <map>
#include <nlohmann/json.hpp>
#include <tuple>
#include <utility>

namespace rustle::comparison {
namespace {

using Indices = std::vector<std::size_t>;

/// Indices by sheet and kind, each in order of time.
std::map<std::pair<std::uint32_t, std::string>, Indices> by_source(std::span<const ListedEvent> events) {
  std::map<std::pair<std::uint32_t, std::string>, Indices> out;
  for (std::size_t k = 0; k < events.size(); ++k) out[{events[k].sheet, events[k].kind}].push_back(k);
  for (auto& [source, indices] : out) {
    std::stable_sort(indices.begin(), indices.end(),
                     [&](std::size_t a, std::size_t b) { return events[a].time_s < events[b].time_s; });
  }
  return out;
}

/// What the best matching of two beginnings comes to: more pairs are better, then less distance.
struct Worth {
  std::size_t pairs = 0;
  double distance_s = 0;
  bool better_than(const Worth& other) const {
    return std::tuple(pairs, -distance_s) > std::tuple(other.pairs, -other.distance_s);
  }
};

/// The best order-preserving matching: on a line no other is better.
void match_burst(std::span<const std::size_t> reference, std::span<const std::size_t> other,
                 std::span<const ListedEvent> reference_events, std::span<const ListedEvent> other_events,
                 double tolerance_s, std::vector<MatchedPair>& out) {
  enum Step : std::uint8_t { kPair, kSkipReference, kSkipOther };
  const std::size_t rows = reference.size(), columns = other.size();
  std::vector<Worth> above(columns + 1), row(columns + 1);
  std::vector<Step> steps(rows * columns);
  for (std::size_t i = 0; i < rows; ++i) {
    row[0] = {};
    for (std::size_t j = 0; j < columns; ++j) {
      Step step = above[j + 1].better_than(row[j]) ? kSkipReference : kSkipOther;
      Worth best = step == kSkipReference ? above[j + 1] : row[j];
      const double apart_s = std::abs(reference_events[reference[i]].time_s - other_events[other[j]].time_s);
      if (const Worth paired{above[j].pairs + 1, above[j].distance_s + apart_s};
          apart_s <= tolerance_s && paired.better_than(best)) {
        step = kPair, best = paired;
      }
      steps[i * columns + j] = step, row[j + 1] = best;
    }
    std::swap(above, row);
  }
  const std::size_t first = out.size();
  for (std::size_t i = rows, j = columns; i > 0 && j > 0;) {
    const Step step = steps[(i - 1) * columns + j - 1];
    if (step == kPair) out.push_back({reference[i - 1], other[j - 1]});
    if (step != kSkipOther) --i;
    if (step != kSkipReference) --j;
  }
  std::reverse(out.begin() + static_cast<std::ptrdiff_t>(first), out.end());
}

double quantile(const std::vector<double>& sorted, double share) {
  return sorted.empty() ? 0 : sorted[static_cast<std::size_t>(share * static_cast<double>(sorted.size() - 1) + 0.5)];
}

}  // namespace

tl::expected<std::vector<ListedEvent>, std::string> read_event_list(const std::string& text) {
  std::vector<ListedEvent> out;
  std::size_t number = 0;
  for (std::size_t at = 0; at < text.size();) {
    const std::size_t end = std::min(text.find('\n', at), text.size());
    const std::string_view line(text.data() + at, end - at);
    at = end + 1, ++number;
    if (line.find_first_not_of(" \t\r") == std::string_view::npos) continue;
    const auto read = nlohmann::json::parse(line, nullptr, false);
    if (!read.is_object()) return tl::unexpected(fmt::format("line {} is not a JSON object", number));
    const auto number_of = [&](const char* name) {
      const auto found = read.find(name);
      return found != read.end() && found->is_number() ? found->get<double>() : std::numeric_limits<double>::quiet_NaN();
    };
    const auto kind = read.find("kind");
    const double sheet = number_of("sheet");
    ListedEvent event{0, "", number_of("time_s"), number_of("amplitude")};
    if (kind == read.end() || !kind->is_string() || !std::isfinite(event.time_s) || !std::isfinite(event.amplitude) ||
        !(sheet >= 0 && sheet <= std::numeric_limits<std::uint32_t>::max())) {
      return tl::unexpected(fmt::format(
          "line {} needs sheet, kind, time_s and amplitude; `rustle render --events` writes such lists", number));
    }
    if (const auto continued = read.find("continues"); continued != read.end() && !continued->is_null()) continue;
    event.sheet = static_cast<std::uint32_t>(sheet);
    event.kind = kind->get<std::string>();
    out.push_back(std::move(event));
  }
  return out;
}

std::vector<MatchedPair> match_events(std::span<const ListedEvent> reference, std::span<const ListedEvent> other,
                                      double tolerance_s) {
  assert(tolerance_s >= 0);
  const auto wanted = by_source(reference), found = by_source(other);
  std::vector<MatchedPair> out;
  for (const auto& [source, all_a] : wanted) {
    const auto there = found.find(source);
    if (there == found.end()) continue;
    const Indices& all_b = there->second;
    // A burst ends where the next event of either list is further away than the tolerance.
    for (std::size_t a = 0, b = 0; a < all_a.size() && b < all_b.size();) {
      const std::size_t first_a = a, first_b = b;
      double last_s = std::min(reference[all_a[a]].time_s, other[all_b[b]].time_s);
      while (true) {
        const bool take_a = a < all_a.size() && reference[all_a[a]].time_s <= last_s + tolerance_s;
        const bool take_b = b < all_b.size() && other[all_b[b]].time_s <= last_s + tolerance_s;
        if (!take_a && !take_b) break;
        const double at_a = take_a ? reference[all_a[a]].time_s : std::numeric_limits<double>::infinity();
        const double at_b = take_b ? other[all_b[b]].time_s : std::numeric_limits<double>::infinity();
        last_s = std::min(at_a, at_b);
        ++(at_a <= at_b ? a : b);
      }
      match_burst(std::span(all_a).subspan(first_a, a - first_a), std::span(all_b).subspan(first_b, b - first_b), reference,
                  other, tolerance_s, out);
    }
  }
  std::stable_sort(out.begin(), out.end(), [&](const MatchedPair& a, const MatchedPair& b) {
    return reference[a.reference].time_s < reference[b.reference].time_s;
  });
  return out;
}

EventScore score_events(std::span<const ListedEvent> reference, std::span<const ListedEvent> other,
                        std::span<const MatchedPair> pairs) {
  EventScore out{.reference = reference.size(), .other = other.size(), .matched = pairs.size()};
  const auto matched = static_cast<double>(pairs.size());
  if (!other.empty()) out.precision = matched / static_cast<double>(other.size());
  if (!reference.empty()) out.recall = matched / static_cast<double>(reference.size());
  std::vector<double> errors_s;
  double decibels = 0, with_amplitude = 0;
  for (const auto& [a, b] : pairs) {
    const double late_s = other[b].time_s - reference[a].time_s;
    errors_s.push_back(std::abs(late_s));
    out.bias_s += late_s / matched;
    if (reference[a].amplitude > 0 && other[b].amplitude > 0) {
      decibels += 20 * std::log10(other[b].amplitude / reference[a].amplitude);
      with_amplitude += 1;
    }
  }
  std::sort(errors_s.begin(), errors_s.end());
  out.median_error_s = quantile(errors_s, 0.5);
  out.p95_error_s = quantile(errors_s, 0.95);
  if (with_amplitude > 0) out.amplitude_db = decibels / with_amplitude;
  return out;
}

}  // namespace rustle::comparison
