#!/usr/bin/python3
"""README.md's examples as programs.

usage: readme_example.py README.md OUT.cpp    the C++ example, with a sheet to send and a verdict after it
"""
import pathlib
import re
import sys

SHEET = """
namespace {

constexpr std::uint32_t kColumns = 16, kRows = 8;
constexpr std::uint32_t vertex_count = (kColumns + 1) * (kRows + 1);

std::vector<std::uint32_t> make_triangles() {
  std::vector<std::uint32_t> out;
  for (std::uint32_t y = 0; y < kRows; ++y)
    for (std::uint32_t x = 0; x < kColumns; ++x) {
      const std::uint32_t a = y * (kColumns + 1) + x;
      for (const std::uint32_t v : {a, a + 1, a + kColumns + 2, a, a + kColumns + 2, a + kColumns + 1}) out.push_back(v);
    }
  return out;
}

// A page that is bent to and fro.
std::vector<float> simulate(double t) {
  const double curvature = 8 * std::sin(12 * t) + 1e-6;
  std::vector<float> out;
  for (std::uint32_t y = 0; y <= kRows; ++y)
    for (std::uint32_t x = 0; x <= kColumns; ++x) {
      const double s = 0.2 * (double(x) / kColumns - 0.5);
      for (const double coordinate : {std::sin(curvature * s) / curvature, 0.1 * y / kRows, (std::cos(curvature * s) - 1) / curvature})
        out.push_back(static_cast<float>(coordinate));
    }
  return out;
}

}  // namespace
"""

VERDICT = """
  const auto figures = session->detach();
  return figures && figures->frames_received > 0 && figures->frames_analysed == figures->frames_received &&
                 figures->messages_refused == 0 && figures->crumpling_events > 0
             ? 0
             : 1;
"""


def example(readme, language):
    """The text of the one code block in this language."""
    blocks = re.findall(rf"^```{language}\n(.*?)^```$", pathlib.Path(readme).read_text(), re.DOTALL | re.MULTILINE)
    if len(blocks) != 1:
        raise SystemExit(f"{readme}: {len(blocks)} blocks of {language}, wanted one")
    return blocks[0]


def cpp_program(readme):
    lines = example(readme, "cpp").splitlines()
    includes = [line for line in lines if line.startswith("#include")]
    body = ["  " + line if line else "" for line in lines if not line.startswith("#include")]
    head = [*includes, "", "#include <cmath>", "#include <cstdint>", "#include <vector>"]
    triangles = "  const std::vector<std::uint32_t> triangles = make_triangles();"
    return "\n".join([*head, SHEET, "int main() {", triangles, *body, VERDICT + "}", ""])


if __name__ == "__main__":
    if len(sys.argv) != 3:
        raise SystemExit(__doc__)
    pathlib.Path(sys.argv[2]).write_text(cpp_program(sys.argv[1]))
