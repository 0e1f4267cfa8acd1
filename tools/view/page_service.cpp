#include "tools/view/page_service.h"

#include <cstdio>
#include <mutex>
#include <thread>
#include <utility>

#include "tools/cli/interrupt.h"

namespace hapticd {
namespace {

// Texts of viewers, from the server's thread to the caller's.
class Texts {
 public:
  void add(std::uint64_t viewer, const std::string& text) {
    const std::lock_guard lock(mutex_);
    if (texts_.size() < 1000) texts_.emplace_back(viewer, text);
  }
  std::vector<std::pair<std::uint64_t, std::string>> take() {
    const std::lock_guard lock(mutex_);
    return std::exchange(texts_, {});
  }

 private:
  std::mutex mutex_;
  std::vector<std::pair<std::uint64_t, std::string>> texts_;
};

void say_where(const PageServer& server, const PageServiceSettings& s) {
  const std::string& address = s.server.address;
  const bool any = address == "0.0.0.0" || address == "::";
  const bool v6 = address.find(':') != std::string::npos;
  const std::string host = any ? "127.0.0.1" : v6 ? "[" + address + "]" : address;
  std::printf("%s: http://%s:%u/\n", s.command.c_str(), host.c_str(), server.port());
  if (address != "127.0.0.1" && address != "::1")
    std::fprintf(stderr, "haptic: whoever reaches %s %s: there is no password and no TLS\n", address.c_str(),
                 s.exposed.c_str());
  std::fflush(stdout);
}

}  // namespace

SharedMessage page_text(std::string key, std::string json) {
  return std::make_shared<const ViewMessage>(ViewMessage{std::move(key), false, std::move(json)});
}

void serve_page(const PageServiceSettings& s, PageFiles files, const PagePoll& poll, const PageHear& hear) {
  using Clock = std::chrono::steady_clock;
  const auto passed = [](Clock::time_point since) {
    return std::chrono::duration<double>(Clock::now() - since).count();
  };
  Texts texts;
  PageServer server(s.server, std::move(files),
                    [&](std::uint64_t viewer, const std::string& text) { texts.add(viewer, text); });
  say_where(server, s);
  const auto begun = Clock::now();
  auto looked = begun;
  while (!interrupted()) {
    for (const auto& [viewer, text] : texts.take()) hear(viewer, text);
    const bool watched = server.viewers() > 0;
    for (SharedMessage& m : poll(watched)) server.put(std::move(m));
    std::this_thread::sleep_for(s.turn);
    if (watched) looked = Clock::now();
    if (s.duration > 0 && passed(begun) > s.duration) break;
    if (s.idle > 0 && passed(looked) > s.idle) break;
  }
}

}  // namespace hapticd
