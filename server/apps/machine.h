#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace rustle::apps {

/// What this machine grants a daemon, and what to do where it does not.
enum class Grade : std::uint8_t {
  kGranted,
  kLimited,  ///< rustled runs, but something will be missing or late
  kMissing,  ///< rustled will not start, or nothing will sound
};

struct MachineCheck {
  std::string name;
  Grade grade = Grade::kGranted;
  std::string found;
  std::string remedy;  ///< empty where all is granted
};

/// "granted", "limited", "missing".
std::string to_string(Grade grade);

// Each asks the system now; none changes it. Those that try something undo it.

MachineCheck check_configuration();
MachineCheck check_packs();
/// Whether the default endpoints, or those the configuration names, can be bound.
MachineCheck check_ports();
/// Talks to sound servers: may take a second.
MachineCheck check_audio();
MachineCheck check_heads();
MachineCheck check_processor();
/// How late a thread wakes that asked for a millisecond, 200 times: a fifth of a second or more.
MachineCheck check_scheduling();
MachineCheck check_realtime_priority();
MachineCheck check_memory_lock();
/// Enough for `sessions` at a time.
MachineCheck check_descriptors(std::size_t sessions);

/// Whether the sidecar of a fleet answers, within a second; absent: there is none.
std::optional<MachineCheck> check_fleet();

/// All of them, in the order in which they are told.
std::vector<MachineCheck> check_machine();

}  // namespace rustle::apps
