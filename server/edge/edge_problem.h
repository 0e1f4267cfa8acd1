// The condensed problem as it crosses a network, both ways.
//
//   sent     C_pp: the mean of both triangles, as √C_ii and C_ij / √(C_ii C_jj), this in 16 bits
//            positions, normals, weights: from an origin near the patch, in single precision
//            samples that follow one another on a face share what is the face's
//   read     only what has the version and counts that belong together, and is sound (problem_check.h)
//
// A problem of n nodes takes 9 n² + 42 n bytes and about 12 a sample. Units: SI. Thread safety: one thread
// each. Guarantee: `read_problem` is noexcept and allocates nothing; `PackedProblem` allocates while problems
// grow.
#pragma once

#include <vector>

#include "idl/edge.h"
#include "physics/contact/condensed_problem.h"

namespace hapticd {

// A message and what it borrows: valid until the next `pack`.
class PackedProblem {
 public:
  // instruments: how many the scene has. The message's world, scene, simulation and edge are the caller's to
  // set.
  hapticd_msg_EdgeProblem& pack(const CondensedProblem& problem, int instruments);
  std::size_t bytes() const noexcept;  // of the newest, as serialised

 private:
  void put_samples(const CondensedProblem& problem);
  void put_compliance(const CondensedProblem& problem);

  hapticd_msg_EdgeProblem message_{};
  Vec3 origin_ = Vec3::Zero();
  std::vector<hapticd_msg_ProblemInstrument> instruments_;
  std::vector<float> positions_, pull_, places_, own_;
  std::vector<std::int16_t> shared_;
  std::vector<hapticd_msg_ProblemFace> faces_;
  std::vector<std::uint16_t> offsets_;
  std::vector<hapticd_msg_ProblemEdge> edges_;
};

enum class ProblemFault : std::uint8_t { none, version, counts, unsound };
const char* to_string(ProblemFault fault) noexcept;

// instruments: how many the scene has. On a fault `problem` is anything. published_ns and step are as sent.
ProblemFault read_problem(const hapticd_msg_EdgeProblem& message, int instruments,
                          CondensedProblem& problem) noexcept;

}  // namespace hapticd
