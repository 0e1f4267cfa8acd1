// Binary legacy VTK as text: the same keywords, and each block of big-endian numbers written out. What the
// text reader does not know is refused there.
#include <algorithm>
#include <array>
#include <bit>
#include <cctype>
#include <cstdio>
#include <cstring>
#include <sstream>

#include "server/files/input_error.h"
#include "server/mesh/mesh_reader_raw.h"

namespace hapticd {
namespace {

class BinaryVtk {
 public:
  BinaryVtk(const std::string& bytes, const std::filesystem::path& file) : bytes_(bytes), file_(file) {}

  std::string as_text() {
    for (int i = 0; i < 2; ++i) text_ += std::string(line()) + '\n';
    line();  // BINARY
    text_ += "ASCII\n";
    while (at_ < bytes_.size()) {
      const std::vector<std::string> words = split(line());
      if (!words.empty()) section(words);
    }
    return std::move(text_);
  }

 private:
  void section(const std::vector<std::string>& w) {
    const std::string& key = w[0];
    section_ = key;
    if (key == "METADATA") {  // ends at an empty line
      while (at_ < bytes_.size() && !split(line()).empty()) {
      }
      return;
    }
    for (const std::string& word : w) text_ += word + ' ';
    text_ += '\n';
    if (key == "POINTS") {
      numbers(product(count(w, 1), 3), word(w, 2));
    } else if (key == "CELLS") {
      cells(w);
    } else if (key == "CELL_TYPES") {
      numbers(count(w, 1), "int");
    } else if (key == "CELL_DATA" || key == "POINT_DATA") {
      rows_ = count(w, 1);
    } else if (key == "SCALARS") {
      text_ += std::string(line()) + '\n';  // LOOKUP_TABLE
      numbers(product(rows_, w.size() > 3 ? count(w, 3) : 1), word(w, 2));
    } else if (key == "VECTORS" || key == "NORMALS") {
      numbers(product(rows_, 3), word(w, 2));
    } else if (key == "LOOKUP_TABLE") {  // a table of colours: four bytes each
      numbers(product(count(w, 2), 4), "unsigned_char");
    } else if (key == "FIELD") {
      for (std::uint64_t i = 0, n = count(w, 2); i < n; ++i) field();
    } else if (key != "DATASET") {
      throw error("this keyword is not known here");
    }
  }

  void cells(const std::vector<std::string>& w) {
    const std::size_t before = at_;
    const std::vector<std::string> next = split(line());
    if (next.empty() || next[0] != "OFFSETS") {
      at_ = before;
      numbers(count(w, 2), "int");
      return;
    }
    text_ += "OFFSETS " + word(next, 1) + '\n';
    numbers(count(w, 1), word(next, 1));
    std::vector<std::string> last = split(line());
    if (last.empty()) last = split(line());  // the block's own line end
    if (last.empty() || last[0] != "CONNECTIVITY") throw error("expected CONNECTIVITY");
    text_ += "CONNECTIVITY " + word(last, 1) + '\n';
    numbers(count(w, 2), word(last, 1));
  }

  void field() {
    std::string_view whole;  // an array's name keeps its letters' case
    std::vector<std::string> w;
    while (w.empty() || w[0] == "METADATA") {
      if (!w.empty()) section(w);
      if (at_ == bytes_.size()) throw error("ends early");
      w = split(whole = line());
    }
    text_ += std::string(whole) + '\n';
    numbers(product(count(w, 1), count(w, 2)), word(w, 3));
  }

  std::string_view line() {
    const std::size_t end = std::min(bytes_.find('\n', at_), bytes_.size());
    const std::string_view found = std::string_view(bytes_).substr(at_, end - at_);
    at_ = std::min(end + 1, bytes_.size());
    return found;
  }
  static std::vector<std::string> split(std::string_view line) {
    std::vector<std::string> words;
    std::istringstream in{std::string(line)};
    for (std::string w; in >> w;) words.push_back(w);
    if (!words.empty())
      for (char& c : words[0]) c = static_cast<char>(std::toupper(static_cast<unsigned char>(c)));
    return words;
  }
  std::string word(const std::vector<std::string>& w, std::size_t i) const {
    if (i >= w.size()) throw error("a word is missing");
    std::string lower = w[i];
    for (char& c : lower) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
    return lower;
  }
  std::uint64_t count(const std::vector<std::string>& w, std::size_t i) const {
    const std::string text = word(w, i);
    if (text.empty() || text.size() > 15 || text.find_first_not_of("0123456789") != std::string::npos)
      throw error("'" + text.substr(0, 40) + "' is not a count");
    return std::stoull(text);
  }
  // What there cannot be is left to `numbers` to refuse.
  static std::uint64_t product(std::uint64_t a, std::uint64_t b) {
    return b != 0 && a > UINT64_MAX / b ? UINT64_MAX : a * b;
  }

  void numbers(std::uint64_t n, const std::string& type) {
    if (type == "float") return block<float>(n, "%.9g\n");
    if (type == "double") return block<double>(n, "%.17g\n");
    if (type == "int" || type == "vtkidtype") return block<std::int32_t>(n, "%.0f\n");
    if (type == "unsigned_int") return block<std::uint32_t>(n, "%.0f\n");
    if (type == "long" || type == "vtktypeint64") return block<std::int64_t>(n, "%.0f\n");
    if (type == "unsigned_long") return block<std::uint64_t>(n, "%.0f\n");
    if (type == "short") return block<std::int16_t>(n, "%.0f\n");
    if (type == "unsigned_short") return block<std::uint16_t>(n, "%.0f\n");
    if (type == "char") return block<std::int8_t>(n, "%.0f\n");
    if (type == "unsigned_char") return block<std::uint8_t>(n, "%.0f\n");
    throw error("the type '" + type.substr(0, 40) + "' is not read");
  }
  // Whole numbers beyond 2⁵³ are no node's.
  template <typename T>
  void block(std::uint64_t n, const char* format) {
    if (n > (bytes_.size() - at_) / sizeof(T)) throw error("ends early");
    char number[64];
    for (std::uint64_t i = 0; i < n; ++i, at_ += sizeof(T)) {
      std::array<char, sizeof(T)> raw;
      std::memcpy(raw.data(), bytes_.data() + at_, sizeof(T));
      std::reverse(raw.begin(), raw.end());
      std::snprintf(number, sizeof number, format, static_cast<double>(std::bit_cast<T>(raw)));
      text_ += number;
    }
  }
  InputError error(const std::string& what) const { return {file_, 0, section_, what}; }

  const std::string& bytes_;
  const std::filesystem::path& file_;
  std::size_t at_ = 0;
  std::string text_, section_ = "header";
  std::uint64_t rows_ = 0;
};

}  // namespace

std::string vtk_as_text(const std::string& bytes, const std::filesystem::path& file) {
  return BinaryVtk(bytes, file).as_text();
}

}  // namespace hapticd
