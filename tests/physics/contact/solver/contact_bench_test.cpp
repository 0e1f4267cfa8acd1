// Not a test of what comes out: that W and a contact solve have not become some times as dear as they were.
// Machines differ, so both are in units of a plain dense product, timed by turns with them. Run alone:
//   test_physics --gtest_also_run_disabled_tests --gtest_filter='ContactBench.*'
#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <memory>

#include "physics/contact/contact_solve.h"
#include "physics/contact/delassus.h"
#include "tests/support/contact_problems.h"

namespace hapticd {
namespace {

constexpr double gross = 2.5;

double us_of(const auto& work) {
  const auto begin = std::chrono::steady_clock::now();
  work();
  return std::chrono::duration<double, std::micro>(std::chrono::steady_clock::now() - begin).count();
}

// A sphere pressed into a sheet of 81 nodes, some forty contacts.
struct Pressed {
  Pressed() {
    Random random(3);
    SheetSettings sheet;
    sheet.nodes = 9;
    sheet.per_triangle = 3;
    sheet.friction = 0.3;
    problem = sheet_problem(random, sheet);
    problem->renewal = Renewal::renewed;
    problem->instrument[0].coupling = {.stiffness = 200, .rotational_stiffness = 0.1, .damping_time = 2e-3};
    options.margin = 0.1e-3;
    move(0);
  }
  void move(int k) {
    Pose X;
    X.p = Vec3(0.2e-3 * std::sin(0.3 * k), 0.2e-3 * std::cos(0.2 * k), 1.5e-3);
    solution = solve_contact(*problem, instrument, X, 1e-3, options, state, *scratch);
  }

  std::unique_ptr<CondensedProblem> problem;
  Instrument instrument = sphere_instrument(2e-3);
  ContactOptions options;
  ContactState state;
  std::unique_ptr<ContactScratch> scratch = std::make_unique<ContactScratch>();
  ContactSolution solution;
};

// Least of many, by turns: what else runs on the machine then matters little.
struct Figures {
  double work_us = 1e300, product_us = 1e300;
  void take(double work, double product) {
    work_us = std::min(work_us, work);
    product_us = std::min(product_us, product);
  }
};

void judge(const char* what, const Figures& f, double usual) {
  const double products = f.work_us / f.product_us;
  std::printf("%-12s %7.1f us, a dense product of the same size %6.1f us: %.2f times (usual: %.2f)\n", what,
              f.work_us, f.product_us, products, usual);
  EXPECT_LT(products, gross * usual) << what << " has become much dearer";
}

TEST(ContactBench, DISABLED_AssemblyOfW) {
  Pressed p;
  const int contacts = p.scratch->rows.contacts;
  ASSERT_GE(contacts, 25);
  ASSERT_EQ(p.scratch->rows.rows_per_contact, 3);
  // A panel of 3 columns for each contact, then 3×3 blocks of it for each pair.
  const double flops = contacts * 36.0 * 3 * p.problem->nodes + 0.5 * contacts * (contacts + 1) * 180.0;
  const auto n = static_cast<Eigen::Index>(std::cbrt(flops / 2) + 0.5);
  const MatX A = MatX::Random(n, n), B = MatX::Random(n, n);
  MatX C(n, n);
  const Vec6 K_inv = inverse_stiffness(p.problem->instrument[0].coupling, 1e-3);
  Figures f;
  for (int k = 0; k < 300; ++k)
    f.take(us_of([&] { assemble_delassus(*p.problem, K_inv, p.scratch->rows); }),
           us_of([&] { C.noalias() = A * B; }));
  std::printf("%d contacts of %d nodes, a product of %d\n", contacts, p.problem->nodes, static_cast<int>(n));
  judge("W", f, 1.6);
}

TEST(ContactBench, DISABLED_ContactSolve) {
  Pressed p;
  const auto n = static_cast<Eigen::Index>(p.scratch->rows.rows());
  const MatX A = MatX::Random(n, n), B = MatX::Random(n, n);
  MatX C(n, n);
  Figures f;
  for (int k = 0; k < 300; ++k) f.take(us_of([&] { p.move(k); }), us_of([&] { C.noalias() = A * B; }));
  EXPECT_GE(p.solution.active, 1);
  std::printf("%d rows, %d contacts with a force\n", static_cast<int>(n), p.solution.active);
  judge("solve", f, 0.7);
}

}  // namespace
}  // namespace hapticd
