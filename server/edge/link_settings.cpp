#include "server/edge/link_settings.h"

#include <algorithm>
#include <random>
#include <utility>

#include "haptic/clock.h"
#include "server/os/realtime.h"

namespace hapticd {

EachInstrument<bool> others_than(const std::vector<std::uint32_t>& ids,
                                 const std::vector<DeviceSettings>& devices) {
  EachInstrument<bool> others;
  for (std::size_t i = 0; i < devices.size(); ++i)
    others[static_cast<int>(i)] = std::find(ids.begin(), ids.end(), devices[i].id) == ids.end();
  return others;
}

std::uint64_t own_number() {
  std::random_device random;
  return (std::uint64_t{random()} << 32 | random()) | 1;
}

LinkWait::LinkWait(const Participant& participant, dds_entity_t reader, dds_entity_t other)
    : set_(require(dds_create_waitset(participant.handle()), "a waitset")) {
  const auto attach = [this](dds_entity_t of, DdsEntity& condition) {
    if (of == 0) return;
    condition = DdsEntity(require(dds_create_readcondition(of, DDS_ANY_STATE), "a read condition"));
    require(dds_waitset_attach(set_.handle(), condition.handle(), 0), "a waitset's entry");
  };
  attach(reader, first_);
  attach(other, second_);
}

void LinkWait::until(std::int64_t ns) noexcept {
  const std::int64_t left = ns - monotonic_ns();
  if (left > 0) dds_waitset_wait(set_.handle(), nullptr, 0, left);
}

void LinkThread::start(const LinkSettings& settings, std::function<void()> run) {
  thread_ = std::thread([run = std::move(run), keep_off = settings.keep_off] {
    name_thread("edge_link");
    if (keep_off) leave_core(*keep_off);
    use_fifo(dds_priority);
    prefault_heap(sample_heap);
    run();
  });
}

void LinkThread::stop() noexcept {
  stopping_.store(true, std::memory_order_relaxed);
  if (thread_.joinable()) thread_.join();
}

}  // namespace hapticd
