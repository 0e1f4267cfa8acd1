#include "physics/simulation/step/interim.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>

#include "physics/tissue/tetrahedron.h"

namespace hapticd {
namespace {

// What went, on its own nodes.
struct WoodburyDowndate {
  std::vector<int> node;   // G
  std::vector<int> place;  // … in the caller's list
  std::vector<int> index;  // per node of the body: into G, or −1
  MatX M;                  // E − s I_o [N/m]
  VecX r;                  // r_E [N]
};

class Linearisation {
 public:
  Linearisation(const Body& body, Linearised at, double h)
      : body_(body), ahead_(at == Linearised::ahead), h_(h) {
    const Material& m = body.model.material;
    per_mass_ = 1 / (h * h) + m.rayleigh_mass / h;
    damping_ = m.rayleigh_stiffness / h;
  }

  double per_mass() const { return per_mass_; }
  double stiffness() const { return 1 + damping_; }

  Vec3 offset(int n) const { return ahead_ ? Vec3(body_.free.predicted.segment<3>(3 * n)) : Vec3::Zero(); }

  // r_e by corner. Of an element turned with R, the force is R sym(RᵀF)'s; of its own rotation it is so
  // anyway.
  Corners load(int t, const Mat3& R) const {
    const TissueModel& m = body_.model;
    const Tet& tet = m.mesh.tets[t];
    const auto [mu, lambda, density] = m.elastic[t];
    Corners motion;
    for (int a = 0; a < 4; ++a) motion.col(a) = offset(tet[a]);
    const Mat3 S =
        R.transpose() * deformation_gradient(corners_of(tet, body_.state.x) + motion, m.gradients[t]);
    const Mat3 F = 0.5 * R * (S + S.transpose());
    const double volume = volume_left(m, body_.state, t);
    Corners load = element_forces(F, R, m.gradients[t], volume, mu, lambda);
    const Mat3 A = R.transpose() * deformation_gradient(motion, m.gradients[t]);
    const Mat3 strained = R * (Mat3::Identity() + 0.5 * (A + A.transpose()));
    load += damping_ * element_forces(strained, R, m.gradients[t], volume, mu, lambda);
    for (int a = 0; a < 4; ++a)
      load.col(a) += mass(t) * (body_.state.v[tet[a]] / h_ + m.gravity - per_mass_ * motion.col(a));
    return load;
  }

  double mass(int t) const {
    return 0.25 * body_.model.elastic[t].density * volume_left(body_.model, body_.state, t);
  }

 private:
  const Body& body_;
  bool ahead_;
  double h_, per_mass_, damping_;
};

// E and r_E of an element with rotation R: `sign` 1 where it goes, −1 where it comes.
void add_element(const Body& body, const Linearisation& at, int t, const Mat3& R, double sign,
                 WoodburyDowndate& gone) {
  const TissueModel& m = body.model;
  const Tet& tet = m.mesh.tets[t];
  const Gradients b = R * m.gradients[t];
  const double mu = sign * at.stiffness() * m.elastic[t].mu,
               lambda = sign * at.stiffness() * m.elastic[t].lambda;
  const Corners load = sign * at.load(t, R);
  for (int i = 0; i < 4; ++i) {
    if (m.fixed[tet[i]]) continue;
    const int gi = 3 * gone.index[tet[i]];
    gone.r.segment<3>(gi) += load.col(i);
    gone.M.diagonal().segment<3>(gi).array() += sign * at.per_mass() * at.mass(t);
    for (int j = 0; j < 4; ++j)
      if (!m.fixed[tet[j]])
        gone.M.block<3, 3>(gi, 3 * gone.index[tet[j]]) +=
            stiffness_block(b.col(i), b.col(j), volume_left(m, body.state, t), mu, lambda);
  }
}

WoodburyDowndate gone_of(const Body& body, std::span<const int> tets, std::span<const StaleRotation> stale,
                         const Linearisation& at, std::span<const int> nodes) {
  WoodburyDowndate gone;
  gone.index.assign(body.state.x.size(), -1);
  const auto add_nodes = [&](int t) {
    for (const int n : body.model.mesh.tets[t])
      if (gone.index[n] < 0) {
        gone.index[n] = static_cast<int>(gone.node.size());
        gone.node.push_back(n);
        gone.place.push_back(static_cast<int>(std::find(nodes.begin(), nodes.end(), n) - nodes.begin()));
      }
  };
  for (const int t : tets) add_nodes(t);
  for (const StaleRotation& t : stale) add_nodes(t.tet);
  const auto size = static_cast<Eigen::Index>(3 * gone.node.size());
  gone.M = MatX::Zero(size, size);
  gone.r = VecX::Zero(size);
  for (const int t : tets) add_element(body, at, t, body.state.rotation[t], 1, gone);
  const double s = size > 0 ? gone.M.diagonal().maxCoeff() : 0;
  for (std::size_t g = 0; g < gone.node.size(); ++g) {
    const int n = gone.node[g];
    if (body.state.live_tets_of_node[n] == 0 && !body.model.fixed[n])
      gone.M.diagonal().segment<3>(static_cast<Eigen::Index>(3 * g)).array() -= s;
  }
  for (const StaleRotation& t : stale) {
    add_element(body, at, t.tet, body.state.rotation[t.tet], 1, gone);
    add_element(body, at, t.tet, t.R, -1, gone);
  }
  return gone;
}

}  // namespace

bool woodbury_downdate(Body& body, std::span<const int> tets, std::span<const StaleRotation> stale,
                       Linearised linearised, double h, std::span<const int> nodes, int kept,
                       const VecX& force, int uncovered, Condensed& out) {
  const auto outside = std::count_if(nodes.begin(), nodes.end(), [&](const int& n) {
    return !body.compliance->zone_covers(std::span(&n, 1));
  });
  if (outside > uncovered) return false;
  const Linearisation at(body, linearised, h);
  const WoodburyDowndate gone = gone_of(body, tets, stale, at, nodes);
  const auto all = static_cast<Eigen::Index>(3 * nodes.size());
  const auto size = static_cast<Eigen::Index>(3 * gone.node.size());
  const Eigen::Index wanted = 3 * kept;
  MatX C_all(all, all);
  body.compliance->patch(nodes, C_all);

  // C_G, and z beside what C' is built from: one solve has both.
  MatX C_G(all, size);
  for (std::size_t g = 0; g < gone.node.size(); ++g)
    C_G.middleCols<3>(static_cast<Eigen::Index>(3 * g)) = C_all.middleCols<3>(3 * gone.place[g]);
  VecX z(all);
  for (std::size_t i = 0; i < nodes.size(); ++i)
    z.segment<3>(static_cast<Eigen::Index>(3 * i)) =
        body.free.dx.segment<3>(3 * nodes[i]) - at.offset(nodes[i]);
  z.noalias() -= C_G * gone.r;

  MatX right(size, wanted + size + 1);  // rows G of C for the nodes kept, for G, and z
  MatX B = MatX::Identity(size, size);
  for (std::size_t g = 0; g < gone.node.size(); ++g) {
    const auto row = static_cast<Eigen::Index>(3 * g);
    right.block(row, 0, 3, wanted) = C_all.block(3 * gone.place[g], 0, 3, wanted);
    right.block(row, wanted, 3, size) = C_G.middleRows<3>(3 * gone.place[g]);
    right.block<3, 1>(row, wanted + size) = z.segment<3>(3 * gone.place[g]);
  }
  B.noalias() -= right.middleCols(wanted, size) * gone.M;
  if (size > 0) right = Eigen::PartialPivLU<MatX>(B).solve(right).eval();
  if (!right.allFinite()) return false;
  // C'_GG: positive definite, or a piece was left that neither mass nor support holds.
  MatX corner = right.middleCols(wanted, size);
  for (std::size_t g = 0; g < gone.node.size(); ++g)
    if (body.model.fixed[gone.node[g]])
      corner.diagonal().segment<3>(static_cast<Eigen::Index>(3 * g)).setOnes();
  if (size > 0 && Eigen::LLT<MatX>(0.5 * (corner + corner.transpose())).info() != Eigen::Success)
    return false;

  out.changed = gone.node;
  out.M = gone.M;
  out.r = gone.r;
  out.moved = right.col(wanted + size);
  out.moved_by = right.leftCols(wanted);
  out.C = C_all.topLeftCorner(wanted, wanted);
  out.dx_free = z.head(wanted);
  // Nothing goes from a body that is pressed beside one that is cut: its problem is the plain one. Eigen
  // divides by the depth of a product that is written into a triangle.
  if (size > 0) {
    out.C.triangularView<Eigen::Lower>() += C_G.topRows(wanted) * (gone.M * right.leftCols(wanted));
    out.dx_free.noalias() += C_G.topRows(wanted) * (gone.M * right.col(wanted + size));
  }
  out.C.triangularView<Eigen::StrictlyUpper>() = out.C.transpose();
  out.dx_pressed = C_all.topRows(wanted) * force;
  for (int i = 0; i < kept; ++i) {
    out.dx_free.segment<3>(3 * i) += at.offset(nodes[i]);
    out.dx_pressed.segment<3>(3 * i) += body.free.dx.segment<3>(3 * nodes[i]);
  }
  return true;
}

VecX force_of_change(const Condensed& c, const VecX& force) {
  return c.M * (c.moved + c.moved_by * force) - c.r;
}

}  // namespace hapticd
