#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "server/monitor/http_address.h"

/// Whom a browser believes it talks to: what keeps a stranger's page from using this daemon through its visitor. Pure.
namespace rustle::monitor {

/// Whether a request's Host is the address served, or one of these names. A stranger's name that was made to lead here (DNS
/// rebinding) is none of them; an address cannot be made to. On loopback every way to say so counts, on all addresses of the
/// machine ("0.0.0.0", "::") every address; ports do not, as tunnels change them.
[[nodiscard]] bool is_served(std::string_view host, const HttpAddress& served, const std::vector<std::string>& names);

/// Whether an Origin is a page that came from this Host, plainly or through a TLS proxy.
[[nodiscard]] bool is_same_origin(std::string_view origin, std::string_view host);

/// A name as --http-name takes it: letters, digits, dots and dashes.
[[nodiscard]] bool is_host_name(std::string_view name);

}  // namespace rustle::monitor
