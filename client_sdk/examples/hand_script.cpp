#include "client_sdk/examples/hand_script.h"

#include <poll.h>
#include <termios.h>
#include <unistd.h>

#include <cmath>
#include <iostream>
#include <sstream>

namespace rustle::examples {
namespace {

using sheets::kLeft;
using sheets::kRight;

constexpr double kKeyTurn_rad = 0.05, kKeyPull_m = 0.01, kKey_s = 0.1, kGrip_s = 0.3;

bool takes_time(const HandAction& action) {
  if (action.kind != HandAction::Kind::kMove && action.kind != HandAction::Kind::kGrip) return true;
  return std::isfinite(action.seconds) && action.seconds > 0 && action.seconds <= 60;
}

/// The hands move apart along the table's x: before the sheet is turned, along its edge.
void pull(HandAction& action, double apart_m) {
  action.whole[kLeft].translation_m = {apart_m / 2, 0};
  action.whole[kRight].translation_m = {-apart_m / 2, 0};
}

}  // namespace

const char* const kHelp =
    "Lines on standard input, angles in rad, lengths in m, times in s:\n"
    "  turn LEFT RIGHT SECONDS    both hands turn; above 0 opens the tear\n"
    "  pull APART SECONDS         the hands move apart\n"
    "  grip SECONDS               the hands turn back and grip farther on\n"
    "  wait SECONDS, new, quit\n"
    "Keys in a terminal: a left hand turns, l right hand turns, space both, p pull, g grip, n new sheet, q quit\n";

std::optional<HandAction> read_action(const std::string& line) {
  std::istringstream words(line);
  std::string verb, rest;
  words >> verb;
  HandAction action;
  action.text = line;
  double left = 0, right = 0, apart = 0;
  if (verb == "turn" && words >> left >> right >> action.seconds) {
    action.whole[kLeft].rotation_rad = left;
    action.whole[kRight].rotation_rad = right;
  } else if (verb == "pull" && words >> apart >> action.seconds) {
    pull(action, apart);
  } else if (verb == "grip" && words >> action.seconds) {
    action.kind = HandAction::Kind::kGrip;
  } else if (verb == "wait" && words >> action.seconds) {
  } else if (verb == "new") {
    action.kind = HandAction::Kind::kNewSheet;
  } else if (verb == "quit") {
    action.kind = HandAction::Kind::kQuit;
  } else {
    return std::nullopt;
  }
  const bool whole = !(words >> rest) && std::isfinite(left) && std::isfinite(right) && std::isfinite(apart);
  return whole && takes_time(action) ? std::optional(action) : std::nullopt;
}

std::optional<HandAction> action_of_key(char key) {
  HandAction action;
  action.seconds = kKey_s;
  action.text = std::string(1, key);
  if (key == 'a' || key == ' ') action.whole[kLeft].rotation_rad = kKeyTurn_rad;
  if (key == 'l' || key == ' ') action.whole[kRight].rotation_rad = kKeyTurn_rad;
  if (key == 'p') pull(action, kKeyPull_m);
  if (key == 'g') {
    action.kind = HandAction::Kind::kGrip;
    action.seconds = kGrip_s;
  }
  if (key == 'n') action.kind = HandAction::Kind::kNewSheet;
  if (key == 'q' || key == 4) action.kind = HandAction::Kind::kQuit;
  const bool known = key == 4 || std::string("al pgnq").find(key) != std::string::npos;
  return known ? std::optional(action) : std::nullopt;
}

struct HandInput::Terminal {
  termios settings;
};

HandInput::HandInput() : terminal_(isatty(STDIN_FILENO) != 0) {
  if (!terminal_) return;
  before_ = std::make_unique<Terminal>();
  tcgetattr(STDIN_FILENO, &before_->settings);
  termios keys = before_->settings;
  keys.c_lflag &= ~static_cast<tcflag_t>(ICANON | ECHO);
  tcsetattr(STDIN_FILENO, TCSANOW, &keys);
}

HandInput::~HandInput() {
  if (before_) tcsetattr(STDIN_FILENO, TCSANOW, &before_->settings);
}

std::optional<HandAction> HandInput::next() {
  if (terminal_) {
    pollfd ready{STDIN_FILENO, POLLIN, 0};
    char key = 0;
    if (poll(&ready, 1, 0) <= 0) return std::nullopt;
    if (read(STDIN_FILENO, &key, 1) != 1) key = 'q';
    return action_of_key(key);
  }
  for (std::string line; std::getline(std::cin, line);) {
    if (line.find_first_not_of(" \t\r") == std::string::npos) continue;
    if (auto action = read_action(line)) return action;
    std::cerr << "no action: \"" << line << "\"; say one of\n" << kHelp;
  }
  HandAction end;
  end.kind = HandAction::Kind::kQuit;
  return end;
}

}  // namespace rustle::examples
