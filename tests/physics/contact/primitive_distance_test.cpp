// The gap is a maximum over directions and, apart, a minimum over points: a value that is both is proved.
#include "physics/contact/distance/primitive_distance.h"

#include <algorithm>
#include <chrono>
#include <cstdio>

#include <fcl/geometry/shape/capsule.h>
#include <fcl/geometry/shape/convex.h>
#include <fcl/geometry/shape/cylinder.h>
#include <fcl/geometry/shape/sphere.h>
#include <fcl/narrowphase/detail/gjk_solver_libccd.h>
#include <gtest/gtest.h>

#include "tests/support/contact_problems.h"
#include "tests/support/malloc_guard.h"

namespace hapticd {
namespace {

constexpr const char* kinds[] = {"sphere", "capsule", "cylinder", "gem", "box"};
constexpr int kind_count = 5;

Primitive round_one(Shape shape, double radius, double half_length, const Pose& placement = {}) {
  return {"part", shape, radius, half_length, placement, {}, {}};
}

Primitive box_of(const Vec3& half, const Pose& placement = {}) {
  std::vector<Vec3> corners;
  for (int i = 0; i < 8; ++i)
    corners.emplace_back(i & 1 ? half.x() : -half.x(), i & 2 ? half.y() : -half.y(),
                         i & 4 ? half.z() : -half.z());
  return make_convex("box", corners, placement);
}

// Instruments of surgery's size: radii of 0.4–2 mm, lengths to 20 mm.
Primitive any_primitive(Random& random, int kind) {
  const Pose placement{1e-3 * unit_vector(random), random_rotation(random)};
  const auto size = [&] { return uniform(random, 0.5e-3, 3e-3); };
  if (kind == 4) return box_of({size(), size(), 3 * size()}, placement);
  if (kind == 3) {
    std::vector<Vec3> points;
    const double extent = size(), stretch = uniform(random, 0.3, 3);
    for (int k = 0; k < 14; ++k)
      points.push_back(
          Vec3(1, 1, stretch).cwiseProduct(uniform(random, 0.7, 1) * extent * unit_vector(random)));
    return make_convex("gem", points, placement);
  }
  const Shape shapes[] = {Shape::sphere, Shape::capsule, Shape::cylinder};
  return round_one(shapes[kind], uniform(random, 0.4e-3, 2e-3), uniform(random, 0.3e-3, 10e-3), placement);
}

struct Pair {
  Primitive a, b;
  Pose X_a, X_b;

  PrimitiveGap gap() const { return gap_between(a, X_a, b, X_b); }
  // min over b of n·x − max over a of n·x: no more than the gap for any n.
  double parting(const Vec3& n) const { return n.dot(support(b, X_b, -n) - support(a, X_a, n)); }
};

Pair any_pair(Random& random, int i, int k) {
  const Pose X_a{0.1 * unit_vector(random), random_rotation(random)};
  const Pose X_b{X_a.p + uniform(random, 0, 15e-3) * unit_vector(random), random_rotation(random)};
  return {any_primitive(random, i), any_primitive(random, k), X_a, X_b};
}

// The smaller of the two largest inner balls' radii.
double breadth(const Pair& pair) {
  double least = 1;
  for (const Primitive* p : {&pair.a, &pair.b}) {
    if (p->shape != Shape::convex) least = std::min(least, p->radius);
    if (p->shape == Shape::cylinder) least = std::min(least, p->half_length);
    for (const Eigen::Vector4d& plane : p->planes) least = std::min(least, -plane[3]);
  }
  return std::max(0.0, least);
}

// Moves b along the normal until the gap is about `wanted`.
void set_gap(Pair& pair, double wanted) {
  for (int k = 0; k < 2; ++k) {
    const PrimitiveGap gap = pair.gap();
    pair.X_b.p += (wanted - gap.distance) * gap.normal;
  }
}

template <typename Theorem>
void for_all_pairs(int trials, Theorem theorem) {
  Random random(11);
  for (int i = 0; i < kind_count; ++i)
    for (int k = 0; k < kind_count; ++k) {
      SCOPED_TRACE(std::string(kinds[i]) + "-" + kinds[k]);
      for (int n = 0; n < trials; ++n) theorem(random, any_pair(random, i, k));
    }
}

double outside(const Primitive& p, const Pose& X, const Vec3& x) {
  return gap_at(p, p.placement.to_local(X.to_local(x))).distance;
}

TEST(PrimitiveDistance, HandValues) {
  const Pose I, right{{5, 0, 0}, Quat::Identity()},
      across{{5, 0, 0}, Quat(Eigen::AngleAxisd(M_PI / 2, Vec3::UnitX()))};
  const Primitive sphere = round_one(Shape::sphere, 1, 0), capsule = round_one(Shape::capsule, 1, 4),
                  cylinder = round_one(Shape::cylinder, 1, 4), box = box_of({2, 3, 4});
  const auto expect = [](const PrimitiveGap& gap, double distance, const Vec3& n, const Vec3& on_a,
                         double within) {
    EXPECT_NEAR(gap.distance, distance, 1e-12);
    EXPECT_LT((gap.normal - n).norm(), 1e-9);
    EXPECT_LT((gap.on_a - on_a).norm(), within);
    EXPECT_LT((gap.on_b - gap.on_a - gap.distance * gap.normal).norm(), 1e-12);
  };
  expect(gap_between(sphere, I, sphere, right), 3, Vec3::UnitX(), {1, 0, 0}, 1e-12);
  expect(gap_between(capsule, I, capsule, across), 3, Vec3::UnitX(), {1, 0, 0}, 1e-9);
  expect(gap_between(capsule, I, capsule, {{0, 1.5, 2}, Quat::Identity()}), -0.5, Vec3::UnitY(), {0, 1, 1},
         1e-9);
  expect(gap_between(cylinder, I, capsule, across), 3, Vec3::UnitX(), {1, 0, 0}, 1e-6);
  expect(gap_between(cylinder, I, sphere, {{4, 0, 8}, Quat::Identity()}), 4, Vec3(3, 0, 4) / 5, {1, 0, 4},
         1e-9);
  expect(gap_between(cylinder, I, cylinder, across), 3, Vec3::UnitX(), {1, 0, 0}, 1e-9);
  expect(gap_between(box, I, sphere, {{5, 7, 4}, Quat::Identity()}), 4, Vec3(3, 4, 0) / 5, {2, 3, 4}, 1e-9);
  EXPECT_NEAR(gap_between(box, I, box, {{3.5, 1, 1}, Quat::Identity()}).distance, -0.5, 1e-12);
  EXPECT_NEAR(gap_between(cylinder, I, box, {{0, 0, 8.25}, Quat::Identity()}).distance, 0.25, 1e-12);
  // Edge across edge, a quarter into each other: neither a face's normal nor a gap of a point to a box says
  // so.
  const Quat turned(Eigen::AngleAxisd(M_PI / 4, Vec3::UnitX())),
      other(Eigen::AngleAxisd(M_PI / 4, Vec3::UnitY()));
  const Primitive cube = box_of({1, 1, 1});
  const PrimitiveGap edges = gap_between(cube, {{}, turned}, cube, {{0.1, 0.1, 2 * M_SQRT2 - 0.25}, other});
  EXPECT_NEAR(edges.distance, -0.25, 1e-9);
  EXPECT_LT((edges.normal - Vec3::UnitZ()).norm(), 1e-6);
}

TEST(PrimitiveDistance, ApartItIsProvedByItsPointsAndByItsNormal) {
  for_all_pairs(200, [](Random& random, Pair pair) {
    set_gap(pair, std::pow(10, uniform(random, -8, -2)));
    const PrimitiveGap gap = pair.gap();
    ASSERT_GT(gap.distance, 0);
    EXPECT_NEAR(gap.normal.norm(), 1, 1e-12);
    EXPECT_NEAR(pair.parting(gap.normal), gap.distance, 1e-9);
    EXPECT_LT((gap.on_b - gap.on_a - gap.distance * gap.normal).norm(), 1e-15);
    // Sideways within the patch: √(2 τ (d + r)) at most.
    const double patch = 1e-2 * (pair.a.radius + pair.b.radius), side = 2 * patch * (gap.distance + 2e-3);
    EXPECT_LT(outside(pair.a, pair.X_a, gap.on_a), 1e-7 + patch + std::sqrt(side));
    EXPECT_LT(outside(pair.b, pair.X_b, gap.on_b), 1e-7 + patch + std::sqrt(side));
  });
}

// To a fifth of the smaller inner radius: no direction parts them sooner, but for rare hulls.
TEST(PrimitiveDistance, ShallowOverlapIsTheLeastTranslationThatPartsThem) {
  int asked = 0, missed = 0;
  double worst = 0;
  for_all_pairs(60, [&](Random& random, Pair pair) {
    const double depth = uniform(random, 0, 0.2) * breadth(pair);
    set_gap(pair, -depth);
    const PrimitiveGap gap = pair.gap();
    EXPECT_NEAR(pair.parting(gap.normal), gap.distance, 1e-9);
    if (gap.distance < -1.001 * depth) return;
    double best = gap.distance;
    Vec3 n = gap.normal;
    for (int k = 0; k < 600; ++k) {
      const Vec3 nearby = n + 0.3 * std::pow(0.97, k - 300) * unit_vector(random);
      const Vec3 u = k < 300 ? unit_vector(random) : Vec3(nearby.normalized());
      if (const double here = pair.parting(u); here > best) {
        best = here;
        n = u;
      }
    }
    ++asked;
    worst = std::max(worst, best - gap.distance);
    missed += best - gap.distance > 1e-6;
    if (pair.a.shape != Shape::convex && pair.b.shape != Shape::convex) {
      EXPECT_LT(best - gap.distance, 1e-6);
    }
  });
  std::printf("%d of %d overlaps have a better direction, by %.1e m at most\n", missed, asked, worst);
  EXPECT_GT(asked, 1300);
  EXPECT_LE(missed, asked / 200);
}

struct OfFcl {
  void* object;
  fcl::detail::GJKSupportFunction support;
  void (*destroy)(void*);
};

template <typename S>
OfFcl of_fcl(const S& shape, const Primitive& p, const Pose& X) {
  using Initializer = fcl::detail::GJKInitializer<double, S>;
  fcl::Transform3<double> T = fcl::Transform3<double>::Identity();
  T.linear() = (X.q * p.placement.q).toRotationMatrix();
  T.translation() = X.to_world(p.placement.p);
  return {Initializer::createGJKObject(shape, T), Initializer::getSupportFunction(),
          &Initializer::deleteGJKObject};
}

// `hull` must outlive the object: FCL's refers to it.
OfFcl of_fcl(const Primitive& p, const Pose& X, std::unique_ptr<fcl::Convexd>& hull) {
  if (p.shape == Shape::sphere) return of_fcl(fcl::Sphered(p.radius), p, X);
  if (p.shape == Shape::capsule) return of_fcl(fcl::Capsuled(p.radius, 2 * p.half_length), p, X);
  if (p.shape == Shape::cylinder) return of_fcl(fcl::Cylinderd(p.radius, 2 * p.half_length), p, X);
  auto faces = std::make_shared<std::vector<int>>();
  for (const Eigen::Vector4d& plane : p.planes) {
    std::vector<int> ring;
    Vec3 centre = Vec3::Zero();
    for (std::size_t k = 0; k < p.vertices.size(); ++k)
      if (std::abs(plane.head<3>().dot(p.vertices[k]) + plane[3]) < 1e-9) {
        ring.push_back(static_cast<int>(k));
        centre += p.vertices[k];
      }
    centre /= static_cast<double>(ring.size());
    const Vec3 n = plane.head<3>(), e = n.unitOrthogonal(), f = n.cross(e);
    const auto angle = [&](int k) {
      return std::atan2(f.dot(p.vertices[k] - centre), e.dot(p.vertices[k] - centre));
    };
    std::sort(ring.begin(), ring.end(), [&](int i, int k) { return angle(i) < angle(k); });
    faces->push_back(static_cast<int>(ring.size()));
    faces->insert(faces->end(), ring.begin(), ring.end());
  }
  hull = std::make_unique<fcl::Convexd>(std::make_shared<const std::vector<Vec3>>(p.vertices),
                                        static_cast<int>(p.planes.size()), faces);
  return of_fcl(*hull, p, X);
}

double distance_of_fcl(const Pair& pair) {
  std::unique_ptr<fcl::Convexd> hull_a, hull_b;
  const OfFcl a = of_fcl(pair.a, pair.X_a, hull_a), b = of_fcl(pair.b, pair.X_b, hull_b);
  double distance = -1;
  fcl::detail::GJKDistance<double>(a.object, a.support, b.object, b.support, 500, 1e-9, &distance, nullptr,
                                   nullptr);
  a.destroy(a.object);
  b.destroy(b.object);
  return distance;
}

TEST(PrimitiveDistance, AgreesWithFclWhereApart) {
  double worst = 0;
  for_all_pairs(160, [&](Random&, const Pair& pair) {
    const PrimitiveGap gap = pair.gap();
    if (gap.distance < 1e-4) return;
    const double theirs = distance_of_fcl(pair);
    EXPECT_GT(theirs, gap.distance - 1e-9);  // theirs is of two points
    EXPECT_LT(theirs, gap.distance + 5e-6);
    worst = std::max(worst, std::abs(gap.distance - theirs));
  });
  std::printf("FCL's distances differ by %.1e m at most\n", worst);
}

TEST(PrimitiveDistance, MirrorAndRigidMotionChangeNothing) {
  for_all_pairs(60, [](Random& random, Pair pair) {
    set_gap(pair, uniform(random, -0.2 * breadth(pair), 2e-3));
    const PrimitiveGap gap = pair.gap(), mirror = gap_between(pair.b, pair.X_b, pair.a, pair.X_a);
    const Pose move{0.05 * unit_vector(random), random_rotation(random)};
    const auto moved = [&](const Pose& X) { return Pose{move.to_world(X.p), move.q * X.q}; };
    const PrimitiveGap other = gap_between(pair.a, moved(pair.X_a), pair.b, moved(pair.X_b));
    const bool hulls = pair.a.shape == Shape::convex || pair.b.shape == Shape::convex;
    const double same = gap.distance < 0 && hulls ? 1e-6 : 1e-9;  // two directions nearly as good
    EXPECT_NEAR(mirror.distance, gap.distance, same);
    EXPECT_NEAR(other.distance, gap.distance, same);
    if (gap.distance < 1e-5) return;
    EXPECT_LT((mirror.normal + gap.normal).norm(), 1e-5);
    EXPECT_LT((other.normal - move.q * gap.normal).norm(), 1e-5);
  });
}

// A point of b moves by |dp| + |dω| r at most, and the gap by no more. Between two hulls that overlap another
// local maximum may be found in the next step: rarely.
TEST(PrimitiveDistance, ChangesNoFasterThanItsBodiesMove) {
  int asked = 0, jumps = 0;
  for_all_pairs(20, [&](Random& random, Pair pair) {
    set_gap(pair, uniform(random, -0.1 * breadth(pair), 1e-4));
    Vec6 step;
    step << 1e-6 * unit_vector(random), 1e-4 * unit_vector(random);
    const double reach = 1e-3 + 14e-3;
    const bool hulls = pair.a.shape == Shape::convex && pair.b.shape == Shape::convex;
    double previous = pair.gap().distance;
    for (int k = 0; k < 40; ++k) {
      pair.X_b = displaced(pair.X_b, step);
      const double now = pair.gap().distance, change = std::abs(now - previous);
      const bool jumped = change > 1e-6 + 1e-4 * reach + 1e-9;
      EXPECT_FALSE(jumped && !(hulls && now < 0 && previous < 0)) << change;
      jumps += jumped;
      previous = now;
      ++asked;
    }
  });
  std::printf("%d jumps in %d steps\n", jumps, asked);
  EXPECT_LE(jumps, asked / 5000);
}

TEST(PrimitiveDistance, ParallelSticksTouchInTheMiddleAndLeaveItSmoothly) {
  const std::pair<Shape, Shape> shapes[] = {{Shape::capsule, Shape::capsule},
                                            {Shape::cylinder, Shape::capsule},
                                            {Shape::capsule, Shape::cylinder},
                                            {Shape::cylinder, Shape::cylinder}};
  for (const auto& [one, other] : shapes) {
    const Primitive a = round_one(one, 0.5e-3, 8e-3), b = round_one(other, 0.5e-3, 8e-3);
    Vec3 previous(0.5e-3, 0, 2e-3);
    for (int k = 0; k <= 400; ++k) {
      const double angle = 5e-5 * k;  // to 20 mrad about y, so that the lower end of b comes nearer
      const Pose X{{1.2e-3, 0, 4e-3}, Quat(Eigen::AngleAxisd(angle, Vec3::UnitY()))};
      const PrimitiveGap gap = gap_between(a, {}, b, X);
      if (k == 0) {
        EXPECT_LT((gap.normal - Vec3::UnitX()).norm(), 1e-12);
        EXPECT_NEAR(gap.on_a.z(), 2e-3, 0.1e-3);  // of the overlap from −4 to 8 mm
      }
      EXPECT_LT((gap.on_a - previous).norm(), 0.6e-3) << angle;
      previous = gap.on_a;
    }
  }
}

TEST(PrimitiveDistance, DegenerateCasesAreFinite) {
  std::vector<Primitive> all = {round_one(Shape::sphere, 1e-3, 0),
                                round_one(Shape::capsule, 1e-3, 0),
                                round_one(Shape::capsule, 1e-3, 5e-3),
                                round_one(Shape::cylinder, 1e-3, 5e-3),
                                round_one(Shape::cylinder, 1e-3, 0),
                                round_one(Shape::capsule, 0, 5e-3),
                                round_one(Shape::cylinder, 0, 5e-3),
                                round_one(Shape::sphere, 0, 0),
                                box_of({1e-3, 1e-3, 5e-3}),
                                box_of({1e-3, 2e-3, 1e-6})};
  const Quat turns[] = {Quat::Identity(), Quat(Eigen::AngleAxisd(M_PI / 2, Vec3::UnitX())),
                        Quat(Eigen::AngleAxisd(M_PI, Vec3::UnitX())),
                        Quat(Eigen::AngleAxisd(1e-9, Vec3::UnitY()))};
  for (const Primitive& a : all)
    for (const Primitive& b : all)
      for (const Quat& q : turns)
        for (const Vec3& p :
             {Vec3(0, 0, 0), Vec3(0, 0, 10e-3), Vec3(2e-3, 0, 0), Vec3(1e-3, 0, 5e-3), Vec3(0, 0, 6e-3),
              Vec3(1e-320, 0, 0), Vec3(1e-13, 0, 1e-3), Vec3(2e-3, 0, 10e-3)}) {
          const PrimitiveGap gap = gap_between(a, {}, b, {p, q});
          ASSERT_TRUE(std::isfinite(gap.distance) && gap.on_a.allFinite() && gap.on_b.allFinite());
          ASSERT_NEAR(gap.normal.norm(), 1, 1e-12);
        }
}

TEST(PrimitiveDistance, NearDeniesNothingWithinReach) {
  int denied = 0;
  for_all_pairs(200, [&](Random&, const Pair& pair) {
    const double distance = pair.gap().distance;
    for (const double reach : {-0.5e-3, 0.0, 1e-3}) {
      const bool within = near(pair.a, pair.X_a, pair.b, pair.X_b, reach);
      EXPECT_TRUE(within || distance >= reach) << distance << " " << reach;
      denied += !within;
    }
  });
  EXPECT_GT(denied, 4000);
}

TEST(PrimitiveDistance, AllocatesNothing) {
  if (!MallocGuard::available()) GTEST_SKIP() << "malloc belongs to the sanitizer";
  for_all_pairs(20, [&](Random& random, Pair pair) {
    set_gap(pair, uniform(random, -1e-3, 1e-3));
    const MallocGuard guard;
    pair.gap();
    near(pair.a, pair.X_a, pair.b, pair.X_b, 1e-3);
    EXPECT_EQ(guard.allocations(), 0);
  });
}

// ns, p50 and p99 of each pair of shapes: apart, and overlapping by a tenth of the smaller inner radius at
// most.
TEST(PrimitiveDistance, DISABLED_Bench) {
  Random random(5);
  const auto percentile = [](std::vector<double>& t, double part) {
    std::sort(t.begin(), t.end());
    return t[static_cast<std::size_t>(part * static_cast<double>(t.size() - 1))];
  };
  for (int i = 0; i < kind_count; ++i)
    for (int k = i; k < kind_count; ++k) {
      std::vector<double> apart, overlapping, bound;
      for (int n = 0; n < 2000; ++n) {
        Pair pair = any_pair(random, i, k);
        set_gap(pair, n % 2 ? uniform(random, 0, 2e-3) : -uniform(random, 0, 0.1) * breadth(pair));
        double least = 1e9, least_bound = 1e9;  // of a few: without what others take
        double sum = 0;
        for (int r = 0; r < 5; ++r) {
          using Clock = std::chrono::steady_clock;
          const auto start = Clock::now();
          sum += pair.gap().distance;
          const auto middle = Clock::now();
          sum += near(pair.a, pair.X_a, pair.b, pair.X_b, 1e-3);
          const auto end = Clock::now();
          least = std::min(least, std::chrono::duration<double, std::nano>(middle - start).count());
          least_bound = std::min(least_bound, std::chrono::duration<double, std::nano>(end - middle).count());
        }
        EXPECT_TRUE(std::isfinite(sum));
        (n % 2 ? apart : overlapping).push_back(least);
        bound.push_back(least_bound);
      }
      std::printf("%s-%s: apart %.0f / %.0f, overlapping %.0f / %.0f, near %.0f / %.0f ns\n", kinds[i],
                  kinds[k], percentile(apart, 0.5), percentile(apart, 0.99), percentile(overlapping, 0.5),
                  percentile(overlapping, 0.99), percentile(bound, 0.5), percentile(bound, 0.99));
    }
}

}  // namespace
}  // namespace hapticd
