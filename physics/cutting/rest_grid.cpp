#include "physics/cutting/rest_grid.h"

#include <algorithm>
#include <cmath>

namespace hapticd {

namespace {

constexpr int most_cells = 64;  // along an axis

Eigen::AlignedBox3d box_of(const TissueModel& model, int tet) noexcept {
  Eigen::AlignedBox3d box;
  for (const int n : model.mesh.tets[tet]) box.extend(model.mesh.nodes[n]);
  return box;
}

double mean_edge_of(const TissueModel& model) {
  double sum = 0;
  for (int t = 0; t < model.tets_in_use; ++t)
    for (int a = 0; a < 4; ++a)
      for (int b = 0; b < a; ++b)
        sum += (model.mesh.nodes[model.mesh.tets[t][a]] - model.mesh.nodes[model.mesh.tets[t][b]]).norm();
  return model.tets_in_use > 0 ? sum / (6.0 * model.tets_in_use) : 1;
}

template <typename Visit>
void each_cell(const std::array<int, 3>& cells, const std::array<int, 3>& low, const std::array<int, 3>& high,
               const Visit& visit) {
  for (int k = low[2]; k <= high[2]; ++k)
    for (int j = low[1]; j <= high[1]; ++j)
      for (int i = low[0]; i <= high[0]; ++i) visit(i + cells[0] * (j + cells[1] * k));
}

}  // namespace

RestGrid::RestGrid(const TissueModel& model)
    : mean_edge_(mean_edge_of(model)),
      root_(model.mesh.tets.size()),
      next_(model.mesh.tets.size(), -1),
      asked_(model.mesh.tets.size(), 0) {
  for (int n = 0; n < model.nodes_in_use; ++n) box_.extend(model.mesh.nodes[n]);
  for (int axis = 0; axis < 3; ++axis) {
    const double size = box_.isEmpty() ? mean_edge_ : std::max(box_.sizes()[axis], mean_edge_);
    cells_[axis] = std::clamp(static_cast<int>(size / mean_edge_), 1, most_cells);
    cell_size_[axis] = size / cells_[axis];
  }
  first_.assign(cells_[0] * cells_[1] * cells_[2] + 1, 0);
  const auto each = [&](const auto& visit) {
    for (int t = 0; t < model.tets_in_use; ++t) {
      const Eigen::AlignedBox3d box = box_of(model, t);
      each_cell(cells_, cell_of(box.min()), cell_of(box.max()), [&](int cell) { visit(cell, t); });
    }
  };
  each([&](int cell, int) { ++first_[cell + 1]; });
  for (std::size_t c = 1; c < first_.size(); ++c) first_[c] += first_[c - 1];
  roots_.resize(first_.back());
  std::vector<int> filled(first_.begin(), first_.end() - 1);
  each([&](int cell, int t) { roots_[filled[cell]++] = t; });
  follow(model);
}

std::array<int, 3> RestGrid::cell_of(const Vec3& p) const noexcept {
  std::array<int, 3> cell;
  for (int axis = 0; axis < 3; ++axis)
    cell[axis] = static_cast<int>(
        std::clamp(std::floor((p[axis] - box_.min()[axis]) / cell_size_[axis]), 0.0, cells_[axis] - 1.0));
  return cell;
}

void RestGrid::follow(const TissueModel& model) noexcept {
  for (; followed_ < model.tets_in_use; ++followed_) {
    const int t = followed_;
    root_[t] = model.parent[t] == t ? t : root_[model.parent[t]];
    if (root_[t] == t) continue;
    next_[t] = next_[root_[t]];
    next_[root_[t]] = t;
  }
}

void RestGrid::find(const TissueModel& model, const TissueState& state, const Eigen::AlignedBox3d& box,
                    std::vector<int>& tets) noexcept {
  follow(model);
  ++query_;
  tets.clear();
  if (!box.intersects(box_)) return;
  each_cell(cells_, cell_of(box.min()), cell_of(box.max()), [&](int cell) {
    for (int k = first_[cell]; k < first_[cell + 1]; ++k) {
      if (asked_[roots_[k]] == query_) continue;
      asked_[roots_[k]] = query_;
      for (int t = roots_[k]; t >= 0; t = next_[t])
        if (state.alive[t] && box_of(model, t).intersects(box)) tets.push_back(t);
    }
  });
  std::sort(tets.begin(), tets.end());
}

}  // namespace hapticd
