#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "client_sdk/capture/import.h"

namespace rustle::capture {

/// The frames that `input` means, in natural order (frame_2 before frame_10): a folder's `.obj` or `.ply` files, the files
/// that match a pattern with * and ? in its last part, or a single file. Error: nothing found, or OBJ and PLY mixed.
tl::expected<std::vector<std::filesystem::path>, ImportError> mesh_sequence_files(const std::string& input);

/// Puts names in natural order: runs of digits compare as numbers.
void sort_naturally(std::vector<std::filesystem::path>& files);

/// One OBJ or PLY file a frame, in the given order, into a capture; frame i is at i / frames_per_s. The topology is sent
/// again only when faces (or the count of vertices) change.
ImportResult import_mesh_sequence(const std::vector<std::filesystem::path>& files, const std::filesystem::path& output,
                                  const ImportOptions& options, const ImportProgress& progress = {});

}  // namespace rustle::capture
