// Half solves with rounded panels, by every kernel that this processor runs.
#include "physics/compliance/zone/quantised_factor.h"

#include <gtest/gtest.h>

#include <random>
#include <string>
#include <string_view>

namespace hapticd {
namespace {

std::vector<const QuantisedKernels*> kernel_sets() {
  std::vector<const QuantisedKernels*> sets = {&generic_quantised_kernels};
#ifdef __x86_64__
  const std::string_view best = quantised_kernels().name;
  if (best != "generic") sets.push_back(&avx2_quantised_kernels);
  if (best == "avx512") sets.push_back(&avx512_quantised_kernels);
#endif
  return sets;
}

class QuantisedFactorOf : public testing::TestWithParam<const QuantisedKernels*> {};

// L = (2, 1, −1/4)ᵀ beside an identity: forward x₁ ← x₁ − x₀/2, x₂ ← x₂ + x₀/8; backward its transpose.
TEST_P(QuantisedFactorOf, OneColumnByHand) {
  const double value[] = {2, 1, -0.25};
  const int rows[] = {0, 1, 2};
  const LeadingPanel panel = {0, 1, 3, 0, 0, 3};
  QuantisedFactor panels({&panel, 1}, rows, value, {}, *GetParam());
  VecX x(3);
  x << 4, 10, 20;
  panels.forward(x);
  EXPECT_EQ(x[0], 2);
  EXPECT_NEAR(x[1], 8, 1e-4);
  EXPECT_NEAR(x[2], 20.5, 1e-4);
  x << 4, 1, 8;
  panels.backward(x);
  EXPECT_NEAR(x[0], (4 - 1 + 0.25 * 8) / 2, 1e-4);
  EXPECT_EQ(x[1], 1);
  EXPECT_EQ(x[2], 8);
}

// Two panels, the first's rows scattered over the second's and beyond: near the exact halves, within units of
// the rounding; and transposes of each other, which rounding does not touch.
TEST_P(QuantisedFactorOf, HalvesAreNearTheExactAndEachOthersTranspose) {
  std::mt19937 random(7);
  std::uniform_real_distribution<double> entry(-1, 1);
  for (const int w0 : {1, 3, 7, 8, 9, 24, 30})
    for (const int w1 : {3, 8, 13}) {
      const int beyond = 3 * w1, n = w0 + w1 + beyond;
      std::vector<int> rows;
      for (int i = 0; i < w0; ++i) rows.push_back(i);
      for (int i = w0; i < n; i += 2) rows.push_back(i);
      const int h0 = static_cast<int>(rows.size()), h1 = w1 + beyond;
      for (int i = w0; i < n; ++i) rows.push_back(i);
      const LeadingPanel list[] = {{0, w0, h0, 0, 0, h0 + 5}, {w0, w1, h1, h0, (h0 + 5) * w0, h1}};
      std::vector<double> values(static_cast<std::size_t>((h0 + 5) * w0 + h1 * w1), 1e300);
      MatX L = MatX::Identity(n, n);
      for (const LeadingPanel& p : list)
        for (int j = 0; j < p.width; ++j)
          for (int i = j; i < p.height; ++i)
            L(rows[p.row + i], p.first + j) = values[p.value + i + j * p.stride] =
                i == j ? 3 + entry(random) : entry(random) / p.width;
      QuantisedFactor panels(list, rows.data(), values.data(), {}, *GetParam());
      const VecX a = VecX::Random(n), b = VecX::Random(n);
      VecX f = a, g = b;
      panels.forward(f);
      panels.backward(g);
      const VecX exact_f = L.triangularView<Eigen::Lower>().solve(a);
      const VecX exact_g = L.transpose().triangularView<Eigen::Upper>().solve(b);
      EXPECT_LT((f - exact_f).norm(), 1e-4 * exact_f.norm()) << w0 << ' ' << w1;
      EXPECT_LT((g - exact_g).norm(), 1e-4 * exact_g.norm()) << w0 << ' ' << w1;
      EXPECT_NEAR(f.dot(b), g.dot(a), 3e-6 * f.norm() * b.norm()) << w0 << ' ' << w1;

      // The last panel alone: a forward half of what is zero before it, and the end of a backward half.
      VecX late = a, end = b;
      late.head(w0).setZero();
      VecX late_whole = late;
      panels.forward(late_whole);
      panels.forward_last(late);
      EXPECT_EQ(late, late_whole);
      panels.backward_last(end);
      EXPECT_EQ(end.tail(n - w0), g.tail(n - w0));
      EXPECT_EQ(end.head(w0), b.head(w0));
    }
}

INSTANTIATE_TEST_SUITE_P(Sets, QuantisedFactorOf, testing::ValuesIn(kernel_sets()),
                         [](const auto& of) { return std::string(of.param->name); });

}  // namespace
}  // namespace hapticd
