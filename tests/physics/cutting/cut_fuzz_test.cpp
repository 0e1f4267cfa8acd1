// Random cuts of random meshes, random openings and removals between: each leaves a valid mesh. HAPTICD_CUTS
// says how many (CMakeLists.txt has a run of 50 000).
#include <array>
#include <cmath>
#include <cstdlib>

#include "physics/cutting/blade_cut.h"
#include "tests/physics/cutting/cut_body.h"
#include "tests/physics/tissue/random_shapes.h"

namespace hapticd {
namespace {

double uniform(std::mt19937& random, double low, double high) {
  return std::uniform_real_distribution<double>(low, high)(random);
}

TetMesh random_mesh(std::mt19937& random) {
  const auto cells = [&] { return 1 + static_cast<int>(random() % 3); };
  const int nx = cells(), ny = cells(), nz = cells();
  const Vec3 size(uniform(random, 0.6, 1.4), uniform(random, 0.6, 1.4), uniform(random, 0.6, 1.4));
  TetMesh mesh = box_mesh(size, nx, ny, nz, random() % 2 ? 5 : 6);
  for (Vec3& x : mesh.nodes)
    x += random_vector(random, 0.07 * std::min({size.x() / nx, size.y() / ny, size.z() / nz}));
  return mesh;
}

// A blade's edge of several segments that moves through the body, turns and bends on its way; a third go
// through nodes, so that edges and faces lie in the surface.
struct Stroke {
  std::vector<Vec3> edge;
  Vec3 step;
  Mat3 turn;

  Stroke(std::mt19937& random, const CutBody& body) {
    const Vec3 middle = random() % 3 ? Vec3(0.5 * Vec3::Ones() + random_vector(random, 0.5))
                                     : body.model.mesh.nodes[random() % body.model.nodes_in_use];
    const Mat3 frame = random_rotation(random);
    const int segments = 1 + static_cast<int>(random() % 4);
    const double half = uniform(random, 0.2, 2);
    const double length = uniform(random, 0.1, 1.2);
    for (int i = 0; i <= segments; ++i)
      edge.push_back(middle + frame * Vec3(half * (2.0 * i / segments - 1), -length,
                                           random() % 2 ? 0.0 : uniform(random, -0.1, 0.1)));
    step = frame * Vec3(0, uniform(random, 0.02, 1.5), 0);
    turn = random() % 2
               ? Mat3(Mat3::Identity())
               : Eigen::AngleAxisd(uniform(random, -0.3, 0.3), frame.col(random() % 3)).toRotationMatrix();
  }

  void advance(SweptSurface& strip) {
    const std::vector<Vec3> from = edge;
    const Vec3 middle = from[from.size() / 2];
    for (Vec3& p : edge) p = middle + turn * (p - middle) + step;
    step = turn * step;
    strip.clear();
    strip.sweep(from, edge);
  }
};

TEST(CutFuzz, EachCutLeavesAValidMesh) {
  const char* wanted = std::getenv("HAPTICD_CUTS");
  const int cuts = wanted ? std::atoi(wanted) : 500;
  int done = 0, opened = 0, out_of_room = 0;
  double worst = 1;
  for (unsigned seed = 0; done < cuts; ++seed) {
    std::mt19937 random(seed);
    CutBody body{random_mesh(random), {600, 4000}};
    const double input_quality = least_quality(body.model, body.state);
    const double volume = body.volume();
    double removed = 0;
    BladeCut cut(body.model);
    SweptSurface strip(4);
    for (int stroke = 0; stroke < 5; ++stroke) {
      Stroke blade(random, body);
      cut.start();
      for (int k = static_cast<int>(random() % 6); k >= 0; --k, ++done) {
        blade.advance(strip);
        body.change.clear();
        const CutStatus status = cut.extend(body.model, body.state, body.work, strip, body.change);
        body.surface.follow(body.model, body.change.tets, body.change.opened);
        out_of_room += status == CutStatus::no_room;
        opened += static_cast<int>(body.change.opened.size());
        ASSERT_EQ(body.check(), "") << "seed " << seed << ", stroke " << stroke;
        ASSERT_GE(least_quality(body.model, body.state), std::min(0.05, input_quality)) << "seed " << seed;
        worst = std::min(worst, least_quality(body.model, body.state));
        ASSERT_NEAR(body.volume() + removed, volume, 1e-9 * volume) << "seed " << seed;
        if (random() % 8 == 0) {
          const auto face = [&] {
            return static_cast<int>(random() % (4 * static_cast<unsigned>(body.model.tets_in_use)));
          };
          (void)body.open(std::array<int, 3>{face(), face(), face()});
          ASSERT_EQ(body.check(), "") << "seed " << seed << ", stroke " << stroke << ", after an opening";
        }
        if (random() % 4) continue;
        const int t = static_cast<int>(random() % body.model.tets_in_use);
        if (body.state.alive[t]) removed += body.model.volume[t];
        body.remove({t});
        ASSERT_EQ(body.check(), "") << "seed " << seed << ", stroke " << stroke << ", after a removal";
      }
    }
  }
  RecordProperty("quality_min", std::to_string(worst));
  std::printf("%d cuts, %d faces opened, least quality %.4f, %d without room\n", done, opened, worst,
              out_of_room);
  EXPECT_GT(opened, done);
  EXPECT_LT(out_of_room, done / 20);
}

}  // namespace
}  // namespace hapticd
