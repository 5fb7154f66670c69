#include "server/page/request.h"

#include <fmt/format.h>

#include <array>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>
#include <utility>

#include "server/session/watch.h"
#include "server/wire/limits.h"

namespace rustle::page {
namespace {

using Object = nlohmann::json;
template <class What>
using Read = tl::expected<What, std::string>;

constexpr double kLeastGain_db = -200;
constexpr std::size_t kSecretLetters = 40;

tl::unexpected<std::string> wrong(std::string sentence) {
  return tl::unexpected(std::move(sentence));
}

Read<std::string> text_at(const Object& object, const char* name) {
  const auto found = object.find(name);
  if (found == object.end() || !found->is_string()) return wrong(fmt::format("\"{}\" must be a text.", name));
  return found->get<std::string>();
}

Read<std::optional<std::string>> session_or_none(const Object& object) {
  const auto found = object.find("session");
  if (found == object.end() || found->is_null()) return std::nullopt;
  if (!found->is_string()) return wrong("\"session\" must be a session's id, or null.");
  return found->get<std::string>();
}

Read<Request> watch(const Object& object) {
  auto session = session_or_none(object);
  if (!session) return tl::unexpected(session.error());
  WatchRequest out{std::move(*session)};
  if (const auto rate = object.find("frames_per_second"); rate != object.end()) {
    const bool whole =
        rate->is_number() && rate->get<double>() >= 1 && rate->get<double>() <= session::Watch::kFramesPerSecond;
    if (!whole) return wrong(fmt::format("\"frames_per_second\" must be 1 to {}.", session::Watch::kFramesPerSecond));
    out.frames_per_second = static_cast<int>(rate->get<double>());
  }
  return out;
}

Read<Request> listen(const Object& object) {
  auto session = session_or_none(object);
  if (!session) return tl::unexpected(session.error());
  return ListenRequest{std::move(*session)};
}

Read<Request> gain(const Object& object) {
  auto session = text_at(object, "session");
  auto kind = text_at(object, "kind");
  if (!session) return tl::unexpected(session.error());
  if (!kind) return tl::unexpected(kind.error());
  GainRequest out{std::move(*session), {}};
  if (*kind == "crumpling") {
    out.gain.kind = synthesis::SoundKind::kCrumpling;
  } else if (*kind == "friction") {
    out.gain.kind = synthesis::SoundKind::kFriction;
  } else if (*kind == "tearing") {
    out.gain.kind = synthesis::SoundKind::kTearing;
  } else if (*kind != "master") {
    return wrong("\"kind\" must be master, crumpling, friction or tearing.");
  }
  const auto db = object.find("db");
  const bool silence = db != object.end() && db->is_null();
  const double value = db != object.end() && db->is_number() ? db->get<double>() : std::nan("");
  // A number that is not one compares false with everything.
  if (!silence && !(value >= kLeastGain_db && value <= synthesis::kMostGain_db))
    return wrong(
        fmt::format("\"db\" must be {:.0f} to {:.0f}, or null for silence.", kLeastGain_db, synthesis::kMostGain_db));
  out.gain.gain_db = silence ? -std::numeric_limits<double>::infinity() : value;
  return out;
}

Read<Request> listener(const Object& object) {
  auto session = text_at(object, "session");
  if (!session) return tl::unexpected(session.error());
  const double most_m = wire::Limits{}.position_m;
  const auto position = object.find("position");
  const bool three = position != object.end() && position->is_array() && position->size() == 3;
  ListenerRequest out{std::move(*session), sheet::Vec3d::Zero()};
  for (std::size_t k = 0; k < 3; ++k) {
    const bool number = three && (*position)[k].is_number();
    out.position_m[static_cast<Eigen::Index>(k)] = number ? (*position)[k].get<double>() : std::nan("");
  }
  if (!(out.position_m.array().abs() <= most_m).all())
    return wrong(fmt::format("\"position\" must be three numbers within ±{:.0f} m.", most_m));
  return out;
}

Read<Request> key(const Object& object) {
  auto secret = text_at(object, "secret");
  if (!secret || secret->size() != kSecretLetters)
    return wrong(fmt::format("\"secret\" must be the {} characters after secret-key in NAME.key_secret.", kSecretLetters));
  return KeyRequest{std::move(*secret)};
}

}  // namespace

tl::expected<Request, std::string> parse_request(std::string_view text) {
  const Object object = Object::parse(text, nullptr, false);
  if (!object.is_object()) return wrong("A message must be a JSON object with a \"type\".");
  const auto type = text_at(object, "type");
  if (!type) return tl::unexpected(type.error());
  using Reader = Read<Request> (*)(const Object&);
  constexpr std::array<std::pair<const char*, Reader>, 5> kReaders = {
      {{"watch", watch}, {"listen", listen}, {"gain", gain}, {"listener", listener}, {"key", key}}};
  for (const auto& [name, read] : kReaders)
    if (*type == name) return read(object);
  return wrong("\"type\" must be watch, listen, gain, listener or key.");
}

}  // namespace rustle::page
