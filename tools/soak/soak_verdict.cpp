#include "tools/soak/soak_verdict.h"

#include <utility>

#include "tools/cli/report.h"

namespace hapticd {
namespace {

// Bounds of the verdict: what the machine does to a public tool, times what we may add.
constexpr double wake_p99_limit = 1.2, wake_p99_9_limit = 1.5, rtt_p50_limit = 1.5, answered_limit = 0.999;
constexpr int draws = 200;

double over(double a, double b) { return b > 0 ? a / b : 0; }

// What the checks of a block look at, and nothing else.
SoakFigures looked_at(const SoakFigures& f) {
  SoakFigures part;
  part.tick.wake_us = f.tick.wake_us;
  part.tick.state_age_us = f.tick.state_age_us;
  part.event.rtt_us = f.event.rtt_us;
  part.cyclictest_us = f.cyclictest_us;
  part.ddsperf = f.ddsperf;
  part.tick.scheduled = f.tick.scheduled;
  part.tick.answered = f.tick.answered;
  part.event.scheduled = f.event.scheduled;
  part.event.answered = f.event.answered;
  return part;
}

SoakCheck late(std::string what, double value, double limit, bool known) {
  return {std::move(what), value, limit, true, known, granted_lateness * limit};
}

}  // namespace

double on_time(const Tally& late_us) {
  std::uint64_t kept = 0;
  for (const auto& [late_by, n] : late_us.bins())
    if (late_by < 1000) kept += n;
  return over(static_cast<double>(kept), static_cast<double>(late_us.count()));
}

bool is_fit(const Tally& cyclictest_us) {
  return cyclictest_us.count() == 0 || on_time(cyclictest_us) >= fit_limit;
}

std::vector<SoakCheck> check_slices(const SoakFigures& f) {
  const bool ticked = f.tick.scheduled > 0, evented = f.event.scheduled > 0;
  const bool tool_woken = f.cyclictest_us.count() > 0, woken = ticked && tool_woken;
  std::vector<SoakCheck> checks;
  const auto of_wake = [&](double percent) {
    return over(f.tick.wake_us.percentile(percent), f.cyclictest_us.percentile(percent));
  };
  if (ticked) {
    checks.push_back(late("wake p99 / cyclictest", of_wake(99), wake_p99_limit, woken));
    checks.push_back(late("wake p99.9 / cyclictest", of_wake(99.9), wake_p99_9_limit, woken));
  }
  if (evented)
    checks.push_back(late("event round trip p50 / ddsperf",
                          over(f.event.rtt_us.percentile(50), f.ddsperf.p50()), rtt_p50_limit,
                          f.ddsperf.count > 0));
  const auto scheduled = static_cast<double>(f.tick.scheduled + f.event.scheduled);
  const double granted = tool_woken ? granted_loss * (1 - on_time(f.cyclictest_us)) : 0;
  checks.push_back({"answered / scheduled",
                    over(static_cast<double>(f.tick.answered + f.event.answered), scheduled), answered_limit,
                    false, true, answered_limit - granted});
  if (ticked)
    checks.push_back(late("state age p99, tick [µs]", f.tick.state_age_us.percentile(99),
                          1000 + 2 * f.cyclictest_us.percentile(99), woken));
  return checks;
}

std::string to_text(SoakOutcome outcome) {
  switch (outcome) {
    case SoakOutcome::pass:
      return "pass";
    case SoakOutcome::fail:
      return "fail";
    case SoakOutcome::machine:
      return "machine";
    case SoakOutcome::incomplete:
      break;
  }
  return "incomplete";
}

SoakOutcome outcome_of(const std::vector<SoakCheck>& checks, bool fit) {
  bool known = true, kept = true, granted = true;
  for (const SoakCheck& c : checks) {
    known = known && c.known;
    kept = kept && (!c.known || c.kept());
    granted = granted && (!c.known || c.granted());
  }
  if (kept) return known ? SoakOutcome::pass : SoakOutcome::incomplete;
  return granted && !fit ? SoakOutcome::machine : SoakOutcome::fail;
}

std::string explained(const SoakVerdict& v) {
  std::string text = to_text(v.outcome);
  if (v.confidence) text += ", " + fixed(100 * *v.confidence, 0) + " % sure";
  if (v.outcome == SoakOutcome::machine)
    text += ": this machine was late by itself, as cyclictest was; ours is within what that explains";
  if (v.outcome == SoakOutcome::fail)
    text += v.fit ? ": ours, on a machine that can hold it"
                  : ": ours, by more than the machine's own lateness explains";
  if (v.outcome == SoakOutcome::incomplete) text += ": a public tool gave nothing to compare with";
  return text;
}

SoakVerdict judge(const SoakRecord& r, const std::vector<SoakCheck>& further) {
  SoakVerdict v;
  v.checks = check_slices(r.all);
  const std::size_t redrawn = v.checks.size();
  v.checks.insert(v.checks.end(), further.begin(), further.end());
  v.fit = is_fit(r.all.cyclictest_us);
  v.outcome = outcome_of(v.checks, v.fit);

  std::vector<SoakFigures> blocks;
  for (const SoakFigures& block : r.blocks.all()) blocks.push_back(looked_at(block));
  v.blocks = blocks.size();
  std::vector<std::vector<double>> values(redrawn);
  int drawn = 0, same = 0;
  redraw(blocks, draws, [&](const SoakFigures& sum) {
    std::vector<SoakCheck> checks = check_slices(sum);
    if (checks.size() != redrawn) return;  // no slice of one kind was drawn
    for (std::size_t i = 0; i < redrawn; ++i)
      if (checks[i].known) values[i].push_back(checks[i].value);
    checks.insert(checks.end(), further.begin(), further.end());
    ++drawn;
    same += outcome_of(checks, is_fit(sum.cyclictest_us)) == v.outcome ? 1 : 0;
  });
  for (std::size_t i = 0; i < redrawn; ++i) v.checks[i].strays = middle_nine_tenths(values[i]);
  if (drawn > 0) v.confidence = static_cast<double>(same) / drawn;
  return v;
}

}  // namespace hapticd
