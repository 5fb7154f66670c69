#include "client_sdk/cpp/certificate.h"
#include "server/access/allowed_key.h"
#include "tests/fuzz/target.h"

/// Files of keys, and what an allowed one says that its holder may.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace rustle;
  const auto certificate = client::parse_certificate(fuzz::text_of(data, size), "fuzzed.key");
  if (!certificate) {
    fuzz::require(!certificate.error().message.empty() && certificate.error().field.starts_with("fuzzed.key"));
    return 0;
  }
  const auto key = access::allowed_key(*certificate, "fuzzed.key");
  if (!key) {
    fuzz::require(!key.error().empty());
    return 0;
  }
  fuzz::require(key->permissions != access::Permissions{});
  const auto written = client::certificate_text(access::certificate_of(*key), false);
  const auto again = client::parse_certificate(written, "fuzzed.key");
  fuzz::require(again.has_value());
  fuzz::require(access::allowed_key(*again, "fuzzed.key") == *key);
  return 0;
}
