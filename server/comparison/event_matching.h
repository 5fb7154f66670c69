#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include <tl/expected.hpp>

/// Two lists of events of the same motion held against each other.
namespace rustle::comparison {

/// One line of an event list (`rustle render --events`).
struct ListedEvent {
  std::uint32_t sheet = 0;
  std::string kind;      ///< "crumpling", "friction", "tearing"
  double time_s = 0;     ///< when it begins, in simulation time
  double amplitude = 0;  ///< crumpling in m (P2), else m/s
};

/// Reads JSON Lines as `rustle render --events` writes them, without the events that continue another. Error: the line and
/// what is wrong with it.
[[nodiscard]] tl::expected<std::vector<ListedEvent>, std::string> read_event_list(const std::string& text);

struct MatchedPair {
  std::size_t reference = 0, other = 0;  ///< indices into the lists
};

/// The most pairs of one event each, of the same sheet and kind and at most `tolerance_s` apart; among those the ones whose
/// times differ least in sum. Pairs in order of the reference's times. O(n m) within bursts denser than the tolerance.
/// \pre tolerance_s ≥ 0
[[nodiscard]] std::vector<MatchedPair> match_events(std::span<const ListedEvent> reference,
                                                    std::span<const ListedEvent> other, double tolerance_s);

/// How well `other` finds the reference's events.
struct EventScore {
  std::size_t reference = 0, other = 0, matched = 0;
  double precision = 1;                        ///< matched / other; 1 where there are none
  double recall = 1;                           ///< matched / reference; 1 where there are none
  double median_error_s = 0, p95_error_s = 0;  ///< of the sizes of time differences of pairs
  double bias_s = 0;                           ///< mean of other - reference
  double amplitude_db = 0;                     ///< mean of 20 log10(other / reference) of pairs with both above 0
};

/// \pre pairs = match_events(reference, other, ...)
[[nodiscard]] EventScore score_events(std::span<const ListedEvent> reference, std::span<const ListedEvent> other,
                                      std::span<const MatchedPair> pairs);

}  // namespace rustle::comparison
