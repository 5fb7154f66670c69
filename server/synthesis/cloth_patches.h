#pragma once

#include <cstddef>
#include <memory>
#include <span>
#include <vector>

#include "server/spatial/dipole.h"
#include "server/synthesis/sound_model.h"

namespace rustle::synthesis {

inline constexpr std::size_t kMostClothPatches = 64;  ///< that sound at a time in a session, channels counted

/// Between two places of an emitter; at 1 the second.
spatial::Emitter between(const spatial::Emitter& a, const spatial::Emitter& b, double share) noexcept;

/// How an emitter is heard in each of the two channels of a corpus, as filters: what microphones or the ears of the
/// session's head hear of it, and of its images in planes up to 10 ms later (C7). The mono layout has the same in both.
/// Pure.
std::vector<std::vector<float>> heard_filters(const spatial::Emitter& emitter, const spatial::Listener& listener,
                                              std::span<const spatial::Plane> planes, const PlanOptions& options);

/// Render half of cloth: patches that sound of the pieces that cues bring (C6). Pieces of a patch are added up, at their
/// samples, and go along its paths (SourcePaths), which follow its emitter, or straight to one channel (C7). Beyond
/// kMostClothPatches a new patch is not begun. [render worker]
std::unique_ptr<RenderModel> make_cloth_patches(const RenderOptions& options);

}  // namespace rustle::synthesis
