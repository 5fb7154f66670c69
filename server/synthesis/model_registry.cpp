#include "server/synthesis/model_registry.h"

#include "server/synthesis/cloth_patches.h"
#include "server/synthesis/cloth_plan.h"
#include "server/synthesis/crumpling.h"
#include "server/synthesis/friction.h"
#include "server/synthesis/friction_noise.h"
#include "server/synthesis/tear_noise.h"
#include "server/synthesis/tearing.h"
#include "server/synthesis/voices.h"

namespace rustle::synthesis {

std::span<const SoundModel> sound_models() noexcept {
  static constexpr SoundModel kModels[] = {
      {"paper crumpling", SoundKind::kCrumpling, make_crumpling_plan, make_voices},
      {"paper friction", SoundKind::kFriction, make_friction_plan, make_friction_noise},
      {"paper tearing", SoundKind::kTearing, make_tearing_plan, make_tear_noise},
      {"cloth", SoundKind::kFriction, make_cloth_plan, make_cloth_patches},
  };
  return kModels;
}

}  // namespace rustle::synthesis
