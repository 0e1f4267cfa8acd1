// Our contact solvers against Siconos, another group's: on problems of the cataract scene's own stroke, and
// on generated hard ones. Forces where they are unique, residuals otherwise.
#include <gtest/gtest.h>

#ifndef HAPTICD_SICONOS

TEST(Siconos, AgreesOnTheCataractStroke) { GTEST_SKIP() << "libsiconos-numerics-dev is not installed"; }
TEST(Siconos, AgreesOnGeneratedHardProblems) { GTEST_SKIP() << "libsiconos-numerics-dev is not installed"; }

#else

#include <FrictionContactProblem.h>
#include <Friction_cst.h>
#include <LCP_Solvers.h>
#include <LinearComplementarityProblem.h>
#include <NonSmoothDrivers.h>
#include <NumericsMatrix.h>
#include <SolverOptions.h>
#include <fc3d_Solvers.h>
#include <lcp_cst.h>

#include <Eigen/Eigenvalues>
#include <functional>
#include <memory>

#include "physics/contact/solver/coulomb.h"
#include "server/record/trajectory_reader.h"
#include "server/scene/scene_reader.h"
#include "server/scene/scene_world.h"
#include "tools/chart/solver/contact_sequence.h"
#include "tools/chart/solver/pgs_baseline.h"

namespace hapticd {
namespace {

struct Problem {
  MatX W;  // with the relative diagonal already added
  VecX q;
  std::vector<double> mu;  // empty: frictionless
};

constexpr double relative_diagonal = 1e-9;

MatX with_diagonal(const MatX& W, bool friction) {
  MatX A = W;
  if (!friction) {
    A.diagonal() *= 1 + relative_diagonal;
  } else {
    for (Eigen::Index i = 0; i < W.rows(); i += 3)
      A.diagonal().segment<3>(i).array() += relative_diagonal * W.diagonal().segment<3>(i).mean();
  }
  return A;
}

struct Agreement {
  int problems = 0, compared = 0, by_motion = 0, by_residual = 0, apart = 0, not_solved_by_them = 0,
      not_solved_by_us = 0;
  double worst_residual = 0, worst_force = 0, worst_motion = 0;
};

struct Options {
  explicit Options(int id) : of(solver_options_create(id)) {}
  ~Options() { solver_options_delete(of); }
  SolverOptions* of;
};

// Siconos's force, from zero; empty where it reports no convergence.
VecX siconos_friction(Problem p) {
  FrictionContactProblem problem{};
  problem.dimension = 3;
  problem.numberOfContacts = static_cast<int>(p.mu.size());
  problem.M =
      NM_create_from_data(NM_DENSE, static_cast<int>(p.q.size()), static_cast<int>(p.q.size()), p.W.data());
  problem.q = p.q.data();
  problem.mu = p.mu.data();
  VecX best;
  double least = 1e-8;
  for (const int id : {SICONOS_FRICTION_3D_NSN_AC, SICONOS_FRICTION_3D_NSGS}) {
    const Options options(id);
    options.of->dparam[SICONOS_DPARAM_TOL] = 1e-12;
    options.of->iparam[SICONOS_IPARAM_MAX_ITER] = id == SICONOS_FRICTION_3D_NSGS ? 3000 : 100;
    VecX reaction = VecX::Zero(p.q.size()), velocity = VecX::Zero(p.q.size());
    fc3d_driver(&problem, reaction.data(), velocity.data(), options.of);
    // Their tolerance is of another norm.
    if (!reaction.allFinite()) continue;
    const double residual = coulomb_residual(p.W, p.q, reaction, p.mu);
    if (residual < least) {
      least = residual;
      best = reaction;
    }
    if (least < 1e-9) break;
  }
  problem.M->matrix0 = nullptr;  // ours
  NM_clear(problem.M);
  free(problem.M);
  return best;
}

VecX siconos_frictionless(Problem p) {
  LinearComplementarityProblem problem{};
  problem.size = static_cast<int>(p.q.size());
  problem.M = NM_create_from_data(NM_DENSE, problem.size, problem.size, p.W.data());
  problem.q = p.q.data();
  const Options options(SICONOS_LCP_LEMKE);
  VecX z = VecX::Zero(p.q.size()), w = VecX::Zero(p.q.size());
  const int info = linearComplementarity_driver(&problem, z.data(), w.data(), options.of);
  problem.M->matrix0 = nullptr;
  NM_clear(problem.M);
  free(problem.M);
  return info == 0 && z.allFinite() && lcp_residual(p.W, p.q, z) < 1e-6 ? z : VecX();
}

// λ is unique to about 1/κ of its residual: compared where that leaves something to compare.
double condition(const MatX& W) {
  const Eigen::SelfAdjointEigenSolver<MatX> eigen(W, Eigen::EigenvaluesOnly);
  return eigen.eigenvalues().maxCoeff() / std::max(eigen.eigenvalues().minCoeff(), 1e-300);
}

void compare(const Problem& p, Agreement& a) {
  static const auto coulomb = std::make_unique<CoulombWorkspace>();
  static const auto lcp = std::make_unique<LcpWorkspace>();
  ++a.problems;
  VecX ours = VecX::Zero(p.q.size());
  double residual = 0;
  if (p.mu.empty()) {
    LcpOptions options;
    options.relative_diagonal = 0;
    std::vector<std::uint8_t> active(static_cast<std::size_t>(p.q.size()), 0);
    residual = solve_lcp(p.W, p.q, ours, active, *lcp, 0, options).residual;
    EXPECT_LE(residual, 1e-9);
  } else {
    CoulombOptions options;
    options.relative_diagonal = 0;
    options.tolerance = 1e-10;
    options.max_sweeps = 2000;
    options.max_newton = 1000;
    options.raised_diagonal = 0;
    residual = solve_coulomb(p.W, p.q, p.mu, ours, *coulomb, 0, options).residual;
    a.not_solved_by_us += residual > 1e-6;
  }
  a.worst_residual = std::max(a.worst_residual, residual);
  const VecX theirs = p.mu.empty() ? siconos_frictionless(p) : siconos_friction(p);
  if (theirs.size() == 0) {
    ++a.not_solved_by_them;
    return;
  }
  if (ours.norm() == 0 && theirs.norm() == 0) return;
  // Friction of large μ may have several solutions. With small μ the forces' effect W λ is one, and the
  // forces themselves are where W is definite; redundant contacts share them in many ways.
  const bool small_mu = p.mu.empty() || *std::max_element(p.mu.begin(), p.mu.end()) <= 0.3;
  if (!small_mu || residual > 1e-8) {
    ++a.by_residual;
    return;
  }
  const VecX apart = ours - theirs;
  const double motion = std::sqrt(std::max(0.0, apart.dot(p.W * apart)) / ours.dot(p.W * ours));
  a.worst_motion = std::max(a.worst_motion, motion);
  a.apart += motion > 1e-4;
  ++a.by_motion;
  if (condition(p.W) > 1e5) return;
  a.worst_force = std::max(a.worst_force, apart.norm() / ours.norm());
  EXPECT_LT(apart.norm(), 1e-4 * ours.norm());
  ++a.compared;
}

// Problems as the haptic loop meets them along the recorded stroke of the cataract scene.
void along_the_stroke(double seconds, int most, const std::function<void(const Problem&)>& visit) {
  const std::filesystem::path folder = std::filesystem::path(SOURCE_DIR) / "config/scenes/cataract";
  Scene scene = read_scene(folder / "cataract.yaml", "");
  scene.compliance = ComplianceMethod::exact;  // there is no thread here that makes bases
  const Trajectory stroke = read_trajectory(folder / "stroke.csv", LengthUnit::metre);
  const auto world = make_world(scene);
  const auto problem = std::make_unique<CondensedProblem>();
  const auto scratch = std::make_unique<ContactScratch>();
  ContactState state;
  ContactOptions options;
  options.whole_W = true;
  options.margin = 0.15 * scene.alarm_distance;
  constexpr int ticks = 20;
  int found = 0;
  for (double t = stroke.begin(); t < stroke.begin() + seconds && found < most; t += 0.02) {
    const auto pose = [&](double at) { return to_scene(scene.first().device, sample_at(stroke, at)); };
    const std::uint32_t buttons = buttons_at(stroke, t);
    world->step(
        [&] {
          return InstrumentSample{pose(t), true, (buttons & pedal_phaco) != 0,
                                  (buttons & pedal_aspiration) != 0};
        },
        *problem);
    for (int tick = 1; tick <= ticks; ++tick) {
      const ContactSolution out =
          solve_contact(*problem, scene.first().shape, pose(t + 1e-3 * tick), 1e-3, options, state, *scratch);
      if (out.active == 0 || tick % 5 != 0) continue;
      const ContactRows& rows = scratch->rows;
      const bool friction = rows.rows_per_contact == 3;
      Problem p{with_diagonal(rows.W(), friction), rows.q(), {}};
      if (friction) p.mu.assign(scratch->mu.begin(), scratch->mu.begin() + rows.contacts);
      visit(p);
      ++found;
    }
  }
}

void report(const char* what, const Agreement& a) {
  std::printf(
      "  %s: %d problems; forces compared %d (worst %.1e), by what they move %d (worst %.1e), by residual "
      "alone %d; apart by 1e-4 %d; not solved by Siconos %d, by us %d; our worst residual %.1e\n",
      what, a.problems, a.compared, a.worst_force, a.by_motion, a.worst_motion, a.by_residual, a.apart,
      a.not_solved_by_them, a.not_solved_by_us, a.worst_residual);
}

TEST(Siconos, AgreesOnTheCataractStroke) {
  Agreement a;
  along_the_stroke(12, 1100, [&](const Problem& p) { compare(p, a); });
  report("cataract", a);
  EXPECT_GE(a.problems, 1000);
  EXPECT_LT(a.not_solved_by_them, a.problems / 2);
  EXPECT_EQ(a.not_solved_by_us, 0);
  EXPECT_EQ(a.apart, 0);
}

TEST(Siconos, AgreesOnGeneratedHardProblems) {
  for (const bool friction : {false, true})
    for (std::size_t kind = 0; kind <= static_cast<std::size_t>(ContactCase::ill_conditioned); ++kind) {
      Agreement a;
      SequenceSettings settings;
      settings.kind = static_cast<ContactCase>(kind);
      settings.contacts = 12;
      settings.friction = friction;
      settings.seed = 7;
      ContactSequence sequence(settings);
      VecX reference;
      const auto workspace = std::make_unique<CoulombWorkspace>();
      const auto lcp = std::make_unique<LcpWorkspace>();
      for (int step = 0; step < 2000; ++step) {
        sequence.advance(reference);
        sequence.carry(reference);
        if (reference.size() == 0) reference = VecX::Zero(sequence.rows());
        if (friction) {
          solve_coulomb(sequence.W(), sequence.q(), sequence.mu(), reference, *workspace, sequence.version(),
                        {});
        } else {
          std::vector<std::uint8_t> active(static_cast<std::size_t>(sequence.rows()), 0);
          solve_lcp(sequence.W(), sequence.q(), reference, active, *lcp, sequence.version(), {});
        }
        if (step % 13 != 0 || reference.isZero(0)) continue;
        compare({with_diagonal(sequence.W(), friction), sequence.q(),
                 friction ? sequence.mu() : std::vector<double>{}},
                a);
      }
      report(contact_case_names()[kind].c_str(), a);
      EXPECT_GT(a.problems, 20) << contact_case_names()[kind];
      EXPECT_LE(a.not_solved_by_us, a.not_solved_by_them) << contact_case_names()[kind];
      EXPECT_EQ(a.apart, 0) << contact_case_names()[kind];
    }
}

}  // namespace
}  // namespace hapticd

#endif
