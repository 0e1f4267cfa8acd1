#include "physics/compliance/near_regions.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <utility>

namespace hapticd {
namespace {

constexpr double spacing_of_radius = 0.4;
constexpr int most_places = 12;            // that share what is condensed of the body first
constexpr std::size_t bytes_of_tet = 400;  // of a submodel

std::vector<int> of_body(std::span<const int> own, const std::vector<int>& body) {
  std::vector<int> out;
  out.reserve(own.size());
  for (const int k : own) out.push_back(body.empty() ? k : body[static_cast<std::size_t>(k)]);
  return out;
}

}  // namespace

NearRegions::NearRegions(std::shared_ptr<const TissueModel> whole, const NearRegion& first,
                         std::size_t most_bytes)
    : whole_(std::move(whole)),
      first_(first.centre),
      radius_(first.radius),
      spacing_(spacing_of_radius * first.radius),
      most_bytes_(most_bytes) {
  const TetMesh& mesh = whole_->mesh;
  Eigen::AlignedBox3d box(first.centre);
  for (int n = 0; n < whole_->nodes_in_use; ++n) box.extend(mesh.nodes[n]);
  for (int t = 0; t < whole_->tets_in_use; ++t) {
    Vec3 sum = Vec3::Zero();
    for (const int n : mesh.tets[t]) sum += mesh.nodes[n];
    centroid_.push_back(sum / 4);
  }
  const auto cell = [&](const Vec3& X, int r) {
    return static_cast<int>(std::lround((X[r] - origin_[r]) / spacing_));
  };
  for (int r = 0; r < 3; ++r) {
    const double below = std::ceil((first.centre[r] - box.min()[r]) / spacing_);
    origin_[r] = first.centre[r] - below * spacing_;
    cells_[r] = cell(box.max(), r) + 2;
  }
  at_.assign(static_cast<std::size_t>(cells_[0]) * cells_[1] * cells_[2], -1);
  const auto add = [&](const Vec3& X) {
    const std::array<int, 3> c = {cell(X, 0), cell(X, 1), cell(X, 2)};
    int& region = at_[(static_cast<std::size_t>(c[2]) * cells_[1] + c[1]) * cells_[0] + c[0]];
    if (region >= 0) return;
    region = count();
    place_.emplace_back(origin_ + spacing_ * Vec3(c[0], c[1], c[2]));
  };
  add(first.centre);
  for (int n = 0; n < whole_->nodes_in_use; ++n) add(mesh.nodes[n]);
  for (int i = 0; i < count(); ++i) order_.push_back(i);
  leaf_.resize(place_.size());
  grow(0, count(), -1);
  position_.resize(place_.size());
  for (int k = 0; k < count(); ++k) position_[order_[k]] = k;
}

// Halves of the longest side, down to one place. Halves of many are no branches: of the body's hull next to
// nothing is far from them, and their boundary is large.
void NearRegions::grow(int begin, int end, int parent) {
  int own = parent;
  if (parent < 0 || end - begin <= most_places) {
    own = static_cast<int>(branch_.size());
    branch_.push_back({});
    branch_[own].begin = begin;
    branch_[own].end = end;
    branch_[own].parent = parent;
  }
  if (end - begin == 1) {
    // The body's own hull is of all places, be there one.
    if (parent < 0) return grow(begin, end, own);
    leaf_[order_[begin]] = own;
    return;
  }
  Eigen::AlignedBox3d box;
  for (int k = begin; k < end; ++k) box.extend(place_[order_[k]]);
  int side = 0;
  box.sizes().maxCoeff(&side);
  const int middle = begin + (end - begin) / 2;
  std::nth_element(order_.begin() + begin, order_.begin() + middle, order_.begin() + end, [&](int a, int b) {
    return place_[a][side] != place_[b][side] ? place_[a][side] < place_[b][side] : a < b;
  });
  grow(begin, middle, own);
  grow(middle, end, own);
}

int NearRegions::nearest(const Vec3& X) const noexcept {
  const Vec3 at = (X - origin_) / spacing_;
  bool inside = true;
  std::array<int, 3> c = {};
  for (int r = 0; r < 3; ++r) {
    inside = inside && at[r] > -0.5 && at[r] < cells_[r] - 0.5;
    if (inside) c[r] = static_cast<int>(std::lround(at[r]));
  }
  if (inside)
    if (const int region = at_[(static_cast<std::size_t>(c[2]) * cells_[1] + c[1]) * cells_[0] + c[0]];
        region >= 0)
      return region;
  int best = 0;
  double least = std::numeric_limits<double>::infinity();
  for (int i = 0; i < count(); ++i)
    if (const double d = (place(i) - X).squaredNorm(); d < least) {
      least = d;
      best = i;
    }
  return best;
}

// Within the radius of one of these places.
bool NearRegions::is_near(const Vec3& X, int begin, int end) const noexcept {
  const Vec3 at = (X - origin_) / spacing_;
  const double reach = radius_ / spacing_;
  std::array<int, 3> low, high;
  for (int r = 0; r < 3; ++r) {
    low[r] = std::max(0, static_cast<int>(std::floor(at[r] - reach)));
    high[r] = std::min(cells_[r] - 1, static_cast<int>(std::ceil(at[r] + reach)));
  }
  for (int k = low[2]; k <= high[2]; ++k)
    for (int j = low[1]; j <= high[1]; ++j)
      for (int i = low[0]; i <= high[0]; ++i) {
        const int region = at_[(static_cast<std::size_t>(k) * cells_[1] + j) * cells_[0] + i];
        if (region < 0 || position_[region] < begin || position_[region] >= end) continue;
        if ((X - place_[region]).norm() <= radius_) return true;
      }
  return false;
}

// Something that is far from it went since; or its parent is another.
bool NearRegions::outdated(const Branch& branch, std::span<const int> gone) const {
  if (branch.version == 0) return true;
  if (branch.parent < 0) return false;
  if (branch.of_parent != branch_[branch.parent].version) return true;
  for (const int t : gone.subspan(std::min(branch.known, gone.size())))
    if (!std::binary_search(branch.kept.begin(), branch.kept.end(), t)) return true;
  return false;
}

std::shared_ptr<NearRegions::Hull> NearRegions::condensed(const Hull& from, const Branch& branch,
                                                          std::span<const int> gone) const {
  const TissueModel& model = from.part ? from.part->model : *whole_;
  TissueState state = from.part ? from.part->state : from.body_state;
  const auto body_tet = [&](int t) { return from.part ? from.tet[t] : t; };
  if (from.part) {
    for (const int t : gone)
      if (const auto found = std::lower_bound(from.tet.begin(), from.tet.end(), t);
          found != from.tet.end() && *found == t)
        state.alive[found - from.tet.begin()] = 0;
  } else {
    for (const int t : gone) state.alive[t] = 0;
  }
  std::vector<std::uint8_t> near(model.mesh.tets.size(), 0);
  for (int t = 0; t < model.tets_in_use; ++t)
    near[t] = is_near(centroid_[body_tet(t)], branch.begin, branch.end);
  const std::shared_ptr<const CondensedTissue> far = condense(model, state, near);
  auto hull = std::make_shared<Hull>();
  if (!far) {  // all of it is near
    if (!from.part) {
      hull->body_state = from.body_state;
      return hull;
    }
    hull->part =
        std::make_unique<Submodel>(from.part->model, from.part->model.condensed->near_node,
                                   from.part->model.condensed->near_tet, from.part->model.condensed.get());
    hull->node = from.node;
    hull->tet = from.tet;
  } else {
    hull->part = std::make_unique<Submodel>(model, far->near_node, far->near_tet, far.get());
    hull->node = of_body(far->near_node, from.node);
    hull->tet = of_body(far->near_tet, from.tet);
  }
  const auto rows = static_cast<std::size_t>(hull->part->model.condensed->stiffness->rows());
  hull->bytes = rows * rows * sizeof(double) + bytes_of_tet * hull->tet.size();
  return hull;
}

const NearRegions::Hull& NearRegions::hull_of(int own, std::span<const int> gone) {
  Branch& branch = branch_[own];
  branch.used = ++clock_;
  if (branch.parent < 0) {
    if (!branch.hull) {
      branch.hull = std::make_shared<Hull>();
      branch.hull->body_state = rest_state(*whole_);
      branch.version = 1;
    }
    return *branch.hull;
  }
  const Hull& from = hull_of(branch.parent, gone);
  const bool anew = outdated(branch, gone);
  if (branch.hull && !anew) return *branch.hull;
  if (branch.hull) bytes_ -= branch.hull->bytes;
  branch.hull.reset();  // what follows may throw
  branch.hull = condensed(from, branch, gone);
  bytes_ += branch.hull->bytes;
  ++made_;
  if (anew) branch.version = ++clock_;
  branch.of_parent = branch_[branch.parent].version;
  branch.known = gone.size();
  branch.kept = branch.hull->tet;
  return *branch.hull;
}

// Those that were used the longest ago.
void NearRegions::forget_unused() {
  while (bytes_ > most_bytes_) {
    Branch* oldest = nullptr;
    for (Branch& b : branch_)
      if (b.hull && b.hull->bytes > 0 && (!oldest || b.used < oldest->used)) oldest = &b;
    if (!oldest) return;
    bytes_ -= oldest->hull->bytes;
    oldest->hull.reset();
  }
}

std::shared_ptr<const CondensedTissue> NearRegions::make(int region, std::span<const int> gone) {
  Branch& leaf = branch_[leaf_[region]];
  const Hull* hull = nullptr;
  try {
    hull = &hull_of(leaf_[region], gone);
  } catch (const std::invalid_argument&) {  // nothing near is left
    return nullptr;
  }
  if (!hull->part) return nullptr;
  const CondensedTissue& own = *hull->part->model.condensed;
  auto far = std::make_shared<CondensedTissue>(own);
  far->near_node = hull->node;
  far->near_tet = hull->tet;
  far->node = of_body(own.node, hull->node);
  far->place.assign(whole_->mesh.nodes.size(), -1);
  for (std::size_t i = 0; i < far->node.size(); ++i) far->place[far->node[i]] = static_cast<int>(i);
  far->tet.assign(whole_->mesh.tets.size(), 0);
  std::fill_n(far->tet.begin(), whole_->tets_in_use, std::uint8_t{1});
  for (const int t : gone) far->tet[t] = 0;
  for (const int t : far->near_tet) far->tet[t] = 0;
  // What it has is in `far`.
  bytes_ -= leaf.hull->bytes;
  leaf.hull.reset();
  forget_unused();
  return far;
}

}  // namespace hapticd
