#include "physics/compliance/node_turn.h"

#include <cmath>

#include "physics/tissue/rotation.h"

namespace hapticd {

NodeTurn::NodeTurn(const TissueModel& model)
    : model_(model), start_(model.node_count() + 1, 0), base_(model.tet_count(), Mat3::Identity()) {
  for (const Tet& tet : model.mesh.tets)
    for (const int n : tet) ++start_[n + 1];
  for (int n = 0; n < model.node_count(); ++n) start_[n + 1] += start_[n];
  tet_.resize(start_.back());
  std::vector<int> next(start_.begin(), start_.end() - 1);
  for (int t = 0; t < model.tet_count(); ++t)
    for (const int n : model.mesh.tets[t]) tet_[next[n]++] = t;
}

Mat3 NodeTurn::operator()(int node, const TissueState& state) const noexcept {
  Mat3 sum = Mat3::Zero();
  double volume = 0;
  for (int k = start_[node]; k < start_[node + 1]; ++k) {
    const int t = tet_[k];
    if (!state.alive[t]) continue;
    sum.noalias() += model_.volume[t] * state.rotation[t] * base_[t].transpose();
    volume += model_.volume[t];
  }
  return volume > 0 ? nearest_rotation(sum / volume, Mat3::Identity()) : Mat3::Identity();
}

double angle_of(const Mat3& rotation) noexcept {
  const Vec3 w(rotation(2, 1) - rotation(1, 2), rotation(0, 2) - rotation(2, 0),
               rotation(1, 0) - rotation(0, 1));
  return std::atan2(0.5 * w.norm(), 0.5 * (rotation.trace() - 1));
}

}  // namespace hapticd
