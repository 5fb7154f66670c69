#include "client_sdk/c/status.h"

namespace rustle::capi {
namespace {

struct LastError {
  client::Error error{};
  rustle_error plain{RUSTLE_OK, 0, "", "", "", ""};
};

LastError& last_error() {
  thread_local LastError last;
  return last;
}

rustle_status status_of(client::ErrorKind kind) {
  switch (kind) {
    case client::ErrorKind::kInvalidArgument:
      return RUSTLE_INVALID_ARGUMENT;
    case client::ErrorKind::kUnreachable:
      return RUSTLE_UNREACHABLE;
    case client::ErrorKind::kTimedOut:
      return RUSTLE_TIMED_OUT;
    case client::ErrorKind::kRefused:
      return RUSTLE_REFUSED;
    case client::ErrorKind::kSessionLost:
      return RUSTLE_SESSION_LOST;
    case client::ErrorKind::kClosed:
      return RUSTLE_CLOSED;
    case client::ErrorKind::kOther:
      return RUSTLE_OTHER;
  }
  return RUSTLE_OTHER;
}

}  // namespace

rustle_status fail(client::Error error) noexcept {
  LastError& last = last_error();
  last.error = std::move(error);
  last.plain = {status_of(client::kind_of(last.error)),
                last.error.code,
                last.error.code_name.c_str(),
                last.error.field.c_str(),
                last.error.message.c_str(),
                last.error.remedy.c_str()};
  return last.plain.status;
}

client::Error invalid(std::string field, std::string message, std::string remedy) {
  return {.code_name = "invalid", .field = std::move(field), .message = std::move(message), .remedy = std::move(remedy)};
}

rustle_status missing(const char* argument) noexcept {
  return guarded([&] { return fail(invalid(argument, "It is NULL.", "Give a pointer to something.")); });
}

}  // namespace rustle::capi

const rustle_error* rustle_last_error(void) {
  return &rustle::capi::last_error().plain;
}
