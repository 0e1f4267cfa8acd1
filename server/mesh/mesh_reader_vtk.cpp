// Legacy VTK, ASCII or binary, unstructured grid. Both layouts of CELLS are read: version ≤ 4 (each cell its
// count and nodes) and version 5 (OFFSETS and CONNECTIVITY).
#include <algorithm>
#include <cctype>
#include <cmath>

#include "server/mesh/mesh_reader_cursor.h"
#include "server/mesh/mesh_reader_raw.h"

namespace hapticd {
namespace {

constexpr std::int64_t vtk_tetrahedron = 10;

std::string upper(std::string_view text) {
  std::string result(text);
  for (char& c : result) c = static_cast<char>(std::toupper(static_cast<unsigned char>(c)));
  return result;
}

bool is_integer_type(const std::string& type) {
  static const char* const types[] = {"INT",   "UNSIGNED_INT",   "LONG",     "UNSIGNED_LONG",
                                      "SHORT", "UNSIGNED_SHORT", "CHAR",     "UNSIGNED_CHAR",
                                      "BIT",   "VTKTYPEINT64",   "VTKIDTYPE"};
  return std::find(std::begin(types), std::end(types), upper(type)) != std::end(types);
}

struct Cell {
  std::vector<std::uint64_t> nodes;
  MeshPlace place;
};

class VtkReader {
 public:
  // has_lines: the bytes are the file's own.
  VtkReader(const std::string& bytes, const std::filesystem::path& file, bool has_lines)
      : in_(bytes, file), file_(file) {
    in_.set_binary(!has_lines);
    in_.set_binary(false);
    raw_.file = file;
    raw_.tet_section = "CELLS";
  }

  RawMesh read() {
    in_.section = "header";
    in_.rest_of_line();
    in_.rest_of_line();
    if (upper(in_.word()) != "ASCII") throw in_.error("expected ASCII or BINARY");
    while (!in_.at_end()) {
      in_.section = "";
      const std::string key = upper(in_.word());
      in_.section = key;
      if (key == "DATASET") {
        if (upper(in_.word()) != "UNSTRUCTURED_GRID") throw in_.error("only UNSTRUCTURED_GRID is read");
      } else if (key == "POINTS") {
        read_points();
      } else if (key == "CELLS") {
        read_cells();
      } else if (key == "CELL_TYPES") {
        read_types();
      } else if (key == "CELL_DATA" || key == "POINT_DATA") {
        on_cells_ = key == "CELL_DATA";
        rows_ = in_.count();
        if (rows_ != (on_cells_ ? cells_.size() : raw_.nodes.size()))
          throw in_.error("as many values are needed as there are " +
                          std::string(on_cells_ ? "cells" : "points"));
        in_data_ = true;
      } else if (in_data_) {
        read_attribute(key);
      } else if (key == "METADATA") {
        skip_metadata();
      } else {
        throw in_.error("this keyword is not known here");
      }
    }
    for (const auto& [found, name] :
         {std::pair{!raw_.nodes.empty(), "POINTS"}, std::pair{!cells_.empty(), "CELLS"},
          std::pair{!tet_of_cell_.empty(), "CELL_TYPES"}})
      if (!found) throw InputError(file_, 0, name, "this section is missing");
    return std::move(raw_);
  }

 private:
  void read_points() {
    const std::uint64_t n = in_.count();
    in_.word();  // data type
    for (std::uint64_t i = 0; i < n; ++i) {
      Vec3 x;
      for (double& value : x) value = in_.number();
      raw_.nodes.push_back({i, x, in_.newest()});
    }
  }

  void read_cells() {
    const std::uint64_t n = in_.count();
    in_.count();
    if (upper(in_.peek()) == "OFFSETS") return read_offsets(n);
    for (std::uint64_t c = 0; c < n; ++c) {
      const std::uint64_t corners = in_.count();
      Cell cell{{}, in_.newest()};
      for (std::uint64_t a = 0; a < corners; ++a) cell.nodes.push_back(in_.count());
      cells_.push_back(std::move(cell));
    }
  }

  // Version 5: n counts the offsets, one more than the cells.
  void read_offsets(std::uint64_t n) {
    in_.word(), in_.word();
    std::vector<std::uint64_t> offset;
    for (std::uint64_t i = 0; i < n; ++i) offset.push_back(in_.count());
    if (upper(in_.word()) != "CONNECTIVITY") throw in_.error("expected CONNECTIVITY");
    in_.word();
    for (std::size_t c = 0; c + 1 < offset.size(); ++c) {
      if (offset[c + 1] < offset[c]) throw in_.error("the offsets go back");
      Cell cell{{}, in_.place()};
      for (std::uint64_t a = offset[c]; a < offset[c + 1]; ++a) {
        cell.nodes.push_back(in_.count());
        if (a == offset[c]) cell.place = in_.newest();
      }
      cells_.push_back(std::move(cell));
    }
  }

  void read_types() {
    const std::uint64_t n = in_.count();
    if (n != cells_.size()) throw in_.error("as many types are needed as there are cells");
    for (const Cell& cell : cells_) {
      const std::int64_t type = in_.integer();
      tet_of_cell_.push_back(-1);
      if (type == vtk_tetrahedron) {
        if (cell.nodes.size() != 4)
          throw mesh_error(file_, cell.place, "CELLS", "a tetrahedron needs 4 nodes");
        tet_of_cell_.back() = static_cast<std::int64_t>(raw_.tets.size());
        raw_.tets.push_back({{cell.nodes[0], cell.nodes[1], cell.nodes[2], cell.nodes[3]}, cell.place});
      } else if (type > vtk_tetrahedron || type < 1) {
        throw in_.error("cell type " + std::to_string(type) + ": only linear tetrahedra are read");
      }
    }
  }

  void read_attribute(const std::string& key) {
    if (key == "SCALARS") {
      const std::string name(in_.word()), type(in_.word());
      std::uint64_t components = 1;
      if (upper(in_.peek()) != "LOOKUP_TABLE") components = in_.count();
      if (upper(in_.peek()) == "LOOKUP_TABLE") in_.word(), in_.word();
      read_array(name, type, components, rows_);
    } else if (key == "FIELD") {
      in_.word();
      for (std::uint64_t i = 0, n = in_.count(); i < n; ++i) {
        const std::string name(in_.word());
        const std::uint64_t components = in_.count(), rows = in_.count();
        const std::string type(in_.word());
        read_array(name, type, components, rows);
        if (!in_.at_end() && upper(in_.peek()) == "METADATA") in_.word(), skip_metadata();
      }
    } else if (key == "VECTORS" || key == "NORMALS") {
      in_.word(), in_.word();
      skip(3, rows_);
    } else if (key == "LOOKUP_TABLE") {
      in_.word();
      skip(4, in_.count());
    } else if (key == "METADATA") {
      skip_metadata();
    } else {
      throw in_.error("this kind of data is not read (SCALARS, VECTORS, NORMALS or FIELD)");
    }
  }

  void read_array(const std::string& name, const std::string& type, std::uint64_t components,
                  std::uint64_t rows) {
    if (components != 1 || rows != rows_ || !is_integer_type(type)) return skip(components, rows);
    for (std::uint64_t i = 0; i < rows; ++i) {
      const std::int64_t value = in_.integer();
      if (value <= 0) continue;
      RawGroup& group = raw_.group(name + "_" + std::to_string(value));
      if (!on_cells_) {
        group.nodes.push_back(i);
        continue;
      }
      group.nodes.insert(group.nodes.end(), cells_[i].nodes.begin(), cells_[i].nodes.end());
      if (i < tet_of_cell_.size() && tet_of_cell_[i] >= 0)
        group.tets.push_back(static_cast<std::size_t>(tet_of_cell_[i]));
    }
  }

  void skip(std::uint64_t components, std::uint64_t rows) {
    if (components == 0) return;
    for (std::uint64_t i = 0; i < rows; ++i) in_.skip_values(components);
  }

  // Ends at an empty line.
  void skip_metadata() {
    in_.rest_of_line();
    while (!in_.at_bytes_end() && !in_.rest_of_line().empty()) {
    }
  }

  MeshCursor in_;
  std::filesystem::path file_;
  RawMesh raw_;
  std::vector<Cell> cells_;
  std::vector<std::int64_t> tet_of_cell_;
  bool in_data_ = false, on_cells_ = false;
  std::uint64_t rows_ = 0;
};

}  // namespace

RawMesh read_vtk(const std::string& bytes, const std::filesystem::path& file) {
  std::size_t third = bytes.find('\n');
  if (third != std::string::npos) third = bytes.find('\n', third + 1);
  if (third != std::string::npos && upper(bytes.substr(third + 1, 6)) == "BINARY")
    return VtkReader(vtk_as_text(bytes, file), file, false).read();
  return VtkReader(bytes, file, true).read();
}

}  // namespace hapticd
