// A daemon that runs with --secure, as strangers, viewers, liars and devices meet it over real DDS.
#include <cmath>
#include <filesystem>
#include <fstream>
#include <functional>
#include <memory>
#include <nlohmann/json.hpp>
#include <sstream>
#include <thread>

#include <gtest/gtest.h>

#include "haptic/clock.h"
#include "server/dds/dds.h"
#include "tests/support/process.h"
#include "tests/tools/secure_keys.h"

namespace hapticd {
namespace {

constexpr std::int64_t ms = 1'000'000;
constexpr std::uint32_t liars_device = 77;
const std::string cube = SOURCE_DIR "/config/scenes/cube/cube.yaml";

std::string text_of(const std::string& file) {
  std::stringstream s;
  s << std::ifstream(file).rdbuf();
  return s.str();
}

// Participants of this process that live in Cyclone domains of their own: they meet only on the wire.
class Peer {
 public:
  Peer(std::uint32_t domain, const std::optional<Security>& security)
      : domain_(next_id++, on_the_wire(domain)), participant_(domain_, security) {}
  const Participant& participant() const { return participant_; }

 private:
  static std::string on_the_wire(std::uint32_t domain) {
    std::string xml = read_dds_profile("loopback");
    const std::string at = "<Discovery>";
    return xml.replace(xml.find(at), at.size(),
                       at + "<ExternalDomainId>" + std::to_string(domain) + "</ExternalDomainId>");
  }
  static inline std::uint32_t next_id =
      110;  // the governance knows domains to 230, tests use those below 100
  Domain domain_;
  Participant participant_;
};

Security liar(const std::string& role) {
  Security security = security_files(secure_keys(), role);
  security.access_control = LYING_PLUGIN;
  return security;
}

struct PoseOf {
  hapticd_msg_DeviceState state{};
  PoseOf(std::uint32_t device_id, std::uint64_t number) {
    state.device_id = device_id;
    state.number = number;
    state.position[2] = 0.0215;  // in the cube
    state.orientation[3] = 1;
    state.enable = true;
  }
};

bool foreign(const hapticd_msg_DeviceState& s) {
  return s.device_id == liars_device || s.number >= 1'000'000'000'000;
}

class SecureProcess : public testing::Test {
 protected:
  void SetUp() override {
    if (std::string(DDS_PLUGINS).empty()) GTEST_SKIP() << "no DDS Security plugins here";
    domain_ = static_cast<std::uint32_t>(40 + getpid() % 60);
    summary_ = secure_scratch().file("run.json");
    daemon_ = std::make_unique<ChildProcess>(
        std::vector<std::string>{BIN_DIR "/hapticd", cube, "--domain", std::to_string(domain_), "--secure",
                                 secure_keys(), "--json", summary_},
        secure_scratch().file("daemon.log"));
  }
  // The figures of the daemon's run.
  nlohmann::json end() {
    daemon_->signal(SIGTERM);
    EXPECT_EQ(daemon_->wait(5000), 0) << text_of(secure_scratch().file("daemon.log"));
    return nlohmann::json::parse(text_of(summary_));
  }
  std::string replay(const std::string& options) const {
    return "replay " SOURCE_DIR "/config/scenes/cube/press.csv --domain " + std::to_string(domain_) +
           " --min-answered " + std::to_string(answered_share()) + " " + options;
  }
  // Every millisecond for so long.
  static void each_ms(int count, const std::function<void(int)>& f) {
    for (int i = 0; i < count; ++i) {
      f(i);
      usleep(1000);
    }
  }
  template <typename T>
  static bool heard(Reader<T>& reader, int timeout_ms) {
    bool any = false;
    for (int i = 0; i < timeout_ms && !any; ++i) {
      reader.take_each([&](const T&, const dds_sample_info_t&) { any = true; });
      usleep(1000);
    }
    return any;
  }

  std::uint32_t domain_ = 0;
  std::string summary_;
  std::unique_ptr<ChildProcess> daemon_;
};

TEST_F(SecureProcess, AStrangerGetsNoSampleAndItsWritesReachNobodyWhileTheDeviceWorks) {
  Peer stranger(domain_, std::nullopt), foreigner(domain_, security_files(secure_keys("other"), "device")),
      watcher(domain_, security_files(secure_keys(), "operator"));
  std::vector<std::unique_ptr<Writer<hapticd_msg_DeviceState>>> writers;
  std::vector<std::unique_ptr<Reader<hapticd_msg_ForceCommand>>> forces;
  std::vector<std::unique_ptr<Reader<hapticd_msg_ServerStatus>>> statuses;
  std::vector<std::unique_ptr<Reader<hapticd_msg_DeviceState>>> states;
  const Peer* peers[] = {&stranger, &foreigner};
  for (const Peer* peer : peers) {  // the foreigner has keys, of another authority
    writers.push_back(std::make_unique<Writer<hapticd_msg_DeviceState>>(peer->participant()));
    forces.push_back(std::make_unique<Reader<hapticd_msg_ForceCommand>>(peer->participant()));
    if (peer == &stranger)
      states.push_back(std::make_unique<Reader<hapticd_msg_DeviceState>>(peer->participant()));
    statuses.push_back(std::make_unique<Reader<hapticd_msg_ServerStatus>>(peer->participant()));
  }
  Reader<hapticd_msg_DeviceState> poses(watcher.participant());
  Reader<hapticd_msg_ForceCommand> answers(watcher.participant());
  ASSERT_TRUE(heard(answers, 15'000));

  CommandResult device;
  std::thread run([&] { device = run_haptic(replay("--secure " + secure_keys())); });
  int stolen = 0, foreign_poses = 0, own_poses = 0;
  each_ms(8000, [&](int i) {
    for (auto& w : writers) w->write(PoseOf(liars_device, 1 + static_cast<std::uint64_t>(i)).state);
    for (auto& w : writers) w->write(PoseOf(0, 1'000'000'000'000 + static_cast<std::uint64_t>(i)).state);
    const auto steal = [&](const auto&, const dds_sample_info_t&) { ++stolen; };
    for (auto& r : forces) r->take_each(steal);
    for (auto& r : statuses) r->take_each(steal);
    for (auto& r : states)  // it hears itself
      r->take_each(
          [&](const hapticd_msg_DeviceState& m, const dds_sample_info_t&) { stolen += !foreign(m); });
    poses.take_each([&](const hapticd_msg_DeviceState& s, const dds_sample_info_t&) {
      (foreign(s) ? foreign_poses : own_poses) += 1;
    });
  });
  run.join();
  EXPECT_EQ(stolen, 0);
  EXPECT_EQ(foreign_poses, 0);
  EXPECT_GT(own_poses, 1000);           // who may, reads
  EXPECT_EQ(writers[0]->matched(), 1);  // itself
  EXPECT_EQ(writers[1]->matched(), 0);
  for (auto& r : forces) EXPECT_EQ(r->matched(), 0);
  EXPECT_EQ(device.code, 0) << device.output;
  const nlohmann::json figures = end();
  EXPECT_EQ(figures["conflicts"], 0);
  EXPECT_EQ(figures["states_rejected"], 0);
  EXPECT_GT(figures["slots_answered"], 5500 * answered_share());
}

TEST_F(SecureProcess, AViewerSeesForcesButCannotWritePoses) {
  Peer viewer(domain_, security_files(secure_keys(), "viewer"));
  Reader<hapticd_msg_ForceCommand> forces(viewer.participant());
  EXPECT_TRUE(heard(forces, 15'000));
  try {
    Writer<hapticd_msg_DeviceState> writer(viewer.participant());
    FAIL() << "a viewer made a writer of poses";
  } catch (const std::runtime_error& e) {
    EXPECT_NE(std::string(e.what()).find("Not Allowed By Security"), std::string::npos) << e.what();
  }
  const CommandResult command = run_haptic(replay("--role viewer --wait 3 --secure " + secure_keys()));
  EXPECT_EQ(command.code, 1);
  EXPECT_NE(command.output.find("Not Allowed By Security"), std::string::npos) << command.output;
  const nlohmann::json figures = end();
  EXPECT_EQ(figures["slots_answered"], 0);
}

// The refusal is the others', not the member's own good will.
TEST_F(SecureProcess, AMemberThatLiesToItselfStillCannotWriteWhatItsPermissionsDoNotSay) {
  Peer viewer(domain_, liar("viewer")), device(domain_, liar("device")),
      honest(domain_, security_files(secure_keys(), "device")),
      watcher(domain_, security_files(secure_keys(), "operator"));
  Writer<hapticd_msg_DeviceState> poses(viewer.participant());
  Reader<hapticd_msg_ForceCommand> forces(viewer.participant());
  Writer<hapticd_msg_ForceCommand> forged(device.participant());  // a device that plays the daemon
  Reader<hapticd_msg_ForceCommand> felt(honest.participant());
  Reader<hapticd_msg_DeviceState> seen(watcher.participant());
  ASSERT_TRUE(heard(forces, 15'000));  // it is a member: what it may read, it gets
  ASSERT_TRUE(heard(felt, 5000));
  int false_forces = 0, true_forces = 0;
  each_ms(3000, [&](int i) {
    poses.write(PoseOf(0, 1 + static_cast<std::uint64_t>(i)).state);
    hapticd_msg_ForceCommand force{};
    force.force[0] = 1e6;
    forged.write(force);
    felt.take_each([&](const hapticd_msg_ForceCommand& f, const dds_sample_info_t&) {
      ++(f.force[0] == 1e6 ? false_forces : true_forces);
    });
  });
  EXPECT_FALSE(heard(seen, 1));
  EXPECT_EQ(false_forces, 0);
  EXPECT_GT(true_forces, 1000);
  const nlohmann::json figures = end();
  EXPECT_EQ(figures["slots_answered"], 0);
  EXPECT_EQ(figures["force_peak_n"], 0.0);
}

TEST(SecureFiles, AMissingOrWrongFileIsNamed) {
  if (std::string(DDS_PLUGINS).empty()) GTEST_SKIP() << "no DDS Security plugins here";
  const std::string folder = secure_keys();
  const auto refused = [&](const std::string& command, int code, const std::string& words) {
    const CommandResult result = run_command(command);
    EXPECT_EQ(result.code, code) << result.output;
    EXPECT_NE(result.output.find(words), std::string::npos) << words << " is not in: " << result.output;
  };
  const std::string daemon = BIN_DIR "/hapticd " + cube + " --duration 1 --domain " +
                             std::to_string(40 + getpid() % 60) + " --secure ";
  refused(daemon + "/no/such/folder", 2, "/no/such/folder: no such folder of keys");
  for (const char* file :
       {"ca.pem", "governance.p7s", "daemon/cert.pem", "daemon/key.pem", "daemon/permissions.p7s"}) {
    const std::string broken = secure_scratch().file("broken");
    std::filesystem::remove_all(broken);
    std::filesystem::copy(folder, broken, std::filesystem::copy_options::recursive);
    std::filesystem::remove(broken + "/" + file);
    refused(daemon + broken, 2, broken + "/" + file + ": no such file");
    std::ofstream(broken + "/" + file) << "nonsense";
    refused(daemon + broken, 2, broken + "/" + file + ": is not ");
    std::filesystem::remove(broken + "/" + file);
    std::filesystem::create_directory(broken + "/" + file);
    refused(daemon + broken, 2, broken + "/" + file + ": is a directory");
  }
  refused(BIN_DIR "/haptic replay " SOURCE_DIR "/config/scenes/cube/press.csv --role viewer --secure " +
              secure_scratch().file("nowhere"),
          2, "no such folder of keys");
  // Signed by another authority: only Cyclone can tell, and does.
  const std::string mixed = secure_scratch().file("mixed");
  std::filesystem::copy(folder, mixed, std::filesystem::copy_options::recursive);
  std::filesystem::copy_file(secure_keys("other") + "/governance.p7s", mixed + "/governance.p7s",
                             std::filesystem::copy_options::overwrite_existing);
  refused(daemon + mixed, 1, mixed + "/daemon");
}

}  // namespace
}  // namespace hapticd
