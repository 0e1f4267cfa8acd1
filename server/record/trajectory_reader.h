// Reads a trajectory from CSV: `t,px,py,pz,qx,qy,qz,qw[,buttons]`.
//
// The first line names the columns, in any order; the orientation's four may all be absent (identity), and
// so may `buttons` (none pressed). `#` begins a comment line; blank lines are skipped. Time in seconds; the
// position's unit is the caller's to say, `scale` metres each. Quaternions within 1e-2 of unit norm are
// normalised. The further columns of the project's own recordings (`hapticd --record`, `haptic replay --forces`)
// are passed over, so that these replay.
// Errors: InputError with file, line and column for a column that is unknown, missing or there twice, a row
// with too few or too many values, what is no finite number, a time that does not rise, a quaternion that is
// not unit, fewer than two rows.
#pragma once

#include <filesystem>
#include <string>

#include "server/record/trajectory.h"

namespace hapticd {

enum class LengthUnit { metre, millimetre };

inline double metres(LengthUnit unit) { return unit == LengthUnit::metre ? 1.0 : 1e-3; }

Trajectory read_trajectory(const std::filesystem::path& file, LengthUnit unit);

// From the file's bytes; `file` is only named in errors.
Trajectory parse_trajectory(const std::string& bytes, const std::filesystem::path& file, LengthUnit unit);

}  // namespace hapticd
