#include <catch2/catch.hpp>
#include <cmath>
#include <cstring>
#include <limits>

#include "sound_db/pack/npy.h"
#include "tests/unit/pack/example_pack.h"

namespace test_npy {

using namespace rustle::pack;

namespace {

std::string npy(const std::string& header, const std::string& data, int major = 1) {
  std::string bytes = "\x93NUMPY";
  bytes += {static_cast<char>(major), '\0', static_cast<char>(header.size() & 255), static_cast<char>(header.size() >> 8)};
  if (major == 2) bytes += std::string(2, '\0');
  return bytes + header + data;
}

}  // namespace

TEST_CASE("an array comes back as it was written") {
  const TemporaryFolder folder;
  const auto file = folder.path() / "a.npy";
  std::vector<float> values;
  for (int i = 0; i < 513; ++i) values.push_back(static_cast<float>(std::sin(i)));
  REQUIRE(write_npy(file, values));
  const auto array = read_npy(file);
  REQUIRE(array);
  CHECK(array->shape == std::vector<std::size_t>{513});
  CHECK(array->values == values);
  const std::string bytes = read_bytes(file);
  CHECK((bytes.size() - 513 * 4) % 64 == 0);
  for (std::size_t length = 0; length < bytes.size(); ++length) {
    write_bytes(file, bytes.substr(0, length));
    REQUIRE_FALSE(read_npy(file));
  }
  write_bytes(file, bytes + "x");
  CHECK_FALSE(read_npy(file));
}

TEST_CASE("what NumPy itself writes is read: float64, two dimensions, format 2") {
  const TemporaryFolder folder;
  const auto file = folder.path() / "a.npy";
  const double wide[6] = {1, 2, 3, 4, 5, 6.5};
  std::string data(sizeof wide, '\0');
  std::memcpy(data.data(), wide, sizeof wide);
  for (const int major : {1, 2}) {
    write_bytes(file, npy("{'descr': '<f8', 'fortran_order': False, 'shape': (2, 3), }\n", data, major));
    const auto array = read_npy(file);
    REQUIRE(array);
    CHECK(array->shape == std::vector<std::size_t>{2, 3});
    CHECK(array->values == std::vector<float>{1, 2, 3, 4, 5, 6.5f});
  }
}

TEST_CASE("other arrays are refused with the reason") {
  const TemporaryFolder folder;
  const auto file = folder.path() / "a.npy";
  const auto reason = [&](const std::string& header, const std::string& data) {
    write_bytes(file, npy(header, data));
    const auto array = read_npy(file);
    return array ? std::string() : array.error();
  };
  const std::string four(4, '\0');
  using Catch::Matchers::Contains;
  CHECK_THAT(reason("{'descr': '>f4', 'fortran_order': False, 'shape': (1,), }", four), Contains(">f4"));
  CHECK_THAT(reason("{'descr': '|O', 'fortran_order': False, 'shape': (1,), }", four), Contains("|O"));
  CHECK_THAT(reason("{'descr': '<f4', 'fortran_order': True, 'shape': (1, 1), }", four), Contains("Fortran"));
  CHECK_THAT(reason("{'descr': '<f4', 'fortran_order': False, 'shape': (-1,), }", four), Contains("shape"));
  CHECK_THAT(reason("{'descr': '<f4', 'fortran_order': False, 'shape': (), }", four), Contains("shape"));
  CHECK_THAT(reason("{'descr': '<f4', 'fortran_order': False, 'shape': (99999999999999999999,), }", four),
             Contains("shape"));
  CHECK_THAT(reason("{'descr': '<f4', 'fortran_order': False, 'shape': (200000000, 200000000), }", four), Contains("shape"));
  CHECK_THAT(reason("{'descr'", ""), Contains("type"));
  CHECK_THAT(reason("{'descr': '<", ""), Contains("type"));
  const float nan = std::numeric_limits<float>::quiet_NaN();
  std::string bad(4, '\0');
  std::memcpy(bad.data(), &nan, 4);
  CHECK_THAT(reason("{'descr': '<f4', 'fortran_order': False, 'shape': (1,), }", bad), Contains("finite"));
  CHECK_FALSE(read_npy(folder.path() / "missing.npy"));
}

}  // namespace test_npy
