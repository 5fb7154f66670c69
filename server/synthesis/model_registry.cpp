#include "server/synthesis/model_registry.h"

#include "server/synthesis/crumpling.h"
#include "server/synthesis/friction.h"
#include "server/synthesis/friction_noise.h"
#include "server/synthesis/voices.h"

namespace rustle::synthesis {

std::span<const SoundModel> sound_models() noexcept {
  static constexpr SoundModel kModels[] = {
      {"paper crumpling", SoundKind::kCrumpling, 0, make_crumpling_plan, make_voices},
      {"paper friction", SoundKind::kFriction, 0, make_friction_plan, make_friction_noise},
  };
  return kModels;
}

}  // namespace rustle::synthesis
