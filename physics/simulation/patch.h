// Gathers the patch: surface within the instruments' reach, its nodes and material sample points.
//
// A triangle is divided into k² equal parts, k = ⌈√(A/spacing²)⌉ of its *rest* area A, and each part's
// centroid is a sample: fixed in the material, about `spacing` apart, never on an edge. A sample's id
// is (body, face, index in the face), so that contact memory finds it again in the next patch.
// Faces join in the order of their nearest sample until the patch's nodes are full, or the share that the
// nearest instrument has of them. Where they do not all
// fit, in the order of how near the free motion takes them on its way: what a retracting instrument held down
// is farther than much of what is beside it, and is met before. Faces of rigid bodies need no nodes. Samples
// beyond capacity are counted in `dropped_samples`.
// Units: m. Allocates: for the simulation thread only.
#pragma once

#include <span>
#include <vector>

#include "physics/contact/condensed_problem.h"
#include "physics/simulation/body.h"
#include "physics/simulation/body_contact/collision.h"

namespace hapticd {

struct PatchNode {
  int body;
  int node;
};

class PatchGatherer {
 public:
  explicit PatchGatherer(double sample_spacing) : spacing_(sample_spacing) {}

  // Fills nodes, samples and counts of `problem` from the candidate faces; positions come later,
  // with `set_patch_positions`. `alarm` bounds the samples' gaps at X. first: nodes that come before all
  // others, as far as there is room.
  void gather(const Bodies& bodies, Instruments instruments, const InstrumentPoses& X, double alarm,
              std::span<const NearFace> candidates, CondensedProblem& problem,
              std::span<const PatchNode> first = {});

  std::span<const PatchNode> nodes() const { return nodes_; }
  std::vector<int> nodes_of(int body) const;  // in the order of `nodes`
  // Of a body's node in `nodes`; −1: it is not among them.
  int index(int body, int node) const { return patch_index_[body][node]; }

 private:
  struct Candidate {
    double gap;
    int instrument;  // the nearest
    NearFace face;
  };

  int deformable_nodes(const Bodies& bodies, int instrument);
  double nearest_on_the_way(const Body& body, int face, const Instrument& instrument, const Pose& X) const;

  double spacing_;
  std::vector<PatchNode> nodes_;
  std::vector<Candidate> candidates_;
  std::vector<std::vector<int>> patch_index_;  // per body, per node; −1 outside the patch
};

// x_now = x, x_free = x + Δx_free of the patch's nodes, and the outward normals of its samples.
void set_patch_positions(const Bodies& bodies, std::span<const PatchNode> nodes, CondensedProblem& problem);

// A force on the patch's nodes [N], as one on all nodes of a body.
VecX force_on_body(const Body& body, int index, std::span<const PatchNode> nodes, const VecX& patch_force);

// Barycentric weights of a triangle's samples, for k subdivisions: k² entries.
const std::vector<std::array<double, 3>>& sample_weights(int subdivisions);
int subdivisions(const Vec3& a, const Vec3& b, const Vec3& c, double spacing);

}  // namespace hapticd
