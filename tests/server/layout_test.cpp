// The rules of the house that a program can check: who may include whom, and what stands at the top.
#include <algorithm>
#include <filesystem>
#include <fstream>
#include <map>
#include <regex>
#include <set>
#include <string>
#include <vector>

#include <gtest/gtest.h>

namespace hapticd {
namespace {

namespace fs = std::filesystem;

struct Include {
  fs::path file;
  std::string target;
};

std::vector<Include> includes_of(const std::string& folder) {
  static const std::regex line(R"re(^\s*#\s*include\s*[<"]([^>"]+)[>"])re");
  std::vector<Include> out;
  for (const auto& entry : fs::recursive_directory_iterator(fs::path(SOURCE_DIR) / folder)) {
    if (entry.path().extension() != ".h" && entry.path().extension() != ".cpp") continue;
    std::ifstream in(entry.path());
    std::smatch match;
    for (std::string text; std::getline(in, text);)
      if (std::regex_search(text, match, line)) out.push_back({entry.path(), match[1]});
  }
  return out;
}

bool starts_with_any(const std::string& text, const std::vector<std::string>& prefixes) {
  return std::any_of(prefixes.begin(), prefixes.end(), [&](const auto& p) { return text.starts_with(p); });
}

TEST(Layout, PhysicsSeesNoThreadClockFileLogOrDds) {
  for (const Include& i : includes_of("physics")) {
    EXPECT_FALSE(starts_with_any(
        i.target, {"haptic/", "server/", "tools/", "idl/", "dds/", "yaml-cpp", "thread", "chrono", "fstream",
                   "iostream", "filesystem", "mutex", "cstdio", "pthread"}))
        << i.file << " includes " << i.target;
  }
}

// The mesh half of a cut knows the tissue alone: contact and law are above it.
TEST(Layout, CuttingSeesOnlyTheTissue) {
  for (const Include& i : includes_of("physics/cutting"))
    if (i.target.starts_with("physics/")) {
      EXPECT_TRUE(starts_with_any(i.target, {"physics/types.h", "physics/cutting/", "physics/tissue/"}))
          << i.file << " includes " << i.target;
    }
}

TEST(Layout, HapticSeesOnlyTheContactProblemOfPhysics) {
  for (const Include& i : includes_of("haptic")) {
    EXPECT_FALSE(starts_with_any(
        i.target, {"server/", "tools/", "idl/", "dds/", "yaml-cpp", "iostream", "fstream", "mutex"}))
        << i.file << " includes " << i.target;
    if (i.target.starts_with("physics/")) {
      EXPECT_TRUE(i.target == "physics/types.h" || i.target.starts_with("physics/contact/"))
          << i.file << " includes " << i.target;
    }
    if (starts_with_any(i.target, {"thread", "pthread", "haptic/clock.h"}) && i.file.stem() != "clock") {
      EXPECT_TRUE(i.file.stem() == "loop") << i.file << ": only the loop has the thread and the clock";
    }
    if (starts_with_any(i.target, {"time.h", "ctime", "chrono"})) {
      EXPECT_TRUE(i.file.stem() == "clock") << i.file << ": only clock.cpp asks the system for the time";
    }
  }
}

// One way: what each room of server and tools may include, of its own floor, besides itself.
const std::map<std::string, std::vector<std::string>> rooms = {
    {"server/os", {}},
    {"server/files", {}},
    {"server/mesh", {"files"}},
    {"server/record", {"files"}},
    {"server/dds", {"files", "os"}},
    {"server/scene", {"files", "mesh", "record"}},
    {"server/observe", {"dds", "os", "record", "scene"}},
    {"server/schedule", {"edge", "files", "observe", "os", "scene"}},
    {"server/plan", {"files", "record", "scene", "schedule"}},
    {"server/edge", {"dds", "observe", "os", "scene"}},
    {"server/app", {"dds", "edge", "files", "observe", "os", "plan", "record", "scene", "schedule"}},
    {"tools/cli", {}},
    {"tools/client_library", {}},
    {"tools/driver", {"client_library"}},
    {"tools/device", {"cli", "driver", "client_library"}},
    {"tools/chart", {"cli"}},
    {"tools/doctor", {"cli", "client", "record"}},
    {"tools/control", {"cli"}},
    {"tools/edge", {"cli", "offline"}},
    {"tools/mesh", {"cli"}},
    {"tools/offline", {"cli"}},
    {"tools/python", {}},
    {"tools/record", {"cli"}},
    {"tools/chart/pieces", {"cli", "chart", "chart/solver", "chart/tissue"}},
    {"tools/chart/cut", {"cli", "chart", "chart/removal", "chart/step", "chart/tissue"}},
    {"tools/chart/economy", {"cli", "chart", "offline"}},
    {"tools/chart/force", {"cli", "chart", "offline"}},
    {"tools/chart/removal", {"cli", "chart"}},
    {"tools/chart/solver", {"cli", "chart"}},
    {"tools/chart/step", {"cli", "chart", "offline"}},
    {"tools/chart/tissue", {"cli", "chart", "offline"}},
    {"tools/client", {"cli", "client_library", "record"}},
    {"tools/robustness", {"cli", "client", "soak"}},
    {"tools/soak", {"cli", "chart", "client"}},
    {"tools/stability",
     {"cli", "chart", "chart/removal", "chart/solver", "chart/tissue", "client", "offline", "soak",
      "stability/bench"}},
    {"tools/stability/bench", {"client", "offline"}},
    {"tools/view", {"cli", "client"}},
    {"tools/fleet", {"cli", "client", "view"}},
};

TEST(Layout, RoomsOfServerAndToolsIncludeOneWay) {
  for (const std::string floor : {"server", "tools"})
    for (const Include& i : includes_of(floor)) {
      if (!i.target.starts_with(floor + "/")) continue;
      const std::string from = fs::relative(i.file, SOURCE_DIR).parent_path();
      const std::string to = fs::path(i.target).parent_path();
      if (from == to) continue;
      const auto room = rooms.find(from);
      ASSERT_NE(room, rooms.end()) << from << " is no room of the plan";
      const std::vector<std::string>& may = room->second;
      EXPECT_TRUE(std::find(may.begin(), may.end(), to.substr(floor.size() + 1)) != may.end())
          << i.file << " includes " << i.target;
    }
}

TEST(Layout, NoFolderHasMoreThanThirtySourceFiles) {
  for (const std::string floor : {"physics", "haptic", "server", "tools", "tests"}) {
    std::map<std::string, int> files;
    for (const auto& entry : fs::recursive_directory_iterator(fs::path(SOURCE_DIR) / floor))
      if (entry.path().extension() == ".h" || entry.path().extension() == ".cpp")
        ++files[entry.path().parent_path()];
    for (const auto& [folder, count] : files) EXPECT_LE(count, 30) << folder;
  }
}

// OpenBLAS's threads are one setting for the process (blas_threads.h), so each program that simulates makes
// it.
TEST(Layout, EveryProgramThatSimulatesUsesOneBlasThread) {
  int programs = 0;
  for (const std::string floor : {"server", "tools", "tests/support", "tests/package"})
    for (const auto& entry : fs::recursive_directory_iterator(fs::path(SOURCE_DIR) / floor)) {
      if (entry.path().extension() != ".cpp") continue;
      std::ifstream in(entry.path());
      const std::string text{std::istreambuf_iterator<char>(in), {}};
      if (text.find("\nint main(") == std::string::npos) continue;
      if (entry.path().string().find("driver") != std::string::npos || entry.path().stem() == "device")
        continue;  // a driver links no simulation
      ++programs;
      EXPECT_NE(text.find("use_one_blas_thread();"), std::string::npos) << entry.path();
    }
  EXPECT_EQ(programs, 4);  // hapticd, haptic, the tests, the example of the libraries
}

TEST(Layout, ServerDoesNotSeeTools) {
  for (const Include& i : includes_of("server"))
    EXPECT_FALSE(i.target.starts_with("tools/")) << i.file << " includes " << i.target;
}

// What runs in the haptic thread never logs: haptic/ cannot (above), and the device port does not know how.
TEST(Layout, TheDevicePortDoesNotLog) {
  for (const Include& i : includes_of("server"))
    if (i.file.stem() == "device_bridge" || i.file.stem() == "force_reader" || i.file.stem() == "dds") {
      EXPECT_NE(i.target, "server/observe/log.h") << i.file;
    }
}

// A driver is linked by people whose programs are not under the GPL: no simulation in it.
TEST(Layout, ClientsSeeOnlyTheWireAndTheirDevicesLimits) {
  const std::set<std::string> allowed = {"haptic/channel.h",           "haptic/limits.h",
                                         "server/dds/force_reader.h",  "server/dds/network.h",
                                         "server/files/input_error.h", "server/files/paths.h",
                                         "server/os/realtime.h",       "server/scene/device_reader.h"};
  for (const std::string folder : {"tools/client_library", "tools/driver", "tools/python"})
    for (const Include& i : includes_of(folder)) {
      if (starts_with_any(i.target, {"physics/", "haptic/", "server/"})) {
        EXPECT_TRUE(allowed.contains(i.target)) << i.file << " includes " << i.target;
      }
      if (i.target.starts_with("tools/")) {
        EXPECT_TRUE(starts_with_any(i.target, {"tools/driver/", "tools/client_library/"}))
            << i.file << " includes " << i.target;
      }
    }
}

// Makers' libraries are loaded into a program that links nothing under the GPL; `haptic` only becomes it.
TEST(Layout, DeviceDriversSeeNoSimulation) {
  for (const Include& i : includes_of("tools/device")) {
    EXPECT_FALSE(i.target.starts_with("physics/")) << i.file << " includes " << i.target;
    if (i.target.starts_with("haptic/")) {
      EXPECT_EQ(i.target, "haptic/channel.h") << i.file;
    }
    if (i.target.starts_with("server/")) {
      EXPECT_TRUE(i.target == "server/os/realtime.h" || i.target == "server/scene/device_reader.h" ||
                  i.target.starts_with("server/files/"))
          << i.file << " includes " << i.target;
    }
    if (i.target.starts_with("tools/cli/")) {
      EXPECT_EQ(i.file.stem(), "device_command") << i.target;
    }
  }
}

TEST(Layout, TopLevelHoldsOnlyWhatTheDesignNames) {
  const std::set<std::string> allowed = {
      "CMakeLists.txt", "CMakePresets.json", "LICENSE", "CHANGELOG.md", "README.md", "MEASURED.md", "server",
      "haptic",         "physics",           "idl",     "config",       "tools",     "tests",       "build"};
  for (const auto& entry : fs::directory_iterator(SOURCE_DIR)) {
    const std::string name = entry.path().filename();
    EXPECT_TRUE(name.starts_with(".") || allowed.contains(name)) << name;
  }
}

}  // namespace
}  // namespace hapticd
