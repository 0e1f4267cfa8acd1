#include <algorithm>

#include "server/files/input_error.h"
#include "server/record/bag_reader.h"
#include "server/record/ros2_messages.h"
#include "tests/fuzz/targets.h"

namespace hapticd {
namespace {

void message(FuzzInput input) {
  for (const auto get : {get_pose, get_transform}) {
    try {
      const StampedPose pose = get(input);
      CdrWriter out;
      put_pose(out, pose.stamp, pose.pose);
      demand(get_pose(out.bytes()).stamp.ns == pose.stamp.ns, "a pose that is read is written");
    } catch (const CdrError&) {
    }
  }
  try {
    get_joy(input);
  } catch (const CdrError&) {
  }
}

}  // namespace

void fuzz_bag(FuzzInput input) {
  const std::string text = text_of(input.first(std::min<std::size_t>(input.size(), 16)));
  try {
    if (text.starts_with("SQLite format 3"))
      parse_bag(input, "fuzz.db3", "", LengthUnit::metre);
    else if (text.starts_with("rosbag2"))
      parse_bag_metadata(text_of(input), "metadata.yaml");
    else
      message(input);
  } catch (const InputError&) {
  }
}

}  // namespace hapticd
