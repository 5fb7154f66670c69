#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "server/synthesis/cloth/selection.h"

namespace rustle::cloth {

/// Samples of a source, sounding from `offset` samples after the place of the unit they belong to.
struct Piece {
  const float* samples = nullptr;
  std::uint32_t count = 0;
  std::int32_t offset = 0;
};

/// A source cut into units that can be put together in any order (C6). Consecutive units are taken as one run. A run is
/// extended at either end to a place where the source changes its sign, at most by half a unit, and what runs have in common
/// is added up. It is the nearest place at which the source steps no further than it does on average (RMS) over the half
/// unit that begins or ends there, else the gentlest one by that measure: a run that begins within a pop reaches back before
/// it, as nothing may sound before that hides the step. Where there is no such place the extension fades in a straight line.
/// Runs do not reach into another recording. Immutable; any thread.
class JoinedSource {
 public:
  /// Keeps the recordings, which outlive it. Each has as many units as fit; what is left at its end serves for extensions
  /// only. Allocates; O(samples). \pre unit_samples ≥ 4
  JoinedSource(std::vector<std::span<const float>> recordings, std::uint32_t unit_samples);

  std::uint32_t unit_samples() const noexcept { return unit_samples_; }
  std::uint32_t units() const noexcept { return static_cast<std::uint32_t>(units_.size()); }
  /// Whether `next` follows `unit` in its recording.
  bool follows(std::uint32_t unit, std::uint32_t next) const noexcept {
    return next == unit + 1 && next < units() && !begins_[next];
  }

  /// The unit itself, what comes before it where it begins a run, and what comes after it where it ends one.
  Piece unit(std::uint32_t unit) const noexcept { return {units_[unit], unit_samples_, 0}; }
  Piece before(std::uint32_t unit) const noexcept { return heads_[unit]; }
  Piece after(std::uint32_t unit) const noexcept { return tails_[unit]; }

 private:
  void extend(std::span<const float> recording, std::size_t begin, std::vector<std::array<std::size_t, 2>>& places);

  std::vector<std::span<const float>> recordings_;
  std::uint32_t unit_samples_;
  std::vector<bool> begins_;  ///< a recording
  std::vector<const float*> units_;
  std::vector<Piece> heads_, tails_;
  std::vector<float> faded_;  ///< extensions that the source does not have as they are
};

/// Choices, one after another, into pieces of sound.
class RunBuilder {
 public:
  explicit RunBuilder(const JoinedSource& source) : source_(source) {}

  /// Pieces at most: the end of the last run, the beginning of a new one, the unit.
  struct Pieces {
    std::array<Piece, 3> pieces;
    std::size_t count = 0;
    bool begins = false;  ///< a run
    /// What goes on where the last one ends becomes one with it.
    void add(const Piece& piece) noexcept;
    std::span<const Piece> all() const { return std::span(pieces).first(count); }
  };
  /// Whether the run goes on with this unit.
  bool goes_on(std::uint32_t unit) const noexcept { return last_ != kNoUnit && source_.follows(last_, unit); }
  /// What the next unit adds, offsets from its place.
  Pieces next(std::uint32_t unit);
  /// The last run ends where the next unit would have been.
  Pieces finish();

 private:
  const JoinedSource& source_;
  std::uint32_t last_ = kNoUnit;
};

/// A whole selection as a signal of units() times the choices. Allocates.
/// \param joins  where given: places of the first sample of every run and of the first after it, extensions included
std::vector<float> concatenated(const JoinedSource& source, std::span<const Choice> choices,
                                std::vector<std::int64_t>* joins = nullptr);

}  // namespace rustle::cloth
