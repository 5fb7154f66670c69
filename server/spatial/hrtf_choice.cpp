#include "server/spatial/hrtf_choice.h"

#include <array>
#include <filesystem>
#include <utility>

#include "server/spatial/measured_head.h"
#include "server/spatial/structural_head.h"

namespace rustle::spatial {
namespace {

constexpr std::array<const char*, 2> kKemarPlaces{"/usr/share/libmysofa/default.sofa",
                                                  "/usr/local/share/libmysofa/default.sofa"};

}  // namespace

std::string kemar_file() {
  for (const char* place : kKemarPlaces) {
    std::error_code failed;
    if (std::filesystem::is_regular_file(place, failed)) return place;
  }
  return {};
}

std::string_view default_hrtf() {
  return kemar_file().empty() ? kStructuralHrtf : kKemarHrtf;
}

tl::expected<std::shared_ptr<const Hrtf>, std::string> load_hrtf(std::string_view name, double rate_hz) {
  if (name.empty()) name = default_hrtf();
  if (name == kStructuralHrtf) return std::make_shared<const Hrtf>(structural_head(rate_hz));
  std::string file(name);
  if (name == kKemarHrtf) {
    file = kemar_file();
    if (file.empty()) {
      return tl::unexpected(
          std::string("The HRTF \"kemar\" is not installed; install libmysofa1 with its data, or use \"structural\"."));
    }
  }
  return measured_head(file, rate_hz).map([](Hrtf&& head) { return std::make_shared<const Hrtf>(std::move(head)); });
}

}  // namespace rustle::spatial
