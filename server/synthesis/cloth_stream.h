#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "server/synthesis/cloth/joins.h"
#include "server/synthesis/cloth/prepared_corpus.h"
#include "server/synthesis/cloth/unit_stream.h"
#include "server/synthesis/cloth_targets.h"
#include "server/synthesis/sound_model.h"

namespace rustle::synthesis {

/// One sheet's sound of one corpus (An et al. 2012, section 4; C3 - C7):
///
///   observations ─► targets ─► features ─► warp ─► choices ─► runs ─► cues
///
/// The target of each patch has choices of its own, and its runs are heard from where the patch is; all patches share what
/// cools off. The targets of the two ears of a corpus of two channels have choices in common, which go to the channels as
/// they are (C7). [analysis worker]
class ClothStream {
 public:
  /// \param seed   of its noise, and what tells its patches from those of other streams
  /// \param begin  the sample of its first frame
  ClothStream(std::shared_ptr<const cloth::PreparedCorpus> corpus, const PlanOptions& options, Bus bus, std::uint64_t seed,
              SampleTime begin);

  /// What a patch of such a stream has in its cues.
  static std::uint64_t patch_id(std::uint64_t seed, std::size_t voice, std::size_t channel) noexcept;

  /// What the sheet did between two frames: see ClothTargets. Appends the cues that it settles.
  void add(const observation::Observation& observation, std::span<const ClothTouch> touches, bool crumples,
           const ClothEars& ears, std::vector<Cue>& out);
  void renumber(std::span<const std::uint32_t> origins) { targets_.renumber(origins); }
  void forget_vertices() { targets_.forget_vertices(); }

  /// No cue will start before this sample.
  SampleTime settled() const noexcept;
  /// Sound before `until` is due: contacts go on as they are as far as is needed for it.
  void complete(SampleTime until, std::vector<Cue>& out);
  /// Contacts end with the newest frame; what is still due.
  void end(std::vector<Cue>& out);

 private:
  struct Voice {
    cloth::UnitStream units;
    std::vector<cloth::RunBuilder> runs;  ///< [channel]
  };

  /// Units whose target is settled.
  void choose(std::vector<Cue>& out);
  void put(std::size_t voice, std::span<const cloth::PlacedUnit> units, std::vector<Cue>& out);

  std::shared_ptr<const cloth::PreparedCorpus> corpus_;
  Bus bus_;
  std::uint64_t seed_;
  SampleTime begin_;
  float gain_;
  ClothTargets targets_;
  std::vector<Voice> voices_;             ///< one a patch, or one in all
  std::vector<std::vector<float>> unit_;  ///< [channel][unit_samples]
  std::vector<cloth::PlacedUnit> placed_;
};

}  // namespace rustle::synthesis
