// Contact with Coulomb friction: a nonlinear complementarity problem with the *circular* cone, solved by
// block Gauss-Seidel with exact local solves and a reduced semi-smooth Newton in turns.
//
//   δ = (W + ε D) λ + q;   per contact: 0 ≤ δ_n ⟂ λ_n ≥ 0,  ‖λ_t‖ ≤ μ λ_n,
//   sliding: δ_t = −c λ_t with c > 0 and ‖λ_t‖ = μ λ_n
//   with a limit, where μ = 0: 0 ≤ λ_n ≤ limit, and at the limit δ_n ≤ 0 (a blade's edge, edge_sample.h)
//   D_i = tr W_ii / 3 · I per contact (isotropic, so that the tangents' choice cannot matter)
//
// Units and shapes: W [m/N], λ [N], q and δ [m], δ_t the slip over the solve's period; rows n, t1, t2 a
// contact; μ = 0 is a frictionless contact among others. Residual: natural map max_i ‖λ_i − P_K(λ_i − ρ_i(δ_i
// + μ‖δ_t‖ n))‖ / scale, ρ_i = 3/tr W_ii, de Saxcé's correction. Status and residual are those of the λ
// returned. Errors: a status. `iteration_cap`, `deadline`: λ is, by residual, the best that a sweep has left;
// `not_finite` (NaN or infinity in W, q or μ, a negative μ or limit, q beyond 1e150) and `too_large` (more
// contacts than the workspace was made for): λ is zero. A warm start of more than 1e6 times the free gaps'
// forces is dropped: its rounding would be taken for an answer. Guarantee: no allocation, wait-free, bounded
// by 2 max_sweeps × contacts² and 2 max_newton × contacts × rows³, and as much again for each of 8 steps that
// eliminate; with a deadline late by at most a sweep, a product of W and the columns that it asks for.
// Source: Alart and Curnier 1991; de Saxcé and Feng 1998; coulomb_solve.cpp has how, where this departs from
// them, and what is known of existence and uniqueness.
#pragma once

#include <span>
#include <vector>

#include "physics/contact/solver/bordered_factor.h"
#include "physics/contact/solver/deadline.h"
#include "physics/contact/solver/lcp.h"
#include "physics/contact/solver/sticking_elimination.h"

namespace hapticd {

constexpr double inside_the_cone = 1 - 1e-6;  // a contact sticks with ‖λ_t‖ / (μ λ_n) below this …
constexpr double sticking_slip = 1e-6;        // … or with less slip than this, of tr W_ii/3 · ‖λ_i‖

struct CoulombOptions {
  double tolerance = 1e-8;  // on the residual
  double relative_diagonal = 1e-9;
  double raised_diagonal = 1e-4;  // where the solve stalls, and in the 20 to 320 solves after; 0: never
  int most_rounds = 8;            // in which it is taken off again; 0: it stays
  int max_sweeps = 200;
  int max_newton = 300;  // steps in all; 0: sweeps only
  ColumnsOnDemand columns;
  Deadline deadline;
};

struct CoulombResult {
  SolveStatus status = SolveStatus::solved;
  int sweeps = 0;
  int newton = 0;  // steps tried
  int factorisations = 0;
  int active = 0;  // contacts with λ_n > 0
  int sliding = 0;
  double residual = 0;  // of W + ε D with …
  // … this ε; 0: of W itself. A raised one is counted from the workspace's `anchor`: ε D (λ − anchor).
  double relative_diagonal = 0;
  int rounds = 0;  // solved, in which a raised diagonal was taken off
};

// One contact's matrix, prepared for many right-hand sides.
class CoulombContact {
 public:
  CoulombContact() = default;
  CoulombContact(const Mat3& A, double mu,
                 double limit = no_limit) noexcept;  // A symmetric positive definite

  // λ for the free gap b.
  Vec3 solve(const Vec3& b) const noexcept;

 private:
  Vec3 slip(const Vec3& b) const noexcept;

  Mat3 inverse_ = Mat3::Zero();
  Eigen::Vector2d to_n_ = Eigen::Vector2d::Zero();       // A_tn / A_nn
  Eigen::Matrix2d basis_ = Eigen::Matrix2d::Identity();  // eigenvectors of S = A_tt − A_tn A_nt / A_nn
  Eigen::Vector2d eigenvalue_ = Eigen::Vector2d::Zero();
  double a_nn_ = 0;
  double mu_ = 0;
  double limit_ = no_limit;
};

// A contact in the reduced system; those that are open or limited have no unknowns.
enum class ContactMode : std::uint8_t { open, stick, slip, frictionless, limited };

struct ReducedContact {
  int contact;
  int first;  // its unknown λ_n, with those of λ_t behind it where it sticks
  int turn;   // slip: the unknown τ
  ContactMode mode;
  double d1, d2;    // slip: the direction d of λ_t
  double lambda_n;  // slip: at the base point
  double c;         // slip: (‖y_t‖ − μ y_n) / (ρ μ y_n), how much δ_t turns with λ_t

  int count() const noexcept { return mode == ContactMode::stick ? 3 : mode == ContactMode::slip ? 2 : 1; }
};

// The Jacobian's factor that is kept.
struct CoulombFactor {
  explicit CoulombFactor(int most);

  std::uint64_t version = 0;  // of W; 0: none
  int contacts = 0;
  int size = 0;
  double epsilon = 0;
  std::vector<ContactMode> mode;
  BorderedFactor jacobian;   // its pivots' ratio is small where hyperstatic
  double flops = 0;          // of the last one, with its assembly
  double ns_per_flop = 0.1;  // of the last ones, where there was a clock
};

struct CoulombElimination;

// One owner. Made for so many contacts at the most, and allocated then: 4 MB for those of the haptic loop.
struct CoulombWorkspace {
  explicit CoulombWorkspace(int contacts = max_contacts, bool eliminates = true);
  void forget() noexcept;  // factors that are kept

  int capacity;                        // contacts
  std::vector<CoulombContact> local;   // per contact
  std::vector<std::uint8_t> prepared;  // local holds this solve's matrix
  std::vector<double> rho;
  std::vector<ReducedContact> reduced;
  std::vector<int> slipping;  // of reduced, those that slip
  std::vector<int> row;       // W's row of each unknown of the others
  std::vector<ContactMode> mode;
  std::vector<double> delta;  // per row
  std::vector<double> best;
  std::vector<double> swept;  // the best that a sweep has left
  std::vector<double> start;
  std::vector<double> turning_point;
  std::vector<double> start_delta;
  std::vector<double> trial;
  std::vector<double> trial_delta;
  std::vector<double> column;
  std::vector<double> step;
  std::vector<double> anchor;  // forces that a raised diagonal is counted from
  std::vector<double> last_anchor;
  CoulombFactor factor;
  // One; none in the workspace of what an elimination leaves.
  std::vector<CoulombElimination> elimination;
  std::uint64_t finite_version = 0;  // of the last W that was seen to be finite; 0: none
  int raised = 0;                    // solves still to come with the raised diagonal …
  int last_raised = 0;               // … of so many; 0: none since one was solved without
  std::int64_t polish_ns = 0;        // of the last two sweeps, where there was a clock
};

// Of contacts that stick, and of the problem that is left.
struct CoulombElimination {
  explicit CoulombElimination(int contacts);

  StickingElimination sticking;
  std::vector<std::uint8_t> other;  // per contact: has been seen not to stick
  std::vector<double> lambda, mu, limit;
  CoulombWorkspace workspace;
};

// One contact alone: minimal λ for local matrix A (3×3, SPD) and free gap b.
Vec3 solve_coulomb_contact(const Mat3& A, const Vec3& b, double mu, double limit = no_limit) noexcept;

// Projection onto the cone ‖t‖ ≤ μ n; with μ = 0 onto n ≤ limit too.
Vec3 project_on_cone(const Vec3& v, double mu, double limit = no_limit) noexcept;

// Natural-map residual for δ = W λ + q, relative to max(max‖λ_i‖, max‖q_i‖·ρ_i).
double coulomb_residual(const Eigen::Ref<const MatX>& W, const Eigen::Ref<const VecX>& q,
                        const Eigen::Ref<const VecX>& lambda, std::span<const double> mu,
                        std::span<const double> limit = {}) noexcept;

// lambda is read as warm start and left as the best iterate.
// matrix_version: equal nonzero values in solves with one workspace promise an unchanged W (and contacts);
// 0: W is new.
// limit: the most that λ_n may be, per contact [N], infinite where μ > 0. Empty: no contact has one.
CoulombResult solve_coulomb(const Eigen::Ref<const MatX>& W, const Eigen::Ref<const VecX>& q,
                            std::span<const double> mu, Eigen::Ref<VecX> lambda, CoulombWorkspace& workspace,
                            std::uint64_t matrix_version, const CoulombOptions& options,
                            std::span<const double> limit = {}) noexcept;

}  // namespace hapticd
