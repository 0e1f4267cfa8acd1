#include "physics/compliance/factor/forward_panel.h"

#include <gtest/gtest.h>

namespace hapticd {
namespace {

// A panel as a front has it, in columns of a stride of its own, with a diagonal that is not small.
struct Panel {
  Panel(int width_, int height_)
      : width(width_), height(height_), values(MatX::Random((height_ + 7) / 8 * 8, width_)) {
    values.diagonal().array() += 2 * width;
  }
  int width, height;
  MatX values;
};

TEST(ForwardPanel, SolvesAndMultipliesWithAnyNumberOfRightHandSides) {
  for (const auto& [width, height] : {std::pair(1, 1), {3, 3}, {3, 8}, {8, 21}, {19, 60}, {45, 46}}) {
    const Panel panel(width, height);
    const MatX L11 = panel.values.topRows(width).triangularView<Eigen::Lower>();
    for (int sides = 1; sides <= 20; ++sides) {
      MatX X = MatX::Random(height + 5, sides), below;
      const MatX own = L11.fullPivLu().solve(X.middleRows(2, width));
      const MatX before = X;
      forward_panel(panel.values.data(), panel.values.rows(), width, height, X.middleRows(2, width), below);
      EXPECT_LT((X.middleRows(2, width) - own).norm(), 1e-13 * own.norm());
      EXPECT_EQ(X.topRows(2), before.topRows(2));
      EXPECT_EQ(X.bottomRows(height + 3 - width), before.bottomRows(height + 3 - width));
      ASSERT_EQ(below.rows(), height - width);
      if (height > width) {
        const MatX expected = panel.values.middleRows(width, height - width) * own;
        EXPECT_LT((below - expected).norm(), 1e-13 * expected.norm()) << width << ", " << sides;
      }
    }
  }
}

// Each right-hand side by itself: so a solve of one has the same bits as it had.
TEST(ForwardPanel, OneRightHandSideIsAsTheSolveHasIt) {
  const Panel panel(21, 50);
  VecX x = VecX::Random(21);
  MatX X = x, below;
  forward_panel(panel.values.data(), panel.values.rows(), 21, 50, X, below);
  VecX y = VecX::Zero(29);
  const int ld = static_cast<int>(panel.values.rows());
  panels::solve_lower(panel.values.data(), ld, 21, x.data());
  panels::add_product(panel.values.data() + 21, ld, 29, 21, x.data(), y.data());
  EXPECT_EQ(X, x);
  EXPECT_EQ(below, y);
}

}  // namespace
}  // namespace hapticd
