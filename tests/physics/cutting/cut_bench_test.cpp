// What a cut of the mesh costs, and that it costs no more after thousands:
//   test_physics --gtest_also_run_disabled_tests --gtest_filter='CutBench.*'
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <ctime>

#include "physics/cutting/blade_cut.h"
#include "tests/physics/cutting/cut_body.h"

namespace hapticd {
namespace {

// Of the same work on fresh bodies.
class Times {
 public:
  void start_run() { runs_.emplace_back(); }
  template <typename Work>
  void measure(const Work& work) {
    const double start = now();
    work();
    runs_.back().push_back(now() - start);
  }

  // The median of the runs' last tenths over that of their first: a stall of the machine is in neither.
  double flatness() const { return quantile(part(0.9, 1), 0.5) / quantile(part(0, 0.1), 0.5); }
  double p99() const { return quantile(part(0, 1), 0.99); }
  void print(const char* what) const {
    std::printf("%-12s %zu runs of %4zu, us: p50 %.2f, p99 %.2f, max %.1f; last tenth over first %.3f\n",
                what, runs_.size(), runs_.back().size(), quantile(part(0, 1), 0.5), p99(),
                quantile(part(0, 1), 1), flatness());
  }

 private:
  static double now() {  // of this thread's processor [µs]
    timespec t{};
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
    return 1e6 * static_cast<double>(t.tv_sec) + 1e-3 * static_cast<double>(t.tv_nsec);
  }
  static double quantile(std::vector<double> us, double q) {
    std::sort(us.begin(), us.end());
    return us[std::min(us.size() - 1, static_cast<std::size_t>(q * static_cast<double>(us.size())))];
  }
  std::vector<double> part(double from, double to) const {
    std::vector<double> us;
    for (const std::vector<double>& run : runs_) {
      const auto at = [&](double f) {
        return run.begin() + static_cast<std::ptrdiff_t>(f * static_cast<double>(run.size()));
      };
      us.insert(us.end(), at(from), at(to));
    }
    return us;
  }

  std::vector<std::vector<double>> runs_;
};

// Faces between elements whose centres are on different sides of a level plane, in the order in which a crack
// from one wall to the other meets them; ten planes, one after the other.
void open_many(CutBody& body, int count, Times& times) {
  times.start_run();
  const auto centre = [&](std::span<const int> nodes) {
    Vec3 sum = Vec3::Zero();
    for (const int n : nodes) sum += body.model.mesh.nodes[n];
    return Vec3(sum / static_cast<double>(nodes.size()));
  };
  int opened = 0;
  for (int plane = 0; opened < count && plane < 10; ++plane) {
    const double z = 0.1 * plane + 0.05;
    std::vector<std::pair<double, int>> faces;
    for (int id = 0; id < 4 * body.model.tets_in_use; ++id) {
      const int other = body.model.across[id];
      if (other > id &&
          (centre(body.model.mesh.tets[id / 4]).z() > z) != (centre(body.model.mesh.tets[other / 4]).z() > z))
        faces.emplace_back(centre(outward_face(body.model.mesh.tets[id / 4], id % 4)).x(), id);
    }
    std::sort(faces.begin(), faces.end());
    for (const auto& [x, face] : faces) {
      if (opened == count) break;
      times.measure([&, id = face] { ASSERT_EQ(body.open({{id}}), CutStatus::done); });
      ++opened;
    }
  }
  EXPECT_EQ(opened, count);
}

// Splits edges at random until so many elements of the first mesh were; none of them twice.
void split_many(CutBody& body, int elements, Times& times) {
  std::mt19937 random(2);
  times.start_run();
  std::vector<char> was_split(body.model.mesh.tets.size(), 0);
  std::vector<int> star;
  const int first = body.model.tets_in_use;
  while (body.model.tets_in_use < first + elements) {
    const auto [a, b] = body.random_edge(random);
    body.work.stars.live(body.state, a, star);
    std::erase_if(star, [&, n = b](int t) {
      return std::find(body.model.mesh.tets[t].begin(), body.model.mesh.tets[t].end(), n) ==
             body.model.mesh.tets[t].end();
    });
    if (std::any_of(star.begin(), star.end(), [&](int t) { return t >= first || was_split[t]; })) continue;
    for (const int t : star) was_split[t] = 1;
    times.measure([&, a = a, b = b] { ASSERT_EQ(body.split(a, b, 0.5), CutStatus::done); });
  }
}

// 4 860 elements, as the paper's lens has.
TEST(CutBench, DISABLED_OpeningsThenSubdivisions) {
  Times openings, splits;
  double volume_error = 0;
  for (int run = 0; run < 10; ++run) {
    CutBody body{box_mesh({1, 1, 1}, 9, 9, 10, 6), {12000, 12000}};
    open_many(body, 2000, openings);
    const double volume = body.volume();
    split_many(body, 2000, splits);
    volume_error = std::max(volume_error, std::abs(body.volume() / volume - 1));
    EXPECT_EQ(body.check(), "");
  }
  openings.print("openings");
  splits.print("splits");
  std::printf("volume kept to %.1e\n", volume_error);
  EXPECT_LT(volume_error, 1e-9);
  for (const Times* times : {&openings, &splits}) {
    EXPECT_LT(times->p99(), 1000);
    EXPECT_LT(times->flatness(), 1.1);
  }
}

// A blade that cuts twenty half sheets, where no other cut was, a fifth of an element at a time.
TEST(CutBench, DISABLED_StripsOfABlade) {
  CutBody body{box_mesh({1, 1, 1}, 9, 9, 10, 6), {30000, 100000}};
  BladeCut cut(body.model);
  SweptSurface strip(4);
  Times times;
  times.start_run();
  int opened = 0;
  for (int stroke = 0; stroke < 20; ++stroke) {
    cut.start();
    const double z = 0.1 * (stroke / 2) + 0.053;
    const double y = stroke % 2 ? 0.55 : 0.05;
    for (double x = 0; x < 1; x += 0.02) {
      std::vector<Vec3> from, to;
      for (int i = 4; i >= 0; --i) {
        from.emplace_back(x, y + 0.1 * i, z);
        to.emplace_back(x + 0.02, y + 0.1 * i, z);
      }
      strip.clear();
      strip.sweep(from, to);
      times.measure([&] {
        body.change.clear();
        ASSERT_NE(cut.extend(body.model, body.state, body.work, strip, body.change), CutStatus::no_room);
        body.surface.follow(body.model, body.change.tets, body.change.opened);
      });
      opened += static_cast<int>(body.change.opened.size());
    }
  }
  times.print("strips");
  std::printf("%d elements, %d faces opened, least quality %.3f\n", body.model.tets_in_use, opened,
              least_quality(body.model, body.state));
  EXPECT_EQ(body.check(), "");
}

}  // namespace
}  // namespace hapticd
