#include "server/analysis/kernel_blocks.h"

#include <cmath>
#include <random>

#include <catch2/catch.hpp>

#include "server/analysis/plane_order.h"

namespace kernel_blocks_test {

using namespace rustle;

TEST_CASE("Blocks sum what the rows of the kernel sum, pieces apart though they overlap") {
  std::mt19937 random(7);
  std::uniform_real_distribution<double> place(0, 0.1);
  analysis::PlanePoints targets, sources;
  for (std::uint32_t i = 0; i < 1500; ++i) {
    targets.at_m.emplace_back(place(random), place(random));
    targets.component.push_back(i % 3 == 0);
  }
  for (std::uint32_t i = 0; i < 900; ++i) {
    sources.at_m.emplace_back(place(random), place(random));
    sources.component.push_back(i % 2);
  }
  std::vector<double> radii_m;
  for (std::size_t i = 0; i < targets.at_m.size(); ++i) radii_m.push_back(0.012 + 0.1 * place(random));
  const analysis::Stencil rows = analysis::kernel(targets, radii_m, sources);
  std::vector<analysis::Moment> moments, response;
  for (std::size_t i = 0; i < sources.at_m.size(); ++i) {
    moments.emplace_back(static_cast<float>(place(random)), 1.0f, static_cast<float>(-place(random)), 2.0f);
  }
  for (std::size_t i = 0; i < targets.at_m.size(); ++i) response.emplace_back(1.0f, 0.5f, 2.0f, 3.0f);

  const auto order = analysis::along_hilbert_curve(targets);
  const auto blocks = analysis::kernel_blocks(rows, order, targets, radii_m, sources);
  std::vector<float> trace(order.size()), last(order.size());
  analysis::sum_blocks(blocks, moments, order, response, trace, last);
  for (std::size_t i = 0; i < order.size(); ++i) {
    const analysis::Moment sum = analysis::weighted_sum(rows.row(i), moments) * response[i];
    CHECK(trace[i] == Approx(sum[0] + sum[1] + sum[2]).epsilon(1e-4).margin(1e-5));
    CHECK(last[i] == Approx(sum[3]).epsilon(1e-4));
  }
  // What the fit is prepared with is what the sums use.
  for (const auto& block : blocks.blocks) {
    float weights = 0;
    for (const std::uint32_t source : blocks.sources_of(block)) weights += blocks.weight(block, 0, source);
    CHECK(last[order[block.first_target]] == Approx(2.0f * weights * 3.0f).epsilon(1e-5));
  }
}

}  // namespace kernel_blocks_test
