#include "server/apps/gain_text.h"

#include <fmt/format.h>

#include <charconv>
#include <cmath>
#include <limits>
#include <optional>
#include <string_view>

#include "server/wire/topics.h"

namespace rustle::apps {
namespace {

constexpr double kLeast_db = -200;

template <typename Number>
std::optional<Number> number_of(std::string_view text) {
  Number number{};
  const auto [end, failed] = std::from_chars(text.data(), text.data() + text.size(), number);
  if (failed != std::errc() || end != text.data() + text.size() || text.empty()) return std::nullopt;
  return number;
}

/// One of the parts that commas separate. False: it is none, or says again what another part said.
bool add_part(std::string_view part, synthesis::Gain& gain) {
  constexpr std::string_view kSheet = "sheet:", kMaterial = "material:";
  if (part.starts_with(kSheet)) {
    if (gain.sheet_id) return false;
    gain.sheet_id = number_of<sheet::SheetId>(part.substr(kSheet.size()));
    return gain.sheet_id.has_value();
  }
  if (part.starts_with(kMaterial)) {
    if (!gain.material.empty()) return false;
    gain.material = part.substr(kMaterial.size());
    return !gain.material.empty();
  }
  if (gain.kind) return false;
  gain.kind = wire::kind_from_name(part);
  return gain.kind.has_value();
}

}  // namespace

tl::expected<synthesis::Gain, std::string> parse_gain(const std::string& text) {
  const auto refuse = [&] { return tl::unexpected(fmt::format("\"{}\" is no gain; write {}", text, kGainSyntax)); };
  const auto equals = text.rfind('=');
  if (equals == std::string::npos) return refuse();
  synthesis::Gain gain;
  std::string_view level = std::string_view(text).substr(equals + 1);
  if (level.starts_with('+')) level.remove_prefix(1);
  const auto gain_db = number_of<double>(level);
  if (!gain_db) return refuse();
  const bool silence = *gain_db == -std::numeric_limits<double>::infinity();
  if (!silence && !(*gain_db >= kLeast_db && *gain_db <= synthesis::kMostGain_db)) return refuse();
  gain.gain_db = *gain_db;
  std::string_view sounds = std::string_view(text).substr(0, equals);
  if (sounds == "all") return gain;
  for (bool last = false; !last;) {
    const auto comma = sounds.find(',');
    last = comma == std::string_view::npos;
    if (!add_part(sounds.substr(0, comma), gain)) return refuse();
    if (!last) sounds.remove_prefix(comma + 1);
  }
  return gain;
}

std::string to_text(const synthesis::Gain& gain) {
  std::string sounds;
  const auto add = [&](const std::string& part) { sounds += (sounds.empty() ? "" : ",") + part; };
  if (gain.sheet_id) add(fmt::format("sheet:{}", *gain.sheet_id));
  if (!gain.material.empty()) add("material:" + gain.material);
  if (gain.kind) add(std::string(wire::kind_name(*gain.kind)));
  return fmt::format("{}={:+g}", sounds.empty() ? "all" : sounds, gain.gain_db);
}

}  // namespace rustle::apps
