// Near regions over a whole body, and for each what is far from it, condensed: so that what is simulated can
// follow an instrument.
//
//   places    a grid of `spacing`, those that are the nearest to a node of the body
//   hull(V)   tetrahedra within `radius` of one of the places V, the rest condensed
//   V: a dozen neighbours, halved until they are one place; hull(V/2) is condensed from hull(V), and the
//   dozen's from the body (condense_far.h): what is far from a neighbourhood is eliminated once
//
// Of 20 000 nodes a dozen costs some seconds, one more of it tenths of a second. Hulls are kept
// until their memory is more than is asked for, and made anew where tissue that is far from them went.
// Units: m. Errors: std::runtime_error from a factor. Thread safety: `make` by one thread at a time, beside
// whoever asks for places.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "physics/compliance/condense_far.h"
#include "physics/compliance/submodel.h"

namespace hapticd {

class NearRegions {
 public:
  // first.centre is a place, if the body is there. Pre: nothing of `whole` is condensed.
  NearRegions(std::shared_ptr<const TissueModel> whole, const NearRegion& first,
              std::size_t most_bytes = std::size_t{1} << 30);

  int count() const noexcept { return static_cast<int>(place_.size()); }
  const Vec3& place(int region) const noexcept { return place_[static_cast<std::size_t>(region)]; }
  double radius() const noexcept { return radius_; }
  double spacing() const noexcept { return spacing_; }
  const Vec3& first() const noexcept { return first_; }
  int nearest(const Vec3& X) const noexcept;

  // gone: all tetrahedra that went so far, in that order. Null: nothing is far from the place, or nothing
  // near it is left.
  std::shared_ptr<const CondensedTissue> make(int region, std::span<const int> gone);

  // Of the hulls that are kept.
  std::size_t memory_bytes() const noexcept { return bytes_; }
  int hulls_made() const noexcept { return made_; }

 private:
  struct Hull {
    std::unique_ptr<Submodel> part;  // null: the body itself
    std::vector<int> node, tet;      // of the body, ascending; of the body itself none
    TissueState body_state;          // of the body itself
    std::size_t known = 0;           // of what went
    std::size_t bytes = 0;
  };
  // A half of the places, or one.
  struct Branch {
    int begin = 0, end = 0;  // in order_
    int parent = -1;
    std::shared_ptr<Hull> hull;
    std::size_t known = 0;                     // of what went, in the last hull that was made
    std::vector<int> kept;                     // its tetrahedra of the body, ascending
    std::uint64_t version = 0, of_parent = 0;  // which hull of its parent it was made from
    std::uint64_t used = 0;
  };

  void grow(int begin, int end, int parent);
  bool is_near(const Vec3& X, int begin, int end) const noexcept;
  bool outdated(const Branch& branch, std::span<const int> gone) const;
  const Hull& hull_of(int branch, std::span<const int> gone);
  std::shared_ptr<Hull> condensed(const Hull& from, const Branch& branch, std::span<const int> gone) const;
  void forget_unused();

  std::shared_ptr<const TissueModel> whole_;
  Vec3 first_;
  double radius_, spacing_;
  std::size_t most_bytes_;
  std::vector<Vec3> centroid_;  // per tetrahedron
  std::vector<Vec3> place_;
  Vec3 origin_ = Vec3::Zero();  // of the grid
  std::array<int, 3> cells_ = {};
  std::vector<int> at_;                // per cell of the grid: the region; −1
  std::vector<int> order_, position_;  // regions, halves side by side; and where each is
  std::vector<Branch> branch_;
  std::vector<int> leaf_;  // per region
  std::uint64_t clock_ = 0;
  std::size_t bytes_ = 0;
  int made_ = 0;
};

}  // namespace hapticd
