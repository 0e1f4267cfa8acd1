// Whose fault it is that a soak's bound was broken, and how sure that is.
//
//   fit         of a machine: cyclictest, alone on the loop's core, is at most a slot late in 99.95 %
//   pass        every bound kept
//   machine     some are not, none by more than an unfit machine is granted, and this one is unfit
//   fail        ours
//   incomplete  kept as far as known; a public tool gave nothing
//   confidence  the share of redraws of the run's blocks (bootstrap.h) with the same verdict; of fewer than
//               ten blocks it decides nothing
//
// Granted: of lateness and drift twice the bound; of slots four times what the tool lost, since few long
// stalls fall unevenly (3.5 times as many on ours in five runs); of memory, allocations and page faults
// nothing.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "tools/soak/bootstrap.h"
#include "tools/soak/soak_record.h"

namespace hapticd {

// A bound and whether it was kept.
struct SoakCheck {
  std::string what;
  double value = 0, limit = 0;
  bool at_most = true;
  bool known = true;
  std::optional<double> unfit_limit = {};  // on a machine that is not fit
  std::optional<Interval> strays = {};     // by the choice of blocks

  bool kept() const { return known && within(limit); }
  bool granted() const { return known && within(unfit_limit.value_or(limit)); }

 private:
  bool within(double bound) const { return at_most ? value <= bound : value >= bound; }
};

constexpr std::size_t fewest_blocks = 10;  // that decide
constexpr double fit_limit = 0.9995, granted_loss = 4, granted_lateness = 2;

// Of the public tool's wake-ups, those less than a slot late: what the machine alone leaves of the slots.
double on_time(const Tally& late_us);
bool is_fit(const Tally& cyclictest_us);  // true without any figure: nothing is excused

// The bounds of what a slice shows: lateness, round trip, slots, age.
std::vector<SoakCheck> check_slices(const SoakFigures& figures);

enum class SoakOutcome { pass, fail, machine, incomplete };
std::string to_text(SoakOutcome outcome);
SoakOutcome outcome_of(const std::vector<SoakCheck>& checks, bool fit);

struct SoakVerdict {
  std::vector<SoakCheck> checks;
  bool fit = true;
  SoakOutcome outcome = SoakOutcome::incomplete;
  std::optional<double> confidence = {};  // nothing of fewer than two blocks
  std::size_t blocks = 0;
  bool decided() const {
    return outcome == SoakOutcome::incomplete || (blocks >= fewest_blocks && confidence.value_or(0) >= 0.95);
  }
};

// In a line: "pass, 99 % sure".
std::string explained(const SoakVerdict& verdict);

// further: bounds that no block has by itself.
SoakVerdict judge(const SoakRecord& record, const std::vector<SoakCheck>& further);

}  // namespace hapticd
