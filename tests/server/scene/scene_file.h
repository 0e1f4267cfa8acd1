// A folder with a mesh and a trajectory, and the faults of scene files in it.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <string>

#include "server/files/input_error.h"
#include "server/scene/scene_reader.h"

namespace hapticd {

// One key per line, so that lines are known.
inline const std::string block_of_tissue = R"(bodies:
  - name: block
    kind: deformable
    mesh: tiny_41_ascii.msh
    removable: true
    fixed: bottom
    material:
      young: 3000
      poisson: 0.45
      density: 1000
)";

class SceneFile : public testing::Test {
 protected:
  // sound: the scene that a test spoils.
  explicit SceneFile(std::string sound = "") : sound_(std::move(sound)) {}

  void SetUp() override {
    folder_ = std::filesystem::path(testing::TempDir()) /
              (std::string("scene_") + testing::UnitTest::GetInstance()->current_test_info()->name());
    std::filesystem::remove_all(folder_);
    std::filesystem::create_directories(folder_);
    std::filesystem::copy(std::filesystem::path(SOURCE_DIR) / "tests/data/tiny_41_ascii.msh", folder_);
    write("move.csv", "t,px,py,pz\n0,0,0,2\n1,0,0,3\n");
  }
  void TearDown() override { std::filesystem::remove_all(folder_); }

  void write(const std::string& name, const std::string& text) { std::ofstream(folder_ / name) << text; }

  Scene read(const std::string& text, const std::string& device = "") {
    write("scene.yaml", text);
    return read_scene(folder_ / "scene.yaml", device);
  }

  static std::string with(std::string text, const std::string& old, const std::string& replacement) {
    const std::size_t at = text.find(old);
    EXPECT_NE(at, std::string::npos) << old;
    return text.replace(at, old.size(), replacement);
  }

  // Replaces a piece of a scene and expects the fault at the line where the replacement's last line is (or at
  // `line`), with this key and these words.
  void expect_fault_in(const std::string& scene, const std::string& old, const std::string& replacement,
                       const std::string& key, const std::string& words, int line = 0) {
    SCOPED_TRACE(replacement);
    const std::string text = with(scene, old, replacement);
    if (line == 0) {
      const std::size_t end = scene.find(old) + replacement.size();
      line = 1 + static_cast<int>(
                     std::count(text.begin(), text.begin() + static_cast<std::ptrdiff_t>(end), '\n'));
    }
    try {
      read(text);
      ADD_FAILURE() << "was accepted";
    } catch (const InputError& e) {
      EXPECT_EQ(e.file(), folder_ / "scene.yaml") << e.what();
      EXPECT_EQ(e.line(), line) << e.what();
      EXPECT_EQ(e.key(), key) << e.what();
      EXPECT_NE(std::string(e.what()).find(words), std::string::npos) << e.what();
      EXPECT_TRUE(std::string(e.what()).starts_with((folder_ / "scene.yaml").string() + ":" +
                                                    std::to_string(line) + ": " + key + ": "))
          << e.what();
    }
  }

  // … of the sound scene.
  void expect_fault(const std::string& old, const std::string& replacement, const std::string& key,
                    const std::string& words, int line = 0) {
    expect_fault_in(sound_, old, replacement, key, words, line);
  }

  const std::string sound_;
  std::filesystem::path folder_;
};

}  // namespace hapticd
