// Views of single stations for those who look at the fleet's page: `haptic view` at that station, a process
// each.
//
// It is started when somebody asks, on a free port, and ends by itself when nobody has looked for a minute,
// so that a station sends its tissue only while it is looked at. Asked again, the running one is named. At
// most `most_views` run at once. Thread safety: one thread. Errors: open returns a fault in words.
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "tools/cli/child.h"

namespace hapticd {

inline constexpr std::size_t most_views = 8;

struct StationViewSettings {
  std::string address = "127.0.0.1";  // to listen on
  std::string secure, role = "viewer";
  std::uint32_t domain = 0;
  bool open_network = false;
};

class StationViews {
 public:
  explicit StationViews(StationViewSettings settings);
  ~StationViews();
  StationViews(const StationViews&) = delete;
  StationViews& operator=(const StationViews&) = delete;

  struct Answer {
    std::string station, fault;  // fault: "": none
    std::uint16_t port = 0;      // 0: not yet
  };
  // Starts it if it is not there. The port comes with poll.
  Answer open(const std::string& station);
  // Those that have just got their port, have failed, or have ended (port 0).
  std::vector<Answer> poll();

 private:
  struct View {
    std::unique_ptr<Child> child;
    std::string output;
    std::uint16_t port = 0;
    bool told = false;
  };
  StationViewSettings settings_;
  std::filesystem::path folder_;
  std::map<std::string, View> views_;
  int started_ = 0;
};

}  // namespace hapticd
