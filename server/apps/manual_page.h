#pragma once

#include <string>

#include "server/apps/command_description.h"
#include "server/apps/settings.h"

/// Manual pages, in the language of man(7).
namespace rustle::apps {

/// The page of a command, such as rustle-pack-build(1). `version` is what --version says of the program.
std::string manual_page(const CommandDescription& command, const std::string& version);

/// The page of a program's configuration file, such as rustled.toml(5): every setting, its default, flag and variable.
std::string manual_page_of_file(const std::string& file, const std::string& program, const Settings& settings,
                                const std::string& version);

}  // namespace rustle::apps
