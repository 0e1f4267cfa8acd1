#include "tools/mesh/foreign_mesh.h"

#include <algorithm>
#include <fstream>

#include "server/files/paths.h"
#include "server/mesh/foreign_format.h"
#include "tools/cli/child.h"

namespace hapticd {
namespace {

namespace fs = std::filesystem;

constexpr double longest_s = 300;
constexpr std::size_t most_lines = 3;  // of what a program said

struct Program {
  const char* name;
  const char* package;
};
constexpr Program gmsh{"gmsh", "gmsh"}, tetgen{"tetgen", "tetgen"}, meshio{"meshio", "meshio-tools"};

// The lines that say what is wrong, or else the last ones.
std::string complaint_in(const fs::path& log) {
  std::ifstream in(log);
  std::vector<std::string> errors, all;
  for (std::string line; std::getline(in, line);) {
    if (line.find_first_not_of(" \r\t") == std::string::npos) continue;
    // A program's own summary of what it said above.
    if (line.find("---") != std::string::npos || line.find("full log") != std::string::npos ||
        line.find("1 error") != std::string::npos || line.find(" errors") != std::string::npos)
      continue;
    all.push_back(line);
    if (line.find("rror") != std::string::npos) errors.push_back(line);
  }
  const std::vector<std::string>& from = errors.empty() ? all : errors;
  std::string text;
  for (std::size_t i = from.size() > most_lines ? from.size() - most_lines : 0; i < from.size(); ++i)
    text += (text.empty() ? "" : "; ") + from[i];
  return text;
}

// Without the folder that is gone when this is read.
std::string without_folder(std::string text, const fs::path& folder) {
  const std::string name = folder.string() + "/";
  for (std::size_t at = 0; (at = text.find(name, at)) != std::string::npos;) text.erase(at, name.size());
  return text;
}

class Converter {
 public:
  Converter(fs::path file, ForeignFormat format, const ForeignOptions& options)
      : file_(std::move(file)), format_(format), options_(options) {}

  RawMesh read() {
    switch (format_) {
      case ForeignFormat::gmsh_1:
      case ForeignFormat::gmsh_other:
        return by_gmsh_alone();
      case ForeignFormat::vtu:
      case ForeignFormat::xdmf:
      case ForeignFormat::xml:
      case ForeignFormat::medit:
      case ForeignFormat::abaqus:
        return result_of(by_meshio(file_, "mesh.vtk"));
      case ForeignFormat::stl:
        return filled(file_);
      case ForeignFormat::obj:
      case ForeignFormat::ply:
      case ForeignFormat::off:
      case ForeignFormat::vtk_surface:
        return filled(by_meshio(file_, "surface.stl"));
      default:
        throw fault(foreign_advice(format_));
    }
  }

  std::vector<std::string> commands;

 private:
  InputError fault(const std::string& what) const { return {file_, 0, "", what}; }

  void require(const Program& program) const {
    if (!is_installed(program.name))
      throw fault(name_of(format_) + ": " + program.name +
                  " is needed to convert it, and is not installed: apt install " + program.package);
  }

  // What it said is empty where it made `output`.
  std::string run(const std::vector<std::string>& command, const fs::path& output) {
    std::string line;
    for (const std::string& word : command) line += (line.empty() ? "" : " ") + word;
    line = without_folder(line, options_.folder);
    const fs::path log = options_.folder / "log";
    Child child({.command = command, .output = log.string()});
    const std::optional<int> code = child.wait(longest_s);
    if (code == 0 && fs::is_regular_file(output) && fs::file_size(output) > 0) {
      commands.push_back(line);
      return "";
    }
    const std::string said = without_folder(complaint_in(log), options_.folder);
    return line +
           (code ? " ended with " + std::to_string(*code) : std::string(" took more than five minutes")) +
           (said.empty() ? "" : ": " + said);
  }

  fs::path by_meshio(const fs::path& from, const char* to) {
    require(meshio);
    const fs::path output = options_.folder / to;
    if (const std::string wrong = run({meshio.name, "convert", from.string(), output.string()}, output);
        !wrong.empty())
      throw fault(name_of(format_) + ": " + wrong);
    return output;
  }

  RawMesh by_gmsh_alone() {
    require(gmsh);
    const fs::path output = options_.folder / "mesh.msh";
    const std::string wrong =
        run({gmsh.name, file_.string(), "-save", "-format", "msh22", "-o", output.string()}, output);
    if (!wrong.empty()) throw fault(name_of(format_) + ": " + wrong);
    return result_of(output);
  }

  // The tissue inside a closed surface.
  RawMesh filled(const fs::path& surface) {
    std::string wrong;
    if (is_installed(gmsh.name)) {
      const fs::path script = options_.folder / "fill.geo", output = options_.folder / "filled.msh";
      std::ofstream(script) << fill_script(surface);
      wrong = run({gmsh.name, "-3", script.string(), "-format", "msh22", "-o", output.string()}, output);
      if (wrong.empty() && has_tetrahedra(output)) return result_of(output);
      if (wrong.empty()) wrong = "gmsh made no tetrahedra";
    } else if (!is_installed(tetgen.name)) {
      throw fault(name_of(format_) +
                  ": gmsh or tetgen is needed to fill it with tetrahedra, and neither is installed: "
                  "apt install gmsh");
    }
    if (!is_installed(tetgen.name))
      throw fault(name_of(format_) + " that gmsh does not fill: it is not closed, or crosses itself (" +
                  wrong + "); tetgen, which keeps the surface's own triangles, may: apt install tetgen");
    // It writes beside what it reads.
    const fs::path copy = options_.folder / "tetgen.stl", output = options_.folder / "tetgen.1.vtk";
    fs::copy_file(surface, copy, fs::copy_options::overwrite_existing);
    const std::string also = run({tetgen.name, "-pqkNEF", copy.string()}, output);
    if (also.empty() && has_tetrahedra(output)) return result_of(output);
    throw fault(name_of(format_) + " that nothing fills: it is not closed, or crosses itself (" +
                (wrong.empty() ? "" : wrong + "; ") + (also.empty() ? "tetgen made no tetrahedra" : also) +
                ")");
  }

  // Faces that meet at less than 40 degrees are one, and are meshed anew.
  std::string fill_script(const fs::path& surface) const {
    const std::string edge =
        options_.edge > 0 ? std::to_string(options_.edge) : "General.BoundingBoxSize / 20";
    return "Merge \"" + fs::absolute(surface).string() +
           "\";\n"
           "h = " +
           edge +
           ";\n"
           "Mesh.MeshSizeMin = h / 2;\nMesh.MeshSizeMax = h;\nMesh.MeshSizeExtendFromBoundary = 1;\n"
           "Mesh.Optimize = 1;\nMesh.Binary = 0;\n"
           "ClassifySurfaces{40 * Pi / 180, 1, 1, Pi};\n"
           "CreateGeometry;\n"
           "Surface Loop(1) = Surface{:};\n"
           "Volume(1) = {1};\n"
           "Physical Surface(\"surface\") = Surface{:};\n"
           "Physical Volume(\"tissue\") = {1};\n";
  }

  static bool has_tetrahedra(const fs::path& file) {
    try {
      return !read_raw_mesh(read_bytes(file), file).tets.empty();
    } catch (const InputError&) {
      return false;
    }
  }

  RawMesh result_of(const fs::path& made) {
    try {
      RawMesh mesh = read_raw_mesh(read_bytes(made), made);
      if (mesh.tets.empty())
        throw fault(name_of(format_) +
                    " without tetrahedra: it is a surface, or made of other cells (save its "
                    "surface as STL: that can be filled)");
      mesh.file = file_;
      return mesh;
    } catch (const InputError& e) {
      if (e.file() == file_) throw;
      throw fault(name_of(format_) + ": what " + commands.back() +
                  " made is not read: " + without_folder(e.what(), options_.folder));
    }
  }

  const fs::path file_;
  const ForeignFormat format_;
  const ForeignOptions options_;
};

}  // namespace

ForeignMesh read_any_mesh(const fs::path& file, const ForeignOptions& options) {
  const std::string bytes = read_bytes(file);
  const ForeignFormat format = foreign_format(bytes, file);
  if (format == ForeignFormat::none) return {read_raw_mesh(bytes, file), {}};
  Converter converter(file, format, options);
  RawMesh mesh = converter.read();
  return {std::move(mesh), std::move(converter.commands)};
}

}  // namespace hapticd
