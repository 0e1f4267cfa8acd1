// What contacts remember between solves, found again by sample id, instrument and primitive.
//
// Sorted by id, then instrument, then primitive. Units: N, m; λ in world axes, on the tissue; anchors in the
// instrument's frame. Shapes: at most max_contacts. Guarantee: a plain value, of which copies take what is in
// use; noexcept, wait-free, no allocation.
#pragma once

#include <array>
#include <cstdint>

#include "physics/contact/instruments.h"
#include "physics/types.h"

namespace hapticd {

inline constexpr int max_contacts = 100;

struct ContactMemory {
  struct Entry {
    std::uint64_t id;
    Vec3 lambda;
    Vec3 anchor;
    bool sticking;
    int primitive = 0;
    int instrument = 0;
    Vec3 other_anchor = Vec3::Zero();  // frame of the instrument that is touched; of a ring, the scene's [m]
    double advance = 0;                // of an edge, in all; of an incision, its play [m]
  };
  int count = 0;
  std::array<Entry, max_contacts> entry;
  EachInstrument<bool> outside;  // tissue presses it from outside (missed_contact.h)

  ContactMemory() = default;
  ContactMemory(const ContactMemory& other) noexcept { *this = other; }
  // Entries that there are, and no others.
  ContactMemory& operator=(const ContactMemory& other) noexcept;

  const Entry* find(std::uint64_t id, int instrument, int primitive) const noexcept;
  // The same, asked in the memory's order, from where the last one was looked for: 0 to begin with.
  const Entry* find(std::uint64_t id, int instrument, int primitive, int& from) const noexcept;
  // The first of the sample and instrument, of whichever primitive.
  const Entry* find(std::uint64_t id, int instrument) const noexcept;
  // Whether it has any of tissue, and not of instruments and rings alone.
  bool knows_tissue() const noexcept;
  // Sum over the sample's entries.
  Vec3 force_on(std::uint64_t id) const noexcept;
};

}  // namespace hapticd
