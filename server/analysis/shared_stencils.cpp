#include "server/analysis/shared_stencils.h"

#include <algorithm>
#include <cstdint>
#include <mutex>
#include <string_view>
#include <utility>
#include <vector>

#include "server/sheet/transfer.h"

namespace rustle::analysis {
namespace {

/// What a shape's stencils are made of.
struct Shape {
  std::shared_ptr<const sheet::Topology> topology;
  sheet::RestPlane plane;
  Parameters parameters;
  bool may_be_coarse;

  bool operator==(const Shape& other) const {
    return may_be_coarse == other.may_be_coarse && plane.coordinates_m == other.plane.coordinates_m &&
           plane.component == other.plane.component && parameters == other.parameters &&
           sheet::same_structure(*topology, *other.topology);
  }

  std::size_t hash() const {
    const auto of = [](const auto* first, std::size_t count) {
      return std::hash<std::string_view>{}({reinterpret_cast<const char*>(first), count * sizeof(*first)});
    };
    return of(plane.coordinates_m.data(), plane.coordinates_m.size()) +
           3 * of(topology->triangles().data(), topology->triangle_count()) + (may_be_coarse ? 1 : 0);
  }
};

/// One kind of them, by the shapes that sheets have now.
template <class Made>
class SharedByShape {
 public:
  template <class Make>
  std::shared_ptr<const Made> get(Shape shape, Make&& make) {
    const std::size_t hash = shape.hash();
    if (auto known = find(hash, shape)) return known;
    // Made without the lock: others go on meanwhile, at worst two make the same.
    Made made = make(shape);
    const auto entry = std::make_shared<const Entry>(Entry{std::move(shape), std::move(made)});
    const std::lock_guard lock(mutex_);
    std::erase_if(entries_, [](const Known& known) { return known.entry.expired(); });
    entries_.push_back({hash, entry});
    return {entry, &entry->made};
  }

 private:
  struct Entry {
    Shape shape;
    Made made;
  };
  struct Known {
    std::size_t hash;
    std::weak_ptr<const Entry> entry;
  };

  std::shared_ptr<const Made> find(std::size_t hash, const Shape& shape) {
    const std::lock_guard lock(mutex_);
    for (const Known& known : entries_) {
      if (known.hash != hash) continue;
      if (auto entry = known.entry.lock(); entry && entry->shape == shape) return {entry, &entry->made};
    }
    return nullptr;
  }

  std::mutex mutex_;
  std::vector<Known> entries_;
};

}  // namespace

std::shared_ptr<const CurvatureStencils> shared_curvature_stencils(const std::shared_ptr<const sheet::Topology>& topology,
                                                                   sheet::RestPlane plane, const Parameters& parameters) {
  static SharedByShape<CurvatureStencils> shared;
  return shared.get({topology, std::move(plane), parameters, false},
                    [](const Shape& s) { return curvature_stencils(s.topology, s.plane, s.parameters); });
}

std::shared_ptr<const RegionMesh> shared_region_mesh(const std::shared_ptr<const sheet::Topology>& topology,
                                                     const sheet::RestPlane& plane, const Parameters& parameters,
                                                     bool may_be_coarse) {
  static SharedByShape<RegionMesh> shared;
  return shared.get({topology, plane, parameters, may_be_coarse},
                    [](const Shape& s) { return region_mesh(s.topology, s.plane, s.parameters, s.may_be_coarse); });
}

}  // namespace rustle::analysis
