#pragma once

#include <span>

#include "server/synthesis/sound_model.h"

namespace rustle::synthesis {

/// Every sound model there is, in the order in which they plan and render. Any thread.
std::span<const SoundModel> sound_models() noexcept;

}  // namespace rustle::synthesis
