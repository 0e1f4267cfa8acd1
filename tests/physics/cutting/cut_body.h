// A body that is cut in a test: model, state and all that follows cuts.
#pragma once

#include <gtest/gtest.h>

#include <random>
#include <set>
#include <utility>
#include <vector>

#include "physics/cutting/mesh_check.h"
#include "physics/cutting/opening.h"
#include "physics/cutting/subdivision.h"
#include "physics/tissue/fragments.h"
#include "tests/support/mesh_shapes.h"

namespace hapticd {

struct CutBody {
  TissueModel model;
  TissueState state;
  CutWorkspace work;
  TopologyChange change;
  BoundarySurface surface;

  CutBody(TetMesh mesh, MeshRoom room, const std::vector<int>& fixed = {}, Law law = Law::corotational)
      : model(make_tissue_model(std::move(mesh), material(law), fixed, Vec3::Zero(), room)),
        state(rest_state(model)),
        work(model),
        change(model),
        surface(model.mesh) {}

  static Material material(Law law) {
    Material m{3e3, 0.4, 1000, 0, 0};
    m.law = law;
    return m;
  }

  CutStatus open(std::span<const int> faces) {
    change.clear();
    const CutStatus status = open_faces(model, state, work, faces, change);
    surface.follow(model, change.tets, change.opened);
    return status;
  }

  CutStatus split(int a, int b, double s, double bound = 0) {
    change.clear();
    const CutStatus status = split_edge(model, state, work, {a, b, s}, bound, change);
    surface.follow(model, change.tets, change.opened);
    return status;
  }

  void remove(const std::vector<int>& tets) {
    remove_tets(model, state, tets);
    surface.remove(tets);
  }

  // Every node of a smooth bend, stretch and twist, and the rotations that follow it.
  void deform() {
    for (int n = 0; n < model.nodes_in_use; ++n) {
      const Vec3 X = model.mesh.nodes[n];
      state.x[n] = X + 0.2 * Vec3(X.y() * X.z(), X.x() * X.x() - X.z(), std::sin(2 * X.x()) + X.y() * X.y());
      state.v[n] = 0.1 * Vec3(X.z(), X.x(), -X.y());
    }
    update_rotations(model, state);
  }

  double volume() const {
    double sum = 0;
    for (int t = 0; t < model.tets_in_use; ++t)
      if (state.alive[t]) sum += model.volume[t];
    return sum;
  }

  double mass() const {
    double sum = 0;
    for (const double m : state.mass) sum += m;
    return sum;
  }

  Vec3 momentum() const {
    Vec3 sum = Vec3::Zero();
    for (int n = 0; n < model.node_count(); ++n) sum += state.mass[n] * state.v[n];
    return sum;
  }

  VecX forces() const {
    VecX f(3 * model.node_count());
    internal_forces(model, state, f);
    return f;
  }

  int fragments() const { return static_cast<int>(find_fragments(model, state).size()); }
  int pieces() const { return find_pieces(model, state).count(); }
  std::string check() { return check_mesh(model, state, work, &surface); }

  // One id of each inner face whose nodes all are where `on` says so.
  template <typename On>
  std::vector<int> inner_faces(const On& on) const {
    std::vector<int> faces;
    for (int id = 0; id < 4 * model.tets_in_use; ++id) {
      if (model.across[id] < id || !state.alive[id / 4] || !state.alive[model.across[id] / 4]) continue;
      const Triangle t = outward_face(model.mesh.tets[id / 4], id % 4);
      if (std::all_of(t.begin(), t.end(), [&](int n) { return on(model.mesh.nodes[n]); }))
        faces.push_back(id);
    }
    return faces;
  }

  double area(const Triangle& t) const {
    const Vec3& a = model.mesh.nodes[t[0]];
    return 0.5 * (model.mesh.nodes[t[1]] - a).cross(model.mesh.nodes[t[2]] - a).norm();
  }

  double cut_area() const {
    double sum = 0;
    for (const SurfaceFace& face : surface.faces())
      if (face.cut) sum += area(face.nodes);
    return sum;
  }

  double surface_area() const {
    double sum = 0;
    for (const SurfaceFace& face : surface.faces()) sum += area(face.nodes);
    return sum;
  }

  std::pair<int, int> random_edge(std::mt19937& random) const {
    for (;;) {
      const int t = static_cast<int>(random() % model.tets_in_use);
      if (!state.alive[t]) continue;
      const int a = static_cast<int>(random() % 4);
      return {model.mesh.tets[t][a], model.mesh.tets[t][(a + 1 + random() % 3) % 4]};
    }
  }
};

// Of what a refused cut must leave as it was.
inline void expect_same(const CutBody& a, const CutBody& b) {
  EXPECT_EQ(a.model.mesh.nodes, b.model.mesh.nodes);
  EXPECT_EQ(a.model.mesh.tets, b.model.mesh.tets);
  EXPECT_EQ(a.model.across, b.model.across);
  EXPECT_EQ(a.model.parent, b.model.parent);
  EXPECT_EQ(a.model.volume, b.model.volume);
  EXPECT_EQ(a.model.nodes_in_use, b.model.nodes_in_use);
  EXPECT_EQ(a.model.tets_in_use, b.model.tets_in_use);
  EXPECT_EQ(a.state.x, b.state.x);
  EXPECT_EQ(a.state.alive, b.state.alive);
  EXPECT_EQ(a.state.mass, b.state.mass);
  EXPECT_EQ(a.state.live_tets_of_node, b.state.live_tets_of_node);
  EXPECT_EQ(a.work.held_open, b.work.held_open);
}

}  // namespace hapticd
