#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <string_view>

#include <tl/expected.hpp>

#include "server/engine/stream_item.h"
#include "server/session/decision.h"
#include "server/session/session_options.h"
#include "server/wire/error.h"

/// What a recording holds beside the stream messages that arrived. Pure; any thread.
namespace rustle::wire {

/// A serialized v1::Decision. `sequence`: its own, from 1.
[[nodiscard]] std::string encode_decision(std::string_view session_id, std::uint64_t sequence,
                                          const session::Decision& decision);

/// What encode_decision() was given. Errors: MALFORMED, UNSUPPORTED (a kind that this version does not know),
/// NOT_FINITE and OUT_OF_RANGE (a time mapping).
[[nodiscard]] tl::expected<session::Decision, Error> decode_decision(std::span<const std::byte> bytes);

/// A v1::StreamMessage with the announcement of a session that was attached by control, unnumbered.
[[nodiscard]] std::string encode_announcement(std::string_view session_id, const std::string& name,
                                              const session::SessionOptions& options);

/// A v1::StreamMessage with a sheet that came with Attach, unnumbered.
[[nodiscard]] std::string encode_sheet(std::string_view session_id, const engine::SheetDescription& sheet);

}  // namespace rustle::wire
