#include "tools/offline/contact_laws.h"

#include <algorithm>
#include <array>
#include <limits>

#include "physics/simulation/step/instrument_contact.h"

namespace hapticd {
namespace {

// The instrument that a node is nearest to; −1: none is there.
int nearest(const CondensedProblem& problem, Instruments instruments, const InstrumentPoses& present,
            int node) {
  int found = -1;
  double least = std::numeric_limits<double>::infinity();
  for (int i = 0; i < instruments.count(); ++i) {
    if (!present.present[i]) continue;
    const double gap =
        gap_at(instruments[i], problem.instrument[i].X_ref, problem.x_now[static_cast<std::size_t>(node)])
            .distance;
    if (gap >= least) continue;
    least = gap;
    found = i;
  }
  return found;
}

}  // namespace

double reciprocity_defect(const CondensedProblem& problem, Instruments instruments,
                          const InstrumentPoses& present) {
  std::array<int, max_patch_nodes> hand{};
  for (int n = 0; n < problem.nodes; ++n)
    hand[static_cast<std::size_t>(n)] = nearest(problem, instruments, present, n);
  const auto C = problem.C();
  double largest = 0, apart = 0;
  for (int i = 0; i < problem.nodes; ++i)
    for (int j = 0; j < i; ++j) {
      if (hand[static_cast<std::size_t>(i)] == hand[static_cast<std::size_t>(j)]) continue;
      const Mat3 ij = C.block<3, 3>(3 * i, 3 * j), ji = C.block<3, 3>(3 * j, 3 * i);
      largest = std::max({largest, ij.cwiseAbs().maxCoeff(), ji.cwiseAbs().maxCoeff()});
      apart = std::max(apart, (ij - ji.transpose()).cwiseAbs().maxCoeff());
    }
  return largest > 0 ? apart / largest : 0;
}

double third_law_defect(const CondensedProblem& problem, const ContactScratch& scratch,
                        const ContactSolution& solution) {
  Vec3 sum = Vec3::Zero();
  double magnitudes = 0;
  const auto add = [&](const Vec3& f) {
    sum += f;
    magnitudes += f.norm();
  };
  for (const Vec6& w : solution.wrench.value) add(w.head<3>());
  const VecX on_tissue = force_on_patch(problem, scratch);
  const bool pulled = is_pulled(problem);
  for (int n = 0; n < problem.nodes; ++n) {
    add(on_tissue.segment<3>(3 * n));
    if (pulled) add(problem.pull[static_cast<std::size_t>(n)]);
  }
  const ContactRows& rows = scratch.rows;
  for (int i = 0; i < rows.contacts; ++i) {
    const ContactRow& row = rows.row[static_cast<std::size_t>(i)];
    if (row.other >= 0 || row.edge >= 0) continue;
    if (!row.incision && problem.sample[static_cast<std::size_t>(row.sample)].node[0] >= 0) continue;
    Vec3 lambda = Vec3::Zero();
    for (int k = 0; k < rows.rows_per_contact; ++k)
      lambda[k] = scratch.lambda[static_cast<std::size_t>(rows.rows_per_contact * i + k)];
    add(row.frame * lambda);
  }
  return magnitudes > 0 ? sum.norm() / magnitudes : 0;
}

}  // namespace hapticd
