// Several instruments in one tissue: each has a pose, a coupling and rows of its own.
//
//   δ = W λ + δ_free,   W = H C_pp Hᵀ + Σ_i J_i K_i⁻¹ J_iᵀ,   wrench_i = J_iᵀ λ
//
// A row belongs to one instrument, or to two where instruments touch. What each instrument has one of stands
// in an EachInstrument, the first instrument's first; where there is one alone its value converts. An
// instrument that is not present has no rows and feels nothing. Units: m. Source: DESIGN §10.
#pragma once

#include <array>
#include <span>
#include <vector>

#include "physics/contact/instrument.h"

namespace hapticd {

inline constexpr int max_instruments = 4;  // of one world

template <typename T>
struct EachInstrument {
  std::array<T, max_instruments> value{};

  EachInstrument() noexcept {
    if constexpr (requires(T & t) { t.setZero(); })
      for (T& of : value) of.setZero();
  }
  EachInstrument(const T& first) : EachInstrument() { value[0] = first; }  // NOLINT: the usual case is one
  T& operator[](int i) noexcept { return value[static_cast<std::size_t>(i)]; }
  const T& operator[](int i) const noexcept { return value[static_cast<std::size_t>(i)]; }
};

// Where each is.
struct InstrumentPoses {
  EachInstrument<Pose> X;
  EachInstrument<bool> present;

  InstrumentPoses() = default;
  InstrumentPoses(const Pose& first) : X(first), present(true) {}  // NOLINT: as above
  Pose& operator[](int i) noexcept { return X[i]; }
  const Pose& operator[](int i) const noexcept { return X[i]; }
  bool any() const noexcept {
    for (const bool p : present.value)
      if (p) return true;
    return false;
  }
};

// X ⊕ s d and X ⊖ Y of those present; the others stay, and differ by nothing.
InstrumentPoses displaced(const InstrumentPoses& X, const EachInstrument<Vec6>& d, double s = 1) noexcept;
EachInstrument<Vec6> difference(const InstrumentPoses& X, const InstrumentPoses& Y) noexcept;
// The longest translation [m].
double longest(const EachInstrument<Vec6>& d) noexcept;

// The instruments of a world, whose owner outlives this.
class Instruments {
 public:
  Instruments(const Instrument& one) noexcept : of_(&one, 1) {}           // NOLINT: as above
  Instruments(const std::vector<Instrument>& all) noexcept : of_(all) {}  // NOLINT: as above
  int count() const noexcept { return static_cast<int>(of_.size()); }
  const Instrument& operator[](int i) const noexcept { return of_[static_cast<std::size_t>(i)]; }

 private:
  std::span<const Instrument> of_;
};

}  // namespace hapticd
