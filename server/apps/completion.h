#pragma once

#include <string>

#include "server/apps/command_description.h"

/// Completion of a program's commands, flags and values, as each shell loads it by the program's name.
namespace rustle::apps {

std::string bash_completion(const CommandDescription& program);
std::string zsh_completion(const CommandDescription& program);
std::string fish_completion(const CommandDescription& program);

}  // namespace rustle::apps
