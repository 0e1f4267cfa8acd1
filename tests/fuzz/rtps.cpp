#include "server/dds/rtps_check.h"
#include "server/dds/rtps_numbers.h"

#include <vector>

#include "tests/fuzz/targets.h"

namespace hapticd {

void fuzz_rtps(FuzzInput input) {
  const bool safe = rtps_is_safe(input);
  if (!safe) return;
  // A message of the header alone is what a refused one becomes.
  demand(rtps_is_safe(input.first(20)), "the header of a safe message is safe");
  // An empty submessage at the beginning says nothing.
  std::vector<std::uint8_t> longer(input.begin(), input.begin() + 20);
  const std::uint8_t nothing[] = {0x01, 0x01, 0x00, 0x00};
  longer.insert(longer.end(), nothing, nothing + 4);
  longer.insert(longer.end(), input.begin() + 20, input.end());
  demand(rtps_is_safe(longer), "a message stays safe with an empty submessage before the others");
  // Numbers may be any; the header alone has none.
  RtpsNumbers numbers;
  numbers.take(input, 1);
  demand(numbers.take(input.first(20), 2), "a header without a submessage is taken");
}

}  // namespace hapticd
