// When reference factors are asked for, and when those made elsewhere come into use (compliance.h).
//
//   wanted → under way (made on any thread) → adopted by the next step that finds its body awake
//
// At most one is under way for a body, and two steps pass between an adoption and the next snapshot. One that
// was overtaken, because a step had to make a newer one itself, is outdated and dropped. Units: steps.
// Errors: a job that `failed` is dropped.
#pragma once

#include <memory>
#include <vector>

#include "physics/simulation/body.h"

namespace hapticd {

inline constexpr int rest_between_references = 2;  // steps

// What a job is: a reference factor; or of a body whose near region follows an instrument
// (region/region_stage.h), another region to be entered, or what is far from one. That last may take seconds
// and is nothing that the next steps need.
enum class JobKind : std::uint8_t { reference, entry, far_tissue };

// A new reference factor that a body's compliance wants: `reference->make()` is to be called, on any thread,
// and the job handed back to `World::adopt`, `failed` if that threw.
struct ReferenceJob {
  int body = 0;
  std::unique_ptr<ReferenceFactor> reference;
  bool failed = false;
  JobKind kind = JobKind::reference;
};

// Of one body.
struct ReferenceProgress {
  bool wanted = false;
  bool under_way = false;
  bool outdated = false;  // under way, but a step has made a newer one itself
  int steps = 0;          // since the last snapshot or adoption
  int last_steps = 2;     // how long the last took
};

class ReferenceScheduling {
 public:
  explicit ReferenceScheduling(std::size_t bodies) : progress_(bodies) {}

  // Between steps.
  std::vector<ReferenceJob> wanted(Bodies& bodies);
  void adopt(ReferenceJob job) { made_.push_back(std::move(job)); }

  // After an interim problem, which needs the factor that there is, and before `update`. Returns how many.
  int take_over(Bodies& bodies);

  // At the end of a step, of an awake body.
  void end_step(int body, bool wants_reference);

  // Another compliance has taken the place of the one that asked.
  void forget(int body) { progress_[body].outdated = progress_[body].under_way; }

  void want(int body) { progress_[body].wanted = true; }
  void made_by_step(int body) { progress_[body].outdated = progress_[body].under_way; }
  const ReferenceProgress& progress(int body) const { return progress_[body]; }

 private:
  std::vector<ReferenceProgress> progress_;
  std::vector<ReferenceJob> made_;
};

}  // namespace hapticd
