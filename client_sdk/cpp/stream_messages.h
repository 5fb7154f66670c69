#pragma once

#include <span>

#include "client_sdk/cpp/types.h"
#include "rustle/v1/session.pb.h"

/// Plain data into stream messages. Not for applications. Pure.
namespace rustle::client::internal {

void write(const SheetOptions& sheet, v1::Sheet* out);
void write(const SessionOptions& options, v1::SessionOptions* out);
/// Name and sheets are not in the message: they are kept.
void read(const v1::SessionOptions& sent, SessionOptions& options);
void write(const Topology& topology, v1::Topology* out);
void write(const FrameExtras& extras, v1::MeshFrame* out);
void write(const SceneUpdate& update, v1::SceneUpdate* out);
void write(const Listener& listener, v1::Listener* out);
void write(const TearTip& tip, v1::TearTip* out);
Notice read(const v1::Notice& notice);

template <class T>
void set_bytes(std::span<const T> values, std::string* out) {
  out->assign(static_cast<const char*>(static_cast<const void*>(values.data())), values.size_bytes());
}

}  // namespace rustle::client::internal
