#include "server/monitor/served_host.h"

#include <algorithm>
#include <boost/asio/ip/address.hpp>
#include <cctype>

namespace rustle::monitor {
namespace {

std::string lower(std::string_view text) {
  std::string out(text);
  std::transform(out.begin(), out.end(), out.begin(), [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return out;
}

/// Without port and brackets.
std::string_view name_of(std::string_view host) {
  if (host.starts_with('[')) {
    const std::size_t end = host.find(']');
    return end == std::string_view::npos ? std::string_view() : host.substr(1, end - 1);
  }
  return host.substr(0, host.rfind(':'));
}

}  // namespace

bool is_served(std::string_view host, const HttpAddress& served, const std::vector<std::string>& names) {
  const std::string name = lower(name_of(host));
  if (std::any_of(names.begin(), names.end(), [&](const std::string& known) { return lower(known) == name; })) return true;
  boost::system::error_code none;
  const auto bound = boost::asio::ip::make_address(served.host, none);
  const bool everywhere = bound.is_unspecified(), here = bound.is_loopback();
  if (name == "localhost") return everywhere || here;
  const auto asked = boost::asio::ip::make_address(name, none);
  if (none) return false;
  return everywhere || (here && asked.is_loopback()) || asked == bound;
}

bool is_same_origin(std::string_view origin, std::string_view host) {
  const std::string from = lower(origin), asked = lower(host);
  return !asked.empty() && (from == "http://" + asked || from == "https://" + asked);
}

bool is_host_name(std::string_view name) {
  return !name.empty() && name.size() <= 253 &&
         std::all_of(name.begin(), name.end(), [](unsigned char c) { return std::isalnum(c) != 0 || c == '.' || c == '-'; });
}

}  // namespace rustle::monitor
