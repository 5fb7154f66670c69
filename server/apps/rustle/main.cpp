#include <CLI/CLI.hpp>
#include <cstdio>
#include <exception>

#include "server/apps/command.h"

namespace {

using namespace rustle::apps;

int run(int argc, char** argv) {
  CLI::App app{"Rustle gives deforming sheets their sound.", "rustle"};
  app.set_version_flag("--version", "rustle " RUSTLE_VERSION);
  app.require_subcommand(1);
  app.footer(
      "Example: rustle import crumple.npz -o crumple.mcap && rustle render crumple.mcap -o crumple.wav\n"
      "Exit status: 0 done, 1 failed, 2 wrong usage. `rustle COMMAND --help` tells more.");
  Action action;
  add_demo(app, action);
  add_render(app, action);
  add_import(app, action);
  add_inspect(app, action);
  add_replay(app, action);
  add_listen(app, action);
  add_gain(app, action);
  add_load(app, action);
  add_record(app, action);
  add_pack(app, action);
  add_validate(app, action);
  add_doctor(app, action);
  add_top(app, action);
  add_trace(app, action);
  add_compare(app, action);
  add_keys(app, action);
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? kDone : kWrongUsage;
  }
  try {
    return action();
  } catch (const std::exception& error) {
    return complain(error.what(), kFailed);
  }
}

}  // namespace

int main(int argc, char** argv) {
  const int status = run(argc, argv);
  // A figure that did not arrive must not look like one that did.
  if (std::fflush(stdout) == 0 && std::ferror(stdout) == 0) return status;
  return complain("what was printed could not be written; is the disk full?", kFailed);
}
