// A network between the halves of a virtual daemon: what was sent when arrives when.
//
//   hands      one datagram: after delay ± jitter, or never
//   problems   as many datagrams as their bytes need: after delay ± jitter, and for each round in which lost
//              ones are asked for again 1 ms and twice that; always, but only the newest (server/edge)
//
// What is overtaken is dropped. Chance is a function of the seed and of what was sent before. Units: s, ns.
#pragma once

#include <cstdint>
#include <deque>
#include <random>
#include <utility>

namespace hapticd {

struct LinkTrouble {
  double delay = 0, jitter = 0;  // one way; jitter at most the delay [s]
  double loss = 0;               // of datagrams
  std::uint64_t seed = 1;
};

// What charts and trials try: one machine, a room, a house, a country, a continent, and what is lost there.
inline constexpr LinkTrouble tried_links[] = {
    {0, 0, 0},     {1e-3, 0, 0},        {1e-3, 0.5e-3, 0.05}, {5e-3, 0, 0},          {5e-3, 2e-3, 0.05},
    {20e-3, 0, 0}, {20e-3, 5e-3, 0.05}, {100e-3, 0, 0},       {100e-3, 10e-3, 0.05}, {200e-3, 0, 0}};

class VirtualLink {
 public:
  explicit VirtualLink(const LinkTrouble& trouble) : trouble_(trouble), random_(trouble.seed) {}

  // When it arrives; below zero: never.
  std::int64_t hands(std::int64_t sent_ns) { return happens(trouble_.loss) ? -1 : sent_ns + underway(); }
  std::int64_t problem(std::int64_t sent_ns, std::size_t bytes) {
    constexpr std::size_t datagram = 1400;
    constexpr std::int64_t asked_again_ns = 1'000'000;
    std::int64_t arrives = sent_ns + underway();
    std::size_t missing = bytes / datagram + 1;
    for (;;) {
      std::size_t lost = 0;
      for (std::size_t k = 0; k < missing; ++k) lost += happens(trouble_.loss);
      if (lost == 0) return arrives;
      missing = lost;
      arrives += asked_again_ns + underway() + underway();
    }
  }

 private:
  double uniform() { return static_cast<double>(random_() >> 11) * 0x1p-53; }
  bool happens(double probability) { return probability > 0 && uniform() < probability; }
  std::int64_t underway() {
    const double jitter = trouble_.jitter > 0 ? trouble_.jitter * (2 * uniform() - 1) : 0;
    return static_cast<std::int64_t>(1e9 * (trouble_.delay + jitter));
  }

  LinkTrouble trouble_;
  std::mt19937_64 random_;
};

// What is on its way, in the order in which it was sent.
template <class T>
class Underway {
 public:
  void send(std::int64_t arrives_ns, T value) {
    if (arrives_ns >= 0) way_.emplace_back(arrives_ns, std::move(value));
  }
  // The newest that has arrived by now, once; what was sent before it is dropped. False: nothing new.
  bool take(std::int64_t now_ns, T& value) {
    for (auto newest = way_.rbegin(); newest != way_.rend(); ++newest) {
      if (newest->first > now_ns) continue;
      value = std::move(newest->second);
      way_.erase(way_.begin(), newest.base());
      return true;
    }
    return false;
  }

 private:
  std::deque<std::pair<std::int64_t, T>> way_;
};

}  // namespace hapticd
