#pragma once

#include <memory>
#include <optional>
#include <string>

#include "client_sdk/sheets/tearing_hands.h"

namespace rustle::examples {

/// Something that both hands do for a while.
struct HandAction {
  enum class Kind { kMove, kGrip, kNewSheet, kQuit };
  Kind kind = Kind::kMove;
  double seconds = 0;
  sheets::HandMotions whole{};  ///< of kMove: in all
  std::string text{};           ///< as it was given
};

/// A line such as "turn 0.3 0.3 0.5"; empty: it is none.
std::optional<HandAction> read_action(const std::string& line);

/// What a key does, for a tenth of a second.
std::optional<HandAction> action_of_key(char key);

/// Both, for people.
extern const char* const kHelp;

/// Lines or keys from standard input, in a terminal's case key by key; never waits for keys.
class HandInput {
 public:
  HandInput();
  ~HandInput();
  HandInput(const HandInput&) = delete;
  HandInput& operator=(const HandInput&) = delete;

  bool is_terminal() const { return terminal_; }
  /// The next action. Empty: no key was pressed. At the end of the input: kQuit. A line that is no action is told to
  /// standard error and left out.
  std::optional<HandAction> next();

 private:
  struct Terminal;
  bool terminal_;
  std::unique_ptr<Terminal> before_;  ///< its settings, to leave it as it was
};

}  // namespace rustle::examples
