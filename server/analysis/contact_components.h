#pragma once

#include <cstdint>
#include <span>
#include <string_view>
#include <vector>

#include "server/analysis/contact_patch.h"
#include "server/observation/observation.h"

namespace rustle::analysis {

/// Splits patches into components: touching vertices that sides of triangles connect. Keeps working memory: once warm only
/// what is returned is allocated.
class ContactComponents {
 public:
  /// Appends a contact a component, in order of their lowest vertices. `once`: of components of one sheet that touch each
  /// other only that with the lowest vertex. O(V) and the patch's triangles.
  void split(const sheet::MeshFrame& frame, const ContactPatch& patch, const sheet::ContactPartner& partner,
             std::string_view surface, bool once, std::vector<observation::FrictionContact>& out);

  /// The component of each of the last patch's vertices, from 0.
  std::span<const std::uint32_t> component() const { return component_; }

 private:
  void connect(const sheet::Topology& topology, const ContactPatch& patch);
  std::uint32_t root(std::uint32_t k) {
    while (parent_[k] != k) k = parent_[k] = parent_[parent_[k]];
    return k;
  }
  void find_sounding(const sheet::Topology& topology, const ContactPatch& patch);

  std::vector<std::uint32_t> place_;  ///< [V], in the patch, or kNone
  std::vector<std::uint32_t> parent_, component_;
  std::uint32_t count_ = 0;
  std::vector<std::size_t> sizes_;         ///< vertices of each component
  std::vector<std::uint32_t> contact_of_;  ///< each component's place in the output, or kNone: it sounds elsewhere
  std::vector<sheet::Vec3d> slip_sums_;    ///< by component
  struct Touched {
    std::uint32_t by, component, place;
    double area_m2;
  };
  std::vector<Touched> touched_;
};

}  // namespace rustle::analysis
