#include "physics/tissue/tissue.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <stdexcept>
#include <string>

#include "physics/tissue/element_lanes.h"
#include "physics/tissue/rotation.h"
#include "physics/tissue/surface.h"
#include "physics/tissue/tetrahedron.h"
#include "physics/tissue/volume_barrier.h"

namespace hapticd {

namespace {

void check_nodes(const TetMesh& mesh, int t) {
  const int nodes = static_cast<int>(mesh.nodes.size());
  for (const int n : mesh.tets[t])
    if (n < 0 || n >= nodes)
      throw std::invalid_argument("tetrahedron " + std::to_string(t) + " names node " + std::to_string(n) +
                                  " of " + std::to_string(nodes));
}

// What of F strains the tissue: RᵀF is symmetric already where R follows F; of a linear model only the
// symmetric part counts, the rest is its rotation.
Mat3 straining(const TissueModel& model, const Mat3& F) noexcept {
  return model.corotational ? F : Mat3(0.5 * (F + F.transpose()));
}

}  // namespace

TissueModel make_tissue_model(TetMesh mesh, const Material& material, std::span<const int> fixed_nodes,
                              const Vec3& gravity, MeshRoom room) {
  TissueModel model;
  model.mesh = std::move(mesh);
  model.material = material;
  model.gravity = gravity;
  model.gradients.reserve(model.tet_count());
  model.volume.reserve(model.tet_count());
  for (int t = 0; t < model.tet_count(); ++t) {
    check_nodes(model.mesh, t);
    const Tet& tet = model.mesh.tets[t];
    const auto& x = model.mesh.nodes;
    const RestShape shape = rest_shape(x[tet[0]], x[tet[1]], x[tet[2]], x[tet[3]]);
    if (!(shape.volume > 0) || !shape.gradients.allFinite())
      throw std::invalid_argument("tetrahedron " + std::to_string(t) + " has no positive volume (" +
                                  std::to_string(shape.volume * 1e9) + " mm³)");
    model.gradients.push_back(shape.gradients);
    model.volume.push_back(shape.volume);
  }
  model.nodes_in_use = model.node_count();
  model.tets_in_use = model.tet_count();
  model.mesh.nodes.resize(model.mesh.nodes.size() + static_cast<std::size_t>(room.nodes),
                          model.mesh.nodes.empty() ? Vec3(Vec3::Zero()) : model.mesh.nodes.front());
  model.mesh.tets.resize(model.mesh.tets.size() + static_cast<std::size_t>(room.tets), no_tet);
  model.gradients.resize(model.mesh.tets.size(), Gradients::Zero());
  model.volume.resize(model.mesh.tets.size(), 0.0);
  model.elastic.assign(model.mesh.tets.size(), elasticity(material));
  model.parent.resize(model.mesh.tets.size());
  std::iota(model.parent.begin(), model.parent.end(), 0);
  model.across = faces_across(model.mesh.tets);
  model.fixed.assign(model.node_count(), 0);
  for (const int n : fixed_nodes) {
    if (n < 0 || n >= model.node_count())
      throw std::invalid_argument("fixed node " + std::to_string(n) + " of " +
                                  std::to_string(model.node_count()));
    model.fixed[n] = 1;
  }
  return model;
}

// From nothing, so that a removal can never leave a rest of rounding errors.
void refresh_mass(const TissueModel& model, TissueState& state) {
  state.mass.assign(model.node_count(), 0.0);
  state.live_tets_of_node.assign(model.node_count(), 0);
  model.each_tet([&](int t) {
    if (!state.alive[t]) return;
    for (const int n : model.mesh.tets[t]) {
      state.mass[n] += 0.25 * model.elastic[t].density * volume_left(model, state, t);
      ++state.live_tets_of_node[n];
    }
  });
  if (!model.condensed) return;
  for (std::size_t i = 0; i < model.condensed->node.size(); ++i) {
    const int n = model.condensed->node[i];
    state.mass[n] += model.condensed->mass[i];
    ++state.live_tets_of_node[n];
  }
}

TissueState rest_state(const TissueModel& model) {
  TissueState state;
  state.x = model.mesh.nodes;
  state.v.assign(model.node_count(), Vec3::Zero());
  state.rotation.assign(model.tet_count(), Mat3::Identity());
  state.alive.assign(model.tet_count(), 0);
  std::fill_n(state.alive.begin(), model.tets_in_use, std::uint8_t{1});
  for (int t = 0; model.condensed && t < model.tets_in_use; ++t) state.alive[t] = !model.condensed->tet[t];
  state.left.assign(model.tet_count(), 1.0);
  if (model.material.law == Law::guarded) state.collapsed.reserve(model.tet_count());
  refresh_mass(model, state);
  return state;
}

namespace {

// Calls visit(tets, count, rotations) before and after each eight.
template <class Before, class After>
void rotate_all(const TissueModel& model, TissueState& state, const Before& before, const After& after) {
  if (!model.corotational) return;
  const bool guarded = model.material.law == Law::guarded;
  state.collapsed.clear();
  each_eight(model, state, [&](const int* tet, int count) {
    Lanes3x4 x, g;
    Lanes3x3 F;
    std::array<Mat3*, element_lanes> R;
    load_corners(
        model, tet, [&](int n) { return state.x[n].data(); }, x);
    load_gradients(model, tet, g);
    deformation_gradients(x, g, F);
    for (int l = 0; l < element_lanes; ++l) R[l] = &state.rotation[tet[l]];
    before(tet, count);
    nearest_rotations(F, R);
    after(tet, count);
    for (int l = 0; guarded && l < count; ++l) barrier(model, tet[l], F.matrix(l), state);
  });
}

}  // namespace

void update_rotations(const TissueModel& model, TissueState& state) noexcept {
  const auto nothing = [](const int*, int) {};
  rotate_all(model, state, nothing, nothing);
}

void update_rotations(const TissueModel& model, TissueState& state, std::vector<Mat3>& before, double turn,
                      std::vector<int>& far) {
  far.clear();
  before.resize(state.rotation.size());
  const double least = 1 + 2 * std::cos(turn);  // tr(beforeᵀ after) = 1 + 2 cos θ
  rotate_all(
      model, state,
      [&](const int* tet, int count) {
        for (int l = 0; l < count; ++l) before[tet[l]] = state.rotation[tet[l]];
      },
      [&](const int* tet, int count) {
        for (int l = 0; l < count; ++l)
          if (before[tet[l]].cwiseProduct(state.rotation[tet[l]]).sum() < least) far.push_back(tet[l]);
      });
}

void external_forces(const TissueModel& model, const TissueState& state, Eigen::Ref<VecX> f) noexcept {
  f.setZero();
  model.each_node([&](int n) {
    if (!model.fixed[n]) f.segment<3>(3 * n) = state.mass[n] * model.gravity;
  });
  for (std::size_t n = 0; n < state.load.size(); ++n)
    if (!model.fixed[n]) f.segment<3>(3 * static_cast<Eigen::Index>(n)) += state.load[n];
  if (!model.condensed) return;
  const CondensedTissue& of = *model.condensed;
  for (std::size_t i = 0; i < of.node.size(); ++i)
    f.segment<3>(3 * of.node[i]) += of.load.segment<3>(3 * static_cast<Eigen::Index>(i));
}

std::vector<std::uint8_t> tets_there(const TissueModel& model, const TissueState& state) {
  std::vector<std::uint8_t> there = state.alive;
  for (int t = 0; t < static_cast<int>(there.size()); ++t) there[t] = is_there(model, state, t);
  return there;
}

double elastic_energy(const TissueModel& model, const TissueState& state) noexcept {
  double energy = 0;
  for (int t = 0; t < model.tet_count(); ++t) {
    if (!state.alive[t]) continue;
    const Mat3 F =
        straining(model, deformation_gradient(corners_of(model.mesh.tets[t], state.x), model.gradients[t]));
    energy += element_energy(F, state.rotation[t], volume_left(model, state, t), model.elastic[t].mu,
                             model.elastic[t].lambda);
  }
  for (std::size_t n = 0; n < model.springs.size(); ++n)
    if (state.live_tets_of_node[n] > 0) energy += spring_energy(model.springs[n], state.x[n]);
  if (model.condensed) energy += model.condensed->energies(state, nullptr).sum();
  for (const Collapsed& c : state.collapsed)
    if (state.alive[c.tet]) energy += c.energy;
  return energy;
}

void thin_tets(const TissueModel& model, TissueState& state, std::span<const Thinned> tets) {
  if (tets.empty()) return;
  for (const Thinned& t : tets) state.left[t.tet] = t.left;
  ++state.thinnings;
  refresh_mass(model, state);
}

int remove_tets(const TissueModel& model, TissueState& state, std::span<const int> tets) {
  int removed = 0;
  for (const int t : tets) {
    if (!state.alive[t]) continue;
    state.alive[t] = 0;
    ++removed;
  }
  if (removed == 0) return 0;
  state.removed += removed;
  refresh_mass(model, state);
  for (int n = 0; n < model.node_count(); ++n)
    if (state.live_tets_of_node[n] == 0) state.v[n].setZero();
  return removed;
}

}  // namespace hapticd
