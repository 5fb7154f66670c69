#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "server/observation/observation.h"
#include "server/spatial/dipole.h"
#include "server/synthesis/cloth/contact_track.h"
#include "server/synthesis/cloth/prepared_corpus.h"
#include "server/synthesis/cloth/target_signal.h"
#include "server/synthesis/sound_model.h"

namespace rustle::synthesis {

inline constexpr std::size_t kClothPatches = 4;  ///< of a sheet

/// A contact that sounds of a corpus, and the part of its area that does (C9).
struct ClothTouch {
  const observation::FrictionContact* contact = nullptr;
  double area_share = 1;
};

/// What targets of two channels are heard through (C7).
struct ClothEars {
  spatial::Listener listener;
  std::vector<spatial::Plane> planes;
};

/// One sheet's contacts and crumpling into the targets of one corpus (An et al. 2012, sections 2 and 3; C1, C2):
///
///   observations ─┬─► speed track ─► friction clips ─┬─► target, one a patch or one an ear
///                 └─► events ─► crumpling units ─────┘
///
/// Contacts belong to patches, kClothPatches at most, each heard from where it is: a component of touching vertices begins
/// in a free patch, else in the nearest one, and events go to the nearest one. Of a corpus of one channel every patch has a
/// target; of one of two channels there is one for each ear, of what that hears of the patches (C7).
/// Times count from the first frame, in samples: what a sheet sounds like does not depend on when it begins. [analysis
/// worker]
class ClothTargets {
 public:
  /// \param seed   of its noise
  /// \param begin  the sample of its first frame
  ClothTargets(std::shared_ptr<const cloth::PreparedCorpus> corpus, const PlanOptions& options, std::uint64_t seed,
               SampleTime begin);

  /// What the sheet did between two frames. Events sound where `crumples`.
  void add(const observation::Observation& observation, std::span<const ClothTouch> touches, bool crumples,
           const ClothEars& ears);
  /// Vertices have other numbers from now on: see ContactTrack.
  void renumber(std::span<const std::uint32_t> origins) { track_.renumber(origins); }
  void forget_vertices() { track_.forget_vertices(); }
  /// One more clip, contacts going on as they are where nothing is known.
  void go_on() { target_.advance(track_, target_.next_clip() + 1); }
  /// Contacts end with the newest frame; all that is still to come is settled.
  void end();

  bool heard() const noexcept { return corpus_->channels() > 1; }
  std::size_t outputs() const noexcept { return target_.outputs(); }
  /// Targets before this sample are settled.
  std::int64_t settled() const noexcept { return target_.settled(); }
  void read(std::size_t output, std::int64_t from, std::span<float> out) const noexcept { target_.read(output, from, out); }
  /// What is before will not be asked for.
  void forget(std::int64_t before);
  /// Where a patch is.
  spatial::Emitter emitter_at(std::size_t patch, std::int64_t at) const;

 private:
  struct Place {
    std::int64_t at = 0;
    spatial::Emitter emitter;
  };
  struct Patch {
    std::vector<std::uint64_t> episodes;  ///< contacts that belong to it
    std::deque<Place> places;             ///< by time
    std::int64_t sounds_until = 0;
  };

  std::size_t patch_of(const observation::FrictionContact& contact);
  std::size_t patch_near(const sheet::Vec3d& position_m) const;
  std::size_t nearest(const sheet::Vec3d& position_m) const;
  bool rests(const Patch& patch) const noexcept;
  std::optional<std::size_t> free_patch() const;
  void move(std::size_t patch, const spatial::Emitter& emitter);
  std::vector<cloth::ContactSample> place_contacts(std::span<const ClothTouch> touches);
  void add_events(const observation::Observation& observation);
  void listen(const ClothEars& ears);

  std::shared_ptr<const cloth::PreparedCorpus> corpus_;
  PlanOptions options_;
  std::uint64_t seed_;
  SampleTime begin_;
  cloth::ContactTrack track_;
  cloth::TargetSignal target_;
  std::vector<Patch> patches_;
  std::int64_t newest_ = 0;  ///< time of the newest frame
};

}  // namespace rustle::synthesis
