#include "server/wire/gains.h"

#include <fmt/format.h>

#include <limits>
#include <utility>

#include "server/wire/fields.h"

namespace rustle::wire {

using synthesis::Gain;
using synthesis::SoundKind;

tl::expected<std::vector<Gain>, Error> gains_from_wire(const google::protobuf::RepeatedPtrField<v1::Gain>& sent,
                                                       const std::string& field, const Limits& limits) {
  if (static_cast<std::size_t>(sent.size()) > limits.gains)
    return refuse(ErrorCode::kTooLarge, field,
                  fmt::format("{} gains are sent; at most {} are taken.", sent.size(), limits.gains),
                  "Send one gain for each sheet, kind and material.");
  std::vector<Gain> out;
  for (const v1::Gain& sent_gain : sent) {
    const std::string one = fmt::format("{}[{}]", field, out.size());
    const bool silence = sent_gain.gain_db() == -std::numeric_limits<double>::infinity();
    if (const auto good =
            check_range(silence ? 0 : sent_gain.gain_db(), -200, synthesis::kMostGain_db, one + ".gain_db", "dB");
        !good)
      return tl::unexpected(good.error());
    if (const auto good = check_text(sent_gain.material(), one + ".material", limits); !good)
      return tl::unexpected(good.error());
    Gain gain{.gain_db = sent_gain.gain_db(), .sheet_id = {}, .kind = {}, .material = sent_gain.material()};
    if (sent_gain.has_sheet_id()) gain.sheet_id = sent_gain.sheet_id();
    switch (sent_gain.kind()) {
      case v1::SOUND_KIND_UNSPECIFIED:
        break;
      case v1::SOUND_KIND_CRUMPLING:
        gain.kind = SoundKind::kCrumpling;
        break;
      case v1::SOUND_KIND_FRICTION:
        gain.kind = SoundKind::kFriction;
        break;
      case v1::SOUND_KIND_TEARING:
        gain.kind = SoundKind::kTearing;
        break;
      default:
        return refuse(ErrorCode::kUnsupported, one + ".kind", fmt::format("The kind is {}.", int{sent_gain.kind()}),
                      "Choose crumpling, friction or tearing, or leave it out for all.");
    }
    out.push_back(std::move(gain));
  }
  return out;
}

void to_wire(const Gain& gain, v1::Gain* out) {
  out->set_gain_db(gain.gain_db);
  if (gain.sheet_id) out->set_sheet_id(*gain.sheet_id);
  if (gain.kind) switch (*gain.kind) {
      case SoundKind::kCrumpling:
        out->set_kind(v1::SOUND_KIND_CRUMPLING);
        break;
      case SoundKind::kFriction:
        out->set_kind(v1::SOUND_KIND_FRICTION);
        break;
      case SoundKind::kTearing:
        out->set_kind(v1::SOUND_KIND_TEARING);
        break;
    }
  out->set_material(gain.material);
}

}  // namespace rustle::wire
