#include "server/access/certificate_file.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <string>

namespace rustle::access {
namespace {

tl::unexpected<client::Error> cannot_be_written(const std::filesystem::path& file, int reason) {
  return tl::unexpected(client::Error{.code_name = "invalid",
                                      .field = file.string(),
                                      .message = std::string("It cannot be written: ") + std::strerror(reason) + ".",
                                      .remedy = "Name a folder and files that you may use."});
}

}  // namespace

tl::expected<void, client::Error> write_certificate(const std::filesystem::path& file,
                                                    const client::Certificate& certificate, bool secret) {
  const std::string text = client::certificate_text(certificate, secret);
  std::string beside = file.string() + ".XXXXXX";
  const int descriptor = ::mkostemp(beside.data(), O_CLOEXEC);  // mode 0600
  if (descriptor < 0) return cannot_be_written(file, errno);
  const bool written = ::write(descriptor, text.data(), text.size()) == static_cast<ssize_t>(text.size()) &&
                       ::fchmod(descriptor, secret ? 0600 : 0644) == 0 && ::fsync(descriptor) == 0;
  if (::close(descriptor) == 0 && written && ::rename(beside.c_str(), file.c_str()) == 0) return {};
  const int reason = errno;
  ::unlink(beside.c_str());
  return cannot_be_written(file, reason);
}

}  // namespace rustle::access
