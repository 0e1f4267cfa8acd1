#include "server/edge/edge_topics.h"

namespace hapticd {

Qos edge_problem_qos(int depth) {
  Qos qos = realtime_qos(depth);
  // Nobody waits: a problem that has not arrived when the next one comes is not sent again.
  dds_qset_reliability(qos.get(), DDS_RELIABILITY_RELIABLE, 0);
  return qos;
}

}  // namespace hapticd
