#include "tools/stability/stability_dds.h"

#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <iterator>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <string>

#include "haptic/device.h"
#include "server/files/paths.h"
#include "server/scene/scene_reader.h"
#include "tools/cli/child.h"
#include "tools/cli/report.h"
#include "tools/soak/soak_daemon.h"
#include "tools/stability/bench/stability_bench.h"

namespace hapticd {

namespace {

constexpr std::uint32_t domain = 77;

std::string replaced(std::string text, const std::string& what, const std::string& by) {
  const std::size_t at = text.find(what);
  if (at == std::string::npos) throw std::runtime_error("the cube scene has no '" + what + "'");
  return text.replace(at, what.size(), by);
}

// The cube scene with another force_scale and a device without limits.
std::string scene_file(const std::filesystem::path& folder, double force_scale) {
  const std::filesystem::path cube = config_directory() / "scenes/cube";
  std::string device = read_bytes(config_directory() / "devices/touch.yaml");
  device = replaced(device, "max_force: 3.3", "max_force: 200");
  device = replaced(device, "max_force_rate: 200", "max_force_rate: 1.0e5");
  device = replaced(device, "quantum: 55.0e-6", "quantum: 20.0e-6");  // the hand's
  write_file((folder / "device.yaml").string(), device);
  std::string scene = read_bytes(cube / "cube.yaml");
  scene = replaced(scene, "mesh: cube.msh", "mesh: " + (cube / "cube.msh").string());
  scene = replaced(scene, "device: touch", "device: " + (folder / "device.yaml").string());
  scene = replaced(scene, "force_scale: 1}", "force_scale: " + fixed(force_scale, 6) + "}");
  scene = replaced(scene, "trajectory: press.csv", "");
  const std::string file = (folder / "cube.yaml").string();
  write_file(file, scene);
  return file;
}

void press(const std::filesystem::path& folder, const ClosedLoopSettings& s, DdsPress& p) {
  SoakDaemon daemon(scene_file(folder, p.force_scale), "tick", domain, folder);
  daemon.go_on();
  const std::string figures = (folder / "hand.json").string();
  const HandSettings& h = s.hand;
  Child hand({.command = {beside_this_program("haptic"),
                          "hand",
                          "--domain",
                          std::to_string(domain),
                          "--at",
                          "0,0," + fixed(s.press.start.z(), 4),
                          "--press",
                          fixed(s.press.depth, 4) + "," + fixed(s.press.speed, 4) + ",1.0",
                          "--mass",
                          fixed(h.mass, 4),
                          "--stiffness",
                          fixed(h.stiffness, 2),
                          "--damping",
                          fixed(h.damping, 3),
                          "--device-damping",
                          fixed(h.device_damping, 3),
                          "--quantum",
                          fixed(1e6 * h.quantum, 1),
                          "--json",
                          figures},
              .output = (folder / "hand.log").string()});
  hand.wait(60);
  std::ifstream in(figures);
  if (!in) return;
  const nlohmann::json j = nlohmann::json::parse(in);
  p.ran = j.contains("swing_at_rest_m");
  p.swing = j.value("swing_at_rest_m", 0.0);
  p.made = -j.value("energy_absorbed_min_j", 0.0);
  if (j.contains("rtt_us")) {
    p.round_trip_p99_us = j["rtt_us"].value("p99", 0.0);
    p.round_trip_max_us = j["rtt_us"].value("max", 0.0);
  }
  p.unanswered = 1 - j.value("answered_share", 0.0);
  p.status = j.value("status_seen", 0u) & ~std::uint32_t{status_disarmed | status_ramping_up};
}

}  // namespace

std::vector<DdsPress> press_over_dds(bool quick, const std::function<bool(double)>& progress) {
  const Scene cube = read_scene(config_directory() / "scenes/cube/cube.yaml");
  StabilityBench bench(cube);
  std::string folder = (std::filesystem::temp_directory_path() / "haptic-stability-XXXXXX").string();
  if (!mkdtemp(folder.data())) throw std::runtime_error("mkdtemp failed");
  std::vector<DdsPress> presses;
  const std::vector<double> scales = geometric(1, quick ? 64 : 4096, quick ? 8 : 2);
  for (std::size_t k = 0; k < scales.size(); ++k) {
    if (!progress(static_cast<double>(k) / static_cast<double>(scales.size()))) break;
    DdsPress p;
    p.force_scale = scales[k];
    const ClosedLoopResult offline = bench.daemon(p.force_scale, bench.press());
    p.displayed = bench.displayed(p.force_scale, offline);
    p.offline_swing = offline.swing;
    p.offline_made = -offline.energy_min;
    press(folder, bench.press(), p);
    presses.push_back(p);
  }
  std::filesystem::remove_all(folder);
  return presses;
}

}  // namespace hapticd
