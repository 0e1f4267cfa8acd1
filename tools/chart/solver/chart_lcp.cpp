#include "tools/chart/solver/chart_lcp.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <memory>

#include "physics/contact/solver/coulomb.h"
#include "tools/chart/solver/pgs_baseline.h"

namespace hapticd {
namespace {

constexpr double tolerance = 1e-6, reference_tolerance = 1e-10, budget_us = 400;
constexpr int regularisation_every = 5;

double now_us() {
  return std::chrono::duration<double, std::micro>(std::chrono::steady_clock::now().time_since_epoch())
      .count();
}

// A deadline by the steady clock.
struct Until {
  double us;
  Deadline deadline() const {
    return {[](const void* until) noexcept {
              return static_cast<std::int64_t>(1e3 * (static_cast<const Until*>(until)->us - now_us()));
            },
            this};
  }
};

struct Answer {
  double residual = 0;
  int active = 0;
  bool solved = true;
  bool late = false;
  double epsilon = 0;              // that its residual is of
  const double* anchor = nullptr;  // forces that a raised ε may be counted from
};

// The natural map of an answer, by nothing that the solver kept but ε and the anchor.
double residual_anew(const ContactSequence& s, const VecX& lambda, const Answer& answer) {
  MatX W = s.W();
  const int width = s.rows() / static_cast<int>(s.mu().size());
  VecX added(s.rows());
  for (Eigen::Index i = 0; i < W.rows(); i += width)
    added.segment(i, width).setConstant(answer.epsilon * W.diagonal().segment(i, width).mean());
  W.diagonal() += added;
  if (width == 1) return lcp_residual(W, s.q(), lambda);
  const double plain = coulomb_residual(W, s.q(), lambda, s.mu());
  if (!answer.anchor) return plain;
  const VecX q = s.q() - added.cwiseProduct(VecX::Map(answer.anchor, s.rows()));
  return std::min(plain, coulomb_residual(W, q, lambda, s.mu()));
}

// One solver with its own warm start, and what it measured.
class Contestant {
 public:
  enum class Start { warm, stale, cold };

  Contestant(std::string solver, Start start, int steps, double tolerance_of_it)
      : tolerance_(tolerance_of_it), start_(start), steps_(steps) {
    point_.solver = std::move(solver);
    point_.warm = start != Start::cold;
  }
  virtual ~Contestant() = default;

  bool due(int step) const { return step < steps_; }

  void run(const ContactSequence& sequence) {
    if (lambda_.size() != sequence.rows()) lambda_ = kept_ = VecX::Zero(sequence.rows());
    sequence.carry(lambda_);
    sequence.carry(kept_);
    if (start_ == Start::cold) lambda_.setZero();
    if (start_ == Start::stale) lambda_ = kept_;
    prepare(sequence);
    const double begun = now_us();
    const Answer answer = solve(sequence, begun);
    us_.push_back(now_us() - begun);
    if (sequence.relinearised()) kept_ = lambda_;
    residual_.push_back(answer.residual);
    active_.push_back(answer.active);
    point_.failures += !answer.solved && !answer.late;
    point_.capped += answer.late;
    if (!answer.solved) return;
    point_.raised += answer.anchor != nullptr;
    point_.solved_but_wrong += !(residual_anew(sequence, lambda_, answer) <= 10 * tolerance_);
  }

  void compare(const ContactSequence& sequence, const Vec6& reference, double largest) {
    const double length = sequence.length(reference);
    if (length > 1e-3 * largest)
      error_.push_back(sequence.length(sequence.wrench(lambda_) - reference) / length);
  }

  LcpPoint point() {
    point_.steps = static_cast<int>(us_.size());
    point_.us = quantiles(us_);
    const Quantiles residual = quantiles(residual_), active = quantiles(active_);
    point_.residual_median = residual.p50;
    point_.residual_max = residual.max;
    point_.active_median = active.p50;
    point_.active_max = active.max;
    point_.wrench_error = quantiles(error_);
    return point_;
  }
  const VecX& lambda() const { return lambda_; }

 protected:
  // What the loop has ready before the solve.
  virtual void prepare(const ContactSequence&) {}
  virtual Answer solve(const ContactSequence& sequence, double begun) = 0;

  VecX lambda_;

 private:
  double tolerance_;
  Start start_;
  int steps_;
  VecX kept_;
  LcpPoint point_;
  std::vector<double> us_, residual_, active_, error_;
};

class Hybrid final : public Contestant {
 public:
  Hybrid(std::string solver, Start start, int steps, const CoulombOptions& options, double limit_us = 0)
      : Contestant(std::move(solver), start, steps, options.tolerance),
        options_(options),
        limit_us_(limit_us) {}

 private:
  Answer solve(const ContactSequence& s, double begun) override {
    const Until until{begun + limit_us_};
    CoulombOptions options = options_;
    if (limit_us_ > 0) options.deadline = until.deadline();
    const CoulombResult r = solve_coulomb(s.W(), s.q(), s.mu(), lambda_, *workspace_, s.version(), options);
    const bool raised = r.relative_diagonal > options.relative_diagonal;
    return {r.residual,
            r.active,
            r.status == SolveStatus::solved,
            r.status == SolveStatus::deadline,
            r.relative_diagonal,
            raised ? workspace_->anchor.data() : nullptr};
  }

  CoulombOptions options_;
  double limit_us_;
  std::unique_ptr<CoulombWorkspace> workspace_ = std::make_unique<CoulombWorkspace>();
};

class PivotingContestant final : public Contestant {
 public:
  PivotingContestant(Start start, int steps) : Contestant("pivoting", start, steps, LcpOptions{}.tolerance) {}

 private:
  void prepare(const ContactSequence&) override {
    active_.assign(static_cast<std::size_t>(lambda_.size()), 0);
    for (Eigen::Index i = 0; i < lambda_.size(); ++i) active_[static_cast<std::size_t>(i)] = lambda_[i] > 0;
  }
  Answer solve(const ContactSequence& s, double) override {
    const LcpResult r = solve_lcp(s.W(), s.q(), lambda_, active_, *workspace_, s.version(), {});
    return {r.residual, r.active, r.status == SolveStatus::solved, false, LcpOptions{}.relative_diagonal};
  }

  std::vector<std::uint8_t> active_;
  std::unique_ptr<LcpWorkspace> workspace_ = std::make_unique<LcpWorkspace>();
};

class Peer final : public Contestant {
 public:
  Peer(Start start, int steps) : Contestant("pgs", start, steps, tolerance) {}

 private:
  Answer solve(const ContactSequence& s, double begun) override {
    const Until until{begun + budget_us};
    const std::span<const double> mu =
        s.rows() == static_cast<int>(s.mu().size()) ? std::span<const double>{} : s.mu();
    const PeerResult r = solve_projected(s.W(), s.q(), mu, lambda_, tolerance, 1 << 20, until.deadline());
    return {r.residual, static_cast<int>((lambda_.array() > 0).count()), r.solved, !r.solved};
  }
};

std::vector<std::unique_ptr<Contestant>> contestants(bool friction, bool stale, const LcpChartSettings& s) {
  using Start = Contestant::Start;
  const Start warm = stale ? Start::stale : Start::warm;
  std::vector<std::unique_ptr<Contestant>> all;
  if (!friction) {
    all.push_back(std::make_unique<PivotingContestant>(Start::warm, s.steps));
    if (stale) all.push_back(std::make_unique<PivotingContestant>(Start::stale, s.steps));
    all.push_back(std::make_unique<PivotingContestant>(Start::cold, s.peer_steps));
  } else {
    CoulombOptions options;
    options.tolerance = reference_tolerance;
    all.push_back(std::make_unique<Hybrid>("hybrid_1e-10", Start::warm, s.steps, options));
    options.tolerance = tolerance;
    all.push_back(std::make_unique<Hybrid>("hybrid", warm, s.steps, options));
    all.push_back(std::make_unique<Hybrid>("hybrid", Start::cold, s.peer_steps, options));
    all.push_back(std::make_unique<Hybrid>("hybrid_400us", warm, s.steps, options, budget_us));
    options.max_newton = 0;
    options.max_sweeps = 1 << 20;
    all.push_back(std::make_unique<Hybrid>("block_gauss_seidel", warm, s.peer_steps, options, budget_us));
    all.push_back(
        std::make_unique<Hybrid>("block_gauss_seidel", Start::cold, s.peer_steps, options, budget_us));
  }
  all.push_back(std::make_unique<Peer>(warm, s.peer_steps));
  all.push_back(std::make_unique<Peer>(Start::cold, s.peer_steps));
  return all;
}

// The rigid problem without the compliance given to it, from the answer with it.
class Unregularised {
 public:
  void run(const ContactSequence& s, const VecX& with) {
    VecX without = with;
    CoulombOptions options;
    options.tolerance = tolerance;
    const double length = s.length(s.wrench(with));
    if (length <= 0) return;
    const CoulombResult r =
        solve_coulomb(s.W_unregularised(), s.q(), s.mu(), without, *workspace_, 0, options);
    if (r.status == SolveStatus::solved)
      change_.push_back(s.length(s.wrench(without) - s.wrench(with)) / length);
    else
      ++unsolved_;
  }
  RegularisationPoint point(int contacts) const {
    return {contacts, static_cast<int>(change_.size()), unsolved_, quantiles(change_)};
  }

 private:
  std::vector<double> change_;
  int unsolved_ = 0;
  std::unique_ptr<CoulombWorkspace> workspace_ = std::make_unique<CoulombWorkspace>();
};

}  // namespace

std::vector<std::string> lcp_case_names() {
  std::vector<std::string> names = contact_case_names();
  names.push_back("stale");
  return names;
}

void chart_case(const std::string& kind, int contacts, bool friction, const LcpChartSettings& settings,
                const std::function<bool(double)>& progress, LcpChart& chart) {
  SequenceSettings of_sequence;
  of_sequence.kind = ContactCase::blunt;
  for (std::size_t k = 0; k < contact_case_names().size(); ++k)
    if (contact_case_names()[k] == kind) of_sequence.kind = static_cast<ContactCase>(k);
  of_sequence.contacts = contacts;
  of_sequence.friction = friction;
  of_sequence.seed = settings.seed;
  ContactSequence sequence(of_sequence);

  const auto all = contestants(friction, kind == "stale" || kind == "flat_stale", settings);
  Unregularised unregularised;
  const bool rigid = friction && of_sequence.kind == ContactCase::rigid;
  VecX reference;
  double largest = 0;
  for (int step = 0; step < settings.steps; ++step) {
    sequence.advance(reference);
    for (const auto& c : all)
      if (c->due(step)) c->run(sequence);
    reference = all.front()->lambda();
    const Vec6 wrench = sequence.wrench(reference);
    largest = std::max(largest, sequence.length(wrench));
    for (const auto& c : all)
      if (c->due(step)) c->compare(sequence, wrench, largest);
    if (rigid && step % regularisation_every == 0) unregularised.run(sequence, reference);
    if (step % 16 == 0 && !progress(static_cast<double>(step) / settings.steps)) return;
  }
  for (const auto& c : all) {
    LcpPoint point = c->point();
    point.rows = sequence.rows();
    point.contacts = contacts;
    point.friction = friction;
    point.kind = kind;
    chart.points.push_back(point);
  }
  if (rigid) chart.regularisation.push_back(unregularised.point(contacts));
}

}  // namespace hapticd
