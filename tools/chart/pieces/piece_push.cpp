#include "tools/chart/pieces/piece_push.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <optional>
#include <stdexcept>
#include <utility>

#include "physics/contact/contact_solve.h"
#include "physics/tissue/fragments.h"
#include "server/scene/scene_world.h"
#include "tests/support/rubbing_worlds.h"

namespace hapticd {
namespace {

constexpr double tick = 1e-3;

// In the frame of the place that is pressed: normal, then two tangents.
const std::vector<std::pair<const char*, Vec3>>& directions() {
  static const std::vector<std::pair<const char*, Vec3>> all = {{"deeper", Vec3(-1, 0, 0)},
                                                                {"+t1", Vec3(0, 1, 0)},
                                                                {"-t1", Vec3(0, -1, 0)},
                                                                {"+t2", Vec3(0, 0, 1)},
                                                                {"-t2", Vec3(0, 0, -1)}};
  return all;
}

Scene without_damping(Scene scene) {
  for (SceneInstrument& i : scene.instruments) i.coupling.damping_time = 0;
  return scene;
}

struct PressedPlace {
  Vec3 x;
  Mat3 frame;  // outward normal, tangents
};

// Of the first body's first piece, over the middle of what other bodies bear of it.
PressedPlace place_to_press(const World& world) {
  const Body& body = world.bodies()[0];
  const Pieces pieces = find_pieces(body.model, body.state);
  Vec3 middle = Vec3::Zero();
  double whole = 0;
  for (const BodyContact& c : world.contacts().contacts()) {
    const ContactPair& pair = world.contacts().pairs()[c.pair];
    if (pair.points == pair.faces) continue;
    const int own = pair.points == 0 ? c.mesh_node[0] : c.mesh_node[1];
    if ((pair.points != 0 && pair.faces != 0) || pieces.of_node[own] != 0) continue;
    middle += c.lambda[0] * body.state.x[own];
    whole += c.lambda[0];
  }
  if (!(whole > 0))
    throw std::runtime_error("the piece that was to be pushed has not come to lie on anything");
  middle /= whole;
  PressedPlace best;
  double nearest = std::numeric_limits<double>::infinity();
  for (const SurfaceFace& f : body.surface.faces()) {
    if (pieces.of_tet[f.id / 4] != 0) continue;
    const auto& x = body.state.x;
    const Vec3 n = (x[f.nodes[1]] - x[f.nodes[0]]).cross(x[f.nodes[2]] - x[f.nodes[0]]).normalized();
    const Vec3 at = (x[f.nodes[0]] + x[f.nodes[1]] + x[f.nodes[2]]) / 3;
    constexpr double upwards = 0.8;
    if (n.z() < upwards) continue;
    const double off = n.cross(middle - at).norm();
    if (off >= nearest) continue;
    nearest = off;
    best = {at, contact_frame(n)};
  }
  if (!std::isfinite(nearest))
    throw std::runtime_error("the piece that was to be pushed has no face upwards");
  return best;
}

// What a push begins with, once for each direction.
struct PushedWorld {
  std::string name;
  double h = 0, radius = 0;  // of the step [s], of the tip [m]
  std::function<std::unique_ptr<World>()> make;
  ContactOptions options;             // of the haptic loop
  std::optional<PressedPlace> place;  // known beforehand
};

// The simulation and the haptic loop in turns, without delays.
class Hand {
 public:
  explicit Hand(const PushedWorld& of) : h_(of.h), world_(of.make()), options_(of.options) {}

  // A step that ends with the device at p, after the ticks on the way there.
  template <typename AtTick>
  StepReport step(const Vec3& from, const Vec3& to, const AtTick& at_tick) {
    const int ticks = static_cast<int>(std::lround(h_ / tick));
    for (int k = 1; k <= ticks; ++k) {
      const InstrumentSample sample = at(from + (to - from) * (static_cast<double>(k) / ticks));
      if (problem_->step > 0)
        at_tick(sample, solve_contact(*problem_, world_->instruments(), sample.pose, tick, options_, state_,
                                      *scratch_));
    }
    return world_->step([&] { return at(to); }, *problem_);
  }
  StepReport rest() {
    return world_->step([] { return InstrumentSamples{}; }, *problem_);
  }
  ContactSolution full(const InstrumentSample& sample) { return world_->solve_unfrozen(sample, *problem_); }
  const World& world() const { return *world_; }

 private:
  double h_;
  std::unique_ptr<World> world_;
  std::unique_ptr<CondensedProblem> problem_ = std::make_unique<CondensedProblem>();
  std::unique_ptr<ContactScratch> scratch_ = std::make_unique<ContactScratch>();
  ContactState state_;
  ContactOptions options_;
};

PushPoint push(const PushedWorld& of, const PushSettings& settings, const char* name, const Vec3& direction) {
  PushPoint out{of.name, name};
  Hand hand(of);
  for (int i = 0; i < settings.settle; ++i) hand.rest();
  const PressedPlace place = of.place ? *of.place : place_to_press(hand.world());
  const Vec3 normal = place.frame.col(0);
  const Vec3 touch = place.x + of.radius * normal;
  Vec3 rested = Vec3::Zero();
  const auto look = [&](const InstrumentSample&, const ContactSolution& felt) {
    rested = felt.wrench[0].head<3>();
  };
  StepReport r;
  Vec3 from = touch + settings.above * normal;
  const Vec3 down = -settings.speed * of.h * normal;
  for (;
       r.contact.wrench[0].head<3>().norm() < settings.pressed && normal.dot(touch - from) < settings.deepest;
       from += down)
    r = hand.step(from, from + down, look);
  for (int i = 0; i < settings.hold; ++i) r = hand.step(from, from, look);
  out.depth = normal.dot(touch - from);
  out.touches = r.body_contact.contacts;
  out.active_before = r.body_contact.active;

  Vec3 f = Vec3::Zero();
  double square = 0, whole = 0, worst = 0;
  int ticks = 0;
  const Vec3 to = from + settings.moved * (place.frame * direction);
  const ContactSolution before = hand.full({{from, Quat::Identity()}, true, false, false});
  r = hand.step(from, to, [&](const InstrumentSample& sample, const ContactSolution& felt) {
    const ContactSolution full = hand.full(sample);
    out.unsolved += (felt.status != SolveStatus::solved) + (full.status != SolveStatus::solved);
    f = full.wrench[0].head<3>();
    const double off = (felt.wrench[0].head<3>() - f).norm();
    square += off * off;
    whole += f.squaredNorm();
    worst = std::max(worst, off);
    out.peak = std::max(out.peak, f.norm());
    ++ticks;
  });
  out.active_after = r.body_contact.active;
  out.rms = std::sqrt(square / ticks);
  if (!(out.peak > 0)) return out;  // it has slid from under the tip
  out.rms_rel = out.rms / out.peak;
  out.rms_rel_to_rms = std::sqrt(square / whole);
  out.max_rel = worst / out.peak;
  out.step_rel = (f - r.contact.wrench[0].head<3>()).norm() / out.peak;
  out.at_rest_rel = (rested - before.wrench[0].head<3>()).norm() / out.peak;
  return out;
}

std::vector<PushPoint> push_each_way(const PushedWorld& of, const PushSettings& settings,
                                     const std::function<bool(double)>& progress) {
  std::vector<PushPoint> out;
  for (const auto& [name, direction] : directions()) {
    out.push_back(push(of, settings, name, direction));
    if (progress && !progress(static_cast<double>(out.size()) / static_cast<double>(directions().size())))
      break;
  }
  return out;
}

}  // namespace

double worst_rms_rel(const std::vector<PushPoint>& pushes) {
  double worst = 0;
  for (const PushPoint& p : pushes)
    if (holds(p)) worst = std::max(worst, p.rms_rel);
  return worst;
}

std::vector<PushPoint> push_piece(const Scene& scene, const PushSettings& settings,
                                  const std::function<bool(double)>& progress) {
  const Scene undamped = without_damping(scene);
  const PushedWorld of{scene.name,
                       1 / scene.rate,
                       scene.first().shape.primitives.front().radius,
                       [&] { return make_world(undamped); },
                       haptic_options(undamped).contact,
                       {}};
  return push_each_way(of, settings, progress);
}

std::vector<PushPoint> push_block(double mu, const PushSettings& settings,
                                  const std::function<bool(double)>& progress) {
  PushedWorld of;
  of.name = std::string("block on block") + (mu > 0 ? "" : ", frictionless");
  of.h = 0.02;
  of.radius = 2e-3;
  of.make = [&] { return block_on_block({mu}); };
  of.options.margin = 5e-4;
  of.place = {Vec3(6e-3, 6e-3, 0.01), contact_frame(Vec3::UnitZ())};
  // At once and slowly: without friction what is not held by the tip slides off.
  PushSettings of_block = settings;
  of_block.settle = 0;
  of_block.above = 0;
  of_block.speed = 1e-3;
  of_block.pressed = std::numeric_limits<double>::infinity();
  of_block.deepest = 0.8e-3;
  return push_each_way(of, of_block, progress);
}

}  // namespace hapticd
