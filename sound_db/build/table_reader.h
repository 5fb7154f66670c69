#pragma once

#include <cstdint>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include <fmt/format.h>
#include <toml++/toml.h>

#include "sound_db/pack/pack_error.h"

namespace rustle::build {

/// A TOML table and its place in the file. Each reading checks type and range, and notes what was asked for.
class TableReader {
 public:
  /// `table` and `findings` outlive this.
  TableReader(const toml::table& table, std::string place, std::string file, pack::Findings& findings)
      : table_(table), place_(std::move(place)), file_(std::move(file)), findings_(findings) {}

  void error(const std::string& key, std::string message, std::string remedy) {
    const toml::node* node = table_.get(key);
    const auto line = node ? node->source().begin.line : place_.empty() ? 0 : table_.source().begin.line;
    const std::string at = line > 0 ? fmt::format(" (line {})", line) : "";
    findings_.push_back({pack::Severity::kError, {file_, field(key) + at, std::move(message), std::move(remedy)}});
  }

  std::optional<double> number(const std::string& key, double low, double high) {
    const toml::node* node = find(key);
    if (!node) return std::nullopt;
    const auto value = node->value<double>();
    if (value && *value >= low && *value <= high) return value;
    error(key, fmt::format("is not a number from {} to {}", low, high), "correct it");
    return std::nullopt;
  }
  double number(const std::string& key, double fallback, double low, double high) {
    return number(key, low, high).value_or(fallback);
  }

  int integer(const std::string& key, int fallback, int low, int high) {
    const toml::node* node = find(key);
    if (!node) return fallback;
    const auto value = node->value_exact<std::int64_t>();
    if (value && *value >= low && *value <= high) return static_cast<int>(*value);
    error(key, fmt::format("is not a whole number from {} to {}", low, high), "correct it");
    return fallback;
  }

  /// A list of so many whole numbers.
  std::optional<std::vector<int>> integers(const std::string& key, std::size_t count, int low, int high) {
    const toml::node* node = find(key);
    if (!node) return std::nullopt;
    std::vector<int> result;
    if (const toml::array* array = node->as_array(); array && array->size() == count) {
      for (const toml::node& item : *array) {
        const auto value = item.value_exact<std::int64_t>();
        if (value && *value >= low && *value <= high) result.push_back(static_cast<int>(*value));
      }
    }
    if (result.size() == count) return result;
    error(key, fmt::format("is not a list of {} whole numbers from {} to {}", count, low, high), "correct it");
    return std::nullopt;
  }

  std::string text(const std::string& key, bool required, std::string fallback = {}) {
    const toml::node* node = find(key);
    if (!node) {
      if (required) error(key, "is missing", "add it: a text in quotes");
      return fallback;
    }
    const auto value = node->value_exact<std::string>();
    if (value && !value->empty()) return *value;
    error(key, "is not a text", "put it in quotes");
    return fallback;
  }

  bool flag(const std::string& key, bool fallback) {
    const toml::node* node = find(key);
    if (!node) return fallback;
    if (const auto value = node->value_exact<bool>()) return *value;
    error(key, "is neither true nor false", "correct it");
    return fallback;
  }

  /// A text or a list of texts.
  std::vector<std::string> texts(const std::string& key) {
    const toml::node* node = find(key);
    std::vector<std::string> result;
    if (node && node->is_string()) result.push_back(*node->value<std::string>());
    if (node && node->is_array()) {
      for (const toml::node& item : *node->as_array()) {
        if (const auto value = item.value_exact<std::string>()) result.push_back(*value);
      }
      if (result.size() != node->as_array()->size()) result.clear();
    }
    if (result.empty()) error(key, node ? "is not a text or a list of texts" : "is missing", "name files in quotes");
    return result;
  }

  /// Two rising numbers.
  std::optional<std::pair<double, double>> span(const std::string& key) {
    const toml::node* node = find(key);
    if (!node) return std::nullopt;
    if (const toml::array* array = node->as_array(); array && array->size() == 2) {
      const auto from = (*array)[0].value<double>(), to = (*array)[1].value<double>();
      if (from && to && *from >= 0 && *from < *to) return std::pair(*from, *to);
    }
    error(key, "is not [from, to] in seconds with 0 <= from < to", "correct it, time = [0.5, 2.0] say");
    return std::nullopt;
  }

  std::optional<TableReader> table(const std::string& key) {
    const toml::node* node = find(key);
    if (!node) return std::nullopt;
    if (const toml::table* inner = node->as_table()) return TableReader(*inner, field(key), file_, findings_);
    error(key, "is not a table", fmt::format("write it as [{}]", field(key)));
    return std::nullopt;
  }

  std::vector<TableReader> tables(const std::string& key) {
    const toml::node* node = find(key);
    std::vector<TableReader> result;
    const toml::array* array = node ? node->as_array() : nullptr;
    if (array) {
      for (const toml::node& item : *array) {
        if (!item.is_table()) continue;
        const auto line = item.source().begin.line;
        result.emplace_back(*item.as_table(), fmt::format("{}[{}] (line {})", key, result.size(), line), file_, findings_);
      }
    }
    if (result.empty()) error(key, "is missing", fmt::format("add a [[{}]] for each kind of recording", key));
    return result;
  }

  bool has(const std::string& key) const { return table_.contains(key); }
  const std::string& place() const { return place_; }

  void refuse_unknown() {
    for (const auto& [key, node] : table_) {
      const std::string name(key.str());
      if (!asked_.contains(name)) {
        error(name, "is not known",
              "check its spelling; `rustle pack build --print-manifest` explains what a manifest may say");
      }
    }
  }

 private:
  const toml::node* find(const std::string& key) {
    asked_.insert(key);
    return table_.get(key);
  }
  std::string field(const std::string& key) const { return place_.empty() ? key : place_ + "." + key; }

  const toml::table& table_;
  std::string place_;
  std::string file_;
  pack::Findings& findings_;
  std::set<std::string> asked_;
};

}  // namespace rustle::build
