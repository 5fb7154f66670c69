#pragma once

#include <functional>
#include <string>
#include <string_view>
#include <vector>

namespace CLI {
class App;
}

/// The commands of `rustle`. Each adds its subcommand and, when that is chosen, sets the action that runs it.
namespace rustle::apps {

enum ExitStatus : int { kDone = 0, kFailed = 1, kWrongUsage = 2 };

using Action = std::function<int()>;

void add_compare(CLI::App& app, Action& action);
void add_demo(CLI::App& app, Action& action);
void add_doctor(CLI::App& app, Action& action);
void add_gain(CLI::App& app, Action& action);
void add_import(CLI::App& app, Action& action);
void add_inspect(CLI::App& app, Action& action);
void add_keys(CLI::App& app, Action& action);
void add_listen(CLI::App& app, Action& action);
void add_load(CLI::App& app, Action& action);
void add_pack(CLI::App& app, Action& action);
void add_record(CLI::App& app, Action& action);
void add_render(CLI::App& app, Action& action);
void add_replay(CLI::App& app, Action& action);
void add_top(CLI::App& app, Action& action);
void add_trace(CLI::App& app, Action& action);
void add_validate(CLI::App& app, Action& action);

/// Prints "rustle: MESSAGE" on standard error and returns `status`.
int complain(std::string_view message, ExitStatus status);
void warn(std::string_view message);
/// Warns of what was left out or went wrong on the way: kFailed when there was anything.
int done_with(const std::vector<std::string>& notices);

/// Why these files cannot all be written: one is an input, or two are the same. Empty: they can.
std::string output_conflict(const std::vector<std::string>& inputs, const std::vector<std::string>& outputs);

/// "-12.3 dBFS", or "silence" for 0.
std::string level_text(double amplitude);

/// From now on SIGINT and SIGTERM only set what interrupted() tells.
void catch_interrupts();
bool interrupted();

/// A line that overwrites itself on a terminal; nothing when standard error is none.
class Progress {
 public:
  explicit Progress(std::string what);
  ~Progress();
  /// Shows a share from 0 to 1, at most ten times a second.
  void show(double share);
  /// The same of work whose end is not known: how far it is, in words.
  void show(const std::string& so_far);

 private:
  std::string what_;
  bool on_terminal_;
  bool shown_ = false;
  double last_shown_s_ = -1;
};

}  // namespace rustle::apps
