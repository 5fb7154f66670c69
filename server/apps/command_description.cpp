#include "server/apps/command_description.h"

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <sstream>

namespace rustle::apps {
namespace {

/// A footer's examples are the lines from "Example: " on that are indented like it; the rest are notes.
void split_footer(const std::string& footer, CommandDescription& command) {
  constexpr std::string_view kExample = "Example: ", kExampleIndent = "         ";
  bool example = false;
  std::istringstream lines(footer);
  for (std::string line; std::getline(lines, line);) {
    example = line.starts_with(kExample) || (example && line.starts_with(kExampleIndent));
    if (example)
      command.examples += line.substr(kExample.size()) + "\n";
    else
      command.notes += line + "\n";
  }
}

/// Type names are "TEXT", "TEXT:{a,b}" or "INT:INT in [1 - 64]".
void split_type(const std::string& type, ArgumentDescription& argument) {
  const auto colon = type.find(':');
  argument.value = type.substr(0, colon);
  if (colon == std::string::npos) return;
  const std::string rest = type.substr(colon + 1);
  if (rest.starts_with('{') && rest.ends_with('}'))
    argument.choices = CLI::detail::split(rest.substr(1, rest.size() - 2), ',');
  else
    argument.limits = rest;
}

ArgumentDescription description_of(const CLI::Option& option) {
  ArgumentDescription argument;
  for (const auto& name : option.get_snames()) argument.names.push_back(fmt::format("-{}", name));
  for (const auto& name : option.get_lnames()) argument.names.push_back(fmt::format("--{}", name));
  if (argument.names.empty()) argument.names.push_back(option.get_name(true));
  if (option.get_type_size() != 0) {
    split_type(option.get_type_name(), argument);
    argument.otherwise = option.get_default_str();
  }
  argument.variable = option.get_envname();
  argument.meaning = option.get_description();
  argument.required = option.get_required();
  argument.repeated = option.get_expected_max() > 1 || option.get_multi_option_policy() == CLI::MultiOptionPolicy::TakeAll;
  return argument;
}

CommandDescription description_of(const CLI::App& app, const std::string& name) {
  CommandDescription command;
  command.name = name;
  command.meaning = app.get_description();
  split_footer(app.get_footer(), command);
  for (const CLI::Option* option : app.get_options())
    (option->get_positional() ? command.positionals : command.options).push_back(description_of(*option));
  for (const CLI::App* each : app.get_subcommands({}))
    command.commands.push_back(description_of(*each, name + " " + each->get_name()));
  return command;
}

}  // namespace

std::string CommandDescription::joined(char between) const {
  std::string out = name;
  std::replace(out.begin(), out.end(), ' ', between);
  return out;
}

std::string CommandDescription::own_name() const {
  return name.substr(name.rfind(' ') + 1);
}

CommandDescription description_of(const CLI::App& app) {
  return description_of(app, app.get_name());
}

}  // namespace rustle::apps
