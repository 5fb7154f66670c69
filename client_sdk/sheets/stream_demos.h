#pragma once

#include <memory>
#include <string_view>
#include <vector>

#include "client_sdk/sheets/sheet_stream.h"

namespace rustle::sheets {

/// Names of demonstrations as streams: those of demo_names(), and an A4 sheet that two hands tear across on a table:
///   tear                slow at first, then faster, then in one pull
///   tear_slow, ...      as tear_script_names() has them
///   cloth               cloth that is rubbed over a table, crumpled and pulled away: make_cloth_demo()
[[nodiscard]] std::vector<std::string_view> stream_demo_names();

/// The material that a demonstration is of where nobody says otherwise.
[[nodiscard]] std::string_view usual_material(std::string_view demo_name);

/// Null: no such name. The same arguments give the same bits. \pre 50 ≤ triangle_count ≤ 100,000
[[nodiscard]] std::unique_ptr<SheetStream> make_stream_demo(std::string_view name, std::size_t triangle_count = 1333,
                                                            std::uint64_t seed = 1,
                                                            std::string_view material = "printer-paper");

}  // namespace rustle::sheets
