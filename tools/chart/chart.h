// What the charts share: which lenses there are, and how a picture is drawn.
//
// Units: SI. Errors: InputError for a mesh that is missing, std::runtime_error when the picture could not be
// drawn.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "physics/tissue/tissue.h"

namespace hapticd {

// The lenses that come with the program, smallest first: "1k" (the cataract scene's, the published size),
// "5k", "20k" (config/scenes/lens_large).
const std::vector<std::string>& lens_names();

// With the cataract scene's material, held at its zonule.
TissueModel read_lens(const std::string& name, MeshRoom room = {});

// Where a chart's figures go: OUT/STEM.json and OUT/STEM.csv where only the folder is named. Makes folders.
// Throws InputError for what may not be written over (server/files/output_file.h); header: of the table.
void prepare_outputs(const std::string& stem, const std::string& header, const std::string& out,
                     std::string& json, std::string& csv, bool force);

// Where a script lies: with the installed configuration, else in the source's tools/plot/.
std::filesystem::path script_file(const std::string& name);

// Runs SCRIPT with Debian's python on these files.
void draw(const std::string& script, const std::string& data, const std::string& picture);

// Runs a program and waits. Returns its exit code; −1 when it could not be started or was ended by a signal.
int run_program(const std::vector<std::string>& words);

}  // namespace hapticd
