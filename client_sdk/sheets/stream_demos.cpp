#include "client_sdk/sheets/stream_demos.h"

#include <algorithm>
#include <array>
#include <string>

#include "client_sdk/sheets/cloth_motion.h"
#include "client_sdk/sheets/demos.h"
#include "client_sdk/sheets/tearing_scripts.h"

namespace rustle::sheets {
namespace {

struct TearDemo {
  std::string_view name, script;
};
constexpr std::array<TearDemo, 6> kTears = {{{"tear", "torn"},
                                             {"tear_slow", "slow"},
                                             {"tear_fast", "fast"},
                                             {"tear_one_handed", "one_handed"},
                                             {"tear_curved", "curved"},
                                             {"tear_pulled", "pulled"}}};

constexpr std::string_view kCloth = "cloth";

}  // namespace

std::vector<std::string_view> stream_demo_names() {
  std::vector<std::string_view> names(demo_names().begin(), demo_names().end());
  for (const TearDemo& tear : kTears) names.push_back(tear.name);
  names.push_back(kCloth);
  return names;
}

std::string_view usual_material(std::string_view demo_name) {
  return demo_name == kCloth ? "cotton" : "printer-paper";
}

std::unique_ptr<SheetStream> make_stream_demo(std::string_view name, std::size_t triangle_count, std::uint64_t seed,
                                              std::string_view material) {
  if (name == kCloth) return make_stream(make_cloth_demo(triangle_count, seed));
  const auto tear = std::find_if(kTears.begin(), kTears.end(), [&](const TearDemo& t) { return t.name == name; });
  if (tear == kTears.end()) {
    std::shared_ptr<const AnimatedSheet> sheet = make_demo(name, triangle_count, seed);
    return sheet ? make_stream(std::move(sheet)) : nullptr;
  }
  TearingOptions options;
  options.triangles = triangle_count;
  options.seed = seed;
  options.material = material;
  return make_tear(tear->script, options);
}

}  // namespace rustle::sheets
