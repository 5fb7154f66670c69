#include "server/apps/configuration.h"

#include "tests/fuzz/file_of_bytes.h"

/// Configuration files: rustled's settings are read, printed, and what was printed is read again to the same.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace rustle;
  static const fuzz::MemoryFolder folder;
  static const auto file = folder.path() / "rustled.toml";
  const auto read = [](apps::Settings& settings) {
    return settings.read(file, [](const char*) -> const char* { return nullptr; });
  };
  fuzz::write_file(file, fuzz::text_of(data, size));
  apps::Configuration configuration;
  auto settings = apps::settings_of(configuration);
  const auto errors = read(settings);
  for (const auto& error : errors) fuzz::require(!error.where.empty() && !error.what.empty());
  const std::string printed = settings.print();
  fuzz::write_file(file, printed);
  apps::Configuration again;
  auto settings_again = apps::settings_of(again);
  fuzz::require(read(settings_again).empty());
  fuzz::require(settings_again.print() == printed);
  static_cast<void>(apps::settings_of(configuration).changes_to(settings_again));
  return 0;
}
