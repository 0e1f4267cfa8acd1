// Serves a page until interrupted: what there is to say goes to the viewers, what they say comes back.
//
// `poll(watched)` runs each `turn`, `hear(viewer, text)` before it, both in the calling thread. A line on
// stdout says where the page is, and one on stderr that whoever reaches another address than loopback looks
// too. Units: s. Errors: as PageServer.
#pragma once

#include <chrono>
#include <functional>
#include <string>
#include <vector>

#include "tools/view/page_server.h"

namespace hapticd {

using PagePoll = std::function<std::vector<SharedMessage>(bool watched)>;
using PageHear = std::function<void(std::uint64_t viewer, const std::string& text)>;

struct PageServiceSettings {
  PageServerSettings server;
  std::string command;  // "haptic view"
  std::string exposed;  // what whoever reaches the address does: "sees the scene"
  double duration = 0;  // 0: until interrupted
  double idle = 0;      // stop after nobody has looked for that long; 0: never
  std::chrono::milliseconds turn{10};
};

void serve_page(const PageServiceSettings& settings, PageFiles files, const PagePoll& poll,
                const PageHear& hear);

// A text for all viewers; it takes the place of the one before with this key.
SharedMessage page_text(std::string key, std::string json);

}  // namespace hapticd
