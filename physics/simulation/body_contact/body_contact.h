// Contact between bodies: rows, W, solve, and their elimination from the patch that the instrument feels.
//
//   rows of all contacts (n, t₁, t₂):  H = Fᵀ (E_node − Σ w_c E_c),  W = Σ_bodies H C Hᵀ
//   δ = W λ + δ_free + H C f,  0 ≤ δ_n ⟂ λ_n ≥ 0,  ‖λ_t‖ ≤ μ λ_n          (f: the instrument's force, given)
//   δ_n,free = gap(x_lin) + n·(relative x_free − x_lin) − allowed,   allowed = min(0, gap_start + v h)
//   δ_t,free = Tᵀ(relative x_free − x_start): slip over the step
//
// Newton's third law holds by construction: λ acts on the node, −w_c λ on the face's corners. In the
// simulation step bodies and instrument are solved as one problem (`solve_with`); what is published has the
// contacts eliminated (`condense`; equations and what that freezes: body_contact_condense.cpp). Recovery: a
// node found inside is let out at no more than v = `recovery_speed`; `allowed` is 0 for all that were
// outside. Capacity: max_body_contacts; above it, contacts that carried force come first, then the deepest
// (before the first solve: in free motion), and `dropped` counts the others that overlap where the solve has
// left them. A node on two bodies that both cannot move (rigid, fixed, asleep) has no row.
// Units: m, N, m/N. Forces on nodes in `force` of a domain. Errors: by status; the best iterate is used.
// Allocates: for the simulation thread only. Source: as contact/rows.h; the Schur complement is ours.
#pragma once

#include <memory>
#include <span>
#include <vector>

#include "physics/contact/rows.h"
#include "physics/contact/solver/coulomb.h"
#include "physics/contact/solver/lcp.h"
#include "physics/simulation/body_contact/contact_candidates.h"
#include "physics/simulation/patch.h"

namespace hapticd {

inline constexpr int max_body_contacts = 1200;

struct BodyContactSettings {
  std::vector<ContactPair> pairs;  // none: no cost, and not a bit changes
  double recovery_speed = 0.01;    // [m/s]
};

// How a contact takes hold of a node: its body, its place in that body's domain (−1: immobile), its weight.
struct ContactStencil {
  int body = -1;
  int place = -1;
  double weight = 0;
};

// One touch of a node with a face, as the last linearisation saw it.
struct BodyContact {
  int candidate;  // in the order of this attempt's
  int pair;
  int node;
  int face;                               // id of the surface face, for good
  std::array<int, 4> mesh_node;           // the node, then the face's corners
  std::array<ContactStencil, 4> stencil;  // their weights are 1, −w
  Mat3 frame;
  double friction;
  double gap;       // true, at the linearisation [m]
  double allowed;   // ≤ 0 [m]
  Vec3 delta_free;  // [m]
  Vec3 lambda;      // in the frame [N]
};

struct BodyContactReport {
  int nodes = 0;     // met a face
  int contacts = 0;  // rows of the last solve
  int active = 0;
  int sliding = 0;
  int dropped = 0;
  int rounds = 0;              // of the last step
  bool held = false;           // geometry was held in the end: rows were added, none renewed
  bool friction_held = false;  // … and friction too
  bool capped = false;  // and still some overlap beyond the tolerance was left, or a solve was not solved
  int joined = 0;       // nodes that only showed once they had moved
  SolveStatus status = SolveStatus::solved;
  double residual = 0;     // natural map
  double penetration = 0;  // deepest true overlap the solve left [m], ≥ 0, recovery under way included
};

class BodyContacts {
 public:
  BodyContacts(BodyContactSettings settings, double h);

  bool empty() const { return finder_.pairs().empty(); }
  std::span<const ContactPair> pairs() const { return finder_.pairs(); }
  bool names(int body) const;  // in one of the pairs
  void surface_changed(int body) { finder_.surface_changed(body); }

  // Who may touch whom in the step that begins at the bodies' present positions.
  void find(const Bodies& bodies);
  bool touching(int a, int b) const;  // whether these bodies have an encounter
  bool any() const { return !candidates_.empty(); }

  // Nodes whose compliance is needed, for the body's zone.
  std::span<const int> nodes_of(int body) const {
    return contact_nodes_.empty() ? std::span<const int>() : std::span<const int>(contact_nodes_[body]);
  }

  // Begins the solve: domains of mobile bodies = patch nodes, then contact nodes.
  void set_domains(const Bodies& bodies, std::span<const PatchNode> patch);
  std::span<const int> domain_nodes(int body) const { return domains_[body].nodes; }
  MatX& compliance(int body) { return domains_[body].C; }  // to be filled

  // Start (present) and free positions of the domains; linearises there.
  void set_free_motion(const Bodies& bodies);
  // … under forces on the patch's nodes beside those of contacts.
  void pull(const VecX& force);

  // Renews geometry at the end of the last solve. Returns how far the rows' gaps were from the true ones
  // where they are closed or overlap [m].
  double linearise(const Bodies& bodies);

  // The linearisation point goes to x, by mesh node of that body; linearise() next.
  void start_from(int body, std::span<const Vec3> x);

  // Keeps the rows of the last solve as they are, and adds one for each node that the solve left inside by
  // more than `tolerance`, linearised where it is. Returns the deepest of them; 0: none is, and the solve
  // ends here.
  double add_violated(const Bodies& bodies, double tolerance);

  // From now on solves find normal forces alone; friction, and what a blade's edge bears, stay as they are.
  void hold_friction(bool held) { friction_held_ = held; }

  // The linearisation point: where the domains' nodes are, one after another [m].
  VecX linearisation_point() const;
  void go_to(const VecX& x);

  // λ under the instrument's force on the patch's nodes (3·nodes); moves the linearisation point.
  void solve(const VecX& tool_force);

  // The same together with the instrument's rows on the patch; λ of those is read to start from and left as
  // the solution. Returns the instrument's force on the patch's nodes, and tells how far its rows were from
  // slipping.
  VecX solve_with(const CondensedProblem& patch, const ContactRows& tool, VecX& tool_lambda);
  const VecX& tool_delta() const { return tool_delta_; }  // δ of the instrument's rows in that solve [m]

  // Where the last linearisation point has the patch's nodes.
  void patch_positions(PatchPositions& x) const;

  // problem.C() and problem.x_free as above, from C, x_free and the solve.
  void condense(CondensedProblem& problem) const;

  bool pushes(int body) const;  // any force of another body on this one

  // Adds the bodies' contact forces to f (3·nodes of the body).
  void add_forces(int body, Eigen::Ref<VecX> f) const;

  // Nodes that are inside at these positions and did not meet the faces there: they join. Returns how many.
  int join_missed(const Bodies& bodies, const Positions& x_end);

  // What the last solve found is what the step applies: `contacts` and `force_on` tell until the next step.
  void keep() { applied_ = solved_; }
  std::span<const BodyContact> contacts() const { return applied_; }
  Vec3 force_on(int body) const;  // sum of them, rigid bodies included [N]
  const BodyContactReport& report() const { return report_; }
  BodyContactReport& report() { return report_; }

 private:
  static constexpr double closed_gap = 1e-9;        // overlap that makes a contact part of the solve [m]
  static constexpr double missed = 1e-6;            // overlap that makes a node join [m]
  static constexpr double reference_margin = 0.05;  // of `depth_of`: what bodies at rest may move in a step

  struct Domain {
    bool mobile = false;
    std::vector<int> nodes;  // patch's first
    std::vector<int> place;  // per mesh node, −1 outside
    MatX C;
    VecX tool, force;  // [N]
    std::vector<Vec3> start, free, linear;
  };
  struct ToolRow {
    std::array<ContactStencil, 4> stencil;
    Mat3 frame;
    bool works = false;  // solved; the others are open
  };
  struct Remembered {
    int pair, node, face;
    Vec3 normal, lambda;  // world
  };

  static bool moves(const Body& body);
  static double depth_of(const Bodies& bodies, const ContactPair& p);  // their smaller mean edge [m]
  void open_faces(const Bodies& bodies);
  void drop_ghosts(const Bodies& bodies, bool all, std::vector<BodyContactCandidate>& found) const;
  void index_contact_nodes(const Bodies& bodies);
  const Vec3& position(const Bodies& bodies, int body, int node, std::vector<Vec3> Domain::*at) const;
  Vec3 relative(const Bodies& bodies, const BodyContact& c, std::vector<Vec3> Domain::*at) const;
  void find_rows(const Bodies& bodies, double ahead, std::vector<BodyContact>& rows);
  std::span<const Remembered> remembered(int pair, int node) const;
  void choose(std::vector<BodyContact>& rows);
  void warm_start(std::vector<BodyContact>& rows) const;
  void choose_working();
  bool grow_working();
  void assemble(std::span<const ToolRow> tool);
  template <int m>
  void assemble_rows(std::span<const ToolRow> tool, int known);
  bool solve_eliminating(const ContactRows& tool, std::span<const int> working, VecX& tool_lambda,
                         VecX& lambda);
  void solve_as_one(const ContactRows& tool, std::span<const int> working, VecX& tool_lambda, VecX& lambda);
  VecX solve_working_with(const CondensedProblem& patch, const ContactRows& tool,
                          std::span<const ToolRow> rows, std::span<const int> working, VecX& tool_lambda);
  static CoulombOptions options_of_coulomb();
  void solve_rows(const MatX& W, const VecX& q, std::span<const double> mu, std::span<const double> limit,
                  VecX& lambda, int rows_per_contact);
  void solve_normals(const MatX& W, const VecX& q, std::span<const double> limit, VecX& lambda,
                     int rows_per_contact);
  void take(const VecX& lambda, int rows_per_contact);
  void set_tool(const VecX& tool_force);
  static VecX displacement(const Domain& d);
  void find_moved();
  void move();
  static double travel(Domain& d, std::span<const Vec3> x);
  void remember();

  BodyContactSettings settings_;
  double h_;
  BodyContactCandidateFinder finder_;
  std::vector<BodyContactCandidate> candidates_;
  std::vector<std::vector<int>> contact_nodes_;
  std::vector<Domain> domains_;
  std::vector<PatchNode> patch_;
  VecX tool_delta_;
  std::vector<BodyContact> rows_;  // linearised, to be solved
  std::vector<BodyContact> solved_;
  std::vector<BodyContact> applied_;
  std::vector<Remembered> memory_;  // by pair, then node
  double travelled_ = 0;            // of the linearisation points since the solve began: no node more [m]
  double last_way_ = 0;             // … and between the last two
  bool first_ = true;               // nothing was ever solved
  bool friction_held_ = false;
  int rows_per_contact_ = 3;
  std::vector<int> working_;  // contacts of solved_ that W_ holds; the others are open
  std::vector<int> works_;    // their places there, −1: not
  MatX W_;
  MatX W_tool_;              // the instrument's rows against the bodies': 3 each
  std::vector<VecX> moved_;  // C f of the forces last solved for, per domain [m]
  std::unique_ptr<LcpWorkspace> lcp_;
  std::unique_ptr<CoulombWorkspace> coulomb_;
  BodyContactReport report_;
};

}  // namespace hapticd
