// Watches what the daemon tells about itself and its bodies while a client runs.
//
// Status is kept with its time of arrival, so that it can be asked for any instant of the run (10 Hz is its
// resolution). Of each body the first and the newest state are kept, and those that are asked for;
// `write_surfaces` leaves DIR/BODY_before.vtk, DIR/BODY_after.vtk and DIR/BODY_at_030.vtk of the moment 30 s
// (surface_file.h); of a rigid body all the same. Thread safety: one thread. Errors: write_surfaces throws
// std::runtime_error naming the file, or when no body was heard of.
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "physics/tissue/mesh.h"
#include "server/dds/dds.h"

namespace hapticd {

struct StatusRecord {
  std::int64_t arrived_ns = 0;
  std::uint32_t elements_removed = 0;
  std::uint32_t fragments_aspirated = 0;
  double haptic_rate_hz = 0;
  double sim_rate_hz = 0;
  std::uint32_t samples = 0, samples_dropped = 0;  // of the newest problem
  std::string scene;
};

class Monitor {
 public:
  Monitor(const Participant& participant, std::uint32_t device_id);

  // Takes what has come.
  void poll();
  // … at this time of the run; of the bodies at each of these times something is kept then [s, rising].
  void keep_at(std::vector<double> times) { keep_at_ = std::move(times); }
  void poll_at(double time);

  const std::vector<StatusRecord>& all() const noexcept { return statuses_; }
  bool heard() const noexcept { return !statuses_.empty(); }
  StatusRecord newest() const { return heard() ? statuses_.back() : StatusRecord{}; }
  // The newest status that had arrived by then; an empty one before the first.
  StatusRecord at(std::int64_t time_ns) const;

  // Returns the files written.
  std::vector<std::filesystem::path> write_surfaces(const std::filesystem::path& directory) const;

 private:
  struct Geometry {
    TetMesh mesh;
    std::vector<std::uint32_t> opened;  // faces that cuts made
  };
  struct State {
    std::vector<Vec3> nodes;
    std::vector<std::uint8_t> alive;
  };
  // A cut brings new geometry; `first` is of the first. Empty: none heard of.
  struct Body {
    std::string name;
    Geometry first_geometry, geometry;
    State first, newest;
    std::map<std::string, std::pair<Geometry, State>> kept;  // by the name of the moment
  };

  std::uint32_t device_id_;
  Reader<hapticd_msg_ServerStatus> status_;
  Reader<hapticd_msg_SceneGeometry> geometry_;
  Reader<hapticd_msg_SceneUpdate> update_;
  std::vector<StatusRecord> statuses_;
  std::map<std::uint32_t, Body> bodies_;
  std::vector<double> keep_at_;
  std::size_t next_kept_ = 0;
};

}  // namespace hapticd
