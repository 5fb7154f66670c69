#pragma once

#include "client_sdk/cpp/types.h"
#include "rustle/v1/sheet.pb.h"

namespace rustle::client::internal {

inline Vector3 from_wire(const v1::Vector3& v) {
  return {v.x(), v.y(), v.z()};
}

}  // namespace rustle::client::internal
