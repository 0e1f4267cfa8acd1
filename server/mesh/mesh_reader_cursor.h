// A cursor over the bytes of a mesh file that reads numbers as text or as binary, and knows where it is.
//
// Every read is bounds-checked and throws InputError at the end of the file or on anything but a number.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>

#include "server/mesh/mesh_reader_raw.h"

namespace hapticd {

class MeshCursor {
 public:
  MeshCursor(const std::string& bytes, std::filesystem::path file) : bytes_(bytes), file_(std::move(file)) {}

  std::string section;                // named in messages

  // How numbers are read from here on. A file with binary parts has no line numbers after the first.
  void set_binary(bool on) {
    binary_ = on;
    has_lines_ = has_lines_ && !on;
  }
  bool binary() const { return binary_; }

  // Text, in binary files too.
  bool at_end();                      // only white space is left
  bool at_bytes_end() const { return at_ == bytes_.size(); }
  std::string_view word();            // next token
  std::string_view peek();            // next token, which stays
  std::string_view rest_of_line();    // up to the line's end, which is consumed
  double number();                    // token as a double, finite or not
  std::int64_t integer();             // token as an integer
  std::uint64_t count();              // token as a size ≥ 0

  // Text or binary.
  std::int64_t read_int();            // binary: int, 4 bytes
  std::uint64_t read_size();          // binary: size_t, 8 bytes
  double read_double();               // binary: double, 8 bytes
  void skip_values(std::uint64_t n);  // text: n tokens; binary: n doubles

  // Moves past `text` at the next line start; false when it is not there.
  bool skip_to_line(std::string_view text);

  // Of the next byte.
  MeshPlace place() const { return {has_lines_ ? line_ : 0, at_}; }
  MeshPlace newest() const { return token_; }  // of the newest read
  InputError error(const std::string& what) const { return mesh_error(file_, token_, section, what); }

 private:
  void skip_space();
  template <typename T>
  T raw();

  const std::string& bytes_;
  std::filesystem::path file_;
  std::size_t at_ = 0;
  int line_ = 1;
  bool binary_ = false;
  bool has_lines_ = true;
  MeshPlace token_{1, 0};
};

}  // namespace hapticd
