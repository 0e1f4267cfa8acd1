// Reciprocity and the third law: hand answers, and what breaks them is found.
#include "tools/offline/contact_laws.h"

#include <gtest/gtest.h>

#include <memory>

#include "tests/support/contact_problems.h"

namespace hapticd {
namespace {

// Two nodes, each under its own instrument; C_01 and C_10ᵀ differ by `apart` in one entry of size 2.
std::unique_ptr<CondensedProblem> two_nodes(double apart) {
  auto problem = std::make_unique<CondensedProblem>();
  problem->nodes = 2;
  problem->x_now[0] = Vec3(-1, 0, 0);
  problem->x_now[1] = Vec3(1, 0, 0);
  problem->instrument[0].X_ref.p = Vec3(-1, 0, 1);
  problem->instrument[1].X_ref.p = Vec3(1, 0, 1);
  auto C = problem->C();
  C.setZero();
  C.diagonal().setConstant(5);
  C(0, 4) = 2;
  C(4, 0) = 2 + apart;
  return problem;
}

TEST(ContactLaws, ReciprocityIsOfCrossBlocksAlone) {
  const std::vector<Instrument> balls(2, sphere_instrument(0.1));
  InstrumentPoses present;
  present.present[0] = present.present[1] = true;
  EXPECT_EQ(reciprocity_defect(*two_nodes(0), balls, present), 0);
  EXPECT_NEAR(reciprocity_defect(*two_nodes(0.5), balls, present), 0.5 / 2.5, 1e-15);
  auto within = two_nodes(0);
  within->C()(0, 1) = 1;  // of one hand's own node
  EXPECT_EQ(reciprocity_defect(*within, balls, present), 0);
  present.present[1] = false;
  EXPECT_EQ(reciprocity_defect(*two_nodes(0.5), balls, present), 0) << "all nodes are one instrument's";
}

TEST(ContactLaws, WhatInstrumentsFeelTissueBears) {
  Random random(3);
  SheetSettings settings;
  settings.friction = 0.3;
  const auto problem = sheet_problem(random, settings);
  const std::vector<Instrument> balls(2, sphere_instrument(2e-3));
  problem->instrument[0].coupling =
      problem->instrument[1].coupling = {.stiffness = 100, .rotational_stiffness = 1e-3};
  InstrumentPoses X;
  for (const int i : {0, 1}) {
    X[i].p = Vec3(i == 0 ? -2e-3 : 2e-3, 0, 1.7e-3);
    X.present[i] = true;
  }
  ContactState state;
  const auto scratch = std::make_unique<ContactScratch>();
  ContactSolution solution = solve_contact(*problem, balls, X, 1e-3, {}, state, *scratch);
  ASSERT_GT(solution.active, 1);
  ASSERT_GT(solution.wrench[0].norm(), 1e-4);
  ASSERT_GT(solution.wrench[1].norm(), 1e-4);
  EXPECT_LT(third_law_defect(*problem, *scratch, solution), 1e-14);
  const double f = solution.wrench[1].head<3>().norm();
  solution.wrench[1].head<3>() *= 2;
  EXPECT_GT(third_law_defect(*problem, *scratch, solution), 0.1)
      << "a force of " << f << " N that nobody bears";
}

// The shaft leans on the ring by a millimetre; the ball touches nothing.
TEST(ContactLaws, ARingBearsWhatItPressesTheShaftWith) {
  const auto problem = std::make_unique<CondensedProblem>();
  std::vector<Instrument> ball(1, sphere_instrument(1e-3));
  ball[0].incision = {Vec3(0, 0, 10e-3), Vec3::UnitZ(), 1e-4, 400, 0.2};
  problem->instrument[0].coupling = {.stiffness = 100, .rotational_stiffness = 1e-3};
  InstrumentPoses X;
  X.present[0] = true;
  ContactState state;
  const auto scratch = std::make_unique<ContactScratch>();
  solve_contact(*problem, ball, X, 1e-3, {}, state, *scratch);  // it enters in the middle
  X[0].p = Vec3(1e-3, 0, 0);
  const ContactSolution solution = solve_contact(*problem, ball, X, 1e-3, {}, state, *scratch);
  ASSERT_EQ(scratch->rows.contacts, 1);
  ASSERT_TRUE(scratch->rows.row[0].incision);
  ASSERT_GT(solution.wrench[0].norm(), 1e-3);
  EXPECT_LT(third_law_defect(*problem, *scratch, solution), 1e-14);
}

}  // namespace
}  // namespace hapticd
