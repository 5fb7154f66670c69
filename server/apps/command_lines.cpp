#include "server/apps/command_lines.h"

namespace rustle::apps {

std::unique_ptr<CLI::App> rustle_command_line(Action& action) {
  auto app = std::make_unique<CLI::App>("Rustle gives deforming sheets their sound.", "rustle");
  app->set_version_flag("--version", "rustle " RUSTLE_VERSION);
  app->require_subcommand(1);
  app->footer(
      "Example: rustle import crumple.npz -o crumple.mcap && rustle render crumple.mcap -o crumple.wav\n"
      "Exit status: 0 done, 1 failed, 2 wrong usage. `rustle COMMAND --help` tells more.");
  add_demo(*app, action);
  add_render(*app, action);
  add_import(*app, action);
  add_inspect(*app, action);
  add_replay(*app, action);
  add_listen(*app, action);
  add_gain(*app, action);
  add_load(*app, action);
  add_record(*app, action);
  add_pack(*app, action);
  add_validate(*app, action);
  add_doctor(*app, action);
  add_top(*app, action);
  add_trace(*app, action);
  add_compare(*app, action);
  add_keys(*app, action);
  return app;
}

std::unique_ptr<CLI::App> rustled_command_line(DaemonRequest& request, Settings& settings) {
  auto app = std::make_unique<CLI::App>("rustled listens to simulators and gives their deforming sheets sound.", "rustled");
  app->set_version_flag("--version", "rustled " RUSTLE_VERSION);
  app->footer(
      "Every setting may also stand in the configuration file or in an environment variable; flags go before variables,\n"
      "variables before the file. SIGHUP reads the file and the keys again.\n"
      "Example: rustled --connect tcp://127.0.0.1:5555\n"
      "         rustled --print-config > rustled.toml && rustled --config rustled.toml\n"
      "Attach a simulator with an SDK or `rustle replay`, hear it with `rustle listen`. SIGTERM or Ctrl-C ends it: what\n"
      "was sent is rendered first, within 5 s.");
  app->add_option("--config", request.file,
                  "Configuration file; \"none\" reads none [RUSTLED_CONFIG, ~/.config/rustle/rustled.toml or "
                  "/etc/rustle/rustled.toml, the first that is there]");
  app->add_flag("--print-config", request.print_configuration,
                "Print the configuration in force, every setting explained, and end");
  app->add_flag("--list-devices", request.list_devices, "Print the devices that --device may name, and end");
  settings.add_flags(*app);
  return app;
}

}  // namespace rustle::apps
