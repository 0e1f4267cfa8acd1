#include "tools/stability/stability_carve.h"

#include <algorithm>
#include <cmath>
#include <exception>
#include <memory>
#include <numbers>
#include <optional>
#include <utility>

#include "tools/offline/renderer.h"
#include "tools/stability/bench/episodes.h"
#include "tools/stability/bench/lens_hand.h"

namespace hapticd {

namespace {

constexpr double tick_s = 1e-3;
constexpr double peak_speed = 12e-3;  // of the tip in the scene [m/s]
constexpr double jerk_peak = 1.875;   // of a minimum-jerk way, over its mean speed
constexpr double equator = 4.3e-3;    // how far out sweeps go [m]
constexpr double clear = -0.5e-3;     // depth between strokes [m]

struct Waypoint {
  Vec3 place;
  double speed;  // mean, to there [m/s]
  std::uint32_t pedals;
  int hold = 0;  // ticks there, afterwards
};

// Every third episode cuts a core loose, and sucks nothing out.
bool cuts_loose(std::uint64_t seed) { return seed % 3 == 0; }

// Strokes, one after another for ever: ways of minimum jerk from waypoint to waypoint.
class Script {
 public:
  explicit Script(std::uint64_t seed) : chance_(seed), core_(cuts_loose(seed)) {
    from_ = to_ = over_lens(0, -0.6e-3, clear);
  }

  void advance() {
    if (++at_ < length_ + hold_) return;
    from_ = to_;
    at_ = 0;
    if (next_ == way_.size()) {
      way_.clear();
      next_ = 0;
      stroke();
      ++strokes_;
    }
    const Waypoint& w = way_[next_++];
    to_ = w.place;
    buttons_ = w.pedals;
    length_ = std::max(1, static_cast<int>(std::ceil((to_ - from_).norm() / w.speed / tick_s)));
    hold_ = w.hold;
  }
  Vec3 tip() const {
    const double u = std::min(1.0, static_cast<double>(at_) / length_);
    return from_ + u * u * u * (10 - 15 * u + 6 * u * u) * (to_ - from_);
  }
  std::uint32_t buttons() const { return buttons_; }
  std::int64_t strokes() const { return strokes_; }

 private:
  void go(const Vec3& place, std::uint32_t pedals, int hold = 0) {
    way_.push_back({place, speed_, pedals, hold});
  }
  // From above a place and back above another, so that nothing is crossed on the way to the next stroke.
  void come_over(double x, double y) { way_.push_back({over_lens(x, y, clear), fast_, 0u, 0}); }

  void stroke() {
    constexpr std::uint32_t both = pedal_phaco | pedal_aspiration;
    const double p = chance_.between(0, 1);
    if (core_ && strokes_ == 0) return around_core();
    const std::uint32_t pedals = core_     ? pedal_phaco
                                 : p < 0.7 ? both
                                 : p < 0.8 ? pedal_phaco
                                 : p < 0.9 ? pedal_aspiration
                                           : 0u;
    speed_ = 1e-3 * std::pow(peak_speed / jerk_peak / 1e-3, chance_.between(0, 1));
    const double kind = chance_.between(0, 1);
    if (kind < 0.3)
      groove(pedals, chance_.between(0, std::numbers::pi), chance_.between(-2e-3, 2e-3));
    else if (kind < 0.4) {
      const double angle = chance_.between(0, std::numbers::pi);
      groove(pedals, angle, 0);
      groove(pedals, angle + 0.5 * std::numbers::pi, 0);
    } else if (kind < 0.6)
      plunge(pedals);
    else if (kind < 0.75)
      to_equator(pedals);
    else if (kind < 0.85)
      along_capsule(pedals);
    else if (kind < 0.95)
      quarter(pedals);
    else
      rest();
  }

  // Round a core of 0.6 to 1.3 mm, deeper each time, until nothing holds it.
  void around_core() {
    const double r = chance_.between(1.2e-3, 1.9e-3);
    speed_ = fast_;
    come_over(r, 0);
    for (double depth = 0.5e-3; depth < 5e-3; depth += 0.6e-3)
      for (int k = 0; k <= 24; ++k) {
        const double angle = k * std::numbers::pi / 12;
        go(within(r * std::cos(angle), r * std::sin(angle), depth), pedal_phaco);
      }
    come_over(r, 0);
  }

  // There and back at rising depth, in a line `aside` of the middle.
  void groove(std::uint32_t pedals, double angle, double aside) {
    const Vec3 along(std::cos(angle), std::sin(angle), 0), across(-along.y(), along.x(), 0);
    const double half = std::sqrt(2.6e-3 * 2.6e-3 - aside * aside), deepest = chance_.between(0.5e-3, 4e-3);
    const Vec3 near = aside * across - half * along, far = aside * across + half * along;
    come_over(near.x(), near.y());
    bool there = false;
    for (double depth = 0.45e-3; depth < deepest; depth += 0.45e-3, there = !there) {
      const Vec3 &a = there ? far : near, &b = there ? near : far;
      go(within(a.x(), a.y(), depth), pedals);
      go(within(b.x(), b.y(), depth), pedals);
    }
    const Vec3& last = there ? far : near;
    come_over(last.x(), last.y());
  }

  // Straight down, up to 0.9 mm below the posterior face: the capsule is 0.2 mm behind it.
  void plunge(std::uint32_t pedals) {
    const double r = 3e-3 * std::sqrt(chance_.between(0, 1)), a = chance_.between(0, 2 * std::numbers::pi);
    const double x = r * std::cos(a), y = r * std::sin(a);
    come_over(x, y);
    const Vec3 below = on_posterior(x, y) - chance_.between(-1e-3, 0.9e-3) * Vec3::UnitZ();
    go(below, pedals, chance_.happens(0.3) ? 300 : 0);
    come_over(x, y);
  }

  // Down beside the middle, and out to the equator, twice.
  void to_equator(std::uint32_t pedals) {
    const double a = chance_.between(0, 2 * std::numbers::pi);
    come_over(0, 0);
    for (int k = 0; k < 2; ++k) {
      const double angle = a + k * chance_.between(0.1, 1), z = chance_.between(-1e-3, 0.8e-3);
      go({0, 0, z}, pedals);
      go({equator * std::cos(angle), equator * std::sin(angle), chance_.between(-0.3e-3, 0.3e-3)}, pedals);
      go({0, 0, z}, pedals);
    }
    come_over(0, 0);
  }

  // An arc on the posterior face, pressed a little into what is behind it.
  void along_capsule(std::uint32_t pedals) {
    const double r = chance_.between(0.5e-3, 3e-3), a = chance_.between(0, 2 * std::numbers::pi),
                 deeper = chance_.between(0, 0.6e-3);
    come_over(r * std::cos(a), r * std::sin(a));
    for (int k = 0; k <= 6; ++k) {
      const double angle = a + 0.4 * k;
      go(on_posterior(r * std::cos(angle), r * std::sin(angle)) - deeper * Vec3::UnitZ(), pedals);
    }
    come_over(r * std::cos(a + 2.4), r * std::sin(a + 2.4));
  }

  // Lines side by side within a quarter of the lens, at one depth.
  void quarter(std::uint32_t pedals) {
    const double sx = chance_.happens(0.5) ? 1 : -1, sy = chance_.happens(0.5) ? 1 : -1;
    const double depth = chance_.between(0.5e-3, 3.5e-3);
    come_over(sx * 0.3e-3, sy * 0.3e-3);
    bool there = false;
    for (double y = 0.3e-3; y < 2.5e-3; y += 0.5e-3, there = !there) {
      go(within(sx * (there ? 2.5e-3 : 0.3e-3), sy * y, depth), pedals);
      go(within(sx * (there ? 0.3e-3 : 2.5e-3), sy * y, depth), pedals);
    }
    come_over(0, 0);
  }

  void rest() { way_.push_back({over_lens(0, -0.6e-3, -1.5e-3), fast_, 0u, 2000}); }

  // No deeper than half a millimetre behind the posterior face.
  Vec3 within(double x, double y, double depth) const {
    Vec3 place = over_lens(x, y, depth);
    place.z() = std::max(place.z(), on_posterior(x, y).z() - 0.5e-3);
    return place;
  }

  Chance chance_;
  const bool core_;
  Vec3 from_, to_;
  int at_ = 0, length_ = 300, hold_ = 0;
  std::uint32_t buttons_ = 0;
  std::vector<Waypoint> way_;
  std::size_t next_ = 0;
  double speed_ = 1e-3;
  const double fast_ = peak_speed / jerk_peak;
  std::int64_t strokes_ = 0;
};

class Episode {
 public:
  Episode(const Scene& scene, std::uint64_t seed, double late_steps, CarveReport& report)
      : scene_(faster(scene, seed)),
        seed_(seed),
        report_(report),
        script_(seed),
        daemon_(scene_, options(seed, late_steps)),
        watch_(scene_, daemon_.world().bodies(), peak_speed) {}

  // False: it ended with a fault.
  bool tick(std::int64_t i) {
    try {
      const std::optional<std::string> fault = advance(i);
      if (fault) report_.faults.push_back({seed_, i, *fault});
      return !fault;
    } catch (const std::exception& e) {
      report_.faults.push_back({seed_, i, e.what()});
      return false;
    }
  }

  void finish() {
    report_.removed += daemon_.world().removed();
    report_.strokes += script_.strokes();
  }

 private:
  static Scene faster(Scene scene, std::uint64_t seed) {
    if (cuts_loose(seed))
      scene.first().removal.rate *= 10;
    else if (seed % 2 == 0)
      scene.first().removal.rate *= 3;
    return scene;
  }
  DaemonRendererOptions options(std::uint64_t seed, double late_steps) {
    DaemonRendererOptions options;
    options.begun = [this] { watch_.begin_step(daemon_.world().bodies()); };
    options.published = [this] { seen_ = watch_.look(daemon_.world().bodies()); };
    if (late_steps > 0) options.late.emplace(late_steps, seed);
    options.reference_steps = 1 + static_cast<int>(seed % 4);
    return options;
  }

  std::optional<std::string> advance(std::int64_t i) {
    const DeviceSettings& device = scene_.first().device;
    const Vec3 tip = script_.tip();
    DeviceSample sample;
    sample.sequence = static_cast<std::uint64_t>(i) + 1;
    sample.pose = {device.frame.conjugate() * ((tip - device.origin) / device.position_scale),
                   (device.frame.conjugate() * through_incision(tip) * device.tool.conjugate()).normalized()};
    sample.buttons = script_.buttons();
    sample.enable = enables(i, last_);
    script_.advance();
    const ForceSample answer = daemon_.tick(&sample);
    ++report_.ticks;
    report_.in_contact += answer.active > 0;
    if (const std::optional<std::string> fault = judge(device, answer, last_, report_)) return fault;
    last_ = answer;
    const std::optional<TissueExtremes> seen = std::exchange(seen_, {});
    return seen ? judged(*seen) : std::nullopt;
  }

  std::optional<std::string> judged(const TissueExtremes& seen) {
    if (const std::optional<std::string> fault = judge(seen, watch_.bounds(), report_)) return fault;
    report_.made = std::max(report_.made, seen.made);
    report_.free_steps += seen.free > 0;
    report_.free_energy = std::max(report_.free_energy, seen.free_energy);
    const double made_allowed = energy_allowed(report_.free_energy);
    report_.made_allowed = std::max(report_.made_allowed, made_allowed);
    if (seen.made > made_allowed) return said("a free piece made", seen.made, made_allowed, "J");
    return std::nullopt;
  }

  const Scene scene_;
  const std::uint64_t seed_;
  CarveReport& report_;
  Script script_;
  DaemonRenderer daemon_;
  TissueWatch watch_;
  ForceSample last_;
  std::optional<TissueExtremes> seen_;  // at the end of a step, not judged yet
};

void add(const CarveReport& part, CarveReport& sum) {
  add(static_cast<const TrialTally&>(part), static_cast<TrialTally&>(sum));
  sum.strokes += part.strokes;
  sum.free_steps += part.free_steps;
  sum.made = std::max(sum.made, part.made);
  sum.free_energy = std::max(sum.free_energy, part.free_energy);
  sum.made_allowed = std::max(sum.made_allowed, part.made_allowed);
  sum.faults.insert(sum.faults.end(), part.faults.begin(), part.faults.end());
}

}  // namespace

CarveReport run_carve(const Scene& cataract, const CarveSettings& settings,
                      const std::function<bool(double)>& progress) {
  const auto run = [&](std::uint64_t seed, std::int64_t ticks, CarveReport& report,
                       const std::function<bool(std::int64_t)>& done) {
    const auto episode = std::make_unique<Episode>(cataract, seed, settings.late_steps, report);
    for (std::int64_t i = 0; i < ticks && episode->tick(i); ++i)
      if (i % 256 == 0 && !done(256)) break;
    episode->finish();
  };
  CarveReport report;
  report.late_steps = settings.late_steps;
  for (const CarveReport& part :
       run_episodes<CarveReport>(settings.ticks, settings.episode, settings.seed, run, progress))
    add(part, report);
  return report;
}

}  // namespace hapticd
