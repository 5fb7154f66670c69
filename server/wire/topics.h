#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "server/synthesis/cue.h"

/// Topics of the out socket, as audio.proto lists them.
namespace rustle::wire {

enum class PcmContent : std::uint8_t { kMix, kStem, kEmitter };
enum class PcmFormat : std::uint8_t { kF32, kS16, kOpus };

/// SESSION/pcm/mix/FORMAT/BLOCKS, SESSION/pcm/stem/SHEET/KIND/FORMAT/BLOCKS or SESSION/pcm/emitter/FORMAT/BLOCKS.
struct PcmTopic {
  std::string session_id;
  PcmContent content = PcmContent::kMix;
  std::uint32_t sheet_id = 0;                                    ///< of a stem
  synthesis::SoundKind kind = synthesis::SoundKind::kCrumpling;  ///< of a stem
  PcmFormat format = PcmFormat::kF32;
  int blocks = 4;  ///< 1 to 4 in one message

  bool operator==(const PcmTopic&) const = default;
};

/// "crumpling", "friction" or "tearing".
std::string_view kind_name(synthesis::SoundKind kind);
std::optional<synthesis::SoundKind> kind_from_name(std::string_view name);

std::string to_string(const PcmTopic& topic);
/// Empty for everything else, prefixes of a PCM topic included: a listener names a whole topic.
std::optional<PcmTopic> parse_pcm_topic(std::string_view topic);

/// The part before the first slash; the whole when there is none.
std::string_view session_of_topic(std::string_view topic);

std::string observations_topic(std::string_view session_id);
std::string acknowledgements_topic(std::string_view session_id);
std::string notices_topic(std::string_view session_id);
std::string statistics_topic(std::string_view session_id);

/// A listener that subscribes to a topic of this prefix, ending in something of its own, gets one empty message on it once
/// everything it subscribed to before is in force; with keys, a serialized v1::Error where it was refused some of it.
/// `Sockets` answers; nobody else sees such topics.
inline constexpr std::string_view kSubscribedPrefix = "subscribed/";

/// 1 to 128 characters, none of them a slash, a space at an end, or a control character.
bool valid_session_id(std::string_view session_id);

}  // namespace rustle::wire
