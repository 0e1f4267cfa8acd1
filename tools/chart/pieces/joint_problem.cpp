#include "tools/chart/pieces/joint_problem.h"

#include <algorithm>
#include <map>
#include <numeric>

#include "physics/contact/solver/coulomb.h"
#include "tools/chart/solver/pgs_baseline.h"

namespace hapticd {
namespace {

// How a touch takes hold of nodes: place in the body's list, weight.
struct Hold {
  int body, place;
  double weight;
};

struct Touch {
  std::vector<Hold> holds;
  Mat3 frame;
  double friction;
  Vec3 q, lambda;
};

class Gathering {
 public:
  explicit Gathering(const Bodies& bodies) : bodies_(bodies), nodes_(bodies.size()), place_(bodies.size()) {}

  void add(Touch& touch, int body, int node, double weight) {
    const auto [at, fresh] = place_[body].try_emplace(node, static_cast<int>(nodes_[body].size()));
    if (fresh) nodes_[body].push_back(node);
    touch.holds.push_back({body, at->second, weight});
  }

  std::vector<MatX> compliances() const {
    std::vector<MatX> out(bodies_.size());
    for (std::size_t b = 0; b < bodies_.size(); ++b) {
      if (nodes_[b].empty()) continue;
      const auto size = 3 * static_cast<Eigen::Index>(nodes_[b].size());
      out[b].resize(size, size);
      bodies_[b].compliance->patch(nodes_[b], out[b]);
    }
    return out;
  }

 private:
  const Bodies& bodies_;
  std::vector<std::vector<int>> nodes_;
  std::vector<std::map<int, int>> place_;
};

// A sample's id is (body, face, index in the face): patch.h. Null: of an obstacle.
const SurfaceFace* face_of(const Bodies& bodies, std::uint64_t id, int& body) {
  body = static_cast<int>(id >> 56);
  const int face = static_cast<int>((id & ((std::uint64_t{1} << 56) - 1)) >> 12);
  for (const SurfaceFace& f : bodies[body].surface.faces())
    if (f.id == face) return &f;
  return nullptr;
}

Touch instrument_touch(const World& world, const CondensedProblem& published, int i, Gathering& gathering) {
  const ContactRows& rows = world.contact_scratch().rows;
  const ContactRow& row = rows.row[i];
  const int m = rows.rows_per_contact;
  Touch t{{}, row.frame, m == 3 ? row.friction : 0, row.delta_free, Vec3::Zero()};
  for (int k = 0; k < m; ++k) t.lambda[k] = world.contact_scratch().lambda[m * i + k];
  if (row.sample < 0) return t;
  const PatchSample& s = published.sample[row.sample];
  int body = 0;
  const SurfaceFace* face = face_of(world.bodies(), s.id, body);
  if (face && s.node[0] >= 0)
    for (int c = 0; c < 3; ++c) gathering.add(t, body, face->nodes[c], s.weight[c]);
  return t;
}

Mat3 between(const std::vector<MatX>& C, const Touch& a, const Touch& b) {
  Mat3 G = Mat3::Zero();
  for (const Hold& s : a.holds)
    for (const Hold& t : b.holds)
      if (s.body == t.body) G += s.weight * t.weight * C[s.body].block<3, 3>(3 * s.place, 3 * t.place);
  return a.frame.transpose() * G * b.frame;
}

}  // namespace

std::optional<JointProblem> joint_problem(const World& world, const CondensedProblem& published,
                                          const StepReport& report) {
  const auto contacts = world.contacts().contacts();
  if (contacts.empty() || report.removed > 0 || report.split || report.awake_bodies == 0) return {};
  const ContactRows& tool = world.contact_scratch().rows;
  const int mt = tool.rows_per_contact;
  Gathering gathering(world.bodies());
  std::vector<Touch> touches;
  for (int i = 0; i < tool.contacts; ++i) touches.push_back(instrument_touch(world, published, i, gathering));
  for (const BodyContact& c : contacts) {
    Touch t{{}, c.frame, c.friction, c.delta_free, c.lambda};
    for (int k = 0; k < 4; ++k)
      if (const ContactStencil& s = c.stencil[k]; s.place >= 0)  // mobile in that step
        gathering.add(t, s.body, c.mesh_node[k], s.weight);
    touches.push_back(std::move(t));
  }
  const std::vector<MatX> C = gathering.compliances();
  const bool friction =
      std::any_of(touches.begin(), touches.end(), [](const auto& t) { return t.friction > 0; });
  const int m = friction ? 3 : 1;
  const auto n = static_cast<int>(touches.size());
  JointProblem out{MatX(m * n, m * n), VecX(m * n), {}, VecX(m * n)};
  for (int j = 0; j < n; ++j) {
    out.q.segment(m * j, m) = touches[j].q.head(m);
    out.lambda.segment(m * j, m) = touches[j].lambda.head(m);
    if (friction) out.mu.push_back(touches[j].friction);
    for (int i = 0; i <= j; ++i) {
      Mat3 block = between(C, touches[i], touches[j]);
      // The instrument's own rows have its coupling in them.
      if (j < tool.contacts) block.topLeftCorner(mt, mt) = tool.W().block(mt * i, mt * j, mt, mt);
      out.W.block(m * i, m * j, m, m) = block.topLeftCorner(m, m);
      out.W.block(m * j, m * i, m, m) = block.topLeftCorner(m, m).transpose();
    }
  }
  return out;
}

JointProblem part_of(const JointProblem& p, const std::vector<int>& touches) {
  const int m = p.width();
  const auto n = static_cast<int>(touches.size());
  JointProblem out{MatX(m * n, m * n), VecX(m * n), {}, VecX(m * n)};
  for (int j = 0; j < n; ++j) {
    out.q.segment(m * j, m) = p.q.segment(m * touches[j], m);
    out.lambda.segment(m * j, m) = p.lambda.segment(m * touches[j], m);
    if (m == 3) out.mu.push_back(p.mu[touches[j]]);
    for (int i = 0; i < n; ++i)
      out.W.block(m * i, m * j, m, m) = p.W.block(m * touches[i], m * touches[j], m, m);
  }
  return out;
}

JointProblem nearest_touches(const JointProblem& p, int touches) {
  const int m = p.width(), n = std::min(touches, p.touches());
  std::vector<int> order(p.touches());
  std::iota(order.begin(), order.end(), 0);
  std::stable_sort(order.begin(), order.end(), [&](int a, int b) {
    const bool a_bears = p.lambda[m * a] > 0, b_bears = p.lambda[m * b] > 0;
    return a_bears != b_bears ? a_bears : p.q[m * a] < p.q[m * b];
  });
  order.resize(n);
  std::sort(order.begin(), order.end());
  return part_of(p, order);
}

double residual_of(const JointProblem& p, const VecX& lambda) {
  return p.mu.empty() ? lcp_residual(p.W, p.q, lambda) : coulomb_residual(p.W, p.q, lambda, p.mu);
}

}  // namespace hapticd
