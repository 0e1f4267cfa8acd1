#include "physics/simulation/region/region_entry.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <utility>

#include "physics/compliance/system_matrix.h"

namespace hapticd {
namespace {

bool simulated(const Body& body, int n) {
  return !body.model.fixed[n] && body.state.live_tets_of_node[n] > 0;
}

constexpr std::size_t most_told = 60;  // tetrahedra that a compliance is told went: more make it anew

double energy(const Body& body) {
  return kinetic_energy(body.model, body.state) + elastic_energy(body.model, body.state);
}

}  // namespace

std::shared_ptr<PreparedRegion> prepare_region(const TissueModel& whole, const CondensedTissue& far,
                                               std::vector<int> alive, std::span<const int> zone,
                                               const WorldSettings& settings) {
  auto made = std::make_shared<PreparedRegion>();
  auto part = std::make_unique<Submodel>(whole, far.near_node, alive, &far);
  const std::vector<int> own = part->nodes_of(zone);
  made->compliance =
      make_compliance(settings.compliance, std::move(part), settings.h, settings.compliance_options, own);
  made->alive = std::move(alive);
  return made;
}

RegionEntry::RegionEntry(Body& body, int region, std::vector<int> zone, const WorldSettings& settings)
    : region_(region),
      whole_(body.regions->whole),
      far_(body.regions->far[static_cast<std::size_t>(region)].tissue),
      zone_(std::move(zone)),
      settings_(settings),
      prepared_(std::exchange(body.regions->far[static_cast<std::size_t>(region)].prepared, nullptr)) {
  const TissueState& state = body.state;
  for (const int t : far_->near_tet) {
    if (!is_there(body.model, state, t)) continue;
    tet_.push_back(t);
    left_.push_back(state.left[t]);
  }
  if (prepared_ && prepared_->alive.size() > tet_.size() + most_told) prepared_.reset();
  for (const int n : far_->near_node) new_.push_back(!whole_->fixed[n] && !simulated(body, n));
}

void RegionEntry::make() {
  part_ = std::make_unique<Submodel>(*whole_, far_->near_node, tet_, far_.get());
  part_->state.left = left_;
  refresh_mass(part_->model, part_->state);
  condense_new_nodes();
  part_.reset();
  if (!prepared_) prepared_ = prepare_region(*whole_, *far_, tet_, zone_, settings_);
}

// K of the new nodes, at rest.
void RegionEntry::condense_new_nodes() {
  TissueModel model = part_->model;
  model.dynamic = model.corotational = false;
  std::vector<int> index(new_.size(), -1), other(new_.size(), -1);
  for (std::size_t k = 0; k < new_.size(); ++k) {
    if (!new_[k] || part_->state.live_tets_of_node[k] == 0) continue;
    index[k] = static_cast<int>(new_node_.size());
    new_node_.push_back(far_->near_node[k]);
  }
  if (new_node_.empty()) return;
  SystemMatrix matrix(model, node_graph(model), settings_.h);
  matrix.assemble(part_->state);
  MatX K = MatX::Zero(3 * new_node_.size(), 3 * new_node_.size());
  std::vector<Eigen::Triplet<double>> to_old;
  const auto add = [&](int i, int j, const Mat3& block) {  // rows of i
    if (index[i] < 0) return;
    if (index[j] >= 0) {
      K.block<3, 3>(3 * index[i], 3 * index[j]) += block;
      return;
    }
    if (other[j] < 0) {
      other[j] = static_cast<int>(old_node_.size());
      old_node_.push_back(far_->near_node[static_cast<std::size_t>(j)]);
    }
    for (int r = 0; r < 3; ++r)
      for (int c = 0; c < 3; ++c) to_old.emplace_back(3 * index[i] + r, 3 * other[j] + c, block(r, c));
  };
  for (std::size_t e = 0; e < matrix.edges().size(); ++e) {
    const auto [i, j] = matrix.edges()[e];
    add(i, j, matrix.coupling()[e]);
    add(j, i, matrix.coupling()[e].transpose());
  }
  for (int n = 0; n < matrix.node_count(); ++n) add(n, n, matrix.diagonal()[n]);
  K_qo_.resize(K.rows(), 3 * static_cast<Eigen::Index>(old_node_.size()));
  K_qo_.setFromTriplets(to_old.begin(), to_old.end());
  K_qq_.compute(K);
  if (K_qq_.info() != Eigen::Success)
    throw std::runtime_error("what is near in the next region does not hold together");
  VecX f(3 * static_cast<Eigen::Index>(part_->node.size())), inner(f.size());
  external_forces(model, part_->state, f);
  internal_forces(model, part_->state, inner);
  f += inner;
  f_q_.resize(K.rows());
  for (std::size_t k = 0; k < index.size(); ++k)
    if (index[k] >= 0) f_q_.segment<3>(3 * index[k]) = f.segment<3>(3 * static_cast<Eigen::Index>(k));
}

void RegionEntry::enter(Body& body) {
  TissueModel& model = body.model;
  TissueState& state = body.state;
  update_rotations(model, state);
  const double before = energy(body);

  // Where the new nodes are, by what is simulated until now.
  VecX u(3 * static_cast<Eigen::Index>(old_node_.size())), v(u.size());
  for (std::size_t k = 0; k < old_node_.size(); ++k) {
    const int n = old_node_[k];
    u.segment<3>(3 * static_cast<Eigen::Index>(k)) = state.x[n] - body.rest()[n];
    v.segment<3>(3 * static_cast<Eigen::Index>(k)) = state.v[n];
  }
  if (!new_node_.empty()) {
    const VecX force = f_q_ - K_qo_ * u, drag = -(K_qo_ * v);
    u = K_qq_.solve(force);
    v = K_qq_.solve(drag);
  }

  const std::vector<std::uint8_t> there = tets_there(model, state);
  auto far = std::make_shared<CondensedTissue>(*far_);
  for (const int t : model.condensed->near_tet) state.alive[t] = 0;
  for (std::size_t t = 0; t < there.size(); ++t) far->tet[t] = far->tet[t] && there[t];
  for (const int t : far->near_tet) {
    state.alive[t] = there[t];
    if (there[t] && model.condensed->tet[t]) state.rotation[t].setIdentity();
  }
  const std::vector<int> left_behind = model.condensed->near_node;
  model.fixed = whole_->fixed;
  model.springs = whole_->springs;
  use_condensed(model, state, std::move(far));
  for (const int n : left_behind)
    if (model.fixed[n]) {
      state.x[n] = body.rest()[n];
      state.v[n].setZero();
    }
  for (std::size_t k = 0; k < new_node_.size(); ++k) {
    state.x[new_node_[k]] = body.rest()[new_node_[k]] + u.segment<3>(3 * static_cast<Eigen::Index>(k));
    state.v[new_node_[k]] = v.segment<3>(3 * static_cast<Eigen::Index>(k));
  }
  update_rotations(model, state);
  const double kinetic = kinetic_energy(model, state), after = kinetic + elastic_energy(model, state);
  if (after > before && kinetic > 0) {
    const double share = std::sqrt(std::max(0.0, 1 - (after - before) / kinetic));
    for (const int n : model.condensed->near_node) state.v[n] *= share;
  }

  std::swap(prepared_->compliance, body.compliance);
  body.references = as_reference_compliance(body.compliance.get());
  std::vector<int> went;
  for (const int t : prepared_->alive)
    if (!state.alive[t]) went.push_back(t);
  if (!went.empty()) body.compliance->remove(state, went);
  body.free.dx.setZero();
  body.free.offset.resize(0);
  body.free.ahead = body.free.forward_solved = false;
  body.energy.elastic.resize(0);
  body.asleep = false;
  body.regions->present = region_;
  body.regions->in_use = far_;
}

}  // namespace hapticd
