#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <variant>

#include "server/observation/observation.h"
#include "server/session/session_options.h"
#include "server/sheet/vector.h"
#include "server/synthesis/cue.h"
#include "server/wire/error.h"
#include "server/wire/topics.h"

/// What goes out on the XPUB socket, as serialized v1::OutMessage. Pure; any thread. Positions and directions leave in the
/// session's axes, in metres.
namespace rustle::wire {

/// Whose message it is.
struct OutHeader {
  std::string_view session_id;
  std::uint64_t sequence = 0;  ///< per topic, from 1
};

struct MixContent {};
struct StemContent {
  std::uint32_t sheet_id = 0;
  synthesis::SoundKind kind = synthesis::SoundKind::kCrumpling;
};
struct EmitterContent {
  std::uint64_t emitter_id = 0;
  std::uint32_t sheet_id = 0;
  synthesis::SoundKind kind = synthesis::SoundKind::kCrumpling;
  sheet::Vec3d position_m = sheet::Vec3d::Zero();
  sheet::Vec3d normal = sheet::Vec3d::UnitZ();
  bool last = false;  ///< nothing follows from it
};

struct PcmHeader {
  std::int64_t first_sample = 0;  ///< 0 is the session's time origin
  std::uint32_t rate_hz = 0;
  std::uint32_t channels = 0;
  PcmFormat format = PcmFormat::kF32;
  std::uint64_t missing_samples = 0;  ///< lost before this message
  double time_s = 0;                  ///< simulation time of the first sample
  std::variant<MixContent, StemContent, EmitterContent> content;
};

/// Interleaved samples. s16: x · 32767 rounded to nearest (ties to even), clamped to ±32767, NaN as 0; no dither.
/// \pre interleaved.size() is a multiple of channels; channels > 0; format is not Opus.
[[nodiscard]] std::string encode_pcm(const OutHeader& header, const PcmHeader& pcm, std::span<const float> interleaved,
                                     session::UpAxis up_axis = session::UpAxis::kZ);

/// An Opus packet, of which `skip_samples` decoded samples are dropped and then `samples` kept.
struct OpusPayload {
  std::span<const std::uint8_t> packet;
  std::uint32_t samples = 0;
  std::uint32_t skip_samples = 0;
};
/// \pre format is Opus
[[nodiscard]] std::string encode_opus(const OutHeader& header, const PcmHeader& pcm, const OpusPayload& payload,
                                      session::UpAxis up_axis = session::UpAxis::kZ);

/// One sample as s16 carries it.
[[nodiscard]] std::int16_t to_s16(float sample);

[[nodiscard]] std::string encode_observation(const OutHeader& header, const observation::Observation& observation,
                                             session::UpAxis up_axis);

/// Flow control: everything up to `acknowledged_sequence` was taken (or refused with a notice).
struct FlowCredit {
  std::uint64_t acknowledged_sequence = 0;
  std::uint32_t window_messages = 0;
  std::uint64_t window_bytes = 0;  ///< 0: not limited
};
[[nodiscard]] std::string encode_credit(const OutHeader& header, const FlowCredit& credit);

[[nodiscard]] std::string encode_stored(const OutHeader& header, std::uint64_t stored_sequence, std::string_view file_name);

/// The last message of a PCM topic. `samples` in the whole stream, from the time origin on.
[[nodiscard]] std::string encode_end(const OutHeader& header, std::int64_t samples);

enum class NoticeLevel : std::uint8_t { kInfo, kWarning, kError };
struct Notice {
  NoticeLevel level = NoticeLevel::kInfo;
  std::string code;  ///< such as "unknown_topology"
  std::string field, message, remedy;
  std::uint64_t sequence = 0;  ///< of the stream message it is about
  std::uint64_t count = 1;     ///< how often since the last notice of this code
};
/// A refused stream message as a notice.
[[nodiscard]] Notice notice_of(const Error& error, std::uint64_t count = 1);
[[nodiscard]] std::string encode_notice(const OutHeader& header, const Notice& notice);

}  // namespace rustle::wire
