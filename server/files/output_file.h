// Where a run may write, and how it writes a file whole.
//
//   figures (JSON), tables (CSV)   replace an earlier run's: its contents show that they are ours
//   a folder of figures, snapshots the same; what has other names in it is left alone
//   mesh, scene, recording         a new name, always
//   --force                        replaces any file; a rosbag2 recording never (bag_writer.h)
//   one output an instrument       the first has the name given, run.csv; the one called NAME has
//   run.NAME.csv
//
// To be asked before the run's work begins, of every path that a person names and of every name derived from
// one. An empty path is no output. Errors: InputError naming the file and the option.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace hapticd {

class OutputRule {
 public:
  explicit OutputRule(bool force) : force_(force) {}

  // There must be no file. A device, as /dev/full, is written to.
  void require_new(const std::string& option, const std::filesystem::path& file) const;
  // No file, an empty one, or JSON that a command of ours has written.
  void require_figures(const std::string& option, const std::filesystem::path& file) const;
  // No file, an empty one, or one that begins as this table's header does.
  void require_table(const std::string& option, const std::filesystem::path& file,
                     const std::string& header) const;
  // A folder in which files can be made, or none and one can be made. So it is of the next three, too.
  void require_folder(const std::string& option, const std::filesystem::path& folder) const;
  // No folder, or one where a file named STEM.*, STEM_* or as `figures` lies only beside `figures` of ours.
  void require_figures_folder(const std::string& option, const std::filesystem::path& folder,
                              const std::string& figures, const std::string& stem) const;
  // No folder, or one without a file that ends so; any file counts where `ending` is empty.
  void require_folder_without(const std::string& option, const std::filesystem::path& folder,
                              const std::string& ending) const;
  // Snapshots of surfaces (BODY_before.vtk, BODY_after.vtk) may replace those of an earlier run.
  void require_snapshots_folder(const std::string& option, const std::filesystem::path& folder) const;

 private:
  bool force_;
};

// A name as a part of a file's: what is neither letter, digit nor '-' is '_'.
std::string as_file_name(std::string name);

// Of instruments, or devices, called so: one file each, no two the same. A name that another has already as a
// file's gets its place behind it.
std::vector<std::filesystem::path> one_file_each(const std::filesystem::path& file,
                                                 const std::vector<std::string>& names);

// Writes the file whole or not at all (a temporary beside it, then rename).
// Throws std::runtime_error naming the file.
void write_file(const std::string& path, const std::string& content);

}  // namespace hapticd
