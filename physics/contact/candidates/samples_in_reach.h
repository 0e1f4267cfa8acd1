// The samples that instruments can have within reach, kept from solve to solve while nothing has moved far.
//
//   {k : d(s_k; X_0) < R}   has all of   {k : d(s_k; X) < reach}   while   reach + moved ≤ R,
//   moved = max_n ‖x_n − x_0,n‖ + max over instruments (‖Δp‖ + ‖Δθ‖ max_k ‖s_k − p‖)
//
// A tick looks at each sample of the patch several times, and only a few are near. They are looked for once,
// R being `reach` and a slack, and again where things have moved or another reach is asked; those within half
// the slack have a list of their own, which is enough for a short reach. d is what `near` of a placed instrument
// compares, which changes by no more than points move. By sample, each with the instruments that it is near.
// Whose samples they are the caller says by a number; 0 is nobody's, and such
// samples are looked for in each call. Units: m. Guarantee: wait-free, no allocation, O(nodes) where nothing
// is looked for, else O(samples × primitives). Source: Verlet 1967 (neighbour lists).
#pragma once

#include <array>
#include <cstdint>
#include <span>

#include "physics/contact/placed_instruments.h"
#include "physics/contact/rows.h"

namespace hapticd {

// By which more than is asked is looked for [alarm distances].
inline constexpr double reach_slack = 0.2;

class SamplesInReach {
 public:
  struct Entry {
    std::int32_t sample;
    std::uint32_t face;  // counts the patch's faces: samples of one have the same
    std::uint32_t of;    // bit i: instrument i is near

    bool near(int instrument) const noexcept { return (of >> instrument & 1U) != 0; }
  };

  // What is known is of other samples than number `of_samples`: it is forgotten.
  void keep(std::uint64_t of_samples) noexcept;

  // placed: the instruments at X. By sample.
  std::span<const Entry> at(const CondensedProblem& problem, const PlacedInstruments& placed,
                            const InstrumentPoses& X, const PatchPositions& x, double reach,
                            double slack) noexcept;

 private:
  struct List {
    double radius = -1;  // below zero: nothing is known
    int count = 0;
    std::array<Entry, max_patch_samples> entry;
  };

  double moved(const CondensedProblem& problem, const InstrumentPoses& X,
               const PatchPositions& x) const noexcept;
  void look(const CondensedProblem& problem, const PlacedInstruments& placed,
            const PatchPositions& x) noexcept;

  std::uint64_t of_samples_ = 0;
  double obstacle_ = 0;  // the farthest sample without nodes, from any X_0
  InstrumentPoses X_;
  PatchPositions x_;
  List all_, nearest_;  // R, and half the slack
};

}  // namespace hapticd
