// haptic device: becomes haptic_device, so that no maker's library is ever loaded beside what is under the GPL.
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <cerrno>
#include <cstring>
#include <fstream>
#include <iterator>
#include <memory>

#include "tools/cli/child.h"
#include "tools/cli/command.h"
#include "tools/device/device_options.h"

namespace hapticd {
namespace {

int become_driver() {
  std::ifstream in("/proc/self/cmdline", std::ios::binary);
  std::string words{std::istreambuf_iterator<char>(in), {}};
  std::vector<char*> argv;
  for (std::size_t i = 0; i < words.size(); i += std::strlen(&words[i]) + 1) argv.push_back(&words[i]);
  argv.push_back(nullptr);
  const std::string program = beside_this_program("haptic_device");
  execv(program.c_str(), argv.data());
  throw std::runtime_error(program + ": " + std::strerror(errno));
}

}  // namespace

Command add_device(CLI::App& application) {
  const auto options = std::make_shared<DeviceRunOptions>();
  const DeviceApp device = add_device_options(application, *options);
  return {device.app, [options] { return become_driver(); }};
}

}  // namespace hapticd
