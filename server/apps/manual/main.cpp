/// What is written of the programs' command lines and settings, when they are built: manual pages, completions and the
/// service's configuration file.
#include <fmt/format.h>

#include <cstdio>
#include <exception>
#include <filesystem>
#include <fstream>
#include <stdexcept>

#include "server/apps/command_lines.h"
#include "server/apps/completion.h"
#include "server/apps/configuration.h"
#include "server/apps/manual_page.h"

namespace {

using namespace rustle::apps;
namespace fs = std::filesystem;

void write(const fs::path& file, const std::string& text) {
  fs::create_directories(file.parent_path());
  std::ofstream out(file, std::ios::trunc);
  if (!(out << text).flush()) throw std::runtime_error(file.string() + ": could not be written; is there space?");
}

void write_pages(const fs::path& folder, const CommandDescription& command, const std::string& version) {
  write(folder / (command.joined() + ".1"), manual_page(command, version));
  for (const auto& each : command.commands) write_pages(folder, each, version);
}

void write_program(const fs::path& folder, const CLI::App& app) {
  const auto program = description_of(app);
  write_pages(folder / "man" / program.name, program, app.version());
  write(folder / "bash" / program.name, bash_completion(program));
  write(folder / "zsh" / ("_" + program.name), zsh_completion(program));
  write(folder / "fish" / (program.name + ".fish"), fish_completion(program));
}

void write_all(const fs::path& folder) {
  Action action;
  write_program(folder, *rustle_command_line(action));

  Configuration defaults;
  Settings settings = settings_of(defaults);
  DaemonRequest request;
  const auto daemon = rustled_command_line(request, settings);
  write_program(folder, *daemon);
  write(folder / "man/rustled/rustled.toml.5", manual_page_of_file("rustled.toml", "rustled", settings, daemon->version()));

  // A service plays on no device and keeps recordings where its unit lets it write.
  Configuration service;
  service.device = "none";
  service.daemon.recordings = "/var/lib/rustle/recordings";
  write(folder / "rustled.toml",
        "# Configuration of the rustled that systemd starts. A line that begins with # and a key says the default.\n"
        "# `systemctl reload rustled` takes over what is read again on SIGHUP, `systemctl restart rustled` all of it.\n\n" +
            settings_of(service).print_to_edit(settings));
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 2 || std::string_view(argv[1]) == "--help") {
    fmt::print(argc == 2 ? stdout : stderr,
               "usage: rustle_manual FOLDER    writes manual pages, completions and rustled.toml\n");
    return argc == 2 ? kDone : kWrongUsage;
  }
  try {
    write_all(argv[1]);
    return kDone;
  } catch (const std::exception& error) {
    fmt::print(stderr, "rustle_manual: {}\n", error.what());
    return kFailed;
  }
}
