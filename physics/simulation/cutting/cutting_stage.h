// The stage that cuts: blades' fronts advance as the contact solve says, and the mesh follows.
//
//   realise  the strips that fronts went since the last step are cut, and faces tear   (physics/cutting)
//   find     fronts ahead of the blades' edges                                          (cut_front.h)
//   publish  them as edge samples of the condensed problem                              (edge_sample.h)
//   advance  them by what the contact solve made of them
//   look     between steps, which faces break in the next: milliseconds that no problem waits for
//
// What is published stands where the step began; the advance since is remembered by whoever solves. A mesh
// whose room is used up is cut no further: `out_of_room`, and what is cut stays as it is. Units: m, N, J/m².
// Errors: none. Source: DESIGN §11.
#pragma once

#include <memory>
#include <span>
#include <vector>

#include "physics/contact/rows.h"
#include "physics/simulation/cutting/cut_body.h"
#include "physics/simulation/cutting/cut_front.h"
#include "physics/simulation/patch.h"

namespace hapticd {

class CuttingStage {
 public:
  CuttingStage() = default;  // cuts nothing
  CuttingStage(Instruments instruments, Bodies& bodies);

  // Bodies that were cut. Their compliances are told by `tell_compliances`.
  std::vector<int> realise(Bodies& bodies, Instruments instruments);
  void tell_compliances(Bodies& bodies);
  // Live tetrahedra of a body around the nodes that came apart since its compliance was told last.
  std::vector<int> around_parted(const Bodies& bodies, int b);

  // After a removal, of these bodies.
  void follow(const Bodies& bodies, std::span<const int> which);

  void find(const Bodies& bodies, Instruments instruments, const InstrumentPoses& X, double reach);
  // That the patch must have.
  std::span<const PatchNode> nodes() const { return nodes_; }
  void publish(const Bodies& bodies, Instruments instruments, const PatchGatherer& patch,
               CondensedProblem& problem) const;

  void advance(const Bodies& bodies, Instruments instruments, const InstrumentPoses& X,
               const CondensedProblem& problem, const ContactMemory& memory);

  void look_for_cracks(Bodies& bodies);

  bool out_of_room() const { return out_of_room_; }
  // Area that blades have separated so far, in the rest shape [m²].
  double area() const { return area_; }

 private:
  void cut_strips(Bodies& bodies, const Blade& blade, int i);
  void tear(Body& body, CutBody& cut);
  void note(CutStatus status);

  std::vector<CutFronts> fronts_;               // per instrument
  std::vector<std::unique_ptr<CutBody>> cuts_;  // per body; null: it cannot be cut
  std::vector<PatchNode> nodes_;
  bool cuts_anything_ = false;
  bool out_of_room_ = false;
  double area_ = 0;
};

}  // namespace hapticd
