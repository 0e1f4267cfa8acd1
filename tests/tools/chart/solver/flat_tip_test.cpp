// A flat tip's problems, solved with contacts that stick eliminated and without.
#include <gtest/gtest.h>

#include <memory>
#include <string>

#include "physics/contact/solver/coulomb.h"
#include "tools/chart/solver/contact_sequence.h"

namespace hapticd {
namespace {

// A flat punch, pressed and dragged: its contacts change between sticking and sliding by dozens. Two solvers,
// each with its own warm start.
TEST(FlatTip, EliminationTakesAFractionOfTheFactorsAndTheSameWrench) {
  SequenceSettings settings;
  settings.kind = ContactCase::flat;
  settings.contacts = 100;
  settings.steps_per_stroke = 150;
  ContactSequence sequence(settings);
  const auto with = std::make_unique<CoulombWorkspace>(),
             without = std::make_unique<CoulombWorkspace>(max_contacts, false);
  VecX reference = VecX::Zero(300), other = reference;
  CoulombOptions options;
  int factors_with = 0, factors_without = 0;
  for (int step = 0; step < 900; ++step) {
    sequence.advance(reference);
    sequence.carry(reference);
    sequence.carry(other);
    const CoulombResult a = solve_coulomb(sequence.W(), sequence.q(), sequence.mu(), reference, *with,
                                          sequence.version(), options);
    const CoulombResult b = solve_coulomb(sequence.W(), sequence.q(), sequence.mu(), other, *without,
                                          sequence.version(), options);
    ASSERT_EQ(a.status, SolveStatus::solved) << step;
    ASSERT_EQ(b.status, SolveStatus::solved) << step;
    factors_with += a.factorisations;
    factors_without += b.factorisations;
    // The law need not have one solution alone where μ is large.
    if (sequence.mu()[0] > 0.3) continue;
    const Vec6 of_a = sequence.wrench(reference), of_b = sequence.wrench(other);
    ASSERT_LT(sequence.length(of_a - of_b), 1e-5 * sequence.length(of_b) + 1e-9) << step;
  }
  EXPECT_LT(3 * factors_with, 2 * factors_without);
  RecordProperty("factors", std::to_string(factors_with) + " " + std::to_string(factors_without));
}

}  // namespace
}  // namespace hapticd
