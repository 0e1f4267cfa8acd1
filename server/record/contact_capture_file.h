// Captured contact problems as files: a field failure that can be solved again.
//
// Layout, little-endian: "HAPTICLC", version (u32), byte-order mark (u32), then instrument, problem, state,
// pose, settings and result, each array with its length before it. Numbers are IEEE doubles or 32/64-bit
// integers; one file is at most 0.9 MB. Version 1 is read too: it lacks the primitives of remembered
// contacts, which are 0 then. Errors: write throws std::runtime_error naming the file; read throws InputError
// for a file that is none of these, of another version, cut short, longer than it says, or with lengths,
// indices or numbers out of range.
#pragma once

#include <filesystem>
#include <memory>
#include <vector>

#include "haptic/contact_capture.h"

namespace hapticd {

struct CapturedProblem {
  std::vector<Instrument> instruments;
  ContactCapture capture;
};

void write_capture(const std::filesystem::path& file, const std::vector<Instrument>& instruments,
                   const ContactCapture& capture);
std::unique_ptr<CapturedProblem> read_capture(const std::filesystem::path& file);

// All `*.contact` files of a directory, by name. InputError where there are none.
std::vector<std::filesystem::path> capture_files(const std::filesystem::path& directory);

}  // namespace hapticd
