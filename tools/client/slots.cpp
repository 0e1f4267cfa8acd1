#include "tools/client/slots.h"

#include <algorithm>

namespace hapticd {

std::int64_t SlotPlan::slot_to_serve(std::int64_t next, std::int64_t now_ns) const noexcept {
  const std::int64_t present = now_ns < t0_ns ? 0 : (now_ns - t0_ns) / period_ns;
  return std::min(std::max(next, present), slots);
}

SlotBook::SlotBook(std::int64_t slots) : sent_at_(index(slots), 0), answered_at_(index(slots), 0) {
  plan_.slots = slots;
}

void SlotBook::begin(std::int64_t t0_ns, std::uint64_t first_number) noexcept {
  plan_.t0_ns = t0_ns;
  plan_.first_number = first_number;
}

void SlotBook::send(std::int64_t k, std::int64_t now_ns) noexcept {
  sent_at_[index(k)] = now_ns;
  sent_.fetch_add(1, std::memory_order_relaxed);
}

std::int64_t SlotBook::slot_of(std::uint64_t number) const noexcept {
  if (number < plan_.first_number || number - plan_.first_number >= static_cast<std::uint64_t>(plan_.slots))
    return -1;
  return static_cast<std::int64_t>(number - plan_.first_number);
}

bool SlotBook::answer(std::int64_t k, std::int64_t now_ns) noexcept {
  if (answered_at_[index(k)] != 0) {
    repeats_.fetch_add(1, std::memory_order_relaxed);
    return false;
  }
  answered_at_[index(k)] = now_ns;
  answered_.fetch_add(1, std::memory_order_relaxed);
  return true;
}

std::vector<double> SlotBook::round_trip_us() const {
  std::vector<double> times;
  for (std::int64_t k = 0; k < plan_.slots; ++k)
    if (answered_ns(k) != 0) times.push_back(1e-3 * static_cast<double>(answered_ns(k) - sent_ns(k)));
  return times;
}

std::vector<double> SlotBook::intended_round_trip_us() const {
  std::vector<double> times;
  for (std::int64_t k = 0; k < plan_.slots; ++k)
    if (answered_ns(k) != 0) times.push_back(1e-3 * static_cast<double>(answered_ns(k) - plan_.time_of(k)));
  return times;
}

std::vector<double> SlotBook::lateness_us() const {
  std::vector<double> times;
  for (std::int64_t k = 0; k < plan_.slots; ++k)
    if (sent_ns(k) != 0) times.push_back(1e-3 * static_cast<double>(sent_ns(k) - plan_.time_of(k)));
  return times;
}

}  // namespace hapticd
