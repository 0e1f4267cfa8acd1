#include "tools/client_library/phase.h"

#include <random>
#include <vector>

#include <gtest/gtest.h>

namespace hapticd {
namespace {

// Shifting by the result brings any phase to the one that is wanted, seen through noise and across the wrap.
TEST(Phase, ThePhaseShiftLeadsToTheWantedAge) {
  std::mt19937 random(5);
  std::normal_distribution<double> noise(0, 40);
  for (double phase = 0; phase < 1000; phase += 25) {
    std::vector<double> ages;
    for (int i = 0; i < 200; ++i) ages.push_back(std::fmod(phase + noise(random) + 2000, 1000));
    for (const double wanted : {450.0, 500.0}) {
      const double shift = phase_shift_us(ages, 1000, wanted);
      EXPECT_GT(shift, -500.001);
      EXPECT_LE(shift, 500);
      EXPECT_NEAR(std::fmod(phase - shift + 2000, 1000), wanted, 15) << phase;
    }
  }
  EXPECT_EQ(phase_shift_us(std::vector<double>{}), 0);
}

// A client that sends 20 µs before the tick: its states are taken twice or not at all.
TEST(Phase, OnceWhileArmingTheGridIsShiftedAndThenKept) {
  PhaseLock lock;
  double age = 20;
  std::int64_t shifted = 0;
  std::uint64_t number = 1;
  const auto run = [&](int slots, bool arming) {
    for (int i = 0; i < slots; ++i, ++number) {
      lock.heard(number, age, arming);
      if (const std::int64_t shift = lock.take_shift_ns(number)) {
        EXPECT_GT(shift, 0);  // time never goes back
        shifted += shift;
        age = std::fmod(age - 1e-3 * static_cast<double>(shift) + 2000, 1000);
      }
    }
  };
  run(300, true);
  EXPECT_NEAR(age, 450, 1);
  EXPECT_NEAR(static_cast<double>(shifted), 570e3, 1e3);
  age = 20;
  run(300, false);
  EXPECT_EQ(age, 20);  // while force is felt nothing moves
  run(300, true);      // another daemon has another tick
  EXPECT_NEAR(age, 450, 1);
}

}  // namespace
}  // namespace hapticd
