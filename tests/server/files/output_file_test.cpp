// What a run may write over: its own kind of output, and nothing else of a person's.
#include "server/files/output_file.h"

#include <gtest/gtest.h>

#include <fstream>
#include <functional>

#include "server/files/input_error.h"
#include "server/files/paths.h"

namespace hapticd {
namespace {

namespace fs = std::filesystem;

class OutputFile : public testing::Test {
 protected:
  OutputFile() : folder_(fs::path(testing::TempDir()) / ("output" + std::to_string(getpid()))) {
    fs::remove_all(folder_);
    fs::create_directories(folder_);
  }
  ~OutputFile() override { fs::remove_all(folder_); }

  fs::path file(const std::string& name, const std::string& content = "") const {
    if (!content.empty()) std::ofstream(folder_ / name) << content;
    return folder_ / name;
  }
  // What is said against it; empty: it may be written. With --force nothing is.
  static std::string fault(const std::function<void(const OutputRule&)>& ask) {
    EXPECT_NO_THROW(ask(OutputRule(true)));
    try {
      ask(OutputRule(false));
    } catch (const InputError& e) {
      EXPECT_EQ(e.key(), "--x");
      EXPECT_NE(std::string(e.what()).find("--force"), std::string::npos) << e.what();
      return e.file().filename();
    }
    return "";
  }
  static std::string figures(const fs::path& p) {
    return fault([&](const OutputRule& r) { r.require_figures("--x", p); });
  }
  static std::string table(const fs::path& p) {
    return fault([&](const OutputRule& r) { r.require_table("--x", p, "t,number,px"); });
  }

  fs::path folder_;
};

const std::string tools_figures = "{\n  \"command\": \"replay\",\n  \"file\": \"a\"\n}\n";
const std::string daemon_figures = "{\n  \"grants\": [],\n  \"haptic_rate_hz\": 1000.0\n}\n";

// Found before the run, not at its end. /proc refuses root too.
TEST_F(OutputFile, APlaceWhereNothingCanBeWrittenIsRefused) {
  for (const fs::path& p : {fs::path("/proc/none.json"), fs::path("/proc/none/none.json"),
                            file("is_a_file", "x") / "none.json", folder_ / std::string(300, 'x')})
    for (const bool force : {false, true}) {
      const OutputRule rule(force);
      EXPECT_THROW(rule.require_figures("--x", p), InputError) << p;
      EXPECT_THROW(rule.require_table("--x", p, "t,number,px"), InputError) << p;
      EXPECT_THROW(rule.require_new("--x", p), InputError) << p;
    }
}

TEST_F(OutputFile, AFolderThatCannotBeMadeIsRefused) {
  for (const fs::path& p :
       {fs::path("/proc/none"), fs::path("/proc"), file("is_a_file", "x") / "none", file("is_a_file")})
    for (const bool force : {false, true}) {
      const OutputRule rule(force);
      EXPECT_THROW(rule.require_folder("--x", p), InputError) << p;
      EXPECT_THROW(rule.require_figures_folder("--x", p, "a.json", "a"), InputError) << p;
      EXPECT_THROW(rule.require_folder_without("--x", p, ""), InputError) << p;
      EXPECT_THROW(rule.require_snapshots_folder("--x", p), InputError) << p;
    }
  EXPECT_NO_THROW(OutputRule(false).require_folder("--x", folder_ / "none" / "of" / "it"));
  EXPECT_FALSE(fs::exists(folder_ / "none"));
}

TEST_F(OutputFile, ALinkThatLiesWhereTheTemporaryGoesIsNotFollowed) {
  const fs::path out = file("out.json"), precious = file("precious", "kept");
  fs::create_symlink(precious, out.string() + "." + std::to_string(getpid()) + ".part");
  write_file(out.string(), "{}");
  EXPECT_EQ(read_bytes(precious), "kept");
  EXPECT_EQ(read_bytes(out), "{}");
  EXPECT_FALSE(fs::is_symlink(out));
}

TEST_F(OutputFile, WhatIsNotThereMayBeWrittenAndNoPathIsNoOutput) {
  for (const fs::path& p : {fs::path(), file("none.json"), folder_ / "no" / "such" / "folder.csv"}) {
    EXPECT_EQ(figures(p), "");
    EXPECT_EQ(table(p), "");
    EXPECT_EQ(fault([&](const OutputRule& r) { r.require_new("--x", p); }), "");
    EXPECT_EQ(fault([&](const OutputRule& r) { r.require_folder_without("--x", p, ""); }), "");
  }
}

TEST_F(OutputFile, FiguresAndTablesReplaceTheirOwnKindAlone) {
  EXPECT_EQ(figures(file("tools.json", tools_figures)), "");
  EXPECT_EQ(figures(file("daemon.json", daemon_figures)), "");
  EXPECT_EQ(figures(file("package.json", "{\n  \"name\": \"mine\"\n}\n")), "package.json");
  EXPECT_EQ(figures(file("scene.yaml", "scene: cube\n")), "scene.yaml");
  EXPECT_EQ(figures(file("mesh.msh", "$MeshFormat\n2.2 0 8\n")), "mesh.msh");
  EXPECT_EQ(table(file("forces.csv", "t,number,px,py\n0,0,0,0\n")), "");
  EXPECT_EQ(table(file("stroke.csv", "t,px,py,pz\n0,0,0,0\n")), "stroke.csv");
  std::ofstream(folder_ / "empty.csv");
  EXPECT_EQ(table(folder_ / "empty.csv"), "");
}

TEST_F(OutputFile, ScenesMeshesAndRecordingsNeedANewName) {
  const auto is_new = [](const fs::path& p) {
    return fault([&](const OutputRule& r) { r.require_new("--x", p); });
  };
  EXPECT_EQ(is_new(file("lens.msh", "$MeshFormat\n")), "lens.msh");
  std::ofstream(folder_ / "empty.yaml");
  EXPECT_EQ(is_new(folder_ / "empty.yaml"), "empty.yaml");
  fs::create_symlink(folder_ / "nowhere", folder_ / "link.csv");
  EXPECT_EQ(is_new(folder_ / "link.csv"), "link.csv");
  // A device keeps nothing that could be lost.
  EXPECT_EQ(is_new("/dev/full"), "");
  EXPECT_THROW(OutputRule(true).require_new("--x", folder_), InputError);
  EXPECT_THROW(OutputRule(true).require_figures("--x", "/dev/null"), InputError);
}

TEST_F(OutputFile, EachOfSeveralHasAFileOfItsOwn) {
  const auto files = [](const fs::path& file, const std::vector<std::string>& names) {
    std::vector<std::string> out;
    for (const fs::path& f : one_file_each(file, names)) out.push_back(f.string());
    return out;
  };
  using Names = std::vector<std::string>;
  EXPECT_EQ(files("out/run.csv", {"phaco"}), (Names{"out/run.csv"}));
  EXPECT_EQ(files("out/run.csv", {"phaco", "chopper"}), (Names{"out/run.csv", "out/run.chopper.csv"}));
  EXPECT_EQ(files("bag/", {"a", "b"}), (Names{"bag/", "bag.b"}));
  // No name leads out of the folder, and no two are one.
  EXPECT_EQ(files("run", {"a", "../b", "b", "___b"}), (Names{"run", "run.___b", "run.b", "run.___b_3"}));
}

TEST_F(OutputFile, AFolderOfFiguresIsOursOrHasNoFileOfThoseNames) {
  const auto folder = [&] {
    return fault(
        [&](const OutputRule& r) { r.require_figures_folder("--x", folder_, "force.json", "force"); });
  };
  EXPECT_EQ(folder(), "");
  file("forces.csv", "a,b\n");  // of another name
  EXPECT_EQ(folder(), "");
  file("force_time.png", "a picture");
  EXPECT_EQ(folder(), "force_time.png");
  file("force.json", "{\"a\": 1}");
  EXPECT_NE(folder(), "");
  file("force.json", tools_figures);
  EXPECT_EQ(folder(), "");
}

TEST_F(OutputFile, AFolderForASeriesIsEmptyAndSnapshotsReplaceSnapshots) {
  const auto captures = [&] {
    return fault([&](const OutputRule& r) { r.require_folder_without("--x", folder_, ".contact"); });
  };
  const auto series = [&] {
    return fault([&](const OutputRule& r) { r.require_folder_without("--x", folder_, ""); });
  };
  const auto snapshots = [&] {
    return fault([&](const OutputRule& r) { r.require_snapshots_folder("--x", folder_); });
  };
  EXPECT_EQ(series(), "");
  file("notes.txt", "mine");
  EXPECT_EQ(captures(), "");
  EXPECT_EQ(series(), "notes.txt");
  file("000001.contact", "HAPTICLC");
  EXPECT_EQ(captures(), "000001.contact");
  file("lens_before.vtk", "# vtk DataFile Version 3.0\nlens before, metres\nASCII\nDATASET POLYDATA\n");
  EXPECT_EQ(snapshots(), "");
  file("lens_after.vtk", "# vtk DataFile Version 3.0\ntetrahedra\nASCII\nDATASET UNSTRUCTURED_GRID\n");
  EXPECT_EQ(snapshots(), "lens_after.vtk");
}

TEST_F(OutputFile, AFileIsWrittenWholeAndTakesNoOtherFilesName) {
  const fs::path out = file("a.json"), other = file("a.json.part", "mine");
  write_file(out, "one");
  write_file(out, "two");
  EXPECT_EQ(read_bytes(out), "two");
  EXPECT_EQ(read_bytes(other), "mine");
  EXPECT_THROW(write_file("/proc/none/a", "x"), std::runtime_error);
  EXPECT_EQ(std::distance(fs::directory_iterator(folder_), fs::directory_iterator()), 2);
}

}  // namespace
}  // namespace hapticd
