#include "server/apps/manual_page.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <sstream>

namespace rustle::apps {
namespace {

/// Text as it is: nothing of it is a request, and its dashes and quotes can be copied from the page.
std::string plain(const std::string& text) {
  std::string out;
  for (std::size_t k = 0; k < text.size(); ++k) {
    const bool begins_line = k == 0 || text[k - 1] == '\n';
    switch (text[k]) {
      case '\\':
        out += "\\e";
        break;
      case '-':
        out += "\\-";
        break;
      case '^':
        out += "\\(ha";
        break;
      case '~':
        out += "\\(ti";
        break;
      case '`':
        out += "\\(ga";
        break;
      case '\'':
        out += "\\(aq";
        break;
      case '.':
        out += begins_line ? "\\&." : ".";
        break;
      default:
        out += text[k];
    }
  }
  return out;
}

std::string bold(const std::string& text) {
  return fmt::format("\\fB{}\\fR", plain(text));
}

std::string italic(const std::string& text) {
  return fmt::format("\\fI{}\\fR", plain(text));
}

std::string heading(const std::string& title, int section, const std::string& version) {
  std::string capitals = title;
  std::transform(capitals.begin(), capitals.end(), capitals.begin(),
                 [](unsigned char c) { return static_cast<char>(std::toupper(c)); });
  return fmt::format(".TH {} {} \"\" \"{}\" Rustle\n", plain(capitals), section, plain(version));
}

std::string synopsis_of(const ArgumentDescription& argument, bool positional) {
  std::string out = positional ? italic(argument.names.front()) : bold(argument.names.back());
  if (!positional && !argument.value.empty()) out += fmt::format(" {}", italic(argument.value));
  if (argument.repeated) out += " ...";
  return argument.required ? out : fmt::format("[{}]", out);
}

std::string item_of(const ArgumentDescription& argument, bool positional) {
  std::string out = ".TP\n";
  if (positional) {
    out += italic(argument.names.front());
  } else {
    for (std::size_t k = 0; k < argument.names.size(); ++k)
      out += fmt::format("{}{}", k > 0 ? ", " : "", bold(argument.names[k]));
    if (!argument.value.empty()) out += fmt::format(" {}", italic(argument.value));
  }
  out += fmt::format("\n{}.\n", plain(argument.meaning));
  if (!argument.choices.empty()) out += plain(fmt::format("One of {}.", fmt::join(argument.choices, ", "))) + "\n";
  if (!argument.limits.empty()) out += plain(argument.limits) + ".\n";
  if (!argument.otherwise.empty()) out += plain(fmt::format("Default: {}", argument.otherwise)) + "\n";
  if (!argument.variable.empty()) out += plain("Variable of the environment: ") + bold(argument.variable) + "\n";
  if (argument.required) out += "Required.\n";
  return out;
}

std::string reference(const std::string& page, int section) {
  return fmt::format("{}({})", bold(page), section);
}

}  // namespace

std::string manual_page(const CommandDescription& command, const std::string& version) {
  std::string out = heading(command.joined(), 1, version);
  out += fmt::format(".SH NAME\n{} \\- {}\n", plain(command.joined()), plain(command.meaning));
  out += fmt::format(".SH SYNOPSIS\n{}", bold(command.name));
  if (!command.options.empty()) out += fmt::format(" [{}]", italic("OPTIONS"));
  for (const auto& option : command.options) {
    if (option.required) out += fmt::format(" {}", synopsis_of(option, false));
  }
  for (const auto& positional : command.positionals) out += fmt::format(" {}", synopsis_of(positional, true));
  if (!command.commands.empty()) out += fmt::format(" {}", italic("COMMAND"));
  out += fmt::format("\n.SH DESCRIPTION\n{}{}\n", plain(command.meaning), command.meaning.ends_with('.') ? "" : ".");
  if (!command.notes.empty()) out += fmt::format(".PP\n{}", plain(command.notes));
  if (!command.positionals.empty()) out += ".SH ARGUMENTS\n";
  for (const auto& positional : command.positionals) out += item_of(positional, true);
  if (!command.commands.empty()) out += ".SH COMMANDS\n";
  for (const auto& each : command.commands)
    out += fmt::format(".TP\n{}\n{}.\n", reference(each.joined(), 1), plain(each.meaning));
  if (!command.options.empty()) out += ".SH OPTIONS\n";
  for (const auto& option : command.options) out += item_of(option, false);
  if (!command.examples.empty()) out += fmt::format(".SH EXAMPLES\n.nf\n{}.fi\n", plain(command.examples));
  std::string other = command.name == "rustled" ? "rustle" : "rustled";
  if (const auto last = command.name.rfind(' '); last != std::string::npos) {
    other = command.name.substr(0, last);
    std::replace(other.begin(), other.end(), ' ', '-');
  }
  out += fmt::format(".SH SEE ALSO\n{}, {}\n", reference(other, 1), reference("rustled.toml", 5));
  return out;
}

std::string manual_page_of_file(const std::string& file, const std::string& program, const Settings& settings,
                                const std::string& version) {
  std::string out = heading(file, 5, version);
  out += fmt::format(".SH NAME\n{} \\- configuration of {}\n", plain(file), plain(program));
  out += fmt::format(
      ".SH DESCRIPTION\nA TOML file of sections and keys. Each setting can also be said by a variable of the environment, "
      "which goes before the file, and by a flag of {}, which goes before both.\n",
      reference(program, 1));
  std::string section;
  for (const auto& each : settings.descriptions()) {
    if (each.section != section) {
      section = each.section;
      out += fmt::format(".SH {}\n{}.\n", plain(fmt::format("[{}]", section)), plain(each.section_meaning));
    }
    out += fmt::format(".TP\n{}\n{}: {}.\n", bold(fmt::format("{} = {}", each.name, each.value)), plain(each.meaning),
                       plain(each.wanted));
    out += fmt::format("Flag {}, variable {}.\n", bold(each.flag), bold(each.variable));
    if (each.reloadable) out += "Read again on SIGHUP.\n";
  }
  return out + ".SH SEE ALSO\n" + reference(program, 1) + "\n";
}

}  // namespace rustle::apps
