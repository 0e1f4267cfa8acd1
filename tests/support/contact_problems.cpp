#include "tests/support/contact_problems.h"

namespace hapticd {
namespace {

void add_triangle_samples(CondensedProblem& problem, const std::array<std::int32_t, 3>& node, int k,
                          double friction) {
  const double h = 1.0 / k;
  const auto add = [&](double u, double v) {
    PatchSample& s = problem.sample[problem.samples++];
    s.id = static_cast<std::uint64_t>(problem.samples);
    s.node = node;
    s.weight = {1 - u - v, u, v};
    s.free = Vec3::Zero();
    s.outward = Vec3::UnitZ();
    s.friction = friction;
  };
  for (int i = 0; i < k; ++i)
    for (int j = 0; i + j < k; ++j) {
      add((i + 1.0 / 3) * h, (j + 1.0 / 3) * h);
      if (i + j + 1 < k) add((i + 2.0 / 3) * h, (j + 2.0 / 3) * h);
    }
}

}  // namespace

double uniform(Random& random, double low, double high) {
  return std::uniform_real_distribution<double>(low, high)(random);
}

double normal(Random& random) { return std::normal_distribution<double>()(random); }

Vec3 unit_vector(Random& random) {
  const double x = normal(random), y = normal(random), z = normal(random);
  return Vec3(x, y, z).normalized();
}

Quat random_rotation(Random& random) {
  const Vec3 axis = unit_vector(random);
  return Quat(Eigen::AngleAxisd(uniform(random, 0, 3.1), axis));
}

MatX random_psd(Random& random, int n, int rank) {
  MatX B(n, rank);
  for (int j = 0; j < rank; ++j)
    for (int i = 0; i < n; ++i) B(i, j) = normal(random);
  return B * B.transpose();
}

std::unique_ptr<CondensedProblem> sheet_problem(Random& random, const SheetSettings& s) {
  auto problem = std::make_unique<CondensedProblem>();
  problem->step = 1;
  problem->alarm_distance = 0.1 * s.side;
  problem->instrument[0].coupling = {200.0, 0.02, 2e-3};
  problem->nodes = s.nodes * s.nodes;
  for (int j = 0; j < s.nodes; ++j)
    for (int i = 0; i < s.nodes; ++i)
      problem->x_free[s.nodes * j + i] =
          s.side * Vec3(i / (s.nodes - 1.0) - 0.5, j / (s.nodes - 1.0) - 0.5, 0);
  problem->x_now = problem->x_free;
  for (int j = 0; j + 1 < s.nodes; ++j)
    for (int i = 0; i + 1 < s.nodes; ++i) {
      const int a = s.nodes * j + i;
      add_triangle_samples(*problem, {a, a + 1, a + s.nodes + 1}, s.per_triangle, s.friction);
      add_triangle_samples(*problem, {a, a + s.nodes + 1, a + s.nodes}, s.per_triangle, s.friction);
    }
  Mat3 R;
  for (int k = 0; k < 9; ++k) R(k) = uniform(random, -1, 1);
  const Mat3 core = Mat3::Identity() + 0.1 * (R + R.transpose());
  for (int a = 0; a < problem->nodes; ++a)
    for (int b = 0; b < problem->nodes; ++b) {
      const double distance = (problem->x_free[a] - problem->x_free[b]).norm();
      problem->C().block<3, 3>(3 * a, 3 * b) = s.compliance * std::exp(-distance / s.reach) * core;
    }
  return problem;
}

Instrument sphere_instrument(double radius) {
  Instrument instrument;
  Primitive tip;
  tip.name = "tip";
  tip.shape = Shape::sphere;
  tip.radius = radius;
  instrument.primitives.push_back(tip);
  return instrument;
}

std::unique_ptr<CondensedProblem> spring_problem(double k, const Vec3& x, double friction) {
  auto problem = std::make_unique<CondensedProblem>();
  problem->step = 1;
  problem->alarm_distance = 1e-3;
  problem->nodes = 1;
  problem->x_free[0] = problem->x_now[0] = x;
  problem->C() = MatX::Identity(3, 3) / k;
  problem->samples = 1;
  problem->sample[0] = {1, {0, 0, 0}, {1, 0, 0}, Vec3::Zero(), Vec3::UnitZ(), friction};
  return problem;
}

MatX dense_H(const CondensedProblem& problem, const ContactRows& rows) {
  MatX H = MatX::Zero(rows.rows(), 3 * problem.nodes);
  for (int i = 0; i < rows.contacts; ++i) {
    const NodeWeights at = node_weights(problem, rows.row[i]);
    for (int c = 0; c < rows.rows_per_contact; ++c)
      for (std::size_t a = 0; a < at.node.size(); ++a)
        H.block<1, 3>(rows.rows_per_contact * i + c, 3 * at.node[a]) +=
            at.weight[a] * rows.row[i].frame.col(c).transpose();
  }
  return H;
}

MatX dense_J(const ContactRows& rows) {
  MatX J(rows.rows(), 6);
  for (int i = 0; i < rows.contacts; ++i)
    for (int c = 0; c < rows.rows_per_contact; ++c) {
      const Vec3 f = rows.row[i].frame.col(c);
      J.row(rows.rows_per_contact * i + c) << -f.transpose(), -rows.row[i].arm.cross(f).transpose();
    }
  return J;
}

}  // namespace hapticd
