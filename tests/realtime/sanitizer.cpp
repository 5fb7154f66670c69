// RealtimeSanitizer's runtime watches by itself: it replaces what allocates, locks or calls the system when it is linked.
#include "tests/realtime/watch.h"

namespace rustle::realtime {

Watch watch_this_thread() {
  return {"RealtimeSanitizer", true};
}

}  // namespace rustle::realtime
