// Faces break by the tension across them.
#include "physics/cutting/breaking.h"

#include <algorithm>
#include <numeric>
#include <set>
#include <utility>

#include <gtest/gtest.h>
#include <Eigen/Cholesky>

#include "physics/compliance/compliance.h"
#include "physics/cutting/mesh_check.h"
#include "physics/cutting/opening.h"
#include "physics/cutting/opening_energy.h"
#include "physics/tissue/fragments.h"
#include "tests/support/mesh_shapes.h"

namespace hapticd {
namespace {

constexpr double young = 2e4, size = 10e-3;

struct Bar {
  TissueModel model = make_tissue_model(box_mesh({4 * size, size, size}, 8, 2, 2), {young, 0, 1000, 0, 0}, {},
                                        Vec3::Zero(), {200, 0});
  TissueState state = rest_state(model);
  BoundarySurface surface{model.mesh};
  CutWorkspace work{model};

  // Uniform: x = (1 + G) X.
  void strain(const Mat3& G) {
    for (int n = 0; n < model.node_count(); ++n) state.x[n] = model.mesh.nodes[n] + G * model.mesh.nodes[n];
    update_rotations(model, state);
  }
  std::vector<int> broken(double toughness, int most = 1000) {
    return faces_that_break(model, state, surface, work,
                            {.toughness = toughness, .most = most, .begins = true});
  }
  Vec3 normal(int face) const {
    const Triangle n = outward_face(model.mesh.tets[face / 4], face % 4);
    const auto& X = model.mesh.nodes;
    return (X[n[1]] - X[n[0]]).cross(X[n[2]] - X[n[0]]).normalized();
  }
};

Mat3 along_x(double strain) {
  Mat3 G = Mat3::Zero();
  G(0, 0) = strain;
  return G;
}

// σ = E e across the bar: a release in the square of both, whatever way the bar has turned, and none where it
// is pressed. Those across it break first.
TEST(Breaking, AFaceReleasesTheSquareOfTheTensionAcrossIt) {
  Bar bar;
  bar.strain(along_x(0.1));
  const std::vector<int> first = bar.broken(1e-3, 1);
  ASSERT_EQ(first.size(), 1u);
  EXPECT_NEAR(std::abs(bar.normal(first[0]).x()), 1, 1e-12);
  const double at = release_of_face(bar.model, bar.state, first[0]);
  bar.strain(along_x(0.2));
  EXPECT_NEAR(release_of_face(bar.model, bar.state, first[0]) / at, 4, 1e-9);

  const Mat3 turn = Eigen::AngleAxisd(1.0, Vec3(1, 2, 3).normalized()).toRotationMatrix();
  for (Vec3& x : bar.state.x) x = turn * x;
  for (Mat3& R : bar.state.rotation) R = turn * R;
  EXPECT_NEAR(release_of_face(bar.model, bar.state, first[0]) / at, 4, 1e-9);

  bar.strain(along_x(-0.2));
  EXPECT_EQ(release_of_face(bar.model, bar.state, first[0]), 0);
  EXPECT_TRUE(bar.broken(1e-12).empty());
}

// At most so many, of which the first has an edge on the surface, and every other one on those
// before it, too.
TEST(Breaking, FromTheSurfaceAndAtMostSoMany) {
  Bar bar;
  bar.strain(along_x(0.1));
  EXPECT_EQ(bar.broken(1e-12, 3).size(), 3u);
  EXPECT_TRUE(bar.broken(1e9).empty());
  std::set<std::pair<int, int>> edges;
  const auto for_edges = [](const Triangle& n, const auto& f) {
    for (int k = 0; k < 3; ++k) f(std::minmax(n[k], n[(k + 1) % 3]));
  };
  for (const SurfaceFace& f : bar.surface.faces())
    for_edges(f.nodes, [&](const auto& e) { edges.insert(e); });
  const std::vector<int> faces = bar.broken(1e-12);
  EXPECT_GT(faces.size(), 8u);
  for (const int face : faces) {
    const Triangle n = outward_face(bar.model.mesh.tets[face / 4], face % 4);
    int open = 0;
    for_edges(n, [&](const auto& e) { open += edges.contains(e); });
    EXPECT_GE(open, 1);
    for_edges(n, [&](const auto& e) { edges.insert(e); });
  }
}

// Looked at bit by bit, in one size of one place a call, the same faces break as at once; and where none do,
// nobody looks again before tension has grown.
TEST(Breaking, BitByBitTheSameFacesBreakAsAtOnce) {
  Bar bar;
  for (int n = 0; n < bar.model.nodes_in_use; ++n) {
    const double x = bar.model.mesh.nodes[n].x();
    bar.model.fixed[n] = x < 1e-9 || x > 4 * size - 1e-9;
  }
  bar.strain(along_x(0.05));
  int calls = 0, most = 0;
  for (const double toughness : {0.02, 0.2, 0.5, 0.8, 1.0, 3.0}) {
    const TearSettings settings{.toughness = toughness, .most = 2, .begins = true};
    const std::vector<int> at_once = faces_that_break(bar.model, bar.state, bar.surface, bar.work, settings);
    RefusedBreaks refused;
    std::vector<int> found;
    for (calls = 0; found.empty() && refused.until == 0 && calls < 2000; ++calls)
      found = faces_that_break(bar.model, bar.state, bar.surface, bar.work, settings, {}, &refused);
    EXPECT_EQ(found, at_once) << toughness;
    EXPECT_EQ(refused.until > 0, at_once.empty()) << toughness;
    most = std::max(most, calls);
  }
  EXPECT_GT(most, 5) << "it was looked at bit by bit";
}

// Step by step a crack goes in from the surface until the bar is in pieces, and the mesh is valid throughout.
TEST(Breaking, ACrackGoesFromTheSurfaceThroughTheBar) {
  Bar bar;
  bar.strain(along_x(0.1));
  TopologyChange change(bar.model);
  int pieces = 1;
  for (int step = 0; step < 200 && pieces < 2; ++step) {
    const std::vector<int> faces = bar.broken(1e-3, 4);
    ASSERT_FALSE(faces.empty()) << step;
    change.clear();
    ASSERT_EQ(open_faces(bar.model, bar.state, bar.work, faces, change), CutStatus::done);
    bar.surface.follow(bar.model, change.tets, change.opened);
    pieces = find_pieces(bar.model, bar.state).count();
  }
  EXPECT_EQ(pieces, 2);
  for (const Fragment& f : find_fragments(bar.model, bar.state)) EXPECT_GT(f.tets.size(), 1u);
  EXPECT_EQ(check_mesh(bar.model, bar.state, bar.work, &bar.surface), "");
}

// A bar between clamps L apart, strained by e, holds ½ E e² of energy in its volume and gives all of it back
// when it comes apart across: its tension is enough (c l > L/2), yet it opens if ½ E e² L > J, and all of it
// then.
TEST(Breaking, NothingOpensForLessThanItsToughness) {
  constexpr double e = 0.05, energy = 0.5 * young * e * e * 4 * size;  // [J/m²]
  Bar bar;
  for (int n = 0; n < bar.model.nodes_in_use; ++n) {
    const double x = bar.model.mesh.nodes[n].x();
    bar.model.fixed[n] = x < 1e-9 || x > 4 * size - 1e-9;
  }
  bar.strain(along_x(e));
  TearSettings settings{.most = 8, .begins = true};
  settings.clefts.resize(4 * bar.model.mesh.tets.size(), 0);
  std::vector<int> across;
  for (int id = 0; id < 4 * bar.model.tets_in_use; ++id) {
    const Triangle n = outward_face(bar.model.mesh.tets[id / 4], id % 4);
    if (std::any_of(n.begin(), n.end(),
                    [&](int k) { return std::abs(bar.model.mesh.nodes[k].x() - 2 * size) > 1e-9; }))
      continue;
    settings.clefts[id] = 1;
    if (bar.model.across[id] > id) across.push_back(id);
  }
  const OpeningEnergy all = energy_of_opening(bar.model, bar.state, bar.work, across, {}, 1.05 * energy);
  EXPECT_NEAR(all.area, size * size, 1e-12);
  EXPECT_LE(all.released, energy * size * size * (1 + 1e-9));
  EXPECT_GE(all.released, energy * size * size * 0.99);
  // Contacts that hold the nodes along the bar keep it together; across it, they do not.
  VecX along = VecX::Zero(3 * bar.model.node_count()), aside = along;
  for (int n = 0; n < bar.model.node_count(); ++n) along[3 * n] = aside[3 * n + 1] = 0.1;
  const auto held = [&](const VecX& pressed) {
    return energy_of_opening(bar.model, bar.state, bar.work, across, pressed, 1.05 * energy).released;
  };
  EXPECT_LT(held(along), 1e-9 * energy * size * size);
  EXPECT_GE(held(aside), energy * size * size * 0.99);

  const auto broken = [&](double toughness) {
    settings.toughness = toughness;
    return faces_that_break(bar.model, bar.state, bar.surface, bar.work, settings);
  };
  EXPECT_GT(release_of_face(bar.model, bar.state, across[0]), 1.2 * energy);
  EXPECT_TRUE(broken(1.01 * energy).empty());
  EXPECT_EQ(broken(0.98 * energy).size(), across.size());
  settings.most = 1;  // together they pay
  EXPECT_EQ(broken(0.98 * energy).size(), across.size());
}

// A bar of which half lies beyond the nodes nearby: its compliance tells what that gives back.
TEST(Breaking, WhatLiesFarReleasesToo) {
  constexpr double e = 0.05, length = 12 * size, energy = 0.5 * young * e * e * length;  // [J/m²]
  TissueModel model = make_tissue_model(box_mesh({length, size, size}, 24, 6, 6), {young, 0, 1000, 0, 0}, {},
                                        Vec3::Zero(), {100, 0});
  TissueState state = rest_state(model);
  CutWorkspace work(model);
  for (int n = 0; n < model.nodes_in_use; ++n) {
    const double x = model.mesh.nodes[n].x();
    model.fixed[n] = x < 1e-9 || x > length - 1e-9;
    state.x[n].x() += e * x;
  }
  update_rotations(model, state);
  std::vector<int> across;
  for (int id = 0; id < 4 * model.tets_in_use; ++id) {
    const Triangle n = outward_face(model.mesh.tets[id / 4], id % 4);
    if (model.across[id] > id && std::all_of(n.begin(), n.end(), [&](int k) {
          return std::abs(model.mesh.nodes[k].x() - 0.5 * length) < 1e-9;
        }))
      across.push_back(id);
  }
  const auto compliance = make_compliance(ComplianceMethod::exact, model, 0.02);
  compliance->update(state);
  const auto released = [&](const ApplyCompliance& C) {
    const OpeningEnergy told = energy_of_opening(model, state, work, across, {}, energy, C);
    EXPECT_NEAR(told.area, size * size, 1e-12);
    return told.released / (size * size);
  };
  EXPECT_LT(released({}), 0.7 * energy);
  const double all = released([&](const VecX& f, VecX& dx) { compliance->apply(f, dx); });
  EXPECT_LE(all, energy * (1 + 1e-9));
  EXPECT_GE(all, 0.98 * energy);
}

// The energy of an opening is what the opened mesh loses on its way to rest, found by a dense solver.
TEST(Breaking, WhatAnOpeningReleasesIsLostByTheOpenedMesh) {
  const auto clamped = [](Bar& bar) {
    for (int n = 0; n < bar.model.nodes_in_use; ++n) {
      const double x = bar.model.mesh.nodes[n].x();
      bar.model.fixed[n] = x < 1e-9 || x > 4 * size - 1e-9;
    }
    bar.model.corotational = false;
    bar.strain(along_x(0.01));
  };
  Bar bar, whole;
  clamped(bar);
  clamped(whole);
  std::vector<int> half;
  for (int id = 0; id < 4 * bar.model.tets_in_use; ++id) {
    const Triangle n = outward_face(bar.model.mesh.tets[id / 4], id % 4);
    if (bar.model.across[id] > id && std::all_of(n.begin(), n.end(), [&](int k) {
          const Vec3& X = bar.model.mesh.nodes[k];
          return std::abs(X.x() - 2 * size) < 1e-9 && X.y() < 0.5 * size + 1e-9;
        }))
      half.push_back(id);
  }
  TopologyChange change(bar.model);
  ASSERT_EQ(open_faces(bar.model, bar.state, bar.work, half, change), CutStatus::done);
  double area = 0;
  for (const auto& [face, other] : change.opened) {
    const Triangle n = outward_face(bar.model.mesh.tets[face / 4], face % 4);
    const auto& X = bar.model.mesh.nodes;
    area += 0.5 * (X[n[1]] - X[n[0]]).cross(X[n[2]] - X[n[0]]).norm();
  }
  std::vector<int> free;
  for (int i = 0; i < 3 * bar.model.nodes_in_use; ++i)
    if (!bar.model.fixed[i / 3]) free.push_back(i);
  VecX dx = VecX::Zero(3 * bar.model.node_count()), f = dx;
  MatX K(free.size(), free.size());
  for (std::size_t j = 0; j < free.size(); ++j) {
    VecX column = VecX::Zero(dx.size());
    dx[free[j]] = 1;
    subtract_stiffness(bar.model, bar.state, dx, -1, column);
    dx[free[j]] = 0;
    K.col(j) = column(free);
  }
  internal_forces(bar.model, bar.state, f);
  const double before = elastic_energy(bar.model, bar.state);
  const VecX u = K.ldlt().solve(f(free));
  for (std::size_t i = 0; i < free.size(); ++i) bar.state.x[free[i] / 3][free[i] % 3] += u[i];
  const double lost = before - elastic_energy(bar.model, bar.state);
  const OpeningEnergy told =
      energy_of_opening(whole.model, whole.state, whole.work, half, {}, 1.05 * lost / area);
  EXPECT_NEAR(told.area, area, 1e-12);
  EXPECT_LE(told.released, lost * (1 + 1e-9));
  EXPECT_GE(told.released, 0.98 * lost);
}

// With clefts named, the bar parts in their plane and nowhere else, without crumbs.
TEST(Breaking, ACrackStaysInItsCleft) {
  Bar bar;
  bar.strain(along_x(0.1));
  TearSettings settings{.toughness = 1e-3, .most = 4, .begins = true};
  settings.clefts.resize(4 * bar.model.mesh.tets.size(), 0);
  const auto in_cleft = [&](int id) {
    const Triangle n = outward_face(bar.model.mesh.tets[id / 4], id % 4);
    return std::all_of(n.begin(), n.end(),
                       [&](int k) { return std::abs(bar.model.mesh.nodes[k].x() - 2 * size) < 1e-9; });
  };
  int of_cleft = 0;
  for (int id = 0; id < 4 * bar.model.tets_in_use; ++id) of_cleft += settings.clefts[id] = in_cleft(id);
  ASSERT_EQ(of_cleft, 2 * 8);
  TopologyChange change(bar.model);
  int opened = 0;
  for (int step = 0; step < 20; ++step) {
    const std::vector<int> faces = faces_that_break(bar.model, bar.state, bar.surface, bar.work, settings);
    if (faces.empty()) break;
    change.clear();
    ASSERT_EQ(open_faces(bar.model, bar.state, bar.work, faces, change), CutStatus::done);
    bar.surface.follow(bar.model, change.tets, change.opened);
    opened += static_cast<int>(change.opened.size());
  }
  EXPECT_EQ(opened, 8);
  EXPECT_EQ(find_pieces(bar.model, bar.state).count(), 2);
  for (const Fragment& f : find_fragments(bar.model, bar.state))
    EXPECT_NEAR(f.volume, 2 * size * size * size, 1e-15);
  EXPECT_EQ(check_mesh(bar.model, bar.state, bar.work, &bar.surface), "");
}

// A slice goes but for what lies at one node of it: two halves that hang together by that node part there.
TEST(Breaking, WhatHangsByANodeAloneParts) {
  TissueModel model = make_tissue_model(box_mesh({3e-3, 1e-3, 1e-3}, 3, 1, 1), {young, 0, 1000, 0, 0}, {},
                                        Vec3::Zero(), {20, 0});
  TissueState state = rest_state(model);
  BoundarySurface surface(model.mesh);
  CutWorkspace work(model);
  TopologyChange change(model);
  // Of the middle cell those with three nodes on one end: what is left of it joins the ends by an edge or a
  // node.
  std::vector<int> gone;
  const auto at = [&](int t, double x) {
    int n = 0;
    for (const int k : model.mesh.tets[t]) n += std::abs(model.mesh.nodes[k].x() - x) < 1e-9;
    return n;
  };
  for (int t = 0; t < model.tets_in_use; ++t)
    if (at(t, 1e-3) + at(t, 2e-3) == 4 && at(t, 1e-3) == 3) gone.push_back(t);
  ASSERT_FALSE(gone.empty());
  surface.remove(gone);
  remove_tets(model, state, gone);
  ASSERT_EQ(find_pieces(model, state).count(), 1);
  const int fragments = static_cast<int>(find_fragments(model, state).size());
  ASSERT_GT(fragments, 1);
  std::vector<int> all;
  for (int n = 0; n < model.nodes_in_use; ++n) all.push_back(n);
  const double mass = std::accumulate(state.mass.begin(), state.mass.end(), 0.0);
  ASSERT_EQ(part_hinges(model, state, work, all, change), CutStatus::done);
  surface.follow(model, change.tets, change.opened);
  EXPECT_EQ(find_pieces(model, state).count(), fragments);
  EXPECT_NEAR(std::accumulate(state.mass.begin(), state.mass.end(), 0.0), mass, 1e-18);
  EXPECT_EQ(check_mesh(model, state, work, &surface), "");
  change.clear();
  EXPECT_EQ(part_hinges(model, state, work, all, change), CutStatus::nothing);
}

}  // namespace
}  // namespace hapticd
