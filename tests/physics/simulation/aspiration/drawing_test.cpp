// What a port pulls again after a solve, against what that solve has thrown.
#include "physics/simulation/aspiration/drawing.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "tests/support/suction_sheet.h"

namespace hapticd {
namespace {

using namespace suction;

// Its nodes yield, each by itself.
std::unique_ptr<CondensedProblem> soft_sheet() {
  auto problem = sheet(4e-3, 10, 0);
  problem->C().diagonal().setConstant(0.1);
  return problem;
}

struct DrawingOf : testing::Test {
  std::unique_ptr<CondensedProblem> problem = soft_sheet();
  const Instrument tip = needle();
  InstrumentSamples hand;
  InstrumentPoses X;
  Drawing drawing;
  EachInstrument<double> occlusion;
  PatchPositions x = problem->x_free;  // where solves end

  DrawingOf() {
    hand[0].present = true;
    hand[0].vacuum = vacuum;
    X.present[0] = true;
    occlusion = drawing.begin(tip, hand, X, X, *problem);
  }
  bool throws() const { return drawing.throws(tip, x, *problem); }
  bool again() { return drawing.again(tip, hand, X, x, *problem, occlusion); }
  double pull() const {
    double sum = 0;
    for (int n = 0; n < problem->nodes; ++n) sum += problem->pull[n].z();
    return sum;
  }
  static constexpr int left = 59, right = 61;  // nodes under the port, 0.4 mm to either side of its middle
};

// A solve that throws nothing: the same pull, by where it has ended, and then nothing more.
TEST_F(DrawingOf, IsMadeAgainOnceWhereNothingIsThrown) {
  EXPECT_EQ(occlusion[0], 1);
  x = problem->x_free;
  for (int n = 0; n < problem->nodes; ++n) x[n].z() -= 0.35e-3;  // out of the port's reach
  EXPECT_TRUE(again());
  EXPECT_EQ(occlusion[0], 0);
  EXPECT_EQ(pull(), 0);
  EXPECT_FALSE(again());
}

// A pull is left out, and x_free stays to the last bit, where it moves no node by a micrometre, nor the tip.
TEST_F(DrawingOf, APullThatMovesNothingIsLeftOut) {
  const PatchPositions before = soft_sheet()->x_free;
  double farthest = 0;
  for (int n = 0; n < problem->nodes; ++n)
    farthest = std::max(farthest, (problem->x_free[n] - before[n]).norm());
  const auto begin = [&](double moves, double stiffness) {
    problem = soft_sheet();
    problem->instrument[0].coupling.stiffness = stiffness;
    hand[0].vacuum = vacuum * moves / farthest;
    occlusion = drawing.begin(tip, hand, X, X, *problem);
    EXPECT_EQ(occlusion[0], 1);
    return is_pulled(*problem);
  };
  for (const double stiffness : {0.0, 1e6}) {
    EXPECT_FALSE(begin(0.99e-6, stiffness));
    EXPECT_EQ(pull(), 0);
    for (int n = 0; n < problem->nodes; ++n) EXPECT_EQ(problem->x_free[n], before[n]);
    EXPECT_TRUE(begin(1.01e-6, stiffness));
  }
  EXPECT_TRUE(begin(0.5e-6, 0.4 * vacuum * port_area / farthest)) << "the tip moves by 1.25 µm";
  EXPECT_FALSE(begin(0.5e-6, 0.6 * vacuum * port_area / farthest)) << "the tip moves by 0.83 µm";
}

// What moves farther than the port is wide and reaches is let go, and stays so; the port has its whole
// pressure on what is left of it, as far as that covers it.
TEST_F(DrawingOf, WhatIsThrownIsNotPulledOn) {
  ASSERT_TRUE(again());
  const double whole = pull();
  ASSERT_NEAR(whole, vacuum * port_area, 1e-12);
  EXPECT_FALSE(throws());
  x[left] += Vec3(0, 12e-3, 0);
  EXPECT_TRUE(throws());
  EXPECT_TRUE(again());
  EXPECT_TRUE(problem->pull[left].isZero(0)) << problem->pull[left];
  EXPECT_FALSE(problem->pull[right].isZero(0));
  EXPECT_NEAR(pull(), vacuum * port_area * occlusion[0], 1e-12);
  EXPECT_FALSE(again()) << "it already is";
  x[left] = problem->x_free[left];
  x[right] += Vec3(0, 12e-3, 0);
  EXPECT_TRUE(again());
  EXPECT_TRUE(problem->pull[left].isZero(0));
  EXPECT_TRUE(problem->pull[right].isZero(0));
  EXPECT_NEAR(pull(), vacuum * port_area * occlusion[0], 1e-12);
  EXPECT_NEAR(problem->instrument[0].load[2], -pull(), 1e-15);
}

// However much is thrown: at most four times a step.
TEST_F(DrawingOf, Ends) {
  int solves = 1;
  for (const int n : {60, 59, 61, 49, 71, 48, 50}) {
    x[n] += Vec3(0, 12e-3, 0);
    const bool thrown = throws(), more = again();
    EXPECT_EQ(thrown, solves > 1 && more) << "the first is made again whatever it throws";
    solves += more;
  }
  EXPECT_EQ(solves, 5);
}

}  // namespace
}  // namespace hapticd
