#include "tools/chart/step/chart_step.h"

#include <sys/resource.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <memory>
#include <thread>

#include "haptic/clock.h"
#include "physics/simulation/region/body_regions.h"
#include "physics/tissue/mesh_quality.h"
#include "server/app/reference_maker.h"
#include "server/os/realtime.h"
#include "server/scene/scene_world.h"
#include "tools/chart/step/drawn_blade.h"
#include "tools/chart/step/travelling_tip.h"
#include "tools/cli/report.h"

namespace hapticd {

namespace {

constexpr double period = 0.02;       // [s]
constexpr double latch_after = 1e-3;  // of a step's begin [s]
constexpr int warm_up = 25;           // steps that are not counted: first contact, first bases
constexpr int fewest_steps = 10;

// In place of the tip: cuts as deep as that, from the first one through the middle on.
BladePath put_blade(Scene& scene, double depth) {
  constexpr double edge = 1.6e-3, toughness = 0.1;  // [m], [J/m²]: a 30th of a millimetre of the lens's E
  constexpr int samples = 16, new_nodes = 8000;
  SceneBody& lens = scene.bodies[0];
  lens.removable = false;
  lens.toughness = toughness;
  lens.max_new_nodes = new_nodes;
  scene.first().shape = sheet_blade(edge, samples);
  double top = lens.mesh.nodes[0].z();
  for (const Vec3& x : lens.mesh.nodes) top = std::max(top, x.z());
  BladePath way;
  way.height = top - depth + edge / 2;
  return way;
}

Vec3 anterior_pole(const TetMesh& mesh) {
  return *std::max_element(mesh.nodes.begin(), mesh.nodes.end(),
                           [](const Vec3& a, const Vec3& b) { return a.z() < b.z(); });
}

bool keeps_references(ComplianceMethod method) {
  return method == ComplianceMethod::zone || method == ComplianceMethod::lazy;
}

int median(std::vector<double> values) { return static_cast<int>(quantiles(std::move(values)).p50); }

// The simulation's place among ordinary programs, where that is allowed, while it lives.
class ScopedNice {
 public:
  ScopedNice() : before_(getpriority(PRIO_PROCESS, 0)) { use_nice(simulation_nice); }
  ~ScopedNice() { use_nice(before_); }
  ScopedNice(const ScopedNice&) = delete;
  ScopedNice& operator=(const ScopedNice&) = delete;

 private:
  const int before_;
};

// Another program on the simulation's core while it lives.
class BusyCore {
 public:
  explicit BusyCore(bool busy) {
    if (busy)
      thread_ = std::jthread([](const std::stop_token& ended) {
        use_core(process_cores().front());
        while (!ended.stop_requested()) continue;
      });
  }

 private:
  std::jthread thread_;
};

// The simulation thread's loop, on this one.
class StepRun {
 public:
  explicit StepRun(const StepCase& of)
      : case_(of),
        scene_(lens_under_tip(of.lens.name, of.lens.alarm_distance, of.lens.sample_spacing)),
        times_(monotonic_ns) {
    if (of.cut_depth > 0)
      way_ = [way = put_blade(scene_, of.cut_depth)](double t) { return drawn_blade(way, t); };
    else
      way_ = [tip = TravellingTip(scene_, {.speed = of.speed})](double t) { return tip.at(t); };
    if (of.near > 0) {
      const TetMesh& mesh = scene_.bodies[0].mesh;
      scene_.bodies[0].near = {anterior_pole(mesh), of.near * measure_mesh(mesh).edge.mean, true};
      point_.near_mm = 1e3 * scene_.bodies[0].near->radius;
    }
    scene_.compliance = of.method;
    scene_.bodies[0].corotational = of.corotational;
    scene_.first().removal.rate = of.removals_per_s;
    WorldSettings settings = world_settings(scene_);
    settings.compliance_options.times = &times_;
    const std::int64_t begun = monotonic_ns();
    world_ = make_world(scene_, settings);
    world_->make_regions([&](int) { return monotonic_ns() - begun > std::llround(1e9 * of.start_seconds); });
    // As the daemon does before its clock starts.
    world_->step([] { return InstrumentSample{}; }, *problem_);
    point_.start_ms = 1e-6 * static_cast<double>(monotonic_ns() - begun);
    bases_.start();
    if (of.near > 0) far_.start([] { use_nice(far_tissue_nice); });
    point_.threads = 2 + (of.near > 0);
  }

  StepPoint run(const std::function<bool(double)>& progress) {
    const BusyCore busy(case_.busy);
    const ScopedCore own(process_cores().front());
    const ScopedNice first;
    const std::int64_t begun = monotonic_ns();
    std::int64_t intended = begun;
    for (int k = 0; k < warm_up + case_.steps; ++k) {
      step(k);
      const double spent = 1e-9 * static_cast<double>(monotonic_ns() - begun);
      if (spent > case_.seconds && k >= fewest_steps) break;
      if (!progress(std::max(spent / case_.seconds, static_cast<double>(k + 1) / (warm_up + case_.steps))))
        break;
      // What other threads make for it comes in time or not.
      if (keeps_references(case_.method) || case_.near > 0) intended = next(intended);
    }
    return point();
  }

 private:
  static std::int64_t next(std::int64_t intended) {
    const auto period_ns = std::llround(1e9 * period);
    do intended += period_ns;
    while (intended + period_ns < monotonic_ns());
    std::this_thread::sleep_for(
        std::chrono::nanoseconds(std::max<std::int64_t>(0, intended - monotonic_ns())));
    return intended;
  }

  void step(int k) {
    InstrumentSample sample[2];
    for (int i = 0; i < 2; ++i) {
      sample[i].pose = way_(period * k + i * latch_after);
      sample[i].present = true;
      sample[i].phaco = case_.removals_per_s > 0;
    }
    int asked = 0;
    times_.start();
    const std::int64_t begin = monotonic_ns();
    for (ReferenceMaker* maker : {&bases_, &far_})
      while (std::optional<ReferenceJob> job = maker->take()) world_->adopt(std::move(*job));
    const StepReport report = world_->step([&] { return sample[std::min(asked++, 1)]; }, *problem_);
    for (ReferenceJob& job : world_->wanted_references())
      (job.kind == JobKind::far_tissue ? far_ : bases_).give(std::move(job));
    times_.enter(0);
    const std::int64_t spent = monotonic_ns() - begin;
    Step& done = done_.emplace_back();
    done.ms = 1e-6 * static_cast<double>(spent);
    for (std::size_t p = 0; p < done.parts_ms.size(); ++p)
      done.parts_ms[p] = 1e-6 * static_cast<double>(times_.ns(static_cast<StepPart>(p)));
    point_.force.push_back(report.contact.wrench[0].head<3>());
    done.nodes = problem_->nodes;
    done.contacts = report.contact.contacts;
    done.active = report.contact.active;
    done.counts = case_.cut_depth == 0 || report.split;
    point_.split_steps += report.split;
    point_.removed += report.removed;
    point_.bases += report.references_adopted;
    point_.regions_entered += report.regions_entered;
    point_.late_references += report.uncovered_nodes > 0;
    point_.fallback_steps += report.condensed_nodes > 0;
  }

  StepPoint point() {
    bases_.stop();
    far_.stop();
    const auto skipped = std::min<std::size_t>(warm_up, done_.size() / 3);
    done_.erase(done_.begin(), done_.begin() + static_cast<std::ptrdiff_t>(skipped));
    std::erase_if(done_, [](const Step& s) { return !s.counts; });
    point_.nodes_added =
        world_->bodies()[0].model.nodes_in_use - static_cast<int>(scene_.bodies[0].mesh.nodes.size());
    point_.busy = case_.busy;
    point_.speed = case_.speed;
    point_.near = case_.near;
    const Body& lens = world_->bodies()[0];
    for (int n = 0; n < lens.model.nodes_in_use; ++n)
      point_.simulated += !lens.model.fixed[n] && lens.state.live_tets_of_node[n] > 0;
    point_.memory_mb = 1e-6 * static_cast<double>(lens.compliance->report().memory_bytes);
    if (lens.regions) {
      point_.boundary = static_cast<int>(lens.model.condensed->node.size());
      point_.memory_mb +=
          1e-6 * static_cast<double>(lens.regions->bytes + lens.regions->regions->memory_bytes());
    }
    point_.model = case_.corotational ? "corotational" : "linear";
    point_.compliance = name_of(case_.method);
    point_.nodes = static_cast<int>(scene_.bodies[0].mesh.nodes.size());
    point_.tets = static_cast<int>(scene_.bodies[0].mesh.tets.size());
    point_.steps = static_cast<int>(done_.size());
    std::vector<double> ms, patch_nodes, contacts, active;
    const auto count = static_cast<double>(done_.size());
    for (const Step& s : done_) {
      ms.push_back(s.ms);
      patch_nodes.push_back(s.nodes);
      contacts.push_back(s.contacts);
      active.push_back(s.active);
      point_.over_20ms += s.ms > 1e3 * period ? 1 / count : 0;
      point_.mean_ms += s.ms / count;
      for (std::size_t p = 0; p < s.parts_ms.size(); ++p) point_.parts_ms[p] += s.parts_ms[p] / count;
    }
    point_.patch_nodes = median(patch_nodes);
    point_.contacts = median(contacts);
    point_.active = median(active);
    point_.reference_ms_median = 1e-6 * bases_.make_time().snapshot().percentile(50);
    const Quantiles q = quantiles(ms);
    point_.step_ms_median = q.p50;
    point_.step_ms_p99 = q.p99;
    point_.step_ms_max = q.max;
    point_.fits_50hz = point_.over_20ms <= 0.005;
    return point_;
  }

  const StepCase& case_;
  Scene scene_;
  std::function<Pose(double)> way_;
  PartTimes times_;
  std::unique_ptr<World> world_;
  std::unique_ptr<CondensedProblem> problem_ = std::make_unique<CondensedProblem>();
  ReferenceMaker bases_, far_;
  struct Step {
    double ms = 0;
    StepParts parts_ms{};
    int nodes = 0, contacts = 0, active = 0;
    bool counts = true;
  };
  std::vector<Step> done_;
  StepPoint point_;
};

}  // namespace

const std::vector<StepLens>& step_lenses() {
  static const std::vector<StepLens> lenses = {{"1k", 1.6e-3, 0.6e-3},
                                               {"5k", 0.6e-3, 0.4e-3},
                                               {"10k", 0.45e-3, 0.3e-3},
                                               {"20k", 0.3e-3, 0.25e-3},
                                               {"100k", 0.18e-3, 0.2e-3}};
  return lenses;
}

const char* name_of(StepPart part) noexcept {
  constexpr const char* names[] = {"publish",     "collision", "assembly", "factor",
                                   "free_motion", "condense",  "solve"};
  return names[static_cast<std::size_t>(part)];
}

const char* name_of(ComplianceMethod method) noexcept {
  switch (method) {
    case ComplianceMethod::exact:
      return "exact";
    case ComplianceMethod::zone:
      return "zone";
    case ComplianceMethod::lazy:
      return "lazy";
    case ComplianceMethod::updown:
      return "updown";
    default:
      return "dense";
  }
}

StepPoint chart_step(const StepCase& of, const std::function<bool(double)>& progress) {
  return StepRun(of).run(progress);
}

void compare_forces(std::span<StepPoint> points) {
  for (StepPoint& p : points) {
    const auto whole = std::find_if(points.begin(), points.end(), [&](const StepPoint& o) {
      return o.near == 0 && o.speed == p.speed && o.nodes == p.nodes && o.model == p.model &&
             o.compliance == p.compliance;
    });
    if (p.near == 0 || whole == points.end()) continue;
    double peak = 0, sum = 0, largest = 0;
    const std::size_t steps = std::min(p.force.size(), whole->force.size());
    for (std::size_t k = 0; k < steps; ++k) {
      const double off = (p.force[k] - whole->force[k]).norm();
      peak = std::max(peak, whole->force[k].norm());
      largest = std::max(largest, off);
      sum += off * off;
    }
    if (!(peak > 0)) continue;
    p.force_rms_rel = std::sqrt(sum / static_cast<double>(steps)) / peak;
    p.force_max_rel = largest / peak;
  }
}

std::optional<double> growth(std::span<const StepPoint> points, const std::string& model,
                             const std::string& compliance, double near, double speed,
                             const std::function<double(const StepPoint&)>& ms) {
  constexpr double least_ms = 0.01;
  double n = 0, x = 0, y = 0, xx = 0, xy = 0;
  for (const StepPoint& p : points) {
    if (p.model != model || p.compliance != compliance || p.near != near || p.speed != speed) continue;
    if (!(ms(p) >= least_ms)) return std::nullopt;
    const double u = std::log(p.nodes), v = std::log(ms(p));
    n += 1;
    x += u;
    y += v;
    xx += u * u;
    xy += u * v;
  }
  const double spread = n * xx - x * x;
  if (n < 2 || !(spread > 1e-9)) return std::nullopt;
  return (n * xy - x * y) / spread;
}

}  // namespace hapticd
