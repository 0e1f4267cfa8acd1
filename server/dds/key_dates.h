// Until when the keys of a role are valid [days from now; negative: they have ended].
//
// Nothing: it is not said, or cannot be read. `days_left` is the least of authority, certificate and signed
// permissions. Cyclone lets a participant go when one of them ends. Thread safety: any thread.
#pragma once

#include <optional>
#include <string>

#include "server/dds/dds_security.h"

namespace hapticd {

std::optional<double> days_left_of_certificate(const std::string& pem);
std::optional<double> days_left_of_permissions(const std::string& text);
std::optional<double> days_left(const Security& security);
// Whose keys have ended and what makes new ones, in words; empty: they hold, or there are none.
std::string ended_keys(const std::optional<Security>& security);

}  // namespace hapticd
