#pragma once

#include <CLI/CLI.hpp>
#include <memory>
#include <string>

#include "server/apps/command.h"
#include "server/apps/settings.h"

/// The command lines of both programs: what they parse, and what manual pages and completions are written of.
namespace rustle::apps {

/// `rustle` with its commands; parsing sets the action that runs the one chosen.
std::unique_ptr<CLI::App> rustle_command_line(Action& action);

/// What rustled is told beside its settings.
struct DaemonRequest {
  std::string file;  ///< of configuration; empty: the default one, "none": none
  bool print_configuration = false;
  bool list_devices = false;
};

/// `rustled` with a flag for every setting. Both arguments must outlive the result.
std::unique_ptr<CLI::App> rustled_command_line(DaemonRequest& request, Settings& settings);

}  // namespace rustle::apps
