#include "tools/fleet/station_views.h"

#include <unistd.h>

#include <csignal>
#include <regex>
#include <stdexcept>
#include <utility>

#include "server/dds/network.h"
#include "server/files/input_error.h"
#include "server/files/paths.h"

namespace hapticd {
namespace {

constexpr const char* idle_seconds = "60";

std::vector<std::string> command_for(const std::string& station, const StationViewSettings& s) {
  const Network& network = process_network();
  std::vector<std::string> c = {"/proc/self/exe"};
  const auto add = [&](const std::string& option, const std::string& value) {
    if (value.empty()) return;
    c.push_back(option);
    c.push_back(value);
  };
  add("--interface", network.interface);
  std::string peers;
  for (const std::string& peer : network.peers) peers += (peers.empty() ? "" : ",") + peer;
  add("--peers", peers);
  add("--station", station);
  if (s.open_network) c.push_back("--open-network");
  c.push_back("view");
  add("--domain", std::to_string(s.domain));
  add("--listen", s.address);
  add("--port", "0");
  add("--idle", idle_seconds);
  add("--secure", s.secure);
  if (!s.secure.empty()) add("--role", s.role);
  return c;
}

}  // namespace

StationViews::StationViews(StationViewSettings settings) : settings_(std::move(settings)) {
  std::string name = (std::filesystem::temp_directory_path() / "haptic-fleet-XXXXXX").string();
  if (!mkdtemp(name.data())) throw std::runtime_error(name + ": cannot be made");
  folder_ = name;
}

StationViews::~StationViews() {
  for (auto& [station, view] : views_) view.child->signal(SIGTERM);
  for (auto& [station, view] : views_) view.child->wait(2);
  views_.clear();
  std::error_code ignored;
  std::filesystem::remove_all(folder_, ignored);
}

StationViews::Answer StationViews::open(const std::string& station) {
  const auto found = views_.find(station);
  if (found != views_.end() && found->second.child->running()) return {station, "", found->second.port};
  std::erase_if(views_, [](auto& v) { return !v.second.child->running(); });
  if (views_.size() >= most_views)
    return {station,
            std::to_string(most_views) + " views are open; one that is closed makes room within a minute", 0};
  View view;
  view.output = (folder_ / std::to_string(++started_)).string();
  view.child = std::make_unique<Child>(
      ChildSettings{.command = command_for(station, settings_), .output = view.output});
  views_[station] = std::move(view);
  return {station, "", 0};
}

std::vector<StationViews::Answer> StationViews::poll() {
  static const std::regex where(R"(http://\S*:(\d+)/)");
  std::vector<Answer> news;
  for (auto& [station, view] : views_) {
    const bool runs = view.child->running();
    if (view.told) {
      if (!runs && std::exchange(view.port, 0) != 0) news.push_back({station, "", 0});
      continue;
    }
    std::smatch found;
    const std::string said = std::filesystem::exists(view.output) ? read_bytes(view.output) : "";
    if (std::regex_search(said, found, where)) {
      view.port = static_cast<std::uint16_t>(std::stoul(found[1]));
      news.push_back({station, "", view.port});
    } else if (!runs) {
      news.push_back({station, said.empty() ? "haptic view ended" : said, 0});
    }
    view.told = view.port != 0 || !runs;
  }
  return news;
}

}  // namespace hapticd
