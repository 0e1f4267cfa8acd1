#include "server/record/trajectory_reader.h"

#include "server/files/input_error.h"
#include "tests/fuzz/targets.h"

namespace hapticd {

void fuzz_trajectory(FuzzInput input) {
  try {
    const Trajectory motion = parse_trajectory(text_of(input), "fuzz.csv", LengthUnit::millimetre);
    demand(motion.samples.size() >= 2 && motion.end() > motion.begin(), "a motion takes time");
    for (int i = -1; i <= 17; ++i) {
      const double t = motion.begin() + i / 16.0 * (motion.end() - motion.begin());
      sample_at(motion, t);
      buttons_at(motion, t);
    }
    for (const TrajectorySample& s : motion.samples)
      demand(sample_at(motion, s.t).p == s.pose.p, "the interpolation meets the samples");
  } catch (const InputError&) {
  }
}

}  // namespace hapticd
