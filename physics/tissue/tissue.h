// One deformable body: what only a cut changes (TissueModel) and what moves (TissueState).
//
//   M a + B v = f_int(x) + f_ext + Hᵀλ,   f_int = −∂E/∂x,   E = Σ_e V_e (μ‖F−R‖² + λ/2 tr(RᵀF−I)²) + springs
//
// Co-rotational linear tetrahedra with lumped mass. Units: m, kg, N, J. Shapes: per node Vec3, per
// tetrahedron Mat3. Fixed nodes never move; orphan nodes (no live tetrahedron left) leave the system:
// they keep their place, carry no force and take no part in C.
// Source: the paper §2.2, eq. (1); Müller and Gross 2004 for the element.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "physics/tissue/condensed_tissue.h"
#include "physics/tissue/material.h"
#include "physics/tissue/mesh.h"

namespace hapticd {

using Gradients = Eigen::Matrix<double, 3, 4>;  // ∂N_a/∂X, columns are corners [1/m]

// Room for what a cut adds: planned at the start, so that a step allocates nothing. Spare nodes are orphans,
// and spare tetrahedra are dead, until a cut takes them into use, in order.
struct MeshRoom {
  int nodes = 0;
  int tets = 0;
};

// What of a material may differ between the tetrahedra of one body (tissue_parts.h).
struct Elasticity {
  double mu = 0, lambda = 0;  // [Pa]
  double density = 0;         // [kg/m³]
};

// A spring from a node to a point of the world: f = −k (x − anchor), whatever way it is drawn. It is part of
// K, damped as the tissue is.
struct NodeSpring {
  double stiffness = 0;  // k [N/m]; 0: none
  Vec3 anchor = Vec3::Zero();
};

inline Elasticity elasticity(const Material& m) noexcept { return {m.mu(), m.lambda(), m.density}; }
inline double spring_energy(const NodeSpring& spring, const Vec3& x) noexcept {
  return 0.5 * spring.stiffness * (x - spring.anchor).squaredNorm();
}

struct TissueModel {
  TetMesh mesh;                      // the spare ones last: nodes where the first is, tetrahedra of no_tet
  Material material;                 // its damping and law are the whole body's
  std::vector<Elasticity> elastic;   // per tetrahedron
  std::vector<NodeSpring> springs;   // per node; empty: there are none
  std::shared_ptr<const CondensedTissue> condensed;  // null: all of it is simulated
  std::vector<Gradients> gradients;  // per tetrahedron, rest shape
  std::vector<double> volume;        // per tetrahedron [m³]
  std::vector<int> across;           // faces_across (surface.h)
  std::vector<int> parent;           // per tetrahedron: which it was split from; itself: of the first mesh
  std::vector<std::uint8_t> fixed;   // per node
  int nodes_in_use = 0, tets_in_use = 0;
  Vec3 gravity = Vec3::Zero();  // [m/s²]
  bool corotational = true;     // false: every rotation stays the identity, f_int = −K u
  bool dynamic = true;          // false: no inertia and no damping, A = K

  // Something of the world holds the node.
  bool holds(int node) const noexcept {
    return fixed[node] != 0 || (!springs.empty() && springs[node].stiffness > 0) ||
           (condensed && condensed->place_of(node) >= 0);
  }

  // visit(node) of those that may move, visit(tetrahedron) of those that may be alive.
  template <class Visit>
  void each_node(const Visit& visit) const {
    if (condensed)
      for (const int n : condensed->near_node) visit(n);
    else
      for (int n = 0; n < node_count(); ++n) visit(n);
  }
  template <class Visit>
  void each_tet(const Visit& visit) const {
    if (condensed)
      for (const int t : condensed->near_tet) visit(t);
    else
      for (int t = 0; t < tet_count(); ++t) visit(t);
  }

  // The spare ones too.
  int node_count() const noexcept { return static_cast<int>(mesh.nodes.size()); }
  int tet_count() const noexcept { return static_cast<int>(mesh.tets.size()); }
};

// Throws std::invalid_argument naming the tetrahedron when one has no positive volume.
TissueModel make_tissue_model(TetMesh mesh, const Material& material, std::span<const int> fixed_nodes,
                              const Vec3& gravity, MeshRoom room = {});

// A tetrahedron of a guarded material that has all but lost its volume (volume_barrier.h).
struct Collapsed {
  int tet;
  Tet node;
  Gradients gradients;         // of the rest shape
  Gradients push;              // ∂J/∂x_a [1/m]
  double force;                // V p: f_a = force · push_a
  double rank_one, isotropic;  // K_ab = rank_one push_a push_bᵀ + isotropic (g_a·g_b) I
  double energy;               // [J]
};

struct TissueState {
  std::vector<Vec3> x;                 // present positions [m]
  std::vector<Vec3> v;                 // [m/s]
  std::vector<Mat3> rotation;          // per tetrahedron, det = +1, warm start for the next
  std::vector<Collapsed> collapsed;    // of a guarded material, at x, as the rotations
  std::vector<std::uint8_t> alive;     // per tetrahedron
  std::vector<double> left;            // per tetrahedron: share of its tissue that the tip has left, above 0
  std::vector<double> mass;            // lumped, summed afresh from live tetrahedra [kg]
  std::vector<Vec3> load;              // per node, beside weight [N]; empty: none
  std::vector<int> live_tets_of_node;  // 0: orphan
  int removed = 0;                     // tetrahedra removed so far
  int thinnings = 0;                   // times that some became less
};

// What is there of a tetrahedron at rest: its stiffness, mass and energy go with it [m³].
inline double volume_left(const TissueModel& model, const TissueState& state, int tet) noexcept {
  return state.left[tet] * model.volume[tet];
}

TissueState rest_state(const TissueModel& model);

// Rotations of all live tetrahedra at x, warm-started from the state's, and which are collapsed; of a linear
// model they stay.
void update_rotations(const TissueModel& model, TissueState& state) noexcept;
// … and `before` gets the live ones as they were, `far` the tetrahedra that turned by more than that [rad]
// since.
void update_rotations(const TissueModel& model, TissueState& state, std::vector<Mat3>& before, double turn,
                      std::vector<int>& far);

// f_int(x) at the state's positions and rotations, and f_ext = gravity · mass + load, 3·nodes entries [N].
// Entries of fixed and orphan nodes are zero.
void internal_forces(const TissueModel& model, const TissueState& state, Eigen::Ref<VecX> f) noexcept;
void external_forces(const TissueModel& model, const TissueState& state, Eigen::Ref<VecX> f) noexcept;

// f_int(x) − s K dx in one pass, K as below.
void internal_forces(const TissueModel& model, const TissueState& state, const VecX& dx, double s,
                     Eigen::Ref<VecX> f) noexcept;

// f −= s K dx, K of the state's rotations: the law that A is made of.
void subtract_stiffness(const TissueModel& model, const TissueState& state, const VecX& dx, double s,
                        Eigen::Ref<VecX> f) noexcept;

// The least signed volume of a live tetrahedron at x, or at x + dx [m³]; not a number where a position is
// none.
double least_volume(const TissueModel& model, const TissueState& state, const VecX* dx) noexcept;

// Mass and node counts of what is alive, and of what is condensed on its boundary, from nothing.
void refresh_mass(const TissueModel& model, TissueState& state);

// What is there of the mesh: alive, or condensed.
inline bool is_there(const TissueModel& model, const TissueState& state, int tet) noexcept {
  return state.alive[tet] != 0 || (model.condensed && model.condensed->tet[static_cast<std::size_t>(tet)] != 0);
}

std::vector<std::uint8_t> tets_there(const TissueModel& model, const TissueState& state);

// Stored elastic energy [J].
double elastic_energy(const TissueModel& model, const TissueState& state) noexcept;

// Sets the share that is left of live tetrahedra, in (0, 1]; mass follows.
struct Thinned {
  int tet;
  double left;
};
void thin_tets(const TissueModel& model, TissueState& state, std::span<const Thinned> tets);

// Takes tetrahedra out: alive, mass and node counts follow; orphaned nodes get v = 0.
// Tetrahedra that are already gone are skipped. Returns how many went.
int remove_tets(const TissueModel& model, TissueState& state, std::span<const int> tets);

}  // namespace hapticd
