#include "tools/record/tick_listener.h"

#include <algorithm>

#include "haptic/clock.h"
#include "server/observe/diagnostics.h"

namespace hapticd {
namespace {

void listen(dds_entity_t reader, void* self, dds_on_data_available_fn f) {
  const std::unique_ptr<dds_listener_t, decltype(&dds_delete_listener)> listener(dds_create_listener(self),
                                                                                 &dds_delete_listener);
  dds_lset_data_available(listener.get(), f);
  require(dds_set_listener(reader, listener.get()), "a listener");
}

}  // namespace

TickListener::TickListener(const Participant& participant, std::uint32_t device_id)
    : device_id_(device_id), status_(participant), state_reader_(participant), force_reader_(participant) {
  listen(state_reader_.handle(), this,
         [](dds_entity_t, void* self) { static_cast<TickListener*>(self)->receive_states(); });
  listen(force_reader_.handle(), this,
         [](dds_entity_t, void* self) { static_cast<TickListener*>(self)->receive_forces(); });
}

TickListener::~TickListener() {
  // Waits for a callback that is under way.
  dds_set_listener(state_reader_.handle(), nullptr);
  dds_set_listener(force_reader_.handle(), nullptr);
}

void TickListener::receive_states() noexcept {
  std::array<hapticd_msg_DeviceState, 8> taken;
  std::array<dds_sample_info_t, 8> infos;
  const int n = state_reader_.take_into(taken, infos);
  for (int i = 0; i < n; ++i) {
    const auto k = static_cast<std::size_t>(i);
    if (infos[k].valid_data && taken[k].device_id == device_id_) states_.push({monotonic_ns(), taken[k]});
  }
}

void TickListener::receive_forces() noexcept {
  std::array<hapticd_msg_ForceCommand, 4> taken;
  std::array<dds_sample_info_t, 4> infos;
  const int n = force_reader_.take_into(taken, infos);
  for (int i = 0; i < n; ++i) {
    const auto k = static_cast<std::size_t>(i);
    if (infos[k].valid_data && taken[k].device_id == device_id_) forces_.push({monotonic_ns(), taken[k]});
  }
}

// Newest first. Another client's state may have the same number, but hardly its clock's time.
const TickListener::State* TickListener::state_of(const hapticd_msg_ForceCommand& m) const {
  for (std::size_t back = 1; back <= std::min(remembered_, state_.size()); ++back) {
    const State& s = state_[(remembered_ - back) % state_.size()];
    if (s.message.number == m.echo_number && s.message.client_time_ns == m.echo_client_time_ns) return &s;
  }
  return nullptr;
}

ForceRecord TickListener::record_of(const Force& f) {
  const hapticd_msg_ForceCommand& m = f.message;
  ForceRecord record;
  record.time_ns = f.arrived_ns;
  record.force.sequence = m.number;
  record.force.echo_sequence = m.echo_number;
  record.force.echo_client_time_ns = m.echo_client_time_ns;
  record.force.force = {m.force[0], m.force[1], m.force[2]};
  record.force.torque = {m.torque[0], m.torque[1], m.torque[2]};
  record.force.status = m.status;
  record.force.step = m.step;
  record.force.contacts = m.contacts;
  record.force.active = m.active;
  record.force.penetration = 1e-6 * static_cast<double>(m.penetration_um);
  record.force.energy = static_cast<double>(m.energy);
  if (m.echo_number == 0 || m.echo_number == answered_) return record;
  answered_ = m.echo_number;
  const State* state = state_of(m);
  if (!state) {
    ++without_pose_;
    return record;
  }
  const State& s = *state;
  record.force.answers = true;
  record.device.p = Eigen::Map<const Vec3>(s.message.position);
  record.device.q.coeffs() = Eigen::Map<const Eigen::Vector4d>(s.message.orientation);
  record.instrument.present = true;
  record.instrument.buttons = s.message.buttons;
  record.instrument.received_ns = s.arrived_ns;
  return record;
}

void TickListener::take(const std::function<void(const ForceRecord&)>& sink) {
  // Only the forces that are here by now: their states came before them, and are here too.
  std::array<Force, 256> batch;
  std::size_t count = 0;
  while (count < batch.size() && forces_.pop(batch[count])) ++count;
  State state;
  while (states_.pop(state)) state_[remembered_++ % state_.size()] = state;
  for (std::size_t i = 0; i < count; ++i) sink(record_of(batch[i]));
}

void TickListener::take_statuses(const std::function<void(const Diagnostic&)>& sink) {
  status_.take_each([&](const hapticd_msg_ServerStatus& m, const dds_sample_info_t&) {
    if (m.device_id == device_id_) sink(diagnostic_of(m, monotonic_ns()));
  });
}

}  // namespace hapticd
