#include "physics/contact/contact_memory.h"

#include <algorithm>

#include "physics/contact/instrument_pairs.h"

namespace hapticd {

ContactMemory& ContactMemory::operator=(const ContactMemory& other) noexcept {
  count = other.count;
  std::copy_n(other.entry.begin(), count, entry.begin());
  outside = other.outside;
  return *this;
}

const ContactMemory::Entry* ContactMemory::find(std::uint64_t id, int instrument) const noexcept {
  const auto end = entry.begin() + count;
  const auto found = std::lower_bound(entry.begin(), end, id, [&](const Entry& e, std::uint64_t key) {
    return e.id != key ? e.id < key : e.instrument < instrument;
  });
  return found != end && found->id == id && found->instrument == instrument ? &*found : nullptr;
}

const ContactMemory::Entry* ContactMemory::find(std::uint64_t id, int instrument,
                                                int primitive) const noexcept {
  const Entry* const end = entry.data() + count;
  for (const Entry* e = find(id, instrument); e && e != end && e->id == id && e->instrument == instrument;
       ++e)
    if (e->primitive == primitive) return e;
  return nullptr;
}

const ContactMemory::Entry* ContactMemory::find(std::uint64_t id, int instrument, int primitive,
                                                int& from) const noexcept {
  const auto is_before = [&](const Entry& e) {
    return e.id != id                   ? e.id < id
           : e.instrument != instrument ? e.instrument < instrument
                                        : e.primitive < primitive;
  };
  if (from > 0 && !is_before(entry[from - 1])) return find(id, instrument, primitive);
  while (from < count && is_before(entry[from])) ++from;
  if (from == count) return nullptr;
  const Entry& e = entry[from];
  return e.id == id && e.instrument == instrument && e.primitive == primitive ? &e : nullptr;
}

bool ContactMemory::knows_tissue() const noexcept {
  return std::any_of(entry.begin(), entry.begin() + count, [](const Entry& e) { return !is_pair(e.id); });
}

Vec3 ContactMemory::force_on(std::uint64_t id) const noexcept {
  Vec3 force = Vec3::Zero();
  const auto begin = entry.begin(), end = begin + count;
  auto e = std::lower_bound(begin, end, id, [](const Entry& a, std::uint64_t key) { return a.id < key; });
  for (; e != end && e->id == id; ++e) force += e->lambda;
  return force;
}

}  // namespace hapticd
