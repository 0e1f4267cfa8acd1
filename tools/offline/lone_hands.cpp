#include "tools/offline/lone_hands.h"

#include <map>

namespace hapticd {
namespace {

// Σ_{j ≠ i} f_j on the problem's nodes [N].
VecX force_of_others(const CondensedProblem& problem, const ContactScratch& step, int hand) {
  std::map<std::uint64_t, Vec3> of_sample;
  const ContactRows& rows = step.rows;
  for (int i = 0; i < rows.contacts; ++i) {
    const ContactRow& row = rows.row[static_cast<std::size_t>(i)];
    if (row.other >= 0 || row.instrument == hand) continue;
    Vec3 lambda = Vec3::Zero();
    for (int k = 0; k < rows.rows_per_contact; ++k)
      lambda[k] = step.lambda[static_cast<std::size_t>(rows.rows_per_contact * i + k)];
    of_sample.try_emplace(row.id, Vec3::Zero()).first->second += row.frame * lambda;
  }
  VecX f = VecX::Zero(3 * problem.nodes);
  for (int k = 0; k < problem.samples; ++k) {
    const PatchSample& s = problem.sample[static_cast<std::size_t>(k)];
    const auto found = s.node[0] < 0 ? of_sample.end() : of_sample.find(s.id);
    if (found == of_sample.end()) continue;
    for (std::size_t c = 0; c < 3; ++c) f.segment<3>(3 * s.node[c]) += s.weight[c] * found->second;
  }
  for (int k = 0; k < problem.edges; ++k) {
    const EdgeSample& e = problem.edge[static_cast<std::size_t>(k)];
    const auto found = of_sample.find(e.id);
    if (found == of_sample.end()) continue;
    for (std::size_t c = 0; c < 4; ++c) f.segment<3>(3 * e.node[c]) += e.weight[c] * found->second;
  }
  return f;
}

}  // namespace

LoneHands::LoneHands(Instruments instruments, const std::vector<DeviceSettings>& devices,
                     const HapticOptions& options) {
  for (int i = 0; i < instruments.count(); ++i) {
    hands_.push_back(std::make_unique<Hand>());
    hands_.back()->tick =
        std::make_unique<HapticTick>(instruments, devices, options, hands_.back()->problems);
  }
}

void LoneHands::publish(const CondensedProblem& problem, const ContactScratch& step) {
  for (std::size_t i = 0; i < hands_.size(); ++i) {
    CondensedProblem& own = hands_[i]->problems.back();
    own = problem;
    const VecX moved = problem.C() * force_of_others(problem, step, static_cast<int>(i));
    for (int n = 0; n < own.nodes; ++n) own.x_free[static_cast<std::size_t>(n)] += moved.segment<3>(3 * n);
    hands_[i]->problems.publish();
  }
}

EachInstrument<ForceSample> LoneHands::tick(const HapticInput& input) {
  EachInstrument<ForceSample> out;
  for (std::size_t k = 0; k < hands_.size(); ++k) {
    const int i = static_cast<int>(k);
    HapticInput own = input;
    for (int j = 0; j < max_instruments; ++j)
      if (j != i) own.device[j] = {};
    out[i] = hands_[k]->tick->run(own)[i];
  }
  return out;
}

}  // namespace hapticd
