#include "tools/chart/solver/chart_captures.h"

#include <chrono>
#include <map>
#include <memory>

#include "server/record/contact_capture_file.h"
#include "tools/chart/solver/pgs_baseline.h"

namespace hapticd {
namespace {

constexpr double tolerance = 1e-6, budget_us = 400;

double now_us() {
  return std::chrono::duration<double, std::micro>(std::chrono::steady_clock::now().time_since_epoch())
      .count();
}

struct Tally {
  std::vector<double> us, residual, active;
  int failures = 0, capped = 0, rows = 0, contacts = 0;
};

struct Key {
  std::string solver;
  bool friction, warm;
  auto operator<=>(const Key&) const = default;
};

class Captures {
 public:
  void run(const std::filesystem::path& file) {
    const auto captured = read_capture(file);
    const ContactCapture& c = captured->capture;
    ContactOptions options;
    options.whole_W = true;
    options.linearisations = c.linearisations;
    options.margin = c.margin;
    options.coulomb.tolerance = c.tolerance;

    const ContactSolution cold = solve(*captured, options, ContactState{}, false);
    static_cast<void>(cold);
    const ContactSolution warm = solve(*captured, options, c.state, true);
    CaptureReport report;
    report.file = file.filename();
    report.rows = scratch_->rows.rows();
    report.contacts = warm.contacts;
    report.active = warm.active;
    report.friction = scratch_->rows.rows_per_contact == 3;
    report.solved_then = c.status == SolveStatus::solved;
    report.solved = warm.status == SolveStatus::solved;
    report.residual_then = c.residual;
    report.residual = warm.residual;
    const double force = std::max(warm.wrench[0].head<3>().norm(), c.wrench[0].head<3>().norm());
    if (force > 0)
      report.wrench_difference = (warm.wrench[0] - c.wrench[0]).head<3>().norm() / force;
    report.penetration_um = 1e6 * warm.penetration;
    chart_.captures.push_back(report);
    if (report.rows > 0) solve_rows();
  }

  CaptureChart finish() {
    for (const auto& [key, t] : tallies_) {
      LcpPoint p;
      p.solver = key.solver;
      p.rows = t.rows;
      p.contacts = t.contacts;
      p.friction = key.friction;
      p.kind = "captured";
      p.warm = key.warm;
      p.steps = static_cast<int>(t.us.size());
      p.us = quantiles(t.us);
      const Quantiles residual = quantiles(t.residual), active = quantiles(t.active);
      p.residual_median = residual.p50;
      p.residual_max = residual.max;
      p.active_median = active.p50;
      p.active_max = active.max;
      p.failures = t.failures;
      p.capped = t.capped;
      chart_.points.push_back(p);
    }
    return std::move(chart_);
  }

 private:
  ContactSolution solve(const CapturedProblem& p, const ContactOptions& options, ContactState state,
                        bool warm) {
    state.frozen_step = 0;
    const double begun = now_us();
    const ContactSolution s = solve_contact(p.capture.problem, p.instruments, p.capture.X, p.capture.period,
                                            options, state, *scratch_);
    const double us = now_us() - begun;
    add({"solve_contact", scratch_->rows.rows_per_contact == 3, warm}, us, s.residual, s.active,
        s.status == SolveStatus::solved, false);
    return s;
  }

  void solve_rows() {
    const ContactRows& rows = scratch_->rows;
    const MatX W = rows.W();
    const VecX q = rows.q();
    VecX lambda = VecX::Zero(q.size());
    double begun = now_us();
    if (rows.rows_per_contact == 1) {
      std::vector<std::uint8_t> active(static_cast<std::size_t>(q.size()), 0);
      const LcpResult r = solve_lcp(W, q, lambda, active, *lcp_, 0, {});
      add({"pivoting", false, false}, now_us() - begun, r.residual, r.active, r.status == SolveStatus::solved,
          false);
    } else {
      const std::vector<double> mu(scratch_->mu.begin(), scratch_->mu.begin() + rows.contacts);
      const std::vector<double> limit(scratch_->limit.begin(), scratch_->limit.begin() + rows.contacts);
      CoulombOptions options;
      options.tolerance = tolerance;
      CoulombResult r = solve_coulomb(W, q, mu, lambda, *coulomb_, 0, options, limit);
      add({"hybrid", true, false}, now_us() - begun, r.residual, r.active, r.status == SolveStatus::solved,
          false);
      lambda.setZero();
      options.max_newton = 0;
      options.max_sweeps = 1 << 20;
      begun = now_us();
      options.deadline = until(begun + budget_us);
      r = solve_coulomb(W, q, mu, lambda, *coulomb_, 0, options, limit);
      const bool solved = r.status == SolveStatus::solved;
      add({"block_gauss_seidel", true, false}, now_us() - begun, r.residual, r.active, solved, !solved);
    }
    lambda.setZero();
    const std::vector<double> mu(scratch_->mu.begin(), scratch_->mu.begin() + rows.contacts);
    const std::vector<double> limit(scratch_->limit.begin(), scratch_->limit.begin() + rows.contacts);
    const bool friction = rows.rows_per_contact == 3;
    begun = now_us();
    const PeerResult r =
        solve_projected(W, q, friction ? std::span<const double>(mu) : std::span<const double>{}, lambda,
                        tolerance, 1 << 20, until(begun + budget_us), limit);
    add({"pgs", friction, false}, now_us() - begun, r.residual,
        static_cast<int>((lambda.array() > 0).count()), r.solved, !r.solved);
  }

  Deadline until(double us) {
    until_us_ = us;
    return {[](const void* u) noexcept {
              return static_cast<std::int64_t>(1e3 * (*static_cast<const double*>(u) - now_us()));
            },
            &until_us_};
  }

  void add(const Key& key, double us, double residual, int active, bool solved, bool late) {
    Tally& t = tallies_[key];
    t.us.push_back(us);
    t.residual.push_back(residual);
    t.active.push_back(active);
    t.failures += !solved && !late;
    t.capped += late;
    t.rows = std::max(t.rows, scratch_->rows.rows());
    t.contacts = std::max(t.contacts, scratch_->rows.contacts);
  }

  CaptureChart chart_;
  std::map<Key, Tally> tallies_;
  double until_us_ = 0;
  std::unique_ptr<ContactScratch> scratch_ = std::make_unique<ContactScratch>();
  std::unique_ptr<LcpWorkspace> lcp_ = std::make_unique<LcpWorkspace>();
  std::unique_ptr<CoulombWorkspace> coulomb_ = std::make_unique<CoulombWorkspace>();
};

}  // namespace

CaptureChart chart_captures(const std::vector<std::filesystem::path>& files,
                            const std::function<bool(double)>& progress) {
  Captures captures;
  for (std::size_t k = 0; k < files.size(); ++k) {
    captures.run(files[k]);
    if (!progress(static_cast<double>(k + 1) / static_cast<double>(files.size()))) break;
  }
  return captures.finish();
}

}  // namespace hapticd
