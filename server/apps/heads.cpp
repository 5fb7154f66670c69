#include "server/apps/heads.h"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>

#include "server/spatial/hrtf_choice.h"

namespace rustle::apps {

tl::expected<Heads, std::string> Heads::open(const std::vector<std::string>& chosen, std::uint32_t rate_hz) {
  Heads heads;
  const auto offer = [&](const std::string& source) {
    const bool known = source == spatial::kStructuralHrtf || source == spatial::kKemarHrtf;
    const std::string name = known ? source : std::filesystem::path(source).stem().string();
    if (std::ranges::find(heads.offers_, name, &Offer::name) == heads.offers_.end()) heads.offers_.push_back({name, source});
  };
  for (const std::string& source : chosen) offer(source);
  if (!spatial::kemar_file().empty()) offer(std::string(spatial::kKemarHrtf));
  offer(std::string(spatial::kStructuralHrtf));
  for (const Offer& each : heads.offers_) {
    auto loaded = spatial::load_hrtf(each.source, rate_hz);
    if (!loaded) return tl::unexpected(fmt::format("--hrtf: {}", loaded.error()));
    heads.held_[{each.source, rate_hz}] = std::move(*loaded);
  }
  return heads;
}

tl::expected<std::shared_ptr<const spatial::Hrtf>, wire::Error> Heads::head_for(const session::SessionOptions& options) {
  if (options.channels != session::ChannelLayout::kBinaural) return nullptr;
  const auto refused = [](std::string what, std::string remedy) {
    return tl::unexpected(wire::Error{
        wire::ErrorCode::kUnsupported, "attach.options.hrtf", std::move(what), std::move(remedy), 0, std::nullopt, {}});
  };
  const std::string& name = options.hrtf.empty() ? default_name() : options.hrtf;
  const auto wanted = std::ranges::find(offers_, name, &Offer::name);
  if (wanted == offers_.end()) {
    std::string names;
    for (const Offer& each : offers_) names += (names.empty() ? "" : ", ") + each.name;
    return refused(fmt::format("There is no HRTF \"{}\" here.", name),
                   fmt::format("Choose one of {}, or start rustled with --hrtf FILE.", names));
  }
  auto& held = held_[{wanted->source, options.rate_hz}];
  if (!held) {
    auto loaded = spatial::load_hrtf(wanted->source, options.rate_hz);
    if (!loaded) return refused(loaded.error(), "Choose another HRTF, or none.");
    held = std::move(*loaded);
  }
  return held;
}

}  // namespace rustle::apps
