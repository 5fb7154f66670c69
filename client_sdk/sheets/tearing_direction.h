#pragma once

#include <cstdint>

#include "client_sdk/sheets/tearing_hands.h"

/// Where a tear begins and which way it goes (paper tearing 2015, section 4.1).
namespace rustle::sheets {

/// Where the ray from a point of the sheet leaves it. \pre from_m inside, along not zero
[[nodiscard]] Point2 border_hit(const RectangleSize& size, Point2 from_m, Point2 along);

/// The way out of the sheet at a point of its border: unit length.
[[nodiscard]] Point2 outward_at(const RectangleSize& size, Point2 border_m);

/// A point of the sheet's border between the hits of the two rays from thumb to index; `share` from 0 (left) to 1. Hits on
/// two edges are joined over the corner between them. Pure.
[[nodiscard]] Point2 tear_start(const RectangleSize& size, const Grips& grips, double share);

/// Advance of the tip in the material plane while the hands turn (eq. 1):
///   t = C (Δθ1 v1/|v1| + Δθ2 v2/|v2|)
/// v from the tip to the thumbs. A hand that closes (Δθ < 0) tears nothing. Pure.
[[nodiscard]] Point2 rotation_advance(const TearPose& pose, const HandMotions& motions, double torn_m_per_rad);

/// Advance of the tip while the hands move over the table without turning. The regions, turned apart by Θ, meet in one
/// point of the sheet only; moved apart by u they meet R(-ā) J u / (2 sin Θ/2) farther on (J a quarter turn, ā the mean of
/// their angles), and the sheet tears up to there. Zero where that lies behind the tip: the fingers slip. Θ counts as
/// 10° at least: a flat sheet pulled apart would tear all at once. Pure.
[[nodiscard]] Point2 translation_advance(const TearPose& pose, const HandMotions& motions);

}  // namespace rustle::sheets
