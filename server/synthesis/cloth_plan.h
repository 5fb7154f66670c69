#pragma once

#include <memory>

#include "server/synthesis/sound_model.h"

namespace rustle::synthesis {

/// Plan half of cloth (C1 - C9; An et al. 2012): a ClothStream for each corpus that a sheet sounds of, those of its own
/// packs and, where it touches cloth of another material, that one's: half of the area each. Cues go to the sheet's friction
/// bus, crumpling included, as units hold both. What it needs of later frames it waits for: settled(). [analysis worker]
std::unique_ptr<PlanModel> make_cloth_plan(const PlanOptions& options);

}  // namespace rustle::synthesis
