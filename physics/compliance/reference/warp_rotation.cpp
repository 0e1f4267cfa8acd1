#include "physics/compliance/reference/warp_rotation.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "physics/tissue/fragments.h"
#include "physics/tissue/rotation.h"

namespace hapticd {

namespace {

constexpr int lanes = 8;  // nodes side by side, so that the compiler may use vector registers
constexpr int most_steps = 8;
constexpr double near_rotation = 0.5;  // ‖MᵀM − I‖ below which Newton–Schulz converges fast

struct Lanes {
  double m[9][lanes];  // entries of column-major 3×3 matrices
};

// R ← R − ½ R (RᵀR − I) on each lane; size[l] = ‖RᵀR − I‖² before the step.
void newton_schulz(Lanes& R, double* size) noexcept {
  for (int l = 0; l < lanes; ++l) {
    double e[3][3];
    double sum = 0;
    for (int i = 0; i < 3; ++i)
      for (int j = 0; j <= i; ++j) {
        double dot = i == j ? -1.0 : 0.0;
        for (int k = 0; k < 3; ++k) dot += R.m[3 * i + k][l] * R.m[3 * j + k][l];
        e[i][j] = e[j][i] = dot;
        sum += (i == j ? 1 : 2) * dot * dot;
      }
    size[l] = sum;
    for (int k = 0; k < 3; ++k) {
      const double r[3] = {R.m[k][l], R.m[3 + k][l], R.m[6 + k][l]};
      for (int j = 0; j < 3; ++j)
        R.m[3 * j + k][l] = r[j] - 0.5 * (r[0] * e[0][j] + r[1] * e[1][j] + r[2] * e[2][j]);
    }
  }
}

// The rotations nearest to sums of rotations, M[0 … lanes): scaled to the norm of one, such a sum is near its
// polar factor unless the rotations disagree widely, and Newton–Schulz finds that without a branch.
void nearest_to_sums(Mat3* M) noexcept {
  Lanes R;
  for (int l = 0; l < lanes; ++l) {
    const double norm = M[l].norm();
    const double scale = norm > 0 ? std::sqrt(3.0) / norm : 0;
    for (int i = 0; i < 9; ++i) R.m[i][l] = scale * M[l].data()[i];
  }
  double size[lanes];
  bool near[lanes];
  newton_schulz(R, size);
  double worst = 0;
  for (int l = 0; l < lanes; ++l) {
    near[l] = size[l] < near_rotation * near_rotation && M[l].determinant() > 0;
    if (near[l]) worst = std::max(worst, size[l]);
  }
  // A step squares ‖RᵀR − I‖.
  for (int step = 1; step < most_steps && worst > 1e-16; ++step) {
    newton_schulz(R, size);
    worst = 0;
    for (int l = 0; l < lanes; ++l)
      if (near[l]) worst = std::max(worst, size[l]);
  }
  for (int l = 0; l < lanes; ++l) {
    if (!near[l])
      M[l] = nearest_rotation(M[l], Mat3::Identity());
    else
      for (int i = 0; i < 9; ++i) M[l].data()[i] = R.m[i][l];
  }
}

}  // namespace

WarpRotation::WarpRotation(const TissueModel& model)
    : model_(model),
      first_(model.node_count(), -1),
      next_(4 * model.tet_count(), -1),
      corners_(model.tet_count(), no_tet),
      reference_(model.tet_count(), Mat3::Identity()),
      known_(model.tets_in_use) {
  for (int t = known_ - 1; t >= 0; --t) link(t);
}

// Each corner that is not yet in its node's list goes from the list where it is to the head of that one.
void WarpRotation::link(int t) {
  for (int a = 0; a < 4; ++a) {
    const int corner = 4 * t + a;
    const int node = model_.mesh.tets[t][a];
    if (corners_[t][a] == node) continue;
    if (corners_[t][a] >= 0) {
      int* at = &first_[corners_[t][a]];
      while (*at != corner) at = &next_[*at];
      *at = next_[corner];
    }
    corners_[t][a] = node;
    next_[corner] = first_[node];
    first_[node] = corner;
  }
}

void WarpRotation::inherit_reference(int t) {
  int from = t;
  while (from >= known_ && model_.parent[from] != from) from = model_.parent[from];
  reference_[t] = reference_[from];
}

void WarpRotation::set_reference(const std::vector<Mat3>& rotation, int known) {
  reference_ = rotation;
  known_ = known;
  for (int t = known; t < model_.tets_in_use; ++t) inherit_reference(t);
}

void WarpRotation::reshape(std::span<const int> tets) {
  for (const int t : tets) {
    link(t);
    if (t >= known_) inherit_reference(t);
  }
  piece_of_tet_.clear();
  removed_ = -1;
}

template <class Use>
void WarpRotation::each_around(int node, const TissueState& state, const Use& use) const {
  for (int k = first_[node]; k >= 0; k = next_[k])
    if (state.alive[k / 4]) use(k / 4);
}

Mat3 WarpRotation::operator()(int node, const TissueState& state) const noexcept {
  Mat3 sum = Mat3::Zero();
  each_around(node, state, [&](int t) {
    sum.noalias() += model_.volume[t] * state.rotation[t] * reference_[t].transpose();
  });
  return nearest_rotation(sum, Mat3::Identity());  // of nothing: the identity
}

void WarpRotation::all(Warping warping, const TissueState& state, std::vector<Mat3>& Q) {
  switch (warping) {
    case Warping::none:
      Q.assign(model_.node_count(), Mat3::Identity());
      break;
    case Warping::node:
      by_node(state, Q);
      break;
    case Warping::piece:
      by_piece(state, Q);
      break;
  }
}

// Whether what went since the pieces were found has cut none of them, as far as the tetrahedra around it
// tell: where those that are left around a removed one's nodes still join these nodes, any path through it
// can go round. Then it only leaves its piece. False is no proof of a cut.
bool WarpRotation::still_whole(const TissueState& state) {
  if (piece_of_tet_.empty()) return false;
  for (int t = 0; t < model_.tet_count(); ++t) {
    if (state.alive[t] || piece_of_tet_[t] < 0) continue;
    if (!joined_around(model_.mesh.tets[t], state)) return false;
    piece_of_tet_[t] = -1;
    for (const int n : model_.mesh.tets[t])
      if (state.live_tets_of_node[n] == 0) piece_of_node_[n] = -1;
  }
  return true;
}

bool WarpRotation::joined_around(const Tet& tet, const TissueState& state) {
  // Union–find over the nodes of the live tetrahedra around; `parent_` is the identity between calls.
  const auto root = [this](int n) {
    while (parent_[n] != n) n = parent_[n] = parent_[parent_[n]];
    return n;
  };
  if (parent_.empty()) {
    parent_.resize(model_.node_count());
    std::iota(parent_.begin(), parent_.end(), 0);
  }
  const auto around = [&](auto&& use) {
    for (const int n : tet) each_around(n, state, [&](int t) { use(model_.mesh.tets[t]); });
  };
  around([&](const Tet& other) {
    for (int a = 1; a < 4; ++a) parent_[root(other[a])] = root(other[0]);
  });
  int joined = -1;
  bool one = true;
  for (const int n : tet) {
    if (state.live_tets_of_node[n] == 0) continue;
    if (joined < 0) joined = root(n);
    one = one && root(n) == joined;
  }
  around([&](const Tet& other) {
    for (const int n : other) parent_[n] = n;
  });
  return one;
}

void WarpRotation::by_piece(const TissueState& state, std::vector<Mat3>& Q) {
  if (removed_ != state.removed && !still_whole(state)) {
    piece_of_tet_ = label_pieces(model_, state);
    piece_of_node_.assign(model_.node_count(), -1);
    int pieces = 0;
    for (int t = 0; t < model_.tet_count(); ++t) {
      if (piece_of_tet_[t] < 0) continue;
      pieces = std::max(pieces, piece_of_tet_[t] + 1);
      for (const int n : model_.mesh.tets[t]) piece_of_node_[n] = piece_of_tet_[t];
    }
    sum_.resize(pieces);
  }
  removed_ = state.removed;
  std::fill(sum_.begin(), sum_.end(), Mat3::Zero());
  for (int t = 0; t < model_.tet_count(); ++t)
    if (piece_of_tet_[t] >= 0)
      sum_[piece_of_tet_[t]].noalias() += (model_.volume[t] * state.rotation[t]) * reference_[t].transpose();
  for (Mat3& sum : sum_) sum = nearest_rotation(sum, Mat3::Identity());
  Q.resize(model_.node_count());
  for (int n = 0; n < model_.node_count(); ++n)
    Q[n] = piece_of_node_[n] >= 0 ? sum_[piece_of_node_[n]] : Mat3::Identity();
}

void WarpRotation::by_node(const TissueState& state, std::vector<Mat3>& Q) const {
  const int nodes = model_.node_count();
  Q.assign((nodes + lanes - 1) / lanes * lanes, Mat3::Zero());
  for (int t = 0; t < model_.tet_count(); ++t) {
    if (!state.alive[t]) continue;
    const Mat3 turn = (model_.volume[t] * state.rotation[t]) * reference_[t].transpose();
    for (const int n : model_.mesh.tets[t]) Q[n] += turn;
  }
  for (std::size_t n = 0; n < Q.size(); n += lanes) nearest_to_sums(&Q[n]);
  Q.resize(nodes);
}

double angle_of(const Mat3& rotation) noexcept {
  const Vec3 w(rotation(2, 1) - rotation(1, 2), rotation(0, 2) - rotation(2, 0),
               rotation(1, 0) - rotation(0, 1));
  return std::atan2(0.5 * w.norm(), 0.5 * (rotation.trace() - 1));
}

}  // namespace hapticd
