// A daemon as a client sees it, without a scene: a spring to the device's origin, answered at 1 kHz over DDS.
//
//   F = −k p for the newest state, 0 while `enable` is false;  one status, one tetrahedron as scene
#pragma once

#include <unistd.h>

#include <atomic>
#include <chrono>
#include <stdexcept>
#include <thread>

#include "haptic/clock.h"
#include "server/dds/device_bridge.h"

namespace hapticd {

// A DDS domain that no other test process on this machine is likely to use. Its ports lie below the
// ephemeral ones.
inline std::uint32_t test_domain() { return 40 + static_cast<std::uint32_t>(getpid()) % 60; }

class FakeDaemon {
 public:
  FakeDaemon(std::uint32_t domain, double stiffness, std::uint32_t device_id = 0)
      : device_id_(device_id),
        stiffness_(stiffness),
        domain_(domain, read_dds_profile("loopback")),
        participant_(domain_),
        port_(participant_, device_id),
        status_(participant_),
        geometry_(participant_),
        update_(participant_) {
    publish_scene(0b1);
    thread_ = std::thread([this] { run(); });
  }
  ~FakeDaemon() {
    stopping_.store(true);
    thread_.join();
  }

  const Domain& domain() const { return domain_; }  // a process has one of each number

  // Largest step between two states that were taken one after the other [m].
  double largest_step() const { return largest_step_.load(); }
  std::uint64_t states() const { return states_.load(); }
  std::uint32_t buttons_seen() const { return buttons_.load(); }

 private:
  void publish_scene(std::uint8_t alive) {
    float nodes[] = {0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1, 1, 1, 1};
    std::uint32_t tets[] = {0, 1, 2, 3, 1, 2, 3, 4};
    char name[] = "lens nucleus", scene[] = "spring", refused[] = "";
    hapticd_msg_SceneGeometry geometry{};
    geometry.name = name;
    geometry.deformable = true;
    geometry.nodes._buffer = nodes;
    geometry.nodes._length = geometry.nodes._maximum = 15;
    geometry.tets._buffer = tets;
    geometry.tets._length = geometry.tets._maximum = 8;
    geometry_.write(geometry);
    hapticd_msg_SceneUpdate update{};
    std::uint8_t bits[] = {static_cast<std::uint8_t>(alive | 0b10)};
    update.nodes = {15, 15, nodes, false};
    update.alive = {1, 1, bits, false};
    update_.write(update);
    hapticd_msg_ServerStatus status{};
    status.device_id = device_id_;
    status.elements_removed = alive & 1 ? 0 : 1;
    status.scene = scene;
    status.refused = refused;
    status_.write(status);
  }

  void run() {
    auto next = std::chrono::steady_clock::now();
    DeviceSample sample;
    bool cut = false;
    for (std::uint64_t tick = 1; !stopping_.load(); ++tick) {
      std::this_thread::sleep_until(next += std::chrono::milliseconds(1));
      const Vec3 before = sample.pose.p;
      const bool had = states_.load() > 0;
      const std::int64_t now = monotonic_ns();
      if (port_.take(now, sample)) {
        ++states_;
        if (had) largest_step_.store(std::max(largest_step_.load(), (sample.pose.p - before).norm()));
        buttons_.fetch_or(sample.buttons);
      }
      ForceSample force;
      force.sequence = tick;
      force.echo_sequence = sample.sequence;
      force.echo_client_time_ns = sample.client_time_ns;
      force.state_age_ns = now - sample.received_ns;
      force.status = sample.enable ? 0u : unsigned{status_disarmed};
      if (sample.enable) force.force = -stiffness_ * sample.pose.p;
      port_.write(force);
      // The pedal takes the first tetrahedron.
      if (!cut && (sample.buttons & pedal_phaco)) {
        cut = true;
        publish_scene(0b0);
      }
    }
  }

  std::uint32_t device_id_;
  double stiffness_;
  Domain domain_;
  Participant participant_;
  DdsDevicePort port_;
  Writer<hapticd_msg_ServerStatus> status_;
  Writer<hapticd_msg_SceneGeometry> geometry_;
  Writer<hapticd_msg_SceneUpdate> update_;
  std::atomic<double> largest_step_{0};
  std::atomic<std::uint64_t> states_{0};
  std::atomic<std::uint32_t> buttons_{0};
  std::atomic<bool> stopping_{false};
  std::thread thread_;
};

}  // namespace hapticd
