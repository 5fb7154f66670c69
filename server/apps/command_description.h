#pragma once

#include <string>
#include <vector>

namespace CLI {
class App;
}

namespace rustle::apps {

/// A flag, an option with a value, or a positional, as --help tells it.
struct ArgumentDescription {
  std::vector<std::string> names;    ///< "-o", "--output"; of a positional its one name
  std::string value;                 ///< "TEXT"; empty: a flag, which takes none
  std::vector<std::string> choices;  ///< the values it may have; empty: no list of them
  std::string limits;                ///< "INT in [1 - 64]"; empty: none
  std::string otherwise;             ///< its value when absent; empty: not told
  std::string variable;              ///< of the environment, in its place; empty: none
  std::string meaning;
  bool required = false;
  bool repeated = false;
};

/// A command of a program, or the program itself.
struct CommandDescription {
  std::string name;     ///< "rustle pack build"
  std::string meaning;  ///< a sentence
  std::string notes;    ///< what --help ends with, without its examples
  std::string examples;
  std::vector<ArgumentDescription> options;
  std::vector<ArgumentDescription> positionals;
  std::vector<CommandDescription> commands;

  /// "rustle-pack-build", with '-' or another character between the words.
  std::string joined(char between = '-') const;
  /// The last word of the name.
  std::string own_name() const;
};

/// What a command line is told to be, with all that is below it.
CommandDescription description_of(const CLI::App& app);

}  // namespace rustle::apps
