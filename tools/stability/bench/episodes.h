// A long random trial in episodes that know nothing of one another: a thread for each core, reports in order.
//
// Episode e has seed `first_seed` + e and `episode` ticks, the last what is left; so what a shard of seeds
// gives is what the whole gives of them. run(seed, ticks, report, done): `done(n)` says that n more ticks
// were made and returns false to stop. progress(fraction), called by the caller's thread, returns false to
// stop.
#pragma once

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstdint>
#include <functional>
#include <thread>
#include <vector>

namespace hapticd {

template <class Report, class Run>
std::vector<Report> run_episodes(std::int64_t ticks, std::int64_t episode, std::uint64_t first_seed,
                                 const Run& run, const std::function<bool(double)>& progress) {
  const std::int64_t episodes = (ticks + episode - 1) / episode;
  std::vector<Report> parts(static_cast<std::size_t>(episodes));
  std::atomic<std::int64_t> next{0}, made{0};
  std::atomic<bool> on{true};
  const std::function<bool(std::int64_t)> done = [&](std::int64_t n) {
    made += n;
    return on.load();
  };
  const auto work = [&] {
    for (std::int64_t e; on && (e = next++) < episodes;)
      run(first_seed + static_cast<std::uint64_t>(e), std::min(episode, ticks - e * episode),
          parts[static_cast<std::size_t>(e)], done);
  };
  std::vector<std::thread> threads;
  const auto cores = static_cast<std::int64_t>(std::max(1u, std::thread::hardware_concurrency()));
  for (std::int64_t k = 0; k < std::min(cores, episodes); ++k) threads.emplace_back(work);
  while (on && next < episodes + static_cast<std::int64_t>(threads.size())) {
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
    on = progress(std::min(1.0, static_cast<double>(made) / static_cast<double>(ticks)));
  }
  for (std::thread& t : threads) t.join();
  return parts;
}

}  // namespace hapticd
