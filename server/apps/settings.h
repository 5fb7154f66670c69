#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <limits>
#include <map>
#include <optional>
#include <string>
#include <type_traits>
#include <variant>
#include <vector>

namespace CLI {
class App;
}

/// What a program can be told, each thing declared once and said in three ways: in a TOML file, by an environment variable,
/// by a flag. The later of these goes before the earlier.
namespace rustle::apps {

/// A mistake in what was said.
struct SettingError {
  std::string where;  ///< "rustled.toml:12", "RUSTLED_AUDIO_RATE" or "--rate"
  std::string what;   ///< with the mend: "audio.rate: 12 is not one of 44100, 48000, 96000"

  std::string text() const { return where + ": " + what; }
  bool operator==(const SettingError&) const = default;
};

/// Numbers, texts and choices behind one list of declarations. Writes into the fields it was given, which must outlive it.
class Settings {
 public:
  struct Limits {
    double least, most;
  };
  /// Refuses a text by a sentence that names the setting and the mend. Empty: it may stand.
  using Check = std::function<std::string(const std::string& value)>;

  /// `prefix` of environment variables, such as "RUSTLED": audio.rate is RUSTLED_AUDIO_RATE.
  explicit Settings(std::string prefix);

  // ---- declarations; `key` is "section.name", `flag` "--name". The field's value is the default.

  /// Heads the section in print().
  void section(const std::string& name, std::string meaning);
  template <class Whole>
  void integer(const std::string& key, const std::string& flag, Whole& field, Limits limits, std::string meaning) {
    static_assert(std::is_integral_v<Whole>);
    number(
        key, flag, limits, true, std::move(meaning), [&field](double value) { field = static_cast<Whole>(value); },
        [&field] { return static_cast<double>(field); });
  }
  /// One of a few numbers.
  template <class Whole>
  void number_of(const std::string& key, const std::string& flag, Whole& field, std::vector<int> choices,
                 std::string meaning) {
    static_assert(std::is_integral_v<Whole>);
    choose(
        key, flag, std::move(choices), std::move(meaning), [&field](int value) { field = static_cast<Whole>(value); },
        [&field] { return static_cast<double>(field); });
  }
  void real(const std::string& key, const std::string& flag, double& field, Limits limits, std::string meaning);
  void truth(const std::string& key, const std::string& flag, bool& field, std::string meaning);
  void text(const std::string& key, const std::string& flag, std::string& field, std::string meaning, Check check = {});
  /// A list of texts: an array, a flag that is repeated, a variable with commas.
  void texts(const std::string& key, const std::string& flag, std::vector<std::string>& field, std::string meaning,
             Check check = {});
  void choice(const std::string& key, const std::string& flag, std::string& field, std::vector<std::string> choices,
              std::string meaning);
  /// The last declared takes effect while the program runs, when its file is read again.
  void reloadable();

  // ---- what was said

  /// Adds a flag for every setting; what the command line says is kept for read().
  void add_flags(CLI::App& app);
  /// Texts by flag, as the command line gave them.
  using Given = std::map<std::string, std::vector<std::string>>;
  const Given& given() const { return given_; }
  void give(Given given) { given_ = std::move(given); }

  /// Sets the fields from file, environment and flags, in this order. Returns everything that was wrong, not only the first;
  /// a value that was refused leaves its field as it was.
  [[nodiscard]] std::vector<SettingError> read(
      const std::optional<std::filesystem::path>& file,
      const std::function<const char*(const char* name)>& environment = default_environment);

  /// All settings as a TOML file that says the same, each with what it means and what it may be.
  std::string print() const;
  /// The same to be edited: what is as `defaults` have it is commented out, as "#key = value".
  std::string print_to_edit(const Settings& defaults) const;

  /// A setting as it is told to people.
  struct Description {
    std::string section, section_meaning;
    std::string name;  ///< without its section
    std::string meaning, wanted, value, flag, variable;
    bool reloadable;
  };
  /// All of them, section by section.
  std::vector<Description> descriptions() const;

  /// How `now` differs, by key: what can be taken over, and what needs a new start.
  struct Changes {
    std::vector<std::string> reloadable, restart;
  };
  Changes changes_to(const Settings& now) const;

 private:
  using Value = std::variant<bool, double, std::string, std::vector<std::string>>;
  /// Nothing: taken. Empty: not what is wanted. Else the sentence of a Check.
  using Refusal = std::optional<std::string>;
  enum class Kind : std::uint8_t { kTruth, kNumber, kText, kTexts };
  struct Setting {
    std::string key, flag, meaning;
    Kind kind;
    std::string wanted;                ///< "a whole number from 1 to 256"
    std::vector<std::string> choices;  ///< where there are few; empty: others
    std::function<Refusal(const Value& value)> take;
    std::function<std::string()> toml;  ///< the value as TOML
    bool reloadable = false;
  };
  struct Section {
    std::string name, meaning;
  };

  static const char* default_environment(const char* name);
  void number(const std::string& key, const std::string& flag, Limits limits, bool whole, std::string meaning,
              std::function<void(double)> set, std::function<double()> get);
  void choose(const std::string& key, const std::string& flag, std::vector<int> choices, std::string meaning,
              std::function<void(int)> set, std::function<double()> get);
  Setting* find(const std::string& key);
  std::string nearest_key(const std::string& key) const;
  std::string variable_of(const Setting& setting) const;
  /// print(), commented out where `said` is false.
  std::string print_where(const std::function<bool(const Description& setting)>& said) const;
  static std::optional<Value> value_of(const Setting& setting, const std::vector<std::string>& texts);
  static void take(Setting& setting, const std::optional<Value>& value, const std::string& where, const std::string& said,
                   std::vector<SettingError>& errors);
  void read_file(const std::filesystem::path& file, std::vector<SettingError>& errors);

  std::string prefix_;
  std::vector<Section> sections_;
  std::vector<Setting> settings_;
  Given given_;
};

}  // namespace rustle::apps
