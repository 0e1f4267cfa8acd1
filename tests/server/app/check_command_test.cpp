// `hapticd SCENE --check` as a person meets it: exit code 2, file, line and key named, nothing started.
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

namespace hapticd {
namespace {

namespace fs = std::filesystem;

struct Answer {
  int code;
  std::string text;
};

Answer hapticd_with(const fs::path& scene, const std::string& options) {
  FILE* pipe = popen((BIN_DIR "/hapticd " + scene.string() + options + " </dev/null 2>&1").c_str(), "r");
  Answer answer{-1, ""};
  char part[4096];
  for (std::size_t n; (n = fread(part, 1, sizeof part, pipe)) > 0;) answer.text.append(part, n);
  const int status = pclose(pipe);
  answer.code = WIFEXITED(status) ? WEXITSTATUS(status) : -1;
  return answer;
}

Answer check(const fs::path& scene, const std::string& more = "") {
  return hapticd_with(scene, " --check" + more);
}

std::string text_of(const fs::path& file) {
  std::stringstream s;
  s << std::ifstream(file).rdbuf();
  return s.str();
}

// The shipped cube scene in a folder of its own, with one text replaced in one of its files.
class CheckCommand : public testing::Test {
 protected:
  CheckCommand() : folder_(fs::temp_directory_path() / ("check" + std::to_string(getpid()))) {
    fs::remove_all(folder_);
    fs::copy(fs::path(SOURCE_DIR) / "config/scenes/cube", folder_);
  }
  ~CheckCommand() override { fs::remove_all(folder_); }

  // Line (1-based) at which `from` stood.
  int replace(const std::string& file, const std::string& from, const std::string& to) {
    std::string text = text_of(folder_ / file);
    const std::size_t at = text.find(from);
    EXPECT_NE(at, std::string::npos) << from;
    const auto line = 1 + std::count(text.begin(), text.begin() + static_cast<std::ptrdiff_t>(at), '\n');
    text.replace(at, from.size(), to);
    std::ofstream(folder_ / file) << text;
    return static_cast<int>(line);
  }
  fs::path scene() const { return folder_ / "cube.yaml"; }
  void expect_refused(const std::string& file, int line, const std::string& key) {
    const Answer answer = check(scene());
    EXPECT_EQ(answer.code, 2);
    EXPECT_NE(answer.text.find(file + ":" + std::to_string(line) + ": "), std::string::npos) << answer.text;
    EXPECT_NE(answer.text.find(key), std::string::npos) << answer.text;
    EXPECT_EQ(answer.text.find("ready"), std::string::npos);
  }

  fs::path folder_;
};

TEST_F(CheckCommand, AcceptsTheShippedScenes) {
  for (const char* name : {"cube/cube.yaml", "cataract/cataract.yaml", "fragment/fragment.yaml"}) {
    const Answer answer = check(fs::path(SOURCE_DIR) / "config/scenes" / name);
    EXPECT_EQ(answer.code, 0) << answer.text;
    EXPECT_NE(answer.text.find("tetrahedra"), std::string::npos);
  }
}

// Each line with its reason, and the same in JSON.
TEST_F(CheckCommand, PrintsThePlan) {
  const Answer answer = check(fs::path(SOURCE_DIR) / "config/scenes/economy/static_pad.yaml",
                              " --json " + (folder_ / "plan.json").string());
  EXPECT_EQ(answer.code, 0) << answer.text;
  EXPECT_NE(answer.text.find("pad: elements"), std::string::npos) << answer.text;
  const nlohmann::json json = nlohmann::json::parse(text_of(folder_ / "plan.json"));
  ASSERT_FALSE(json["plan"].empty());
  EXPECT_EQ(json["plan"].back()["term"], "total");
  for (const auto& line : json["plan"])
    for (const char* key : {"term", "choice", "reason", "cost_ms", "error_estimate"})
      EXPECT_TRUE(line.contains(key)) << key;
}

TEST_F(CheckCommand, SeveralInstrumentsAreCheckedAndServed) {
  std::string text = text_of(scene());
  text = text.substr(0, text.find("instrument:")) + "instruments:\n";
  for (const char* id : {"0", "1"})
    text += std::string("  - {name: hand") + id + ", id: " + id + ", device: touch, tip: t, " +
            "primitives: [{name: t, shape: sphere, radius: 3.0e-3}], " +
            "coupling: {stiffness: 400, rotational_stiffness: 0.04, damping_time: 2.0e-3}, " +
            "mapping: {position_scale: 1, force_scale: 1}}\n";
  std::ofstream(scene()) << text;
  const Answer checked = check(scene()), served = hapticd_with(scene(), " --duration 0.1 --domain 91");
  EXPECT_EQ(checked.code, 0) << checked.text;
  EXPECT_NE(checked.text.find("hand1: 1 primitives"), std::string::npos) << checked.text;
  EXPECT_EQ(served.code, 0) << served.text;
}

TEST_F(CheckCommand, UnknownKey) {
  expect_refused("cube.yaml", replace("cube.yaml", "alarm_distance", "alarm_distanse"), "alarm_distanse");
}
TEST_F(CheckCommand, MissingMesh) {
  expect_refused("cube.yaml", replace("cube.yaml", "mesh: cube.msh", "mesh: none.msh"), "mesh");
}
TEST_F(CheckCommand, NegativeModulus) {
  expect_refused("cube.yaml", replace("cube.yaml", "young: 5.0e3", "young: -5.0e3"), "young");
}
TEST_F(CheckCommand, IncompressiblePoisson) {
  expect_refused("cube.yaml", replace("cube.yaml", "poisson: 0.45", "poisson: 0.5"), "poisson");
}
TEST_F(CheckCommand, NothingHoldsTheBody) {
  replace("cube.yaml", "    fixed: bottom\n", "");
  const Answer answer = check(scene());
  EXPECT_EQ(answer.code, 2);
  EXPECT_NE(answer.text.find("cube.yaml:"), std::string::npos) << answer.text;
  EXPECT_NE(answer.text.find("fixed"), std::string::npos) << answer.text;
}
TEST_F(CheckCommand, UnreadableTrajectory) {
  expect_refused("press.csv", replace("press.csv", "0.008,", "0.0o8,"), "t");
  replace("cube.yaml", "trajectory: press.csv", "trajectory: none.csv");
  const Answer answer = check(scene());
  EXPECT_EQ(answer.code, 2);
  EXPECT_NE(answer.text.find("trajectory"), std::string::npos) << answer.text;
}

// Two corners of a tetrahedron exchanged, and a tetrahedron that names one corner twice.
TEST_F(CheckCommand, InvertedAndDegenerateTetrahedra) {
  const std::string good =
      "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$PhysicalNames\n1\n3 1 "
      "\"bottom\"\n$EndPhysicalNames\n$Nodes\n4\n"
      "1 0 0 0\n2 1e-2 0 0\n3 0 1e-2 0\n4 0 0 1e-2\n$EndNodes\n$Elements\n1\n1 4 2 1 1 1 2 3 "
      "4\n$EndElements\n";
  std::ofstream(folder_ / "cube.msh") << good;
  replace("cube.msh", "1 4 2 1 1 1 2 3 4", "1 4 2 1 1 2 1 3 4");
  expect_refused("cube.msh", 17, "inver");
  std::ofstream(folder_ / "cube.msh") << good;
  replace("cube.msh", "4 0 0 1e-2", "4 1e-2 1e-2 1e-18");
  expect_refused("cube.msh", 17, "degenerate");
}

}  // namespace
}  // namespace hapticd
