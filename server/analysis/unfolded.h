#pragma once

#include <cstdint>
#include <memory>
#include <utility>
#include <vector>

#include "server/analysis/contact_patch.h"

namespace rustle::analysis {

/// Proof that no two parts of a sheet lie on top of each other: it is in one piece, all its normals are within 84° of an
/// axis, and its border seen along that does not cross itself. Conservative: false says nothing.
/// A proof also tells how far vertices can move while it stands, so that a sheet that slides or hardly bends costs O(V)
/// instead of O(T + B), or O(T + B log B + crossings in x) where the border is not star-shaped. The answer is that of a
/// proof from the start, up to the choice of axis. Nothing is allocated once warm.
class UnfoldedProof {
 public:
  bool holds(const ContactGeometry& geometry);

 private:
  struct Side {
    sheet::Vec2d start, end;
    std::uint32_t first, last;
    double low, high;
  };

  bool still_stands(const ContactGeometry& geometry) const;
  bool prove(const ContactGeometry& geometry);
  sheet::Vec4f mean_normal(const ContactGeometry& geometry) const;
  float star_margin_m(const ContactGeometry& geometry, const sheet::Vec4f& axis) const;
  void project_border(const ContactGeometry& geometry, const sheet::Vec4f& axis);
  bool border_crosses_itself(const ContactGeometry& geometry, const sheet::Vec4f& axis);

  std::shared_ptr<const sheet::Topology> topology_;
  bool connected_ = false;
  std::vector<Eigen::Vector4f> proven_m_;  ///< relative positions of the last proof
  bool served_ = false;                    ///< it has held for a frame after its own
  int unkept_ = 0;                         ///< proofs to come that are not kept
  float margin_m_ = 0;                     ///< how far any vertex may have moved from there, relative to the origin; 0: none
  std::vector<Side> sides_;
  std::vector<std::pair<double, std::uint32_t>> order_;
};

}  // namespace rustle::analysis
