// What is fed with arbitrary bytes. Each of them either does what it says with them or refuses them by
// InputError; anything else ends the process: a crash, a sanitizer's report, an invariant that does not hold.
//
// Run by libFuzzer (preset `fuzz`), and by every ordinary test run on the corpus
// (server/fuzz_corpus_test.cpp).
#pragma once

#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <span>
#include <string>

namespace hapticd {

using FuzzInput = std::span<const std::uint8_t>;

void fuzz_mesh(FuzzInput input);        // Gmsh and VTK, repaired and measured
void fuzz_scene(FuzzInput input);       // a scene's YAML, beside a small mesh and trajectory
void fuzz_trajectory(FuzzInput input);  // a CSV recording, sampled
void fuzz_bag(FuzzInput input);         // a rosbag2's database, its metadata.yaml, or one message's CDR
void fuzz_rtps(FuzzInput input);        // what Cyclone may be given of a received message
void fuzz_device(FuzzInput input);      // ticks of a device: sample check, watchdog, haptic step

inline std::string text_of(FuzzInput input) {
  return {reinterpret_cast<const char*>(input.data()), input.size()};
}

inline void demand(bool holds, const char* what) {
  if (holds) return;
  std::fprintf(stderr, "fuzz: does not hold: %s\n", what);
  std::abort();
}

}  // namespace hapticd
