#include "tests/support/rubbing_worlds.h"

#include <algorithm>
#include <cmath>

namespace hapticd {
namespace {

constexpr double g = 9.81;
constexpr double wedge_height = 6e-3, wedge_width = 6e-3;

Quat about_y(double angle) { return Quat(Eigen::AngleAxisd(angle, Vec3::UnitY())); }

double sign_of(int side) { return side == 0 ? -1 : 1; }

}  // namespace

std::unique_ptr<World> block_on_block(const BlockOnBlock& settings) {
  WorldSettings s = contact_world({});
  if (settings.contacts) s.body_contact.pairs = {{0, 1, settings.mu}};
  if (settings.gravity) s.gravity = Vec3(0, 0, -g);
  s.removal[0] = {400, 2e-4, 0, 0};
  BodySettings lower = block("lower", Vec3(0.012, 0.012, 6e-3), {4, 4, 3}, {10e3, 0.4, 1000, 0, 2e-3});
  lower.fixed_nodes = lower.mesh.group("bottom")->nodes;
  lower.removable = true;
  const BodySettings upper = block("upper", Vec3(8e-3, 8e-3, 4e-3), {4, 4, 3}, {5e3, 0.4, 1000, 0, 2e-3},
                                   {Vec3(2e-3, 2e-3, 6e-3 + settings.apart), Quat::Identity()});
  return std::make_unique<World>(std::vector<BodySettings>{upper, lower}, ball(2e-3), s);
}

Incline::Incline(double angle, double mu, bool soft_ground, const std::array<int, 3>& cells) {
  const Pose tilt{Vec3::Zero(), about_y(angle)};
  down = tilt.q * Vec3::UnitX();
  Pose lower = tilt, upper = tilt;
  lower.p = tilt.q * Vec3(-0.01, -0.005, -0.004);
  upper.p = tilt.q * Vec3(0, 0, 1e-5);
  WorldSettings s = contact_world({{0, 1, mu}});
  s.gravity = Vec3(0, 0, -g);
  BodySettings incline = slab("incline", Vec3(0.3, 0.02, 0.004), {30, 2, 1}, lower);
  if (soft_ground) {
    incline.deformable = true;
    incline.material = {50e3, 0.3, 1000, 0, 2e-3};
    incline.fixed_nodes = incline.mesh.group("bottom")->nodes;
  }
  const BodySettings upon = block("block", Vec3(0.01, 0.01, 0.005), cells, {5000, 0.4, 1000, 0, 2e-3}, upper);
  world = std::make_unique<World>(std::vector<BodySettings>{upon, incline}, ball(1e-3), s);
}

StepReport Incline::step() {
  return world->step([] { return nobody(); }, problem);
}

double Incline::speed() const { return velocity_of(body()).dot(down); }

Wedge::Wedge(double half_angle, double mu, const std::array<int, 3>& cells) : alpha_(half_angle), mu_(mu) {
  const double slope = std::tan(alpha_);
  BodySettings wedge =
      block("wedge", Vec3(wedge_width, 4e-3, wedge_height), cells, {20e3, 0.3, 1000, 10, 5e-3});
  for (Vec3& x : wedge.mesh.nodes)
    x.x() = (x.x() - wedge_width / 2) * (1 + 2 * (x.z() - wedge_height) * slope / wedge_width);
  // Walls whose faces lie along the wedge's sides, 10 µm away.
  const auto wall = [&](const std::string& name, int side) {
    BodySettings w = slab(name, Vec3(2e-3, 12e-3, 20e-3), {1, 1, 2});
    for (Vec3& x : w.mesh.nodes) {
      x -= Vec3(side > 0 ? 0 : 2e-3, 4e-3, 10e-3);
      x = about_y(sign_of(side) * alpha_) * x +
          Vec3(sign_of(side) * (wedge_width / 2 - wedge_height * slope + 1e-5), 0, 0);
    }
    return w;
  };
  world = std::make_unique<World>(std::vector<BodySettings>{wedge, wall("left", 0), wall("right", 1)},
                                  ball(2e-3), contact_world({{0, 1, mu}, {0, 2, mu}}));
}

StepReport Wedge::step() {
  const int i = done_++;
  const double depth = std::min({1e-3, 2e-5 * i, std::max(-5e-3, 1e-3 - 2e-4 * (i - 70))});
  const StepReport r = world->step([&] { return at(Vec3(0, 2e-3, wedge_height + 2e-3 - depth)); }, *problem_);
  const double wall = on_wall(0).norm();
  if (wall > pressed) {
    pressed = wall;
    applied = std::abs(r.contact.wrench[0].z());
  }
  return r;
}

Vec3 Wedge::on_wall(int side) const { return world->contacts().force_on(1 + side); }

double Wedge::sliding_in() const {
  return 0.5 * std::sqrt(1 + mu_ * mu_) / (std::sin(alpha_) + mu_ * std::cos(alpha_));
}

}  // namespace hapticd
