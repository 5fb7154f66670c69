#pragma once

#include <cstdint>
#include <vector>

#include "rustle/v1/session.pb.h"

namespace rustle::capture {

struct TimedMessage {
  double time_s;
  v1::StreamMessage message;
};

/// A session "small": a sheet of 10 x 10 cm and 60 triangles over a reflecting plane, 46 frames at 30 Hz. It is held bent
/// upward (10 % compression), flips to the other side between 0.3 and 0.4 s, flattens, comes down to 2 mm above
/// the plane and slides over it at up to 0.2 m/s until 1.5 s. One edge is held. z is up, the listener stands 1 m away.
std::vector<TimedMessage> small_session();

}  // namespace rustle::capture
