// Trajectories: what the reader accepts and refuses, and how well the interpolation does.
#include "server/record/trajectory.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <functional>
#include <random>

#include "server/files/input_error.h"
#include "server/record/trajectory_reader.h"

namespace hapticd {
namespace {

constexpr double pi = 3.14159265358979323846;

std::string fault(const std::string& csv) {
  try {
    parse_trajectory(csv, "t.csv", LengthUnit::metre);
  } catch (const InputError& e) {
    return e.what();
  }
  return "none";
}

Quat about_z(double angle) { return Quat(Eigen::AngleAxisd(angle, Vec3::UnitZ())); }

TEST(TrajectoryReader, ColumnsInAnyOrderCommentsAndUnits) {
  const Trajectory t = parse_trajectory(
      "# a comment\n\nbuttons, pz,py,px,t,qw,qx,qy,qz\r\n1,3,2,1,0,1,0,0,0\n# "
      "more\n2,3,2,5,0.5,0,0,0,1.001\n",
      "t.csv", LengthUnit::millimetre);
  ASSERT_EQ(t.samples.size(), 2u);
  EXPECT_LT((t.samples[0].pose.p - Vec3(1e-3, 2e-3, 3e-3)).norm(), 1e-15);
  EXPECT_EQ(t.samples[1].buttons, 2u);
  EXPECT_NEAR(t.samples[1].pose.q.norm(), 1, 1e-15);
  EXPECT_NEAR(t.samples[1].pose.q.z(), 1, 1e-15);
  EXPECT_EQ(
      parse_trajectory("t,px,py,pz\n0,0,0,0\n1,1,1,1", "t.csv", LengthUnit::metre).samples[1].pose.q.w(), 1);
}

TEST(TrajectoryReader, NamesFileLineAndColumn) {
  const std::string head = "t,px,py,pz,qx,qy,qz,qw\n0,0,0,0,0,0,0,1\n";
  EXPECT_TRUE(fault(head + "1,0,x,0,0,0,0,1\n").starts_with("t.csv:3: column py: 'x' is not a number"));
  EXPECT_TRUE(fault(head + "1,nan,0,0,0,0,0,1\n").starts_with("t.csv:3: column px: must be finite"));
  EXPECT_TRUE(fault(head + "0,0,0,0,0,0,0,1\n").starts_with("t.csv:3: column t: the time does not rise"));
  EXPECT_TRUE(fault(head + "1,0,0,0,0,0,0,1.02\n").starts_with("t.csv:3: column qx: not a unit quaternion"));
  EXPECT_TRUE(fault(head + "1,0,0,0,0,0,0\n").starts_with("t.csv:3: column qw: has no value"));
  EXPECT_TRUE(fault(head + "1,0,0,0,0,0,0,1,4\n").starts_with("t.csv:3: column 9: a value too many"));
  EXPECT_TRUE(fault("t,px,py\n").starts_with("t.csv:1: column pz: is missing"));
  EXPECT_TRUE(fault("t,px,py,pz,qx,qy,qz\n").starts_with("t.csv:1: column qw: is missing"));
  EXPECT_TRUE(fault("t,px,px,pz\n").starts_with("t.csv:1: column px: is there twice"));
  EXPECT_NE(fault("t,px,py,pz,button\n").find("did you mean 'buttons'"), std::string::npos);
  EXPECT_NE(fault(head).find("two at least"), std::string::npos);
  EXPECT_NE(fault("").find("is empty"), std::string::npos);
  EXPECT_TRUE(fault("t,px,py,pz,buttons\n0,0,0,0,-1\n").starts_with("t.csv:2: column buttons"));
}

// 62.5 Hz with stamps uneven by 1 %, as a recorder writes them.
std::vector<TrajectorySample> uneven(double seconds, const std::function<Pose(double)>& motion) {
  std::mt19937 random(3);
  std::uniform_real_distribution<double> jitter(-0.01, 0.01);
  std::vector<TrajectorySample> samples;
  for (int i = 0; i < seconds * 62.5; ++i) {
    const double t = (i + jitter(random)) / 62.5;
    samples.push_back({t, motion(t), static_cast<std::uint32_t>(i)});
  }
  return samples;
}

TEST(Trajectory, ASineOfTwoHertzComesBack) {
  const auto motion = [](double t) {
    return Pose{Vec3(0.05 * std::sin(4 * pi * t), 0, 0), about_z(0.5 * std::sin(4 * pi * t))};
  };
  const Trajectory trajectory = make_trajectory(uneven(4, motion));
  double place = 0, turn = 0;
  for (double t = 0.5; t < 3.5; t += 1e-3) {
    const Vec6 error = difference(sample_at(trajectory, t), motion(t));
    place = std::max(place, error.head<3>().norm());
    turn = std::max(turn, error.tail<3>().norm());
  }
  // A cubic spline errs by at most 5/384 h^4 times the fourth derivative: 1.2 um of the 50 mm. The curve of
  // the rotations is of lower order (its velocities come from parabolas): 0.067 of the 500 mrad.
  EXPECT_LT(place, 5.0 / 384 * std::pow(1.02 / 62.5, 4) * std::pow(4 * pi, 4) * 0.05);
  EXPECT_LT(turn, 1e-4);
}

TEST(Trajectory, SamplesAreHitExactly) {
  const std::filesystem::path recorded =
      std::filesystem::path(SOURCE_DIR) / "../shared/data/trajectories/cataract_training_01.csv";
  std::vector<std::filesystem::path> files = {std::filesystem::path(SOURCE_DIR) /
                                              "config/scenes/cataract/stroke.csv"};
  if (std::filesystem::exists(recorded)) files.push_back(recorded);
  for (const auto& file : files) {
    const Trajectory trajectory = read_trajectory(file, LengthUnit::metre);
    for (const TrajectorySample& s : trajectory.samples) {
      const Pose pose = sample_at(trajectory, s.t);
      ASSERT_EQ(pose.p, s.pose.p);
      ASSERT_EQ(pose.q.coeffs(), s.pose.q.coeffs());
      ASSERT_EQ(buttons_at(trajectory, s.t), s.buttons);
    }
    // And from either side.
    for (std::size_t i = 1; i + 1 < trajectory.samples.size(); ++i)
      for (double side : {-1e-9, 1e-9}) {
        const Pose& knot = trajectory.samples[i].pose;
        ASSERT_LT(difference(sample_at(trajectory, trajectory.samples[i].t + side), knot).norm(), 1e-6);
      }
  }
}

TEST(Trajectory, VelocityIsContinuousAtSamplesAndAccelerationOfThePositionToo) {
  std::mt19937 random(5);
  std::normal_distribution<double> normal;
  std::vector<TrajectorySample> samples;
  double t = 0;
  for (int i = 0; i < 40; ++i) {
    t += 0.5 + 0.4 * std::tanh(normal(random));
    const Vec3 axis = Vec3(normal(random), normal(random), normal(random)).normalized();
    samples.push_back({t, {axis, Quat(Eigen::AngleAxisd(0.6 * normal(random), axis))}, 0});
  }
  const Trajectory trajectory = make_trajectory(samples);
  const double d = 1e-4;
  for (int i = 1; i < 39; ++i) {
    const auto at = [&](double offset) { return sample_at(trajectory, samples[i].t + offset); };
    const Vec6 before = difference(at(0), at(-d)) / d, after = difference(at(d), at(0)) / d;
    EXPECT_LT((after - before).norm(), 0.02 * (1 + before.norm())) << i;
    const Vec3 curve_before = (at(0).p - 2 * at(-d).p + at(-2 * d).p) / (d * d);
    const Vec3 curve_after = (at(2 * d).p - 2 * at(d).p + at(0).p) / (d * d);
    EXPECT_LT((curve_after - curve_before).norm(), 0.05 * (1 + curve_before.norm())) << i;
  }
}

TEST(Trajectory, ImagesOfAToneAreAsTheHeaderSays) {
  // A 2 Hz tone at 62.5 Hz; its image at 60.5 Hz by projection over 4 s (a whole number of both periods).
  std::vector<TrajectorySample> samples;
  for (int i = 0; i <= 625; ++i)
    samples.push_back({i / 62.5, {Vec3(std::sin(4 * pi * i / 62.5), 0, 0), {1, 0, 0, 0}}, 0});
  const Trajectory trajectory = make_trajectory(samples);
  double s = 0, c = 0;
  const int n = 16000;
  for (int k = 0; k < n; ++k) {
    const double t = 3 + 4.0 * k / n, x = sample_at(trajectory, t).p.x();
    s += 2 * x * std::sin(2 * pi * 60.5 * t) / n;
    c += 2 * x * std::cos(2 * pi * 60.5 * t) / n;
  }
  EXPECT_NEAR(std::hypot(s, c), 1.2e-6, 0.1e-6);
}

TEST(Trajectory, ConstantTurnAndOppositeSignsAreOneMotion) {
  std::vector<TrajectorySample> samples;
  for (int i = 0; i < 10; ++i) {
    samples.push_back(
        {0.1 * i + 0.01 * (i % 3), {Vec3::Zero(), about_z(3.0 * (0.1 * i + 0.01 * (i % 3)))}, 0});
    if (i % 2) samples.back().pose.q.coeffs() *= -1;
  }
  const Trajectory trajectory = make_trajectory(samples);
  for (double t = 0; t < 0.9; t += 0.007)
    EXPECT_LT(difference(sample_at(trajectory, t), {Vec3::Zero(), about_z(3 * t)}).norm(), 1e-12) << t;
}

TEST(Trajectory, OutsideItStandsStillAndButtonsAreHeld) {
  const Trajectory trajectory =
      make_trajectory({{1, {Vec3(1, 0, 0), Quat::Identity()}, 1}, {2, {Vec3(2, 0, 0), Quat::Identity()}, 2}});
  EXPECT_EQ(sample_at(trajectory, 0).p.x(), 1);
  EXPECT_EQ(sample_at(trajectory, 9).p.x(), 2);
  EXPECT_DOUBLE_EQ(sample_at(trajectory, 1.25).p.x(), 1.25);
  EXPECT_EQ(buttons_at(trajectory, 0), 1u);
  EXPECT_EQ(buttons_at(trajectory, 1.999), 1u);
  EXPECT_EQ(buttons_at(trajectory, 2), 2u);
  EXPECT_EQ(buttons_at(trajectory, 5), 2u);
  EXPECT_THROW(make_trajectory({{1, {}, 0}}), std::invalid_argument);
  EXPECT_THROW(make_trajectory({{1, {}, 0}, {1, {}, 0}}), std::invalid_argument);
}

TEST(TrajectoryReader, OwnRecordingsReplay) {
  const Trajectory t = parse_trajectory(
      "t,tick,echo,px,py,pz,qx,qy,qz,qw,buttons,ix,fx,status,energy_j\n"
      "0,7,9,0.1,0.2,0.3,0,0,0,1,2,5,1e-3,0,-0.5\n0.001,8,10,0.2,0.2,0.3,0,0,0,1,3,5,nan,0,-0.5\n",
      "record.csv", LengthUnit::metre);
  ASSERT_EQ(t.samples.size(), 2u);
  EXPECT_EQ(t.samples[1].pose.p.x(), 0.2);
  EXPECT_EQ(t.samples[1].buttons, 3u);
  EXPECT_THROW(parse_trajectory("t,px,py,pz,tick\n0,1,2,3,4\n1,1,2,3\n", "short.csv", LengthUnit::metre),
               InputError);
}

}  // namespace
}  // namespace hapticd
