#include "tools/robustness/stage_figures.h"

#include <algorithm>
#include <cmath>

namespace hapticd {
namespace {

constexpr double min_answered = 0.99;

double share(std::int64_t part, std::int64_t whole) noexcept {
  return whole > 0 ? static_cast<double>(part) / static_cast<double>(whole) : 0;
}

}  // namespace

double StageFigures::answered_of_sent() const noexcept { return share(answered, sent); }
double StageFigures::answered_between_stalls() const noexcept {
  return share(between.answered, between.sent);
}

bool StageFigures::kept(bool held, double maximum, double step) const noexcept {
  return finite && force_max <= maximum * (1 + 1e-9) && step_max <= step * (1 + 1e-6) &&
         answered_between_stalls() >= min_answered &&
         (held || !(status & (status_latched | status_not_finite)));
}

StageFigures figures_of(const DeviceClient& client, const Stage& stage, const Stalls& stalls) {
  StageFigures f;
  f.force_min = HUGE_VAL;
  const SlotBook& book = client.book();
  f.between = between_stalls(book, stalls, stage.begin_ns, stage.end_ns);
  const hapticd_msg_ForceCommand* before = nullptr;
  std::int64_t unanswered = 0;
  for (std::int64_t k = 0; k < book.scheduled(); ++k) {
    const std::int64_t t = book.plan().time_of(k);
    if (t < stage.begin_ns || t >= stage.end_ns) continue;
    ++f.scheduled;
    f.sent += book.sent_ns(k) != 0;
    unanswered = book.answered_ns(k) == 0 ? unanswered + 1 : 0;
    f.longest_unanswered = std::max(f.longest_unanswered, unanswered);
    if (unanswered > 0) continue;
    ++f.answered;
    const hapticd_msg_ForceCommand& m = client.answer(k);
    const Vec3 force(m.force[0], m.force[1], m.force[2]);
    f.finite = f.finite && force.allFinite();
    f.status |= m.status;
    f.force_min = std::min(f.force_min, force.norm());
    f.force_max = std::max(f.force_max, force.norm());
    if (before && m.number == before->number + 1 && force.norm() > 0) {
      const Vec3 last(before->force[0], before->force[1], before->force[2]);
      f.step_max = std::max(f.step_max, (force - last).norm());
    }
    before = &m;
  }
  return f;
}

nlohmann::ordered_json to_json(const Stage& stage, const StageFigures& f, bool kept) {
  return {{"attack", stage.name},
          {"slots", {{"scheduled", f.scheduled}, {"sent", f.sent}, {"answered", f.answered}}},
          {"longest_unanswered", f.longest_unanswered},
          {"answered_of_sent", rounded(f.answered_of_sent(), 5)},
          {"answered_of_sent_between_stalls", rounded(f.answered_between_stalls(), 5)},
          {"force_min_n", rounded(f.force_min, 5)},
          {"force_max_n", rounded(f.force_max, 5)},
          {"step_max_n", rounded(f.step_max, 5)},
          {"status_seen", status_text(f.status)},
          {"kept", kept}};
}

std::string to_text(const StageFigures& f) {
  return fixed(100 * f.answered_of_sent(), 2) + " % answered (" +
         fixed(100 * f.answered_between_stalls(), 2) + " % between stalls) of " + std::to_string(f.sent) +
         " sent (of " + std::to_string(f.scheduled) + ", longest break " +
         std::to_string(f.longest_unanswered) + " ms), " + fixed(f.force_min, 3) + " … " +
         fixed(f.force_max, 3) + " N, step " + fixed(f.step_max, 3) + " N; " + status_text(f.status);
}

}  // namespace hapticd
