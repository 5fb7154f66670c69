#include "sound_db/build/correspondences.h"

#include <cctype>
#include <cmath>
#include <cstdlib>
#include <fstream>

#include <fmt/format.h>

namespace rustle::build {

namespace {

constexpr double kLongest_s = 1e5;
constexpr std::size_t kMost = 10000;

/// The numbers of a line, separated by commas, semicolons or blanks; nothing when anything else is in it.
std::vector<double> numbers_of(const std::string& line) {
  std::vector<double> values;
  const char* at = line.c_str();
  while (true) {
    while (std::isspace(static_cast<unsigned char>(*at)) || *at == ',' || *at == ';') ++at;
    if (*at == '\0') return values;
    char* end = nullptr;
    const double value = std::strtod(at, &end);
    if (end == at || !std::isfinite(value)) return {};
    values.push_back(value);
    at = end;
  }
}

}  // namespace

tl::expected<std::vector<pack::Correspondence>, std::string> read_correspondences(const std::filesystem::path& file) {
  std::ifstream stream(file);
  if (!stream) return tl::unexpected(std::string("cannot be read"));
  std::vector<pack::Correspondence> result;
  std::string line;
  for (int number = 1; std::getline(stream, line); ++number) {
    const auto start = line.find_first_not_of(" \t\r");
    if (start == std::string::npos || line[start] == '#') continue;
    if (result.empty() && std::isalpha(static_cast<unsigned char>(line[start]))) continue;
    const std::vector<double> values = numbers_of(line);
    const bool numbers = values.size() == 2 || values.size() == 3;
    pack::Correspondence pair;
    if (numbers) pair = {values[0], values[1], values.size() == 3 ? values[2] : pair.length_s};
    const auto within = [](double x) { return x >= 0 && x <= kLongest_s; };
    if (!numbers || !within(pair.target_s) || !within(pair.database_s) || !within(pair.length_s) || pair.length_s == 0) {
      return tl::unexpected(
          fmt::format("line {} is not \"target_s, database_s, length_s\" in seconds: {}", number, line.substr(0, 60)));
    }
    result.push_back(pair);
    if (result.size() > kMost) return tl::unexpected(fmt::format("holds more than {} correspondences", kMost));
  }
  if (result.empty()) return tl::unexpected(std::string("holds no \"target_s, database_s, length_s\" line"));
  return result;
}

std::string correspondences_text(std::span<const pack::Correspondence> correspondences) {
  std::string text = "# target_s, database_s, length_s\n";
  for (const auto& pair : correspondences) {
    text += fmt::format("{:.4f}, {:.4f}, {:.4f}\n", pair.target_s, pair.database_s, pair.length_s);
  }
  return text;
}

}  // namespace rustle::build
