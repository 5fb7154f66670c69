#include "server/apps/settings.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#define TOML_ASSERT(expr) static_assert(true)  // "[.a]" trips one in a debug build, and is an error with its line without
#include <toml++/toml.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdlib>
#include <fstream>
#include <numeric>
#include <sstream>

#include "server/apps/toml_text.h"

namespace rustle::apps {
namespace {

std::string in_quotes(const std::string& text) {
  std::ostringstream out;
  out << toml::value<std::string>(text);
  return out.str();
}

/// The shortest digits that read back as the same number.
std::string plain(double value) {
  return fmt::format("{}", value);
}

/// How many letters must be added, left out or changed to make the one of the other.
std::size_t edits_between(std::string_view a, std::string_view b) {
  std::vector<std::size_t> row(b.size() + 1);
  std::iota(row.begin(), row.end(), std::size_t{0});
  for (std::size_t i = 0; i < a.size(); ++i) {
    std::size_t diagonal = std::exchange(row[0], i + 1);
    for (std::size_t j = 0; j < b.size(); ++j) {
      const std::size_t changed = diagonal + (a[i] == b[j] ? 0 : 1);
      diagonal = row[j + 1];
      row[j + 1] = std::min({changed, row[j] + 1, row[j + 1] + 1});
    }
  }
  return row.back();
}

std::string shown(const toml::node& node) {
  std::ostringstream out;
  node.visit([&](const auto& value) { out << value; });
  return out.str();
}

}  // namespace

Settings::Settings(std::string prefix) : prefix_(std::move(prefix)) {}

const char* Settings::default_environment(const char* name) {
  return std::getenv(name);
}

// ------------------------------------------------------------------------------------------------------- declarations

void Settings::section(const std::string& name, std::string meaning) {
  sections_.push_back({name, std::move(meaning)});
}

void Settings::number(const std::string& key, const std::string& flag, Limits limits, bool whole, std::string meaning,
                      std::function<void(double)> set, std::function<double()> get) {
  Setting setting{key, flag, std::move(meaning), Kind::kNumber, {}, {}, {}, {}, false};
  setting.wanted = fmt::format("a {}number from {} to {}", whole ? "whole " : "", plain(limits.least), plain(limits.most));
  setting.take = [limits, whole, set = std::move(set)](const Value& value) -> Refusal {
    const double number = std::get<double>(value);
    // A number that is not one compares false with everything.
    if (!(number >= limits.least && number <= limits.most) || (whole && number != std::floor(number))) return "";
    set(number);
    return std::nullopt;
  };
  setting.toml = [get = std::move(get)] { return plain(get()); };
  settings_.push_back(std::move(setting));
}

void Settings::choose(const std::string& key, const std::string& flag, std::vector<int> choices, std::string meaning,
                      std::function<void(int)> set, std::function<double()> get) {
  Setting setting{key, flag, std::move(meaning), Kind::kNumber, fmt::format("one of {}", fmt::join(choices, ", ")), {}, {},
                  {},  false};
  for (const int choice : choices) setting.choices.push_back(std::to_string(choice));
  setting.take = [choices = std::move(choices), set = std::move(set)](const Value& value) -> Refusal {
    for (const int choice : choices) {
      if (std::get<double>(value) != choice) continue;
      set(choice);
      return std::nullopt;
    }
    return "";
  };
  setting.toml = [get = std::move(get)] { return plain(get()); };
  settings_.push_back(std::move(setting));
}

void Settings::real(const std::string& key, const std::string& flag, double& field, Limits limits, std::string meaning) {
  number(
      key, flag, limits, false, std::move(meaning), [&field](double value) { field = value; }, [&field] { return field; });
}

void Settings::truth(const std::string& key, const std::string& flag, bool& field, std::string meaning) {
  Setting setting{key, flag, std::move(meaning), Kind::kTruth, "true or false", {}, {}, {}, false};
  setting.take = [&field](const Value& value) -> Refusal {
    field = std::get<bool>(value);
    return std::nullopt;
  };
  setting.toml = [&field] { return std::string(field ? "true" : "false"); };
  settings_.push_back(std::move(setting));
}

void Settings::text(const std::string& key, const std::string& flag, std::string& field, std::string meaning, Check check) {
  Setting setting{key, flag, std::move(meaning), Kind::kText, "a text", {}, {}, {}, false};
  setting.take = [&field, check = std::move(check)](const Value& value) -> Refusal {
    const auto& text = std::get<std::string>(value);
    if (auto refusal = check ? check(text) : std::string(); !refusal.empty()) return refusal;
    field = text;
    return std::nullopt;
  };
  setting.toml = [&field] { return in_quotes(field); };
  settings_.push_back(std::move(setting));
}

void Settings::texts(const std::string& key, const std::string& flag, std::vector<std::string>& field, std::string meaning,
                     Check check) {
  Setting setting{key, flag, std::move(meaning), Kind::kTexts, "a list of texts", {}, {}, {}, false};
  setting.take = [&field, check = std::move(check)](const Value& value) -> Refusal {
    const auto& list = std::get<std::vector<std::string>>(value);
    for (const auto& text : list) {
      if (auto refusal = check ? check(text) : std::string(); !refusal.empty()) return refusal;
    }
    field = list;
    return std::nullopt;
  };
  setting.toml = [&field] {
    std::vector<std::string> each;
    for (const auto& text : field) each.push_back(in_quotes(text));
    return fmt::format("[{}]", fmt::join(each, ", "));
  };
  settings_.push_back(std::move(setting));
}

void Settings::choice(const std::string& key, const std::string& flag, std::string& field, std::vector<std::string> choices,
                      std::string meaning) {
  Setting setting{
      key, flag, std::move(meaning), Kind::kText, fmt::format("one of {}", fmt::join(choices, ", ")), choices, {},
      {},  false};
  setting.take = [&field, choices = std::move(choices)](const Value& value) -> Refusal {
    const auto& text = std::get<std::string>(value);
    if (std::find(choices.begin(), choices.end(), text) == choices.end()) return "";
    field = text;
    return std::nullopt;
  };
  setting.toml = [&field] { return in_quotes(field); };
  settings_.push_back(std::move(setting));
}

void Settings::reloadable() {
  settings_.back().reloadable = true;
}

// ------------------------------------------------------------------------------------------------------ what was said

void Settings::add_flags(CLI::App& app) {
  for (const auto& setting : settings_) {
    if (setting.kind == Kind::kTruth) {
      app.add_flag_callback(
          setting.flag, [this, flag = setting.flag] { given_[flag] = {"true"}; }, setting.meaning);
      continue;
    }
    auto* option = app.add_option_function<std::vector<std::string>>(
        setting.flag, [this, flag = setting.flag](const std::vector<std::string>& texts) { given_[flag] = texts; },
        fmt::format("{} [{}]", setting.meaning, setting.toml()));
    const std::string type = setting.kind == Kind::kText || setting.kind == Kind::kTexts ? "TEXT" : "NUMBER";
    option->type_name(setting.choices.empty() ? type : fmt::format("{}:{{{}}}", type, fmt::join(setting.choices, ",")));
    option->expected(1);
    option->multi_option_policy(setting.kind == Kind::kTexts ? CLI::MultiOptionPolicy::TakeAll
                                                             : CLI::MultiOptionPolicy::TakeLast);
  }
}

Settings::Setting* Settings::find(const std::string& key) {
  const auto found = std::find_if(settings_.begin(), settings_.end(), [&](const Setting& s) { return s.key == key; });
  return found == settings_.end() ? nullptr : &*found;
}

std::string Settings::nearest_key(const std::string& key) const {
  const auto nearest = std::min_element(settings_.begin(), settings_.end(), [&](const Setting& a, const Setting& b) {
    return edits_between(a.key, key) < edits_between(b.key, key);
  });
  return nearest == settings_.end() ? "" : nearest->key;
}

std::string Settings::variable_of(const Setting& setting) const {
  std::string name = prefix_ + "_" + setting.key;
  for (char& c : name) c = c == '.' || c == '-' ? '_' : static_cast<char>(std::toupper(static_cast<unsigned char>(c)));
  return name;
}

std::optional<Settings::Value> Settings::value_of(const Setting& setting, const std::vector<std::string>& texts) {
  switch (setting.kind) {
    case Kind::kTexts:
      return texts;
    case Kind::kText:
      return texts.back();
    case Kind::kTruth:
      if (texts.back() == "true") return true;
      if (texts.back() == "false") return false;
      return std::nullopt;
    case Kind::kNumber:
      break;
  }
  const std::string& text = texts.back();
  double number = 0;
  const auto [end, failed] = std::from_chars(text.data(), text.data() + text.size(), number);
  if (failed != std::errc() || end != text.data() + text.size()) return std::nullopt;
  return number;
}

void Settings::take(Setting& setting, const std::optional<Value>& value, const std::string& where, const std::string& said,
                    std::vector<SettingError>& errors) {
  const Refusal refusal = value ? setting.take(*value) : Refusal("");
  if (!refusal) return;
  errors.push_back(
      {where, refusal->empty() ? fmt::format("{}: {} is not {}", setting.key, said, setting.wanted) : *refusal});
}

void Settings::read_file(const std::filesystem::path& file, std::vector<SettingError>& errors) {
  const std::string name = file.string();
  std::ifstream in(file, std::ios::binary);
  std::ostringstream read;
  if (in.peek() != std::ifstream::traits_type::eof()) read << in.rdbuf();
  if (in.bad() || !in.is_open()) {
    errors.push_back({name, "cannot be read; name a file that can, or \"none\""});
    return;
  }
  const auto ascii = ascii_toml(read.str());
  if (!ascii) {
    errors.push_back({fmt::format("{}:{}", name, ascii.error().line), ascii.error().what});
    return;
  }
  toml::table table;
  try {
    table = toml::parse(*ascii, name);
  } catch (const toml::parse_error& error) {
    errors.push_back(
        {fmt::format("{}:{}", name, error.source().begin.line), fmt::format("{}; correct the line", error.description())});
    return;
  }
  const auto at = [&](const toml::key& key) { return fmt::format("{}:{}", name, key.source().begin.line); };
  for (const auto& [section, node] : table) {
    const std::string heading(section.str());
    const bool known = std::any_of(sections_.begin(), sections_.end(), [&](const Section& s) { return s.name == heading; });
    const toml::table* entries = node.as_table();
    if (!known || entries == nullptr) {
      std::vector<std::string> names;
      for (const auto& each : sections_) names.push_back("[" + each.name + "]");
      errors.push_back({at(section), fmt::format("there is no section [{}]; there are {}, which --print-config explains",
                                                 heading, fmt::join(names, ", "))});
      continue;
    }
    for (const auto& [entry, value] : *entries) {
      const std::string key = heading + "." + std::string(entry.str());
      Setting* setting = find(key);
      if (setting == nullptr) {
        errors.push_back(
            {at(entry), fmt::format("{} is not known; did you mean {}? --print-config lists all", key, nearest_key(key))});
        continue;
      }
      std::optional<Value> said;
      if (setting->kind == Kind::kTruth) said = value.value_exact<bool>();
      if (setting->kind == Kind::kNumber) said = value.value<double>();
      if (setting->kind == Kind::kNumber && value.is_boolean()) said.reset();
      if (setting->kind == Kind::kText) said = value.value_exact<std::string>();
      if (setting->kind == Kind::kTexts && value.is_array()) {
        std::vector<std::string> list;
        for (const auto& each : *value.as_array()) {
          if (const auto text = each.value_exact<std::string>()) list.push_back(*text);
        }
        if (list.size() == value.as_array()->size()) said = std::move(list);
      }
      take(*setting, said, at(entry), shown(value), errors);
    }
  }
}

std::vector<SettingError> Settings::read(const std::optional<std::filesystem::path>& file,
                                         const std::function<const char*(const char* name)>& environment) {
  std::vector<SettingError> errors;
  if (file) read_file(*file, errors);
  for (auto& setting : settings_) {
    const std::string name = variable_of(setting);
    const char* said = environment(name.c_str());
    if (said == nullptr) continue;
    std::vector<std::string> texts{said};
    if (setting.kind == Kind::kTexts) texts = *said == '\0' ? std::vector<std::string>() : CLI::detail::split(said, ',');
    take(setting, value_of(setting, texts), name, in_quotes(said), errors);
  }
  for (auto& setting : settings_) {
    const auto given = given_.find(setting.flag);
    if (given != given_.end())
      take(setting, value_of(setting, given->second), setting.flag, fmt::format("{}", fmt::join(given->second, ", ")),
           errors);
  }
  return errors;
}

std::vector<Settings::Description> Settings::descriptions() const {
  std::vector<Description> all;
  for (const auto& [name, meaning] : sections_) {
    for (const auto& setting : settings_) {
      if (!setting.key.starts_with(name + ".")) continue;
      all.push_back({name, meaning, setting.key.substr(name.size() + 1), setting.meaning, setting.wanted, setting.toml(),
                     setting.flag, variable_of(setting), setting.reloadable});
    }
  }
  return all;
}

std::string Settings::print() const {
  return print_where([](const Description&) { return true; });
}

std::string Settings::print_to_edit(const Settings& defaults) const {
  return print_where([before = defaults.descriptions()](const Description& setting) {
    return std::none_of(before.begin(), before.end(), [&](const Description& other) {
      return other.flag == setting.flag && other.value == setting.value;
    });
  });
}

std::string Settings::print_where(const std::function<bool(const Description& setting)>& said) const {
  std::string out, section;
  for (const auto& each : descriptions()) {
    if (each.section != section)
      out += fmt::format("{}# {}\n[{}]\n", out.empty() ? "" : "\n", each.section_meaning, each.section);
    section = each.section;
    out += fmt::format("# {}: {}. {}, {}{}\n{}{} = {}\n", each.meaning, each.wanted, each.flag, each.variable,
                       each.reloadable ? "; read again on SIGHUP" : "", said(each) ? "" : "#", each.name, each.value);
  }
  return out;
}

Settings::Changes Settings::changes_to(const Settings& now) const {
  Changes changes;
  for (std::size_t k = 0; k < settings_.size(); ++k) {
    if (settings_[k].toml() == now.settings_[k].toml()) continue;
    (settings_[k].reloadable ? changes.reloadable : changes.restart).push_back(settings_[k].key);
  }
  return changes;
}

}  // namespace rustle::apps
