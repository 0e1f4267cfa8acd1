#include "physics/compliance/reference_compliance.h"

#include <stdexcept>

#include <gtest/gtest.h>

#include "tests/physics/compliance/oracle.h"

namespace hapticd {
namespace {

TEST(ReferenceCompliance, IsOfTheMethodsThatKeepAReferenceFactor) {
  const TissueModel model = oracle::box(2);
  for (const auto method : {ComplianceMethod::zone, ComplianceMethod::lazy, ComplianceMethod::updown}) {
    EXPECT_TRUE(as_reference_compliance(make_compliance(method, model, oracle::h).get()));
    EXPECT_TRUE(make_reference_compliance(method, model, oracle::h));
  }
  for (const auto method : {ComplianceMethod::exact, ComplianceMethod::dense}) {
    EXPECT_FALSE(as_reference_compliance(make_compliance(method, model, oracle::h).get()));
    EXPECT_THROW(static_cast<void>(make_reference_compliance(method, model, oracle::h)),
                 std::invalid_argument);
  }
  EXPECT_FALSE(as_reference_compliance(nullptr));
}

TEST(ReferenceCompliance, WithoutHalvesEverySolveIsWhole) {
  const TissueModel model = oracle::box(2);
  const TissueState state = oracle::deformed(model, 3);
  for (const auto method : {ComplianceMethod::lazy, ComplianceMethod::updown}) {
    const auto compliance = make_reference_compliance(method, model, oracle::h);
    compliance->update(state);
    const VecX b = oracle::load(3 * model.node_count());
    VecX y(b.size()), expected(b.size());
    compliance->apply(b, expected);
    EXPECT_EQ(compliance->start_solve(b, y), Solved::whole);
    EXPECT_EQ(y, expected);
    EXPECT_THROW(compliance->finish_solve(b, y), std::runtime_error);
    EXPECT_EQ(compliance->disagreement(state, y), 0);
  }
}

}  // namespace
}  // namespace hapticd
