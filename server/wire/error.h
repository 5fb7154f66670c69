#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

namespace rustle::wire {

/// Why something was refused; the values are those of v1::ErrorCode.
enum class ErrorCode : std::uint8_t {
  kUnspecified = 0,
  kProtocolVersion = 1,
  kMalformed = 2,   ///< not a message of this protocol, or a field of the wrong size
  kOutOfRange = 3,  ///< an index, a count or a value beyond its limits
  kNotFinite = 4,
  kUnknownSession = 5,
  kUnknownSheet = 6,
  kUnknownTopology = 7,
  kUnknownObstacle = 8,
  kUnknownMaterial = 9,
  kSessionExists = 10,
  kTimeOrder = 11,  ///< earlier than what was already taken
  kTooLarge = 12,
  kQuotaExceeded = 13,
  kPermissionDenied = 14,
  kOverloaded = 15,
  kUnsupported = 16,
  kStorage = 17,
  kIdle = 18,          ///< nothing came for so long that the daemon ended the session
  kUnidentified = 19,  ///< a mesh made anew at every frame, without material coordinates
};

/// The code as notices and logs spell it, such as "unknown_topology".
constexpr std::string_view code_name(ErrorCode code) {
  switch (code) {
    case ErrorCode::kUnspecified:
      return "unspecified";
    case ErrorCode::kProtocolVersion:
      return "protocol_version";
    case ErrorCode::kMalformed:
      return "malformed";
    case ErrorCode::kOutOfRange:
      return "out_of_range";
    case ErrorCode::kNotFinite:
      return "not_finite";
    case ErrorCode::kUnknownSession:
      return "unknown_session";
    case ErrorCode::kUnknownSheet:
      return "unknown_sheet";
    case ErrorCode::kUnknownTopology:
      return "unknown_topology";
    case ErrorCode::kUnknownObstacle:
      return "unknown_obstacle";
    case ErrorCode::kUnknownMaterial:
      return "unknown_material";
    case ErrorCode::kSessionExists:
      return "session_exists";
    case ErrorCode::kTimeOrder:
      return "time_order";
    case ErrorCode::kTooLarge:
      return "too_large";
    case ErrorCode::kQuotaExceeded:
      return "quota_exceeded";
    case ErrorCode::kPermissionDenied:
      return "permission_denied";
    case ErrorCode::kOverloaded:
      return "overloaded";
    case ErrorCode::kUnsupported:
      return "unsupported";
    case ErrorCode::kStorage:
      return "storage";
    case ErrorCode::kIdle:
      return "idle";
    case ErrorCode::kUnidentified:
      return "unidentified";
  }
  return "unspecified";
}

struct Quota {
  std::string name;  ///< "sessions", "triangles", "bytes_per_s", "frames_per_s", "voices"
  double limit = 0;
  double asked = 0;
};

/// What is wrong with something a client sent, and what to do about it.
struct Error {
  ErrorCode code = ErrorCode::kUnspecified;
  std::string field;           ///< such as "frame.positions"
  std::string message;         ///< a sentence
  std::string remedy;          ///< a sentence
  std::uint64_t sequence = 0;  ///< of the stream message at fault; 0: none
  std::optional<Quota> quota;  ///< for kQuotaExceeded
  std::string permission;      ///< for kPermissionDenied
};

/// One line for logs: "unknown_topology in frame.topology_id: ... (remedy)".
inline std::string to_string(const Error& error) {
  std::string text{code_name(error.code)};
  if (!error.field.empty()) text += " in " + error.field;
  text += ": " + error.message;
  if (!error.remedy.empty()) text += " " + error.remedy;
  return text;
}

}  // namespace rustle::wire
