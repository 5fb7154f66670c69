#pragma once

#include <complex>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "server/synthesis/cloth/contact_track.h"
#include "server/synthesis/cloth/prepared_corpus.h"
#include "sound_db/dsp/fft.h"

namespace rustle::cloth {

/// The target that units are found for (An et al. 2012, sections 2 and 3; C1, C2), from one sheet's contacts and crumpling,
/// on its own sample axis, which begins with 0.
///   friction   clips of 50 ms, hop 25 ms, sine window: noise of the power Σ_v A_v/A_patch · A(f, s_v(t))² of the vertices
///   of a
///              patch at the clip's centre, independent phases, so that powers add and the level is free of resolution
///   crumpling  a recorded unit from an event's onset on
/// Patches either have an output each, dry, or all go to two outputs, each through filters of its own: those of the ears
/// (C7). Noise is seeded by (seed, patch, clip): the same contacts give the same bits. [analysis worker]
class TargetSignal {
 public:
  /// \param outputs_heard  0: an output per patch; else so many, which the filters of hear_through() lead to
  TargetSignal(std::shared_ptr<const PreparedCorpus> corpus, std::uint64_t seed, std::size_t patches,
               std::size_t outputs_heard = 0);

  std::size_t outputs() const noexcept { return outputs_.size(); }

  /// How a patch is heard from now on, by output. \pre outputs_heard filters, each as long as a clip at most
  void hear_through(std::size_t patch, std::span<const std::vector<float>> filters);

  /// Starts a crumpling unit of the corpus, or as soon as nothing before is settled. \pre patch and unit are there
  void pop(std::int64_t onset, std::size_t patch, std::size_t unit);

  /// Makes the clips whose centres come before `until`, for which `track` shall be settled.
  void advance(const ContactTrack& track, std::int64_t until);

  std::int64_t hop() const noexcept { return hop_; }
  /// The centre of the clip that is made next.
  std::int64_t next_clip() const noexcept { return next_clip_; }
  /// Sound before this sample is settled: the centre of the clip that was made last.
  std::int64_t settled() const noexcept { return next_clip_ > 0 ? next_clip_ - hop_ : 0; }

  /// Reads out.size() samples of an output from `from` on. \pre what has been forgotten is not asked for
  void read(std::size_t output, std::int64_t from, std::span<float> out) const noexcept;
  void forget(std::int64_t before);

 private:
  struct Patch {
    std::vector<double> row_weights;
    bool slides = false;
    std::vector<std::vector<float>> filters;                  ///< [output]
    std::vector<std::vector<std::complex<float>>> responses;  ///< [output][bin] of those
  };

  void add(std::size_t output, std::int64_t from, std::span<const float> sound);
  void add_clip(std::size_t output);
  void make_clip(std::size_t patch);

  std::shared_ptr<const PreparedCorpus> corpus_;
  std::uint64_t seed_;
  std::int64_t size_, hop_;
  std::int64_t next_clip_ = 0;
  std::vector<Patch> patches_;
  bool heard_;
  std::vector<std::vector<float>> outputs_;  ///< [output], from first_ on
  std::int64_t first_ = 0;
  dsp::RealFft fft_;
  std::vector<float> window_, power_;
  std::vector<std::complex<float>> noise_;
};

}  // namespace rustle::cloth
