#pragma once

#include <string>
#include <string_view>

#include <tl/expected.hpp>

namespace rustle::wire {

/// An endpoint that can be bound: "tcp://" with an address of this machine or the name of one of its devices ("*" for all
/// addresses) and a port ("*" lets the system choose one), or "ipc://" with a path that fits a socket address. Returns it as
/// ZeroMQ wants it. `flag` such as "--control" is named in the error. Pure.
[[nodiscard]] tl::expected<std::string, std::string> check_bind_endpoint(std::string_view endpoint, std::string_view flag);

/// Whether only this machine reaches what is bound there: ipc, or tcp with a loopback address (127.0.0.0/8, [::1] or
/// localhost). Pure.
[[nodiscard]] bool is_local(std::string_view endpoint);

/// An endpoint that may be connected to: "tcp://HOST:PORT" or "ipc://PATH". Pure.
[[nodiscard]] tl::expected<std::string, std::string> check_connect_endpoint(std::string_view endpoint,
                                                                            std::string_view flag);

/// True where somebody answers on this ipc endpoint: ZeroMQ would take the path away from them without a word.
bool ipc_in_use(std::string_view endpoint);

/// What follows the last colon of a tcp endpoint.
std::string_view port_of(std::string_view endpoint);

}  // namespace rustle::wire
