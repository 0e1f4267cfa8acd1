// Gmsh MSH 2.2 and 4.1. The two differ in how nodes and elements are grouped; in 4.1 ASCII and binary hold
// the same values in the same order, in 2.2 the counts stay text.
#include <algorithm>
#include <map>

#include "server/mesh/mesh_reader_cursor.h"
#include "server/mesh/mesh_reader_raw.h"

namespace hapticd {
namespace {

struct ElementType {
  int nodes, dimension;
  const char* name;
};

constexpr int tetrahedron = 4;
constexpr std::uint64_t max_groups_of_entity = 64;  // bounds memory: elements times groups

// Linear types, and the second-order ones for a helpful message.
const std::map<std::int64_t, ElementType> element_types = {
    {1, {2, 1, "line"}},         {2, {3, 2, "triangle"}},   {3, {4, 2, "quadrangle"}},
    {4, {4, 3, "tetrahedron"}},  {5, {8, 3, "hexahedron"}}, {6, {6, 3, "prism"}},
    {7, {5, 3, "pyramid"}},      {8, {3, 1, "second-order line"}},
    {9, {6, 2, "second-order triangle"}}, {11, {10, 3, "second-order tetrahedron"}},
    {15, {1, 0, "point"}}};

using PhysicalTag = std::pair<std::int64_t, std::int64_t>;  // dimension, number

class GmshReader {
 public:
  GmshReader(const std::string& bytes, const std::filesystem::path& file) : in_(bytes, file), file_(file) {
    raw_.file = file;
    raw_.tet_section = "$Elements";
  }

  RawMesh read() {
    read_format();
    while (!in_.at_end()) {
      in_.set_binary(false);
      in_.section = "";
      const std::string name(in_.word());
      if (!name.starts_with('$')) throw in_.error("expected a section ($Nodes, $Elements, …)");
      in_.section = name;
      if (name == "$PhysicalNames") read_physical_names();
      else if (name == "$Entities") read_entities();
      else if (name == "$Nodes") version_ == 4 ? read_nodes_4() : read_nodes_2();
      else if (name == "$Elements") version_ == 4 ? read_elements_4() : read_elements_2();
      else if (name == "$PartitionedEntities")
        throw in_.error("partitioned meshes are not read (save the mesh in one piece)");
      if (!in_.skip_to_line("$End" + name.substr(1))) throw in_.error("there is no $End" + name.substr(1));
      sections_.push_back(name);
    }
    for (const char* needed : {"$Nodes", "$Elements"})
      if (std::find(sections_.begin(), sections_.end(), needed) == sections_.end())
        throw InputError(file_, 0, needed, "this section is missing");
    return std::move(raw_);
  }

 private:
  void read_format() {
    in_.section = "$MeshFormat";
    if (in_.word() != "$MeshFormat") throw in_.error("expected $MeshFormat first");
    const double version = in_.number();
    if (version != 2.2 && version != 4.1)
      throw in_.error("this version of the format is not read (save as msh22 or msh41)");
    version_ = version > 4 ? 4 : 2;
    const std::int64_t type = in_.integer(), size = in_.integer();
    if (type != 0 && type != 1) throw in_.error("the file type must be 0 (ASCII) or 1 (binary)");
    if (size != 8) throw in_.error("the data size must be 8");
    binary_ = type == 1;
    if (binary_) {
      in_.rest_of_line();
      in_.set_binary(true);
      if (in_.read_int() != 1) throw in_.error("written on a machine of the other byte order");
      in_.set_binary(false);
    }
    if (!in_.skip_to_line("$EndMeshFormat")) throw in_.error("there is no $EndMeshFormat");
  }

  // In binary files the numbers of a section begin right after the newline of its name or count.
  void begin_numbers() {
    if (!binary_) return;
    in_.rest_of_line();
    in_.set_binary(true);
  }

  void read_physical_names() {
    for (std::uint64_t i = 0, n = in_.count(); i < n; ++i) {
      const std::int64_t dimension = in_.integer(), number = in_.integer();
      std::string_view line = in_.rest_of_line();
      const std::size_t open = line.find('"'), close = line.rfind('"');
      if (open == std::string_view::npos || close <= open) throw in_.error("expected a name in quotes");
      name_[{dimension, number}] = line.substr(open + 1, close - open - 1);
    }
  }

  void read_entities() {
    if (version_ != 4) return;
    begin_numbers();
    std::array<std::uint64_t, 4> count;
    for (std::uint64_t& n : count) n = in_.read_size();
    for (int dimension = 0; dimension < 4; ++dimension)
      for (std::uint64_t i = 0; i < count[dimension]; ++i) {
        const std::int64_t tag = in_.read_int();
        in_.skip_values(dimension == 0 ? 3 : 6);
        std::vector<std::int64_t>& physical = physical_of_entity_[{dimension, tag}];
        physical.clear();
        const std::uint64_t groups = in_.read_size();
        if (groups > max_groups_of_entity) throw in_.error("an entity is in too many physical groups");
        for (std::uint64_t k = 0; k < groups; ++k) physical.push_back(std::abs(in_.read_int()));
        if (dimension > 0)
          for (std::uint64_t k = 0, n = in_.read_size(); k < n; ++k) in_.read_int();
      }
  }

  void add_node(std::uint64_t number) {
    Vec3 x;
    for (double& value : x) value = in_.read_double();
    raw_.nodes.push_back({number, x, in_.newest()});
  }

  void read_nodes_2() {
    const std::uint64_t n = in_.count();
    begin_numbers();
    for (std::uint64_t i = 0; i < n; ++i) {
      const std::int64_t number = in_.read_int();
      if (number < 0) throw in_.error("a node's number is negative");
      add_node(static_cast<std::uint64_t>(number));
    }
  }

  void read_nodes_4() {
    begin_numbers();
    const std::uint64_t blocks = in_.read_size();
    for (int i = 0; i < 3; ++i) in_.read_size();  // number of nodes, least and greatest number
    std::vector<std::uint64_t> numbers;
    for (std::uint64_t b = 0; b < blocks; ++b) {
      const std::int64_t dimension = in_.read_int();
      in_.read_int();
      const std::int64_t parametric = in_.read_int();
      const std::uint64_t n = in_.read_size();
      numbers.clear();
      for (std::uint64_t i = 0; i < n; ++i) numbers.push_back(in_.read_size());
      for (std::uint64_t number : numbers) {
        add_node(number);
        if (parametric)
          in_.skip_values(static_cast<std::uint64_t>(std::clamp<std::int64_t>(dimension, 0, 3)));
      }
    }
  }

  const ElementType& type_of(std::int64_t type) {
    const auto found = element_types.find(type);
    if (found == element_types.end())
      throw in_.error("element type " + std::to_string(type) + " is not read (only linear tetrahedra)");
    if (found->second.dimension == 3 && type != tetrahedron)
      throw in_.error(std::string("a ") + found->second.name + ": only linear tetrahedra are read");
    return found->second;
  }

  std::string group_name(const PhysicalTag& tag) const {
    const auto found = name_.find(tag);
    return found == name_.end() ? std::to_string(tag.second) : found->second;
  }

  // One element: its nodes are next in the file. `place` is where it starts.
  void add_element(std::int64_t type, const ElementType& kind, const std::vector<std::int64_t>& physical,
                   const MeshPlace& place, bool wide) {
    std::array<std::uint64_t, 10> node{};
    for (int a = 0; a < kind.nodes; ++a) node[a] = wide ? in_.read_size() : narrow_node();
    if (type == tetrahedron) raw_.tets.push_back({{node[0], node[1], node[2], node[3]}, place});
    for (std::int64_t number : physical) {
      if (number == 0) continue;
      RawGroup& group = raw_.group(group_name({kind.dimension, number}));
      group.nodes.insert(group.nodes.end(), node.begin(), node.begin() + kind.nodes);
      if (type == tetrahedron) group.tets.push_back(raw_.tets.size() - 1);
    }
  }

  std::uint64_t narrow_node() {
    const std::int64_t number = in_.read_int();
    if (number < 0) throw in_.error("a node's number is negative");
    return static_cast<std::uint64_t>(number);
  }

  void read_elements_2() {
    const std::uint64_t total = in_.count();
    begin_numbers();
    for (std::uint64_t done = 0; done < total;) {
      std::int64_t type = 0, in_block = 1, tags = 0;
      MeshPlace place;
      const auto check_tags = [&] {
        if (tags < 0 || tags > 1000) throw in_.error("the number of tags is out of range");
      };
      if (binary_) {
        type = in_.read_int();
        in_block = in_.read_int();
        tags = in_.read_int();
        check_tags();
        if (in_block <= 0) throw in_.error("an element block is empty");
      }
      for (std::int64_t i = 0; i < in_block; ++i, ++done) {
        in_.read_int();  // the element's number
        place = in_.newest();
        if (!binary_) {
          type = in_.read_int();
          tags = in_.read_int();
          check_tags();
        }
        const ElementType& kind = type_of(type);
        std::vector<std::int64_t> physical;
        for (std::int64_t k = 0; k < tags; ++k) {
          const std::int64_t tag = in_.read_int();
          if (k == 0) physical.push_back(std::abs(tag));
        }
        add_element(type, kind, physical, place, false);
      }
    }
  }

  void read_elements_4() {
    begin_numbers();
    const std::uint64_t blocks = in_.read_size();
    for (int i = 0; i < 3; ++i) in_.read_size();  // number of elements, least and greatest number
    for (std::uint64_t b = 0; b < blocks; ++b) {
      const std::int64_t dimension = in_.read_int(), entity = in_.read_int(), type = in_.read_int();
      const std::uint64_t n = in_.read_size();
      const ElementType& kind = type_of(type);
      const std::vector<std::int64_t>& physical = physical_of_entity_[{dimension, entity}];
      for (std::uint64_t i = 0; i < n; ++i) {
        in_.read_size();  // the element's number
        const MeshPlace place = in_.newest();
        add_element(type, kind, physical, place, true);
      }
    }
  }

  MeshCursor in_;
  std::filesystem::path file_;
  RawMesh raw_;
  int version_ = 0;
  bool binary_ = false;
  std::vector<std::string> sections_;
  std::map<PhysicalTag, std::string> name_;
  std::map<PhysicalTag, std::vector<std::int64_t>> physical_of_entity_;  // dimension, entity → numbers
};

}  // namespace

RawMesh read_gmsh(const std::string& bytes, const std::filesystem::path& file) {
  return GmshReader(bytes, file).read();
}

}  // namespace hapticd
