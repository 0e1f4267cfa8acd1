// When method `zone` samples its error, and whether the last sample still speaks for the present state.
//
// A sample is two halves (residual.h). With `sample_every` ≤ 1 both fall into one step; where samples are
// rare they fall into two, and a step that has just paid for a new reference factor pays for neither.
#pragma once

#include <limits>
#include <optional>
#include <span>
#include <vector>

#include "physics/compliance/residual.h"

namespace hapticd {

class ZoneSample {
 public:
  explicit ZoneSample(const ComplianceOptions& options)
      : every_(options.sample_every), still_(0.1 * options.good_error) {}

  // The reference factor that it was of has gone.
  void forget();

  // After each update, its reference factor `age` updates old. Returns true if a sample is due: then `take`.
  [[nodiscard]] bool due_after_update(int age);
  void take(ResidualSample first_half, std::span<const Mat3> Q, int removed);

  // At a report: finishes the sample where it is time to. 0 while a new reference factor has none.
  [[nodiscard]] const SampledError& error(Compliance& compliance);

  // True if nothing turned and nothing was removed since the sample.
  [[nodiscard]] bool holds(std::span<const Mat3> Q, int removed) const;

 private:
  int every_;
  double still_;
  int since_ = std::numeric_limits<int>::max() / 2;  // updates
  bool due_ = false;
  bool fresh_ = false;  // of the last update
  std::optional<ResidualSample> first_half_;
  SampledError sampled_;
  std::vector<Mat3> Q_;  // at the sample
  int removed_ = 0;
};

}  // namespace hapticd
