// The scene of a running daemon as a series for ParaView (vtk_series.h), as it is published: 25 Hz.
//
// Bodies, instruments and contacts are of one simulation step; the force on an instrument is what its
// contacts sum up to, in the scene. Thread safety: one thread. Errors: std::runtime_error naming the file.
#pragma once

#include <map>

#include "server/dds/dds.h"
#include "tools/record/vtk_series.h"

namespace hapticd {

class SceneFrames {
 public:
  SceneFrames(const Participant& participant, const std::filesystem::path& directory);

  // Writes a frame if there is a new step.
  void poll();
  void finish() const { series_.finish(); }
  int count() const { return series_.frames(); }

 private:
  struct Body {
    std::string name;
    TetMesh mesh;
    std::vector<Vec3> nodes;
    std::vector<std::uint8_t> alive;
  };

  Reader<hapticd_msg_SceneGeometry> geometry_;
  Reader<hapticd_msg_SceneUpdate> update_;
  Reader<hapticd_msg_SceneInstrument> instrument_;
  std::map<std::uint32_t, std::vector<Vec3>> surfaces_;
  std::map<std::uint32_t, Body> bodies_;
  std::uint64_t step_ = 0, written_ = 0;
  VtkContact contact_;
  std::int64_t first_ns_ = 0;
  VtkSeries series_;
};

}  // namespace hapticd
