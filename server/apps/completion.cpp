#include "server/apps/completion.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <functional>

namespace rustle::apps {
namespace {

void for_each(const CommandDescription& command, const std::function<void(const CommandDescription&)>& act) {
  act(command);
  for (const auto& each : command.commands) for_each(each, act);
}

/// In single quotes, for any of the shells' POSIX part.
std::string in_quotes(const std::string& text) {
  std::string out = "'";
  for (const char c : text) out += c == '\'' ? std::string("'\\''") : std::string(1, c);
  out += "'";
  return out;
}

std::vector<std::string> choices_of(const std::vector<ArgumentDescription>& arguments) {
  std::vector<std::string> all;
  for (const auto& each : arguments) all.insert(all.end(), each.choices.begin(), each.choices.end());
  return all;
}

// ---------------------------------------------------------------------------------------------------------------- bash

std::string bash_case(const CommandDescription& command) {
  std::vector<std::string> words;
  for (const auto& option : command.options) words.insert(words.end(), option.names.begin(), option.names.end());
  std::string out =
      fmt::format("    {})\n      flags={}\n", in_quotes(command.name), in_quotes(fmt::format("{}", fmt::join(words, " "))));
  words = choices_of(command.positionals);
  for (const auto& each : command.commands) words.push_back(each.own_name());
  if (!words.empty()) out += fmt::format("      words={}\n", in_quotes(fmt::format("{}", fmt::join(words, " "))));
  std::string cases, files;
  for (const auto& option : command.options) {
    if (option.value.empty()) continue;
    const std::string names = fmt::format("{}", fmt::join(option.names, "|"));
    if (option.choices.empty())
      files += fmt::format("{}{}", files.empty() ? "" : "|", names);
    else
      cases += fmt::format("        {}) flags= words={} ;;\n", names,
                           in_quotes(fmt::format("{}", fmt::join(option.choices, " "))));
  }
  if (!files.empty()) cases += fmt::format("        {}) flags= words= ;;\n", files);
  if (!cases.empty()) out += fmt::format("      case $before in\n{}      esac\n", cases);
  return out + "      ;;\n";
}

// ----------------------------------------------------------------------------------------------------------------- zsh

/// A description in the brackets of _arguments.
std::string zsh_text(const std::string& text) {
  std::string out;
  for (const char c : text) {
    if (c == '[' || c == ']' || c == ':' || c == '\\') out += '\\';
    out += c;
  }
  return out;
}

std::string zsh_values(const ArgumentDescription& argument) {
  return argument.choices.empty() ? "_files" : fmt::format("({})", fmt::join(argument.choices, " "));
}

std::string zsh_function(const CommandDescription& command) {
  std::string out = fmt::format("_{}() {{\n  local context state state_descr line\n  typeset -A opt_args\n  _arguments -C",
                                command.joined('_'));
  const std::string next = " \\\n    ";
  for (const auto& option : command.options) {
    const std::string others = option.repeated ? "*" : fmt::format("({})", fmt::join(option.names, " "));
    for (const auto& name : option.names) {
      std::string specification = fmt::format("{}{}[{}]", others, name, zsh_text(option.meaning));
      if (!option.value.empty()) specification += fmt::format(":{}:{}", option.value, zsh_values(option));
      out += next + in_quotes(specification);
    }
  }
  if (!command.commands.empty()) {
    out += next + "'1:command:->command'" + next +
           "'*::argument:->argument'\n  case $state in\n    command)\n      local -a commands=(";
    for (const auto& each : command.commands)
      out += fmt::format("\n        {}", in_quotes(fmt::format("{}:{}", each.own_name(), zsh_text(each.meaning))));
    out += fmt::format(
        "\n      )\n      _describe command commands ;;\n    argument) _call_function - _{}_$words[1] ;;\n  esac\n",
        command.joined('_'));
    return out + "}\n\n";
  }
  for (const auto& positional : command.positionals)
    out += next + in_quotes(fmt::format("{}:{}:{}", positional.repeated ? "*" : "", positional.names.front(),
                                        zsh_values(positional)));
  return out + "\n}\n\n";
}

// ---------------------------------------------------------------------------------------------------------------- fish

std::string fish_text(const std::string& text) {
  std::string out = "'";
  for (const char c : text) {
    if (c == '\'' || c == '\\') out += '\\';
    out += c;
  }
  out += "'";
  return out;
}

/// When the command line has come to this command and to none below it.
std::string fish_condition(const CommandDescription& command, const std::string& program) {
  std::string condition = fmt::format("__{}_command_is {}", program, fish_text(command.name));
  return fmt::format("-n {}", fish_text(condition));
}

std::string fish_lines(const CommandDescription& command, const std::string& program) {
  const std::string begin = fmt::format("complete -c {} {}", program, fish_condition(command, program));
  std::string out;
  for (const auto& each : command.commands)
    out += fmt::format("{} -f -a {} -d {}\n", begin, fish_text(each.own_name()), fish_text(each.meaning));
  for (const auto& option : command.options) {
    out += begin;
    for (const auto& name : option.names)
      out += name.starts_with("--") ? fmt::format(" -l {}", name.substr(2)) : fmt::format(" -s {}", name.substr(1));
    if (!option.value.empty())
      out += option.choices.empty() ? " -r -F"
                                    : fmt::format(" -x -a {}", fish_text(fmt::format("{}", fmt::join(option.choices, " "))));
    out += fmt::format(" -d {}\n", fish_text(option.meaning));
  }
  if (const auto choices = choices_of(command.positionals); !choices.empty())
    out += fmt::format("{} -f -a {}\n", begin, fish_text(fmt::format("{}", fmt::join(choices, " "))));
  return out;
}

}  // namespace

std::string bash_completion(const CommandDescription& program) {
  std::string commands, cases;
  for_each(program, [&](const CommandDescription& command) {
    if (command.name != program.name) commands += fmt::format("{}{}", commands.empty() ? "" : "|", in_quotes(command.name));
    cases += bash_case(command);
  });
  const std::string walk = commands.empty() ? ""
                                            : fmt::format(R"(  for word in "${{COMP_WORDS[@]:1:COMP_CWORD-1}}"; do
    case "$command $word" in {}) command+=" $word" ;; esac
  done
)",
                                                          commands);
  return fmt::format(R"(# Completion of {0} for bash, written of its command line.
_{0}() {{
  local command={0} word before=${{COMP_WORDS[COMP_CWORD-1]}} flags= words=
{1}  word=${{COMP_WORDS[COMP_CWORD]}}
  # --flag=value comes as three words.
  if [ "$word" = = ]; then
    word=
  elif [ "$before" = = ]; then
    before=${{COMP_WORDS[COMP_CWORD-2]}}
  fi
  case $command in
{2}  esac
  if [ -n "$flags" ] && [[ $word == -* ]]; then
    mapfile -t COMPREPLY < <(compgen -W "$flags" -- "$word")
  elif [ -n "$words" ]; then
    mapfile -t COMPREPLY < <(compgen -W "$words" -- "$word")
  else
    compopt -o filenames 2>/dev/null
    mapfile -t COMPREPLY < <(compgen -f -- "$word")
  fi
}}
complete -F _{0} {0}
)",
                     program.name, walk, cases);
}

std::string zsh_completion(const CommandDescription& program) {
  std::string out = fmt::format("#compdef {0}\n# Completion of {0} for zsh, written of its command line.\n\n", program.name);
  for_each(program, [&](const CommandDescription& command) { out += zsh_function(command); });
  return out + fmt::format("_{} \"$@\"\n", program.name);
}

std::string fish_completion(const CommandDescription& program) {
  std::string commands, lines;
  for_each(program, [&](const CommandDescription& command) {
    if (command.name != program.name) commands += fmt::format(" {}", fish_text(command.name));
    lines += fish_lines(command, program.name);
  });
  return fmt::format(R"(# Completion of {0} for fish, written of its command line.
function __{0}_command_is
    set -l command {0}
    for word in (commandline -opc)[2..-1]
        contains -- "$command $word"{1}; and set command "$command $word"
    end
    test $command = $argv[1]
end
{2})",
                     program.name, commands, lines);
}

}  // namespace rustle::apps
