#include "server/scene/scene_reader.h"

#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <set>

#include "server/files/input_error.h"
#include "tests/fuzz/targets.h"

namespace hapticd {
namespace {

// A folder with what a scene may name: tissue.msh, tissue.vtk, motion.csv.
class Folder {
 public:
  Folder() {
    const std::filesystem::path fast = "/dev/shm", data = SOURCE_DIR "/tests/data";
    path_ = (std::filesystem::is_directory(fast) ? fast : std::filesystem::temp_directory_path()) /
            ("hapticd-fuzz-" + std::to_string(getpid()));
    std::filesystem::create_directories(path_);
    std::filesystem::copy_file(data / "tiny_22_ascii.msh", path_ / "tissue.msh",
                               std::filesystem::copy_options::overwrite_existing);
    std::filesystem::copy_file(data / "tiny.vtk", path_ / "tissue.vtk",
                               std::filesystem::copy_options::overwrite_existing);
    std::ofstream(path_ / "motion.csv") << "t,px,py,pz\n0,0,0,0\n1,0,0,1\n";
  }
  ~Folder() {
    std::error_code ignored;
    std::filesystem::remove_all(path_, ignored);
  }
  std::filesystem::path scene(FuzzInput input) const {
    const std::filesystem::path file = path_ / "fuzz.yaml";
    std::ofstream(file, std::ios::binary) << text_of(input);
    return file;
  }

 private:
  std::filesystem::path path_;
};

}  // namespace

void fuzz_scene(FuzzInput input) {
  static const Folder folder;
  try {
    const Scene scene = read_scene(folder.scene(input));
    demand(scene.rate > 0 && scene.alarm_distance > 0 && scene.sample_spacing > 0, "a scene has its scales");
    demand(!scene.bodies.empty(), "a scene has a body");
    demand(!scene.instruments.empty() && scene.instruments.size() <= 4,
           "a scene has one to four instruments");
    std::set<std::uint32_t> ids;
    for (const SceneInstrument& held : scene.instruments) {
      const int parts = static_cast<int>(held.shape.primitives.size());
      demand(held.shape.tip >= 0 && held.shape.tip < parts, "a tip is a part of its instrument");
      demand(held.coupling.stiffness > 0, "an instrument is held");
      ids.insert(held.device.id);
    }
    for (const DeviceSettings& device : scene.more_devices) ids.insert(device.id);
    demand(ids.size() == scene.instruments.size() + scene.more_devices.size(), "each device has its own id");
    demand(scene.instruments.size() == 1 || scene.more_devices.empty(),
           "several instruments share one tissue");
    for (const SceneBody& b : scene.bodies)
      for (const int n : b.fixed_nodes)
        demand(n >= 0 && n < static_cast<int>(b.mesh.nodes.size()), "what is fixed is a node");
    for (const ContactPair& p : scene.contacts)
      demand(static_cast<std::size_t>(p.points) < scene.bodies.size() &&
                 static_cast<std::size_t>(p.faces) < scene.bodies.size(),
             "who touches is a body");
  } catch (const InputError&) {
  }
}

}  // namespace hapticd
