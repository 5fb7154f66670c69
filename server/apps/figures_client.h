#pragma once

#include <string>

#include <nlohmann/json.hpp>
#include <tl/expected.hpp>

namespace rustle::apps {

inline constexpr const char* kDefaultHttp = "127.0.0.1:7393";

/// What a daemon's HTTP address tells under `target`, such as "/figures". Error: a sentence with what to do.
[[nodiscard]] tl::expected<nlohmann::ordered_json, std::string> ask_daemon(const std::string& http,
                                                                           const std::string& target);

}  // namespace rustle::apps
