#include <cstdio>
#include <exception>

#include "server/apps/command_lines.h"

namespace {

using namespace rustle::apps;

int run(int argc, char** argv) {
  Action action;
  const auto app = rustle_command_line(action);
  try {
    app->parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app->exit(error) == 0 ? kDone : kWrongUsage;
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
