#include "tools/chart/force/chart_force.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>

#include "tools/offline/operation_history.h"
#include "tools/offline/reference_cache.h"

namespace hapticd {

namespace {

constexpr double longest_step = 1e-3;     // of a reference [s]
constexpr double shortest_step = 250e-6;  // … whose half is the last that is tried
constexpr double shortest_with_removals = 125e-6;

// Pieces of work by about how long they take, for the progress bar.
class Work {
 public:
  using Report = std::function<bool(double, const std::string&)>;
  Work(const Report& report, double whole) : report_(report), whole_(whole) {}

  void begin(const std::string& what, double weight) {
    done_ += weight_;
    weight_ = weight;
    what_ = what;
  }
  OfflineProgress progress() {
    return [this](double fraction) {
      go_on_ = go_on_ && (!report_ || report_(std::min(1.0, (done_ + fraction * weight_) / whole_), what_));
      return go_on_;
    };
  }
  bool goes_on() const { return go_on_; }
  void is_whole(double whole) { whole_ = whole; }

 private:
  const Report& report_;
  double whole_, done_ = 0, weight_ = 0;
  std::string what_;
  bool go_on_ = true;
};

// Of an exact step, which nearly everything consists of.
double step_weight(const Scene& scene) {
  double weight = 0;
  for (const SceneBody& b : scene.bodies)
    if (b.kind == BodyKind::deformable) weight += std::pow(static_cast<double>(b.mesh.nodes.size()), 1.5);
  return weight;
}

struct Reference {
  OfflineResult run;  // the finer of the two that were compared
  double step = 0;    // the other's [s]
  int inverted = 0;
  double half_step_rel = 0;
  bool converged = false;
};

// Halves the step until two agree, at most `shortest`'s half.
Reference reference_of(const Scene& scene, const OfflineInput& input, double shortest,
                       const ForceChartSettings& settings, const std::string& what, Work& work) {
  const double span = (input.to - input.from + input.settle) * step_weight(scene);
  Reference r;
  work.begin(what + ", reference", span / longest_step);
  r.run = cached_reference(settings.cache, scene, input, longest_step, work.progress());
  for (r.step = longest_step; work.goes_on(); r.step /= 2) {
    work.begin(what + ", reference at half the step", 2 * span / r.step);
    OfflineResult half = cached_reference(settings.cache, scene, input, r.step / 2, work.progress());
    r.half_step_rel = worst(force_errors(r.run.hands, half.hands)).rms_rel;
    r.inverted = r.run.inverted + half.inverted;
    r.run = std::move(half);
    r.converged = work.goes_on() && r.half_step_rel <= converged_within && r.inverted == 0;
    if (r.converged || r.inverted > 0 || r.step < 1.5 * shortest) break;
  }
  return r;
}

// How much later than scheduled a problem without what goes came into use [s].
double felt_after(const OfflineOptions& o, const OfflineResult& result) {
  return (result.interim.work.empty() ? o.publish_after : *o.interim_after) - removal_lead;
}

// The same removals, each as late as that.
OfflineInput removed_after(OfflineInput input, double delay) {
  for (RemovalEvent& e : input.removals) e.t += delay;
  return input;
}

ForcePoint point_of(const ForceConfiguration& c, const OfflineInput& input, const OfflineResult& result) {
  ForcePoint p;
  p.label = c.label;
  p.config = c.words;
  const double per_second = 1e3 / (input.to - input.from);
  p.simulation_ms_per_s = per_second * result.simulation.total;
  p.haptic_ms_per_s = per_second * result.haptic.total;
  p.references_ms_per_s = per_second * result.bases.total;
  p.cpu_ms_per_s = p.simulation_ms_per_s + p.haptic_ms_per_s + p.references_ms_per_s;
  p.simulation_step_ms_p50 = 1e3 * result.simulation.quantile(50);
  p.simulation_step_ms_p99 = 1e3 * result.simulation.quantile(99);
  p.interim_ms_p50 = 1e3 * result.interim.quantile(50);
  p.haptic_us_p50 = 1e6 * result.haptic.quantile(50);
  p.haptic_us_p99 = 1e6 * result.haptic.quantile(99);
  p.memory_mb = 1e-6 * static_cast<double>(result.memory_bytes);
  p.cut_area = result.cut_area;
  p.inverted = result.inverted;
  p.capped = result.capped;
  p.dropped_samples = result.dropped_samples;
  p.uncovered_nodes = result.uncovered_nodes;
  p.reciprocity = result.reciprocity;
  p.third_law = result.third_law;
  return p;
}

bool same_but_tolerance(nlohmann::ordered_json a, nlohmann::ordered_json b) {
  a.erase("tolerance");
  b.erase("tolerance");
  return a == b;
}

const ForceRun::Trace* trace(const ForceRun& run, const std::string& label) {
  for (const ForceRun::Trace& t : run.traces)
    if (t.label == label) return &t;
  return nullptr;
}

struct Job {
  Scene scene;
  OfflineInput input;
  std::string trajectory;
  int removals;
};

std::vector<Job> recording_jobs(const Scene& scene, const std::vector<std::filesystem::path>& recordings,
                                const ForceChartSettings& settings, const std::vector<int>& removals) {
  std::vector<Job> jobs;
  for (const std::filesystem::path& file : recordings)
    for (const int per_step : removals) {
      Job job{scene, motion_in_scene(scene, file, settings.window), file.stem().string(), per_step};
      if (per_step > 0) job.input.removals = record_removals(scene, job.input, per_step);
      jobs.push_back(std::move(job));
    }
  return jobs;
}

// What is another part's has no removals, and no history.
std::vector<Job> window_jobs(const Scene& scene, const std::vector<ForceWindow>& windows,
                             const ForceChartSettings& settings, Work& work) {
  const std::vector<int>& removals = settings.removals;
  std::vector<Job> jobs;
  std::vector<std::size_t> with_history;
  for (const ForceWindow& w : windows) {
    if (std::none_of(removals.begin(), removals.end(), [&](int r) { return (r > 0) == w.removals; }))
      continue;
    if (w.history && settings.shard.has(jobs.size())) with_history.push_back(jobs.size());
    jobs.push_back({scene, motions_in_window(scene, w), w.name, w.removals ? 1 : 0});
  }
  if (!with_history.empty()) {
    std::vector<double> begins;
    for (const std::size_t k : with_history) begins.push_back(jobs[k].input.from - jobs[k].input.settle);
    work.begin("what the operation leaves",
               *std::max_element(begins.begin(), begins.end()) * scene.rate * step_weight(scene));
    const std::vector<BodyStarts> starts = bodies_along_trajectories(scene, begins, work.progress());
    for (std::size_t i = 0; i < starts.size(); ++i)
      jobs[with_history[i]].scene = begun_from(scene, starts[i]);
  }
  for (std::size_t k = 0; k < jobs.size() && work.goes_on(); ++k)
    if (jobs[k].removals > 0 && settings.shard.has(k))
      jobs[k].input.removals = record_removals(jobs[k].scene, jobs[k].input, {});
  return jobs;
}

bool is_of(const ForceRun& run, const ForcePoint& p) {
  return p.trajectory == run.trajectory && p.removals == run.removals;
}

// Where a tighter tolerance does not give a smaller error, and why.
void explain_tolerances(ForceChart& chart, const ForceRun& run) {
  constexpr double default_tolerance = 1e-8;
  const auto tolerance = [&](const ForcePoint& p) { return p.config.value("tolerance", default_tolerance); };
  for (const ForcePoint& tight : chart.points)
    for (const ForcePoint& loose : chart.points) {
      if (!is_of(run, tight) || !is_of(run, loose) || tolerance(tight) >= tolerance(loose) ||
          tight.error.rms_rel <= loose.error.rms_rel || !same_but_tolerance(tight.config, loose.config))
        continue;
      const ForceRun::Trace *a = trace(run, tight.label), *b = trace(run, loose.label);
      if (!a || !b || run.reference[0].empty()) continue;
      const double apart = worst(force_errors(a->hands, b->hands)).rms_rel;
      char text[400];
      std::snprintf(
          text, sizeof text,
          "%s, %d removals: '%s' asks for a tighter tolerance than '%s' and errs by %.4f %% instead of "
          "%.4f %%. Their forces are %.2g %% of the peak apart: the solver is not what errs, the "
          "20 ms between two problems is, and a difference so small falls on either side of it.",
          run.trajectory.c_str(), run.removals, tight.label.c_str(), loose.label.c_str(),
          100 * tight.error.rms_rel, 100 * loose.error.rms_rel, 100 * apart);
      chart.notes.push_back(text);
    }
}

// What the blend after a removal does to a hand's steps, and what it costs.
void explain_blends(ForceChart& chart, const ForceRun& run) {
  for (const ForcePoint& blended : chart.points) {
    const double time = blended.config.value("blend", 0.0);
    if (!is_of(run, blended) || blended.removals == 0 || time <= 0) continue;
    nlohmann::ordered_json direct = blended.config;
    direct.erase("blend");
    direct.erase("label");
    for (const ForcePoint& p : chart.points) {
      nlohmann::ordered_json other = p.config;
      other.erase("label");
      other.erase("quick");
      if (!is_of(run, p) || other != direct) continue;
      char text[400];
      std::snprintf(
          text, sizeof text,
          "%s, %d removals: '%s' (%g ms) takes the steps at swaps (p95) from %.1f to %.1f %% of the "
          "peak, where the reference's own are %.1f, and the RMS error from %.2f to %.2f %%.",
          p.trajectory.c_str(), p.removals, blended.label.c_str(), 1e3 * time,
          100 * p.error.swap_step_p95_rel, 100 * blended.error.swap_step_p95_rel,
          100 * p.error.reference_step_p95_rel, 100 * p.error.rms_rel, 100 * blended.error.rms_rel);
      chart.notes.push_back(text);
    }
  }
}

}  // namespace

void mark_front(std::vector<ForcePoint>& points) {
  for (ForcePoint& p : points) {
    p.front_factor = 1;
    for (const ForcePoint& q : points) {
      if (&p == &q || q.trajectory != p.trajectory || q.removals != p.removals || !q.reference_converged)
        continue;
      if (q.cpu_ms_per_s <= 0 || q.error.rms_rel <= 0) continue;
      p.front_factor = std::max(p.front_factor,
                                std::min(p.cpu_ms_per_s / q.cpu_ms_per_s, p.error.rms_rel / q.error.rms_rel));
    }
    p.pareto = p.reference_converged && p.front_factor <= 1;
  }
}

ForceChart chart_force(const Scene& scene, const std::vector<std::filesystem::path>& recordings,
                       const ForceTable& table, const ForceChartSettings& settings,
                       const std::function<bool(double, const std::string&)>& progress) {
  std::vector<const ForceConfiguration*> chosen;
  for (const ForceConfiguration& c : table.configurations)
    if (!settings.quick || c.quick || c.label == table.default_label) chosen.push_back(&c);
  const std::vector<int>& removals = settings.removals;

  double whole = 0;
  for (const ForceWindow& w : table.windows)
    if (w.history) whole = std::max(whole, w.from * scene.rate * step_weight(scene));
  Work work(progress, whole);
  // Inputs first: a fault in the last recording is not found after an hour.
  const std::vector<Job> jobs = table.windows.empty() ? recording_jobs(scene, recordings, settings, removals)
                                                      : window_jobs(scene, table.windows, settings, work);
  for (const Job& job : jobs) {
    const double span = job.input.to - job.input.from + job.input.settle;
    whole += (job.removals > 0 ? 90 : 15) * span / longest_step * step_weight(scene);
    for (const ForceConfiguration* c : chosen)
      whole += span * c->rate.value_or(scene.rate) * step_weight(scene);
  }
  const bool in_space = !settings.quick && !table.finest.empty() && !jobs.empty();
  const Scene finest = in_space ? with_meshes(scene, table.finest) : Scene{};
  if (in_space) whole += 3 * (jobs[0].input.to - jobs[0].input.from) / longest_step * step_weight(finest);

  ForceChart chart;
  chart.default_label = table.default_label;
  chart.shard = ShardLedger(settings.shard);
  work.is_whole(whole);
  for (const Job& job : jobs) {
    if (!chart.shard.begins()) continue;
    if (!work.goes_on()) return chart;
    const std::string what = job.trajectory + (job.removals > 0 ? " with removals" : "");
    const double shortest = job.removals > 0 ? shortest_with_removals : shortest_step;
    const Reference own = reference_of(job.scene, job.input, shortest, settings, what, work);
    Reference finest_reference;
    std::map<double, Reference> felt;  // by delay
    if (job.removals > 0) felt[0] = own;
    const bool space_here = in_space && &job == &jobs[0];
    if (space_here)
      finest_reference =
          reference_of(finest, job.input, longest_step, settings, what + ", finest mesh", work);

    ForceRun run;
    run.trajectory = job.trajectory;
    run.removals = job.removals;
    run.removed = own.run.removed;
    run.cut_area = own.run.cut_area;
    run.half_step_rel = own.half_step_rel;
    run.reference_step = own.step;
    run.inverted = own.inverted;
    run.converged = own.converged;
    run.reference_cpu_s = own.run.simulation.total;
    run.reference = own.run.hands;
    for (const ForceConfiguration* c : chosen) {
      if (!work.goes_on()) return chart;
      // A schedule names elements of the scene's own mesh, and so does a history.
      if (!c->meshes.empty() && (job.removals > 0 || job.input.leads_in)) continue;
      const Scene as = configured(job.scene, *c);
      Reference other;
      if (!c->meshes.empty())
        other = reference_of(with_meshes(job.scene, c->meshes), job.input, shortest_step, settings, c->label,
                             work);
      const Reference& truth = c->meshes.empty() ? own : other;
      work.begin(what + ": " + c->label,
                 (job.input.to - job.input.from + job.input.settle) * as.rate * step_weight(as));
      const OfflineResult result = run_offline(as, job.input, c->options, work.progress());
      ForcePoint p = point_of(*c, job.input, result);
      p.trajectory = job.trajectory;
      p.removals = job.removals;
      p.hands = force_errors(result.hands, truth.run.hands);
      p.error = worst(p.hands);
      p.reference_converged = c->meshes.empty() ? run.converged : other.converged;
      if (job.removals > 0) {
        const double delay = felt_after(c->options, result);
        if (!felt.contains(delay))
          felt[delay] = reference_of(job.scene, removed_after(job.input, delay), shortest, settings,
                                     what + " felt", work);
        const Reference& late = felt[delay];
        run.felt_half_step_rel = std::max(run.felt_half_step_rel, late.half_step_rel);
        run.felt_converged = run.felt_converged && late.converged;
        p.felt_hands = force_errors(result.hands, late.run.hands);
        p.felt = worst(p.felt_hands);
      }
      if (space_here) {
        p.space_rms_rel = force_error(truth.run.ticks(), finest_reference.run.ticks()).rms_rel;
        p.whole_rms_rel = force_error(result.ticks(), finest_reference.run.ticks()).rms_rel;
      }
      run.traces.push_back({c->label, result.hands});
      chart.points.push_back(std::move(p));
    }
    chart.runs.push_back(std::move(run));
    chart.shard.made("runs", chart.runs.size());
    chart.shard.made("points", chart.points.size());
    explain_tolerances(chart, chart.runs.back());
    explain_blends(chart, chart.runs.back());
    chart.shard.made("notes", chart.notes.size());
  }
  mark_front(chart.points);
  return chart;
}

}  // namespace hapticd
