#pragma once

#include <cstdint>
#include <map>
#include <utility>
#include <vector>

#include "server/synthesis/sound_model.h"
#include "server/synthesis/unit_loudness.h"

namespace rustle::synthesis {

inline constexpr std::int64_t kSlots_per_s = 500;  ///< 2 ms each

/// The slot that holds a sample, on the absolute grid, and its first sample.
std::int64_t slot_of(SampleTime sample, std::uint32_t rate_hz) noexcept;
SampleTime first_sample_of(std::int64_t slot, std::uint32_t rate_hz) noexcept;

/// Merging of dense bursts (P9). Of the crumpling events of one bus that begin in one slot the strongest stays; where there
/// are three or more, the rest becomes one of them, drawn with a probability proportional to its energy and raised to their
/// total energy:   energy = Σ over its units of gain² Σ x²,   gain' = gain √(Σ energies / energy).
/// So at most kSlots_per_s · 2 events a second sound, with the expected energy unchanged. All units (resonators) of an event
/// go together. Drawn from hash(seed, bus, slot): neither the order in which events come nor the size of blocks matters, as
/// long as a slot's events are merged in one call. [analysis worker]
class DenseBursts {
 public:
  explicit DenseBursts(const PlanOptions& options) : options_(options) {}

  /// From now on so many slots count as one. \pre slots ≥ 1
  void join_slots(int slots) noexcept { joined_ = slots; }

  /// Where a release up to `until` has to reach so that no slot is cut: the end of the last one that it begins (onsets lie
  /// at most kQuantum after their start). Never less than `until`.
  SampleTime whole_slots(SampleTime until) const noexcept;

  /// Merges the CrumpleCues in cues[first ..); what is left keeps its order. Other cues stay. In `published` mode nothing.
  void merge(std::vector<Cue>& cues, std::size_t first);

  /// A CrumpleRaiseCue in cues[first ..) that is meant for an event merged into another becomes one for that, which raises
  /// its energy by as much as the event's would have been.
  void redirect_raises(std::vector<Cue>& cues, std::size_t first);

  /// Forgets what was merged more than a second before `now`.
  void forget(SampleTime now);
  /// The material's units are about to go.
  void forget(const Material& material) { loudness_.forget(material); }

  std::uint64_t merged() const noexcept { return merged_; }  ///< units left out for another one's

 private:
  struct Member {
    std::int64_t slot = 0;
    Bus bus = 0;
    std::uint64_t event = 0;
    double energy = 0;
  };
  struct Merger {
    std::uint64_t sounding = 0;  ///< the event that sounds for all
    double energy = 0;           ///< of all now
    SampleTime onset = 0;
  };
  struct Merged {
    std::uint64_t merger = 0;
    double energy = 0;
  };
  std::int64_t slot_at(SampleTime sample) const noexcept;
  SampleTime first_sample_at(std::int64_t slot) const noexcept;
  void merge_slot(std::size_t from, std::size_t to);

  PlanOptions options_;
  int joined_ = 1;
  UnitLoudness loudness_;
  std::vector<Member> members_;                                    ///< of the cues at hand, and
  std::vector<float> factors_;                                     ///< how much louder each gets, 0: another sounds for it
  std::map<std::uint64_t, Merger> mergers_;                        ///< by number
  std::map<std::pair<Bus, std::uint64_t>, Merged> merged_events_;  ///< visible ones, which may still be raised
  std::uint64_t next_merger_ = 0;
  std::uint64_t merged_ = 0;
};

}  // namespace rustle::synthesis
