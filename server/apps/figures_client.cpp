#include "server/apps/figures_client.h"

#include <fmt/format.h>

#include <chrono>

#include "server/monitor/http_address.h"
#include "server/monitor/http_client.h"

namespace rustle::apps {

tl::expected<nlohmann::ordered_json, std::string> ask_daemon(const std::string& http, const std::string& target) {
  const auto address = monitor::parse_http_address(http, "--http");
  if (!address) return tl::unexpected(address.error());
  const auto reply = monitor::http_get(*address, target, std::chrono::seconds(3));
  if (!reply) return tl::unexpected(reply.error());
  if (reply->status != 200) {
    std::string why = reply->body;
    while (!why.empty() && why.back() == '\n') why.pop_back();
    return tl::unexpected(why.empty() ? fmt::format("{} answers with status {}", address->text(), reply->status) : why);
  }
  auto told = nlohmann::ordered_json::parse(reply->body, nullptr, false);
  if (told.is_discarded())
    return tl::unexpected(fmt::format("what answers at {} is no rustled; name its --http address", address->text()));
  return told;
}

}  // namespace rustle::apps
