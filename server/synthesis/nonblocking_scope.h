#pragma once

/// The way in and out of what must not block, as LLVM's RealtimeSanitizer runtime names it. Absent unless a program is
/// linked with that runtime, or with the guard that stands in its place (tests/realtime).
extern "C" {
[[gnu::weak]] void __rtsan_realtime_enter() noexcept;
[[gnu::weak]] void __rtsan_realtime_exit() noexcept;
}

namespace rustle::synthesis {

/// As long as it lives its thread neither allocates, locks nor calls the system; where something watches that, it stops the
/// program otherwise. Costs two comparisons where nothing does. Scopes may lie in one another.
class NonblockingScope {
 public:
  NonblockingScope() noexcept {
    if (&__rtsan_realtime_enter != nullptr) __rtsan_realtime_enter();
  }
  ~NonblockingScope() {
    if (&__rtsan_realtime_exit != nullptr) __rtsan_realtime_exit();
  }
  NonblockingScope(const NonblockingScope&) = delete;
  NonblockingScope& operator=(const NonblockingScope&) = delete;
};

}  // namespace rustle::synthesis
