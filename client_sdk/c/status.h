#pragma once

#include <exception>
#include <new>
#include <string>

#include "client_sdk/c/rustle.h"
#include "client_sdk/cpp/types.h"

/// The C SDK over the C++ SDK. Not for applications.
namespace rustle::capi {

/// Keeps the error for rustle_last_error() of this thread; returns its status.
rustle_status fail(client::Error error) noexcept;

client::Error invalid(std::string field, std::string message, std::string remedy);
/// A pointer that must be there is NULL.
rustle_status missing(const char* argument) noexcept;

/// No exception passes a function of C: what `call` throws is RUSTLE_OTHER.
template <typename Call>
rustle_status guarded(const Call& call) noexcept {
  try {
    return call();
  } catch (const std::bad_alloc&) {
    return fail({.code_name = "no_memory", .message = "No memory.", .remedy = "Free some."});  // so short that it needs none
  } catch (const std::exception& thrown) {
    return fail({.code_name = "internal", .message = thrown.what(), .remedy = "Report it, with the call."});
  }
}

}  // namespace rustle::capi
