#pragma once

#include <string_view>

#include <tl/expected.hpp>

#include "rustle/v1/session.pb.h"
#include "server/session/session_options.h"
#include "server/wire/error.h"
#include "server/wire/limits.h"

namespace rustle::wire {

/// Unspecified values get their defaults; the rest is checked against the ranges SessionOptions states.
/// Error: field is `prefix` and the option's name, such as "attach.options.metres_per_unit".
[[nodiscard]] tl::expected<session::SessionOptions, Error> from_wire(const v1::SessionOptions& options,
                                                                     std::string_view prefix, const Limits& limits = {});

void to_wire(const session::SessionOptions& options, v1::SessionOptions* out);

}  // namespace rustle::wire
