#pragma once

#include <string>
#include <vector>

#include <tl/expected.hpp>

#include "rustle/v1/session.pb.h"
#include "server/synthesis/gain.h"
#include "server/wire/error.h"
#include "server/wire/limits.h"

namespace rustle::wire {

/// Errors name `field`[k]: OUT_OF_RANGE, NOT_FINITE (a level), TOO_LARGE (too many, a long name), UNSUPPORTED (a kind that
/// is not known).
[[nodiscard]] tl::expected<std::vector<synthesis::Gain>, Error> gains_from_wire(
    const google::protobuf::RepeatedPtrField<v1::Gain>& sent, const std::string& field, const Limits& limits);
void to_wire(const synthesis::Gain& gain, v1::Gain* out);

}  // namespace rustle::wire
