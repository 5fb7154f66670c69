#pragma once

#include <string>
#include <string_view>

namespace rustle::capture {

/// A serialized rustle.v1.StreamMessage moved in time by `by_s`: everything in it that has a time. With `reset_history` a
/// mesh frame says that the sheet jumped, so that a loop's seam makes no event. What cannot be parsed comes back as it was.
std::string retimed(std::string_view stream_message, double by_s, bool reset_history);

}  // namespace rustle::capture
