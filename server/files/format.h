// std::printf's text as a string: for what a person reads. Errors: what is longer than 511 bytes is cut off.
#pragma once

#include <string>

namespace hapticd {

[[gnu::format(printf, 1, 2)]] std::string format(const char* text, ...);

}  // namespace hapticd
