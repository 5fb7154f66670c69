#pragma once

#include <cmath>
#include <cstdint>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "sound_db/pack/pack_error.h"

namespace rustle::pack {

using Json = nlohmann::ordered_json;

/// A JSON object and its place in the file. Each reading checks type and range, and notes what was asked for. What is wrong
/// goes to the findings, and the fallback or the least value is returned.
class Reader {
 public:
  /// `object` and `findings` outlive this.
  Reader(const Json& object, std::string place, std::string file, Findings& findings)
      : object_(object), place_(std::move(place)), file_(std::move(file)), findings_(findings) {}

  void error(const std::string& key, std::string message, std::string remedy) {
    findings_.push_back({Severity::kError, {file_, field(key), std::move(message), std::move(remedy)}});
  }
  void warning(const std::string& key, std::string message, std::string remedy) {
    findings_.push_back({Severity::kWarning, {file_, field(key), std::move(message), std::move(remedy)}});
  }

  double number(const std::string& key, std::optional<double> fallback, double low, double high) {
    const Json* value = find(key, !fallback, "a number");
    if (!value) return fallback.value_or(low);
    const double x = value->is_number() ? value->get<double>() : std::nan("");
    if (x >= low && x <= high) return x;
    error(key, fmt::format("is {}, expected a number from {} to {}", short_text(*value), low, high), "correct it");
    return fallback.value_or(low);
  }

  std::int64_t integer(const std::string& key, std::optional<std::int64_t> fallback, std::int64_t low, std::int64_t high) {
    const Json* value = find(key, !fallback, "a whole number");
    if (!value) return fallback.value_or(low);
    const double x = value->is_number_integer() ? value->get<double>() : std::nan("");
    if (x >= static_cast<double>(low) && x <= static_cast<double>(high)) return value->get<std::int64_t>();
    error(key, fmt::format("is {}, expected a whole number from {} to {}", short_text(*value), low, high), "correct it");
    return fallback.value_or(low);
  }

  std::string text(const std::string& key, bool required) {
    const Json* value = find(key, required, "a text");
    if (!value) return {};
    if (value->is_string() && (!required || !value->get_ref<const std::string&>().empty())) return value->get<std::string>();
    error(key, fmt::format("is {}, expected a text", short_text(*value)), "put it in quotes");
    return {};
  }

  bool flag(const std::string& key, bool fallback) {
    const Json* value = find(key, false, "");
    if (!value) return fallback;
    if (value->is_boolean()) return value->get<bool>();
    error(key, fmt::format("is {}, expected true or false", short_text(*value)), "correct it");
    return fallback;
  }

  std::optional<Reader> object(const std::string& key, bool required) {
    const Json* value = find(key, required, "an object");
    if (!value) return std::nullopt;
    if (value->is_object()) return Reader(*value, field(key), file_, findings_);
    error(key, fmt::format("is {}, expected an object", short_text(*value)), "put it in braces");
    return std::nullopt;
  }

  /// A list of at least `least` and at most kMostEntries numbers.
  std::vector<double> numbers(const std::string& key, std::size_t least, double low, double high) {
    const Json* value = find(key, true, "a list of numbers");
    std::vector<double> result;
    if (!value) return result;
    if (!value->is_array() || value->size() < least || value->size() > kMostEntries) {
      error(key, fmt::format("is {}, expected a list of at least {} numbers", short_text(*value), least), "correct it");
      return result;
    }
    for (std::size_t i = 0; i < value->size(); ++i) {
      const Json& element = (*value)[i];
      const double x = element.is_number() ? element.get<double>() : std::nan("");
      if (!(x >= low && x <= high)) {
        error(fmt::format("{}[{}]", key, i),
              fmt::format("is {}, expected a number from {} to {}", short_text(element), low, high), "correct it");
      }
      result.push_back(x);
    }
    return result;
  }

  std::vector<Reader> objects(const std::string& key) {
    const Json* value = find(key, true, "a list");
    std::vector<Reader> result;
    if (!value) return result;
    if (!value->is_array() || value->size() > kMostEntries) {
      error(key, fmt::format("is {}, expected a list of at most {} objects", short_text(*value), kMostEntries),
            "correct it");
      return result;
    }
    for (std::size_t i = 0; i < value->size(); ++i) {
      const std::string name = fmt::format("{}[{}]", key, i);
      if ((*value)[i].is_object()) {
        result.emplace_back((*value)[i], field(name), file_, findings_);
      } else {
        error(name, fmt::format("is {}, expected an object", short_text((*value)[i])), "put it in braces");
      }
    }
    return result;
  }

  /// Keys that nothing asked for.
  std::vector<std::string> unknown() const {
    std::vector<std::string> keys;
    for (const auto& [key, value] : object_.items()) {
      if (!asked_.contains(key)) keys.push_back(key);
    }
    return keys;
  }
  void warn_unknown() {
    for (const std::string& key : unknown()) warning(key, "is not known and is left alone", "check its spelling");
  }

  std::string field(const std::string& key) const {
    return place_.empty() ? key : key.empty() ? place_ : place_ + "." + key;
  }

 private:
  static constexpr std::size_t kMostEntries = 10000;

  const Json* find(const std::string& key, bool required, const char* what) {
    asked_.insert(key);
    const auto at = object_.find(key);
    if (at != object_.end()) return &*at;
    if (required) error(key, "is missing", fmt::format("add it: {}", what));
    return nullptr;
  }

  static std::string short_text(const Json& value) {
    const std::string text = value.dump(-1, ' ', true, Json::error_handler_t::replace);
    return text.size() <= 40 ? text : text.substr(0, 37) + "...";
  }

  const Json& object_;
  std::string place_;
  std::string file_;
  Findings& findings_;
  std::set<std::string> asked_;
};

}  // namespace rustle::pack
