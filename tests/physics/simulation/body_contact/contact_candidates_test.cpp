#include "physics/simulation/body_contact/contact_candidates.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <random>

#include "tests/support/bodies.h"

namespace hapticd {
namespace {

const Material soft{5000, 0.4, 1000, 0, 2e-3};

struct Scene {
  Bodies bodies;
  BodyContactCandidateFinder finder{{ContactPair{0, 1, 0}}};

  Scene(BodySettings points, BodySettings faces) {
    bodies.emplace_back(std::move(points), 0.02, Vec3::Zero());
    bodies.emplace_back(std::move(faces), 0.02, Vec3::Zero());
    finder.begin_step(bodies);
  }
  std::vector<BodyContactCandidate> find(double margin, double depth = 1e-3) {
    std::vector<BodyContactCandidate> out;
    finder.find(
        bodies, 0, [&](int b) { return std::span<const Vec3>(bodies[b].state.x); },
        [&](int, int) { return margin; }, depth, 0, out);
    return out;
  }
};

Scene rough_pair(std::uint32_t seed) {
  BodySettings lower =
      block("lower", Vec3(0.02, 0.02, 0.006), {8, 8, 2}, soft, {Vec3(0, 0, -0.006), Quat::Identity()});
  BodySettings upper =
      block("upper", Vec3(0.012, 0.012, 0.006), {7, 7, 3}, soft,
            {Vec3(4e-3, 4e-3, 2e-4), Quat(Eigen::AngleAxisd(0.03, Vec3(1, 2, 3).normalized()))});
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> shift(-2e-4, 2e-4);
  for (BodySettings* b : {&lower, &upper})
    for (Vec3& x : b->mesh.nodes) x.z() += shift(random);
  return Scene(upper, lower);
}

// Against looking at every face.
TEST(BodyContactCandidates, FindsEveryNodeThatIsNearAndNoOther) {
  for (std::uint32_t seed = 1; seed < 20; ++seed) {
    Scene scene = rough_pair(seed);
    const double margin = 4e-4;
    const std::vector<BodyContactCandidate> found = scene.find(margin);
    const Body &points = scene.bodies[0], &faces = scene.bodies[1];
    int near = 0;
    for (const int n : scene.finder.normals(0).nodes) {
      double nearest = 1;
      for (std::size_t f = 0; f < faces.surface.faces().size(); ++f) {
        const Triangle& t = faces.surface.faces()[f].nodes;
        const std::array<Vec3, 3> x = {faces.state.x[t[0]], faces.state.x[t[1]], faces.state.x[t[2]]};
        if (scene.finder.normals(1).face[f].z() < 0.5) continue;  // the top
        const auto w = nearest_on_triangle(points.state.x[n], x);
        nearest = std::min(nearest, (points.state.x[n] - w[0] * x[0] - w[1] * x[1] - w[2] * x[2]).norm());
      }
      const bool is_near = nearest < margin;
      near += is_near;
      const bool listed =
          std::any_of(found.begin(), found.end(), [&](const BodyContactCandidate& e) { return e.node == n; });
      if (is_near) {
        EXPECT_TRUE(listed) << seed << ' ' << n;
      } else if (listed) {
        // Inside, then, and deeper than the margin.
        EXPECT_LT(std::find_if(found.begin(), found.end(),
                               [&](const BodyContactCandidate& e) { return e.node == n; })
                      ->gap,
                  0);
      }
    }
    EXPECT_GT(near, 5);
  }
}

// A node in a thin wall sees the side it came through, never the back.
TEST(BodyContactCandidates, TheBackOfAWallIsNotSeen) {
  const double thick = 3e-4;
  BodySettings wall =
      slab("wall", Vec3(0.02, 0.02, thick), {8, 8, 1}, {Vec3(-0.01, -0.01, -thick), Quat::Identity()});
  for (const double depth : {0.0, 1e-4, 2e-4, 2.9e-4, 4e-4}) {
    Scene scene(block("block", Vec3(4e-3, 4e-3, 4e-3), {2, 2, 2}, soft,
                      {Vec3(-2e-3, -2e-3, -depth), Quat::Identity()}),
                wall);
    const auto found = scene.find(1e-5);
    EXPECT_EQ(found.size(), 9u) << depth;
    for (const BodyContactCandidate& e : found) {
      EXPECT_NEAR(e.gap, -depth, 1e-12);
      for (const int f : e.faces) EXPECT_NEAR(scene.finder.normals(1).face[f].z(), 1, 1e-12);
    }
  }
}

// By the plane of a face a point beyond its edge may be behind it; it is outside.
TEST(BodyContactCandidates, APointBeyondAConvexEdgeIsOutside) {
  Scene scene(block("other", Vec3(1e-3, 1e-3, 1e-3), {1, 1, 1}, soft, {Vec3(0.1, 0, 0), Quat::Identity()}),
              block("block", Vec3(2e-3, 2e-3, 2e-3), {1, 1, 1}, soft));
  const Body& body = scene.bodies[1];
  SurfaceNormals normals;
  normals.set_surface(body);
  normals.follow(body);
  const auto nearest = [&](const Vec3& x) {
    double d = 1;
    for (int f = 0; f < static_cast<int>(body.surface.faces().size()); ++f) {
      const double of = normals.distance(body, f, x, body.state.x);
      if (std::abs(of) < std::abs(d)) d = of;
    }
    return d;
  };
  EXPECT_NEAR(nearest(Vec3(2.3e-3, 1e-3, 1e-3)), 0.3e-3, 1e-12);
  EXPECT_NEAR(nearest(Vec3(1.8e-3, 1e-3, 1e-3)), -0.2e-3, 1e-12);
  EXPECT_NEAR(nearest(Vec3(2.3e-3, 1e-3, 2.4e-3)), 0.5e-3, 1e-12);
}

TEST(BodyContactCandidates, FollowASurfaceThatIsEatenAway) {
  BodySettings lower =
      block("lower", Vec3(0.01, 0.01, 4e-3), {5, 5, 2}, soft, {Vec3(0, 0, -4e-3), Quat::Identity()});
  Scene scene(
      block("upper", Vec3(4e-3, 4e-3, 4e-3), {2, 2, 2}, soft, {Vec3(3e-3, 3e-3, 1e-5), Quat::Identity()}),
      lower);
  EXPECT_EQ(scene.find(1e-4).size(), 9u);
  // The whole upper layer goes: the ground is now 2 mm farther down.
  std::vector<int> top;
  const Body& body = scene.bodies[1];
  for (int t = 0; t < body.model.tet_count(); ++t) {
    double z = 0;
    for (const int n : body.model.mesh.tets[t]) z += body.state.x[n].z() / 4;
    if (z > -2e-3) top.push_back(t);
  }
  remove_from(scene.bodies[1], top);
  scene.finder.surface_changed(1);
  scene.finder.begin_step(scene.bodies);
  EXPECT_TRUE(scene.find(1e-4).empty());
  const auto found = scene.find(2.1e-3);
  EXPECT_GE(found.size(), 9u);
  for (const BodyContactCandidate& e : found) EXPECT_GE(e.gap, 2e-3);
}

// Inside one piece and just outside another: nearer is not instead of deeper.
TEST(BodyContactCandidates, ANodeMeetsEachPieceByItself) {
  BodySettings floor =
      block("floor", Vec3(0.01, 0.01, 4e-3), {5, 5, 2}, soft, {Vec3(-5e-3, 0, -4e-3), Quat::Identity()});
  const BodySettings wall =
      block("wall", Vec3(4e-3, 0.01, 8e-3), {2, 5, 4}, soft, {Vec3(-4e-3, 0, -2e-3), Quat::Identity()});
  const int first = static_cast<int>(floor.mesh.nodes.size());
  for (const Vec3& x : wall.mesh.nodes) floor.mesh.nodes.push_back(x);
  for (Tet t : wall.mesh.tets) {
    for (int& n : t) n += first;
    floor.mesh.tets.push_back(t);
  }
  // 10 um in the floor, 5 um before the wall that is sunk in it.
  Scene scene(
      block("block", Vec3(3e-3, 3e-3, 3e-3), {1, 1, 1}, soft, {Vec3(5e-6, 3.3e-3, -1e-5), Quat::Identity()}),
      floor);
  std::vector<int> met;
  for (const BodyContactCandidate& e : scene.find(-1e-6))
    if (scene.bodies[0].state.x[e.node].x() < 1e-3 && scene.bodies[0].state.x[e.node].z() < 1e-3) {
      met.push_back(e.node);
      EXPECT_NEAR(e.gap, -1e-5, 1e-12);
      for (const int f : e.faces) EXPECT_NEAR(scene.finder.normals(1).face[f].z(), 1, 1e-12);
    }
  EXPECT_EQ(met.size(), 2u);
  met.clear();
  for (const BodyContactCandidate& e : scene.find(1e-5))
    if (scene.bodies[0].state.x[e.node].x() < 1e-3 && scene.bodies[0].state.x[e.node].z() < 1e-3)
      met.push_back(e.piece);
  std::sort(met.begin(), met.end());
  EXPECT_EQ(met, std::vector<int>({0, 0, 1, 1}));
}

// A corner that leans over an edge looks as the face below it does, and yet is before it, not behind a wall.
TEST(BodyContactCandidates, ACornerThatLooksAsideIsSeenByTheFaceBelow) {
  const BodySettings ground = slab("ground", Vec3(0.01, 0.01, 6e-3), {5, 5, 3},
                                   {Vec3(-0.01, 0, -6e-3), Quat::Identity()});  // its edge is the y axis
  const Quat leaning(Eigen::AngleAxisd(-20 * M_PI / 180, Vec3::UnitY()));
  const Vec3 corner(-1e-5, 3.3e-3, 5e-5), local(0, 0, 4e-3);
  Scene scene(block("block", Vec3(4e-3, 4e-3, 4e-3), {2, 2, 2}, soft, {corner - leaning * local, leaning}),
              ground);
  const std::vector<BodyContactCandidate> found = scene.find(1e-4);
  int node = -1;
  for (const int n : scene.finder.normals(0).nodes)
    if ((scene.bodies[0].state.x[n] - corner).norm() < 1e-9) node = n;
  ASSERT_GE(node, 0);
  EXPECT_GT(scene.finder.normals(0).node(node).z(), 0.2);
  bool seen = false;
  for (const BodyContactCandidate& e : found) {
    if (e.node != node) continue;
    seen = true;
    EXPECT_NEAR(e.gap, 5e-5, 1e-12);
  }
  EXPECT_TRUE(seen);
}

}  // namespace
}  // namespace hapticd
