#include "tools/chart/pieces/stirred_scene.h"

#include <algorithm>
#include <chrono>
#include <memory>
#include <random>

#include "server/scene/scene_world.h"
#include "tools/chart/pieces/piece_overlap.h"

namespace hapticd {
namespace {

constexpr double tunnel = 0.1;  // of an edge

// One instrument's way.
class Stirrer {
 public:
  Stirrer(const StirSettings& settings, double h, std::mt19937& random)
      : settings_(settings), h_(h), random_(random) {}

  InstrumentSample next(const Body& body) {
    if (++at_ > steps_) begin_stroke(body);
    const double s = static_cast<double>(at_) / steps_;
    return {{from_ + (to_ - from_) * (s * s * (3 - 2 * s)), Quat::Identity()}, true, false, false};
  }

 private:
  void begin_stroke(const Body& body) {
    Eigen::AlignedBox3d box;
    for (const SurfaceFace& f : body.surface.faces())
      for (const int n : f.nodes) box.extend(body.state.x[n]);
    const Vec3 aside = Vec3::Constant(settings_.about);
    const auto drawn = [&] {
      const Vec3 u(uniform_(random_), uniform_(random_), uniform_(random_));
      Vec3 p = box.min() - aside + u.cwiseProduct(box.sizes() + 2 * aside);
      p.z() = box.max().z() + settings_.above - u.z() * (settings_.above + settings_.below);
      return p;
    };
    // The first one comes from above.
    from_ = placed_ ? to_ : Vec3(box.center().x(), box.center().y(), box.max().z() + 1.5e-3);
    placed_ = true;
    to_ = drawn();
    constexpr double fastest = 1.5;  // of the mean speed
    steps_ = std::max(1, static_cast<int>(fastest * (to_ - from_).norm() / (settings_.speed * h_)));
    at_ = 1;
  }

  const StirSettings& settings_;
  double h_;
  std::mt19937& random_;
  std::uniform_real_distribution<double> uniform_{0, 1};
  Vec3 from_, to_;
  bool placed_ = false;
  int at_ = 0, steps_ = 0;
};

double third_law(const World& world) {
  Vec3 sum = Vec3::Zero();
  double size = 0;
  for (int b = 0; b < static_cast<int>(world.bodies().size()); ++b) {
    const Vec3 f = world.contacts().force_on(b);
    sum += f;
    size += f.norm();
  }
  return size > 0 ? sum.norm() / size : 0;
}

}  // namespace

StirFigures stir(const Scene& scene, const StirSettings& settings,
                 const std::function<bool(double)>& progress, const AfterStep& after) {
  StirFigures out;
  out.name = scene.name;
  std::mt19937 random(settings.seed);
  const double h = 1 / scene.rate;
  const auto problem = std::make_unique<CondensedProblem>();
  for (int done = 0; done < settings.steps;) {
    const std::unique_ptr<World> world = make_world(scene);
    std::vector<Stirrer> hands;
    for (std::size_t i = 0; i < scene.instruments.size(); ++i) hands.emplace_back(settings, h, random);
    for (int i = 0; i < settings.episode && done < settings.steps; ++i, ++done) {
      InstrumentSamples samples;
      for (std::size_t k = 0; i >= settings.rest && k < hands.size(); ++k)
        samples[static_cast<int>(k)] = hands[k].next(world->bodies()[0]);
      const auto begun = std::chrono::steady_clock::now();
      const StepReport r = world->step([&] { return samples; }, *problem);
      out.step_ms.push_back(
          std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - begun).count());
      ++out.steps;
      const BodyContactReport& c = r.body_contact;
      out.joint += c.contacts > 0;
      out.capped += c.capped;
      out.held += c.held;
      out.friction_held += c.friction_held;
      out.bounded += r.bounded_bodies > 0;
      out.rounds = std::max(out.rounds, c.rounds);
      out.touches = std::max(out.touches, c.contacts);
      out.third_law = std::max(out.third_law, third_law(*world));
      if (after) after(*world, *problem, r);
      if (i % settings.look == 0) {
        const PieceOverlap o = find_overlap(world->bodies(), world->contacts().pairs());
        out.overlap = std::max(out.overlap, o.depth);
        out.tunnelled += o.depth > tunnel * world->bodies()[0].edge;
      }
    }
    if (progress && !progress(static_cast<double>(done) / settings.steps)) break;
  }
  return out;
}

}  // namespace hapticd
