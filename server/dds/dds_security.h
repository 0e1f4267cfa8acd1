// A participant's identity in a domain that refuses strangers: DDS Security with the built-in plugins (PKI-DH
// authentication, permissions, AES-GCM-GMAC).
//
//   DIR/ca.pem  governance.p7s                     the same for everybody
//   DIR/ROLE/cert.pem key.pem permissions.p7s      daemon, edge, device, viewer, operator
//
// config/dds/security/make_keys.sh makes such a folder; the documents there say who may do what.
// Contract: every participant of a process in one domain is secured, or none is.
// Errors: security_files throws InputError naming the file that is missing, unreadable or not what its name
// says, and std::runtime_error where this build knows no plugins. Making the participant fails on what only
// Cyclone can tell (a signature, an authority, an expiry). A key that belongs to another certificate shows
// only as silence: nobody answers.
#pragma once

#include <dds/dds.h>

#include <array>
#include <filesystem>
#include <string>

namespace hapticd {

inline constexpr std::array<const char*, 5> security_roles = {"daemon", "edge", "device", "viewer",
                                                              "operator"};

struct Security {
  std::string role;
  std::filesystem::path authority, governance, certificate, key, permissions;
  // Plugins: libdds_security_{auth,ac,crypto}.so.
  std::filesystem::path authentication, access_control, cryptography;
};

// The files of `role` in DIR, checked.
Security security_files(const std::filesystem::path& directory, const std::string& role);

// The properties by which Cyclone is told.
void set_security(dds_qos_t& qos, const Security& security);

}  // namespace hapticd
