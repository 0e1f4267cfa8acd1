#include "physics/simulation/step/reference_scheduling.h"

#include <utility>

namespace hapticd {

std::vector<ReferenceJob> ReferenceScheduling::wanted(Bodies& bodies) {
  std::vector<ReferenceJob> jobs;
  for (std::size_t b = 0; b < bodies.size(); ++b) {
    ReferenceProgress& p = progress_[b];
    if (!bodies[b].deformable || !p.wanted || p.under_way || p.steps < rest_between_references) continue;
    p.wanted = false;
    if (!bodies[b].references) continue;
    std::unique_ptr<ReferenceFactor> reference = bodies[b].references->snapshot_reference(bodies[b].state);
    p.under_way = true;
    p.steps = 0;
    jobs.push_back({static_cast<int>(b), std::move(reference), false});
  }
  return jobs;
}

// A new reference factor is of no use before an `update`, and a body that sleeps has none in this step: its
// reference factor waits until it wakes, or the interim problem of the step that wakes it would find no
// factor. What sleeps does not change, so the reference factor still fits.
int ReferenceScheduling::take_over(Bodies& bodies) {
  int adopted = 0;
  std::vector<ReferenceJob> waiting;
  for (ReferenceJob& job : made_) {
    Body& body = bodies[job.body];
    ReferenceProgress& p = progress_[job.body];
    if (body.asleep) {
      waiting.push_back(std::move(job));
      continue;
    }
    p.under_way = false;
    p.last_steps = p.steps;
    p.steps = 0;
    if (std::exchange(p.outdated, false) || job.failed || !job.reference) continue;
    body.references->adopt_reference(std::move(job.reference), body.state);
    body.free.ahead = false;
    ++adopted;
  }
  made_ = std::move(waiting);
  return adopted;
}

void ReferenceScheduling::end_step(int body, bool wants_reference) {
  if (wants_reference) progress_[body].wanted = true;
  ++progress_[body].steps;
}

}  // namespace hapticd
