// The inverse of a reference factor matrix that follows low-rank changes of it: what `updown`, `lazy` and
// `dense` differ in.
//
//   A ← A − V Vᵀ (an element goes)   or   A ← A + V Vᵀ (an orphan's row gets the identity)
//
// Everything is in the reference factor's frame, without rotations since (warped_compliance.h adds them).
// Shapes: vectors of 3·nodes in the model's node order. Units: A [N/m], C [m/N].
// Errors: the factories throw std::runtime_error when A is not positive definite. `change` returns false when
// the changed A has no inverse in floating point; the object must not be used after that.
#pragma once

#include <cstddef>
#include <memory>
#include <span>

#include "physics/compliance/element_term.h"
#include "physics/compliance/system_matrix.h"

namespace hapticd {

class LowRankInverse {
 public:
  virtual ~LowRankInverse() = default;

  [[nodiscard]] virtual bool change(const ElementTerm& term, TermSign sign) = 0;

  // The order in which `element_term` should have an element's corners.
  virtual int place(int node) const = 0;

  virtual void apply(VecX& x) = 0;  // x ← C x

  // C_pp, both triangles, exactly symmetric. Nodes are free and not named twice.
  virtual void patch(std::span<const int> nodes, Eigen::Ref<MatX> block) = 0;

  virtual std::size_t memory_bytes() const = 0;
};

// L D Lᵀ by CHOLMOD, changed by its Modify module. `zone` nodes are last in `order`: their compliance comes
// from the trailing corner. An empty zone: from sparse forward solves (METIS order).
std::unique_ptr<LowRankInverse> make_updown_inverse(const SystemMatrix& A, std::span<const int> order,
                                                    std::span<const int> zone);

// The paper's stacked terms on a reference factor that stays a factor (lazy_inverse.cpp).
std::unique_ptr<LowRankInverse> make_lazy_inverse(const SystemMatrix& A, std::span<const int> order,
                                                  std::span<const int> zone);

// A dense inverse, updated whole. Throws std::invalid_argument above 3000 nodes (650 MB).
std::unique_ptr<LowRankInverse> make_dense_inverse(const SystemMatrix& A);

}  // namespace hapticd
