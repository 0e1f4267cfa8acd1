// haptic doctor: whether this machine can serve a scene, and what to do where it cannot.
//
// Every check ends in a verdict, what was found, and the way out unless it passed. `warn`: it works, but
// forces can be late, or something expires soon; `fail`: hapticd would refuse, or could not serve the scene.
// Nothing is changed: rights are tried on threads that end at once, DDS on a domain of its own.
// Thread safety: one thread. Errors: a check that cannot be made says so as its verdict.
#pragma once

#include <filesystem>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

#include "server/dds/dds_security.h"

namespace hapticd {

enum class Health { pass, warn, fail };

struct Finding {
  std::string name;
  Health health = Health::pass;
  std::string found;
  std::string fix;  // empty where it passed
};

std::vector<Finding> check_machine();     // kernel, rights, memory, clock, idle states, BLAS
Finding check_dds(std::uint32_t domain);  // a round trip with a process of its own, on loopback
std::vector<Finding> check_security(const std::filesystem::path& keys);  // files, expiry, who may read them
std::vector<Finding> check_scene(const std::string& scene, const std::string& device);

// A running daemon: its instruments, what device each has, and that device's client.
std::vector<Finding> check_daemon(std::uint32_t domain, const std::optional<Security>& security);

// The other end of check_dds, for `seconds`: answers every state by a force of its number.
int answer_dds(std::uint32_t domain, double seconds);

Health worst(const std::vector<Finding>& findings);
std::string to_text(const std::vector<Finding>& findings);
nlohmann::ordered_json to_json(const std::vector<Finding>& findings);

}  // namespace hapticd
