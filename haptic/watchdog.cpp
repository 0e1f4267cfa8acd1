#include "haptic/watchdog.h"

#include <algorithm>

namespace hapticd {
namespace {

// Time constant of the velocity estimate: five ticks tame the encoder's quantum and still follow a hand.
constexpr double velocity_filter_s = 5e-3;

void forget_client(WatchdogState& s) noexcept {
  s.has_sample = false;
  s.velocity.setZero();
  s.armed = false;
  s.may_arm = false;
  s.latched_by_refusals = false;
  s.refusals_in_a_row = 0;
  s.gain = 0;
}

bool latched(const WatchdogState& s) noexcept {
  return s.latched_by_refusals || s.latched_by_force || s.latched_by_rival;
}

void disarm(WatchdogState& s) noexcept {
  s.armed = false;
  s.may_arm = false;
  s.gain = 0;
}

void estimate_velocity(const DeviceSettings& device, const DeviceSample& now, std::int64_t period_ns,
                       WatchdogState& s) noexcept {
  const double dt = 1e-9 * static_cast<double>(std::max(now.received_ns - s.sample.received_ns, period_ns));
  const Vec3 raw = (now.pose.p - s.sample.pose.p) / dt;
  s.velocity += (raw - s.velocity) * (dt / (dt + velocity_filter_s));
  const double speed = s.velocity.norm();
  if (speed > device.max_speed) s.velocity *= device.max_speed / speed;
}

void accept(const WatchdogLimits& limits, const DeviceSettings& device, const DeviceSample& sample,
            WatchdogState& s) noexcept {
  if (s.has_sample && sample.enable)
    estimate_velocity(device, sample, limits.period_ns, s);
  else
    s.velocity.setZero();
  s.has_sample = true;
  s.sample = sample;
  s.sample.pose.q.normalize();
  s.refusals_in_a_row = 0;
  if (sample.enable) return;
  s.latched_by_refusals = s.latched_by_force = false;
  s.latched_by_rival = s.rival;
  disarm(s);
  s.may_arm = true;
}

void refuse(const WatchdogLimits& limits, WatchdogState& s) noexcept {
  ++s.refused;
  if (++s.refusals_in_a_row < limits.refusals_to_latch) return;
  s.latched_by_refusals = true;
  disarm(s);
}

std::uint32_t fault_bits(const WatchdogState& s, std::int64_t now_ns) noexcept {
  std::uint32_t bits = 0;
  if (s.refusals_in_a_row > 0) bits |= status_rejected;
  // One that lets its force down because of a second daemon is armed still.
  if (latched(s) && !s.armed) bits |= status_latched;
  if (s.latched_by_force) bits |= status_not_finite;
  if (s.latched_by_rival) bits |= status_rival;
  if (now_ns < s.conflict_until_ns) bits |= status_conflict;
  return bits;
}

double moved(double gain, std::int64_t dt_ns, std::int64_t whole_ns, bool up) noexcept {
  const double change = static_cast<double>(dt_ns) / static_cast<double>(whole_ns);
  return std::clamp(up ? gain + change : gain - change, 0.0, 1.0);
}

}  // namespace

Verdict watch(const WatchdogLimits& limits, const DeviceSettings& device, const WatchdogInput& input,
              WatchdogState& s) noexcept {
  Verdict v;
  const std::int64_t gap = s.last_tick_ns ? input.now_ns - s.last_tick_ns : 0;
  const std::int64_t dt = std::clamp(gap, std::int64_t{0}, limits.period_ns);
  s.last_tick_ns = input.now_ns;

  if (input.has_problem)
    v.problem_age_ns = std::max<std::int64_t>(input.now_ns - input.problem_published_ns, 0);
  const bool problem_old = !input.has_problem || v.problem_age_ns >= limits.problem_old_ns;
  const bool problem_lost = !input.has_problem || v.problem_age_ns >= limits.problem_lost_ns;
  const std::uint32_t problem_bits = problem_lost  ? std::uint32_t{status_problem_lost}
                                     : problem_old ? std::uint32_t{status_problem_old}
                                                   : 0u;

  if (input.presence.conflict) {
    // One that writes each tick is one conflict, not a thousand a second.
    if (input.now_ns >= s.conflict_until_ns) ++s.conflicts;
    s.conflict_until_ns = input.now_ns + limits.conflict_shown_ns;
  }
  s.rival = input.presence.rival;
  if (s.rival && !s.latched_by_rival) {
    s.latched_by_rival = true;
    s.rival_since_ns = input.now_ns;
  }
  if (!input.presence.connected) {
    forget_client(s);
    v.status = status_disarmed | problem_bits | fault_bits(s, input.now_ns);
    return v;
  }
  if (input.presence.new_client) {
    forget_client(s);
    s.may_arm = true;
  }
  if (input.taken) {
    // Numbers begin anew where a client lets go of a latch: one that is far ahead, whoever sent it, would
    // otherwise refuse all that follow.
    const bool anew = !s.has_sample || (s.latched_by_refusals && !input.sample.enable);
    v.refusal = check_sample(device, input.sample, anew ? nullptr : &s.sample, limits.period_ns,
                             limits.quaternion_tolerance);
    v.answers = v.refusal == Refusal::none;
    if (v.answers)
      accept(limits, device, input.sample, s);
    else
      refuse(limits, s);
  }
  v.status = problem_bits | fault_bits(s, input.now_ns);
  if (gap >= limits.own_gap_ns) v.status |= status_gap;
  if (!s.has_sample) {
    v.status |= status_disarmed;
    return v;
  }

  v.state_age_ns = std::max<std::int64_t>(input.now_ns - s.sample.received_ns, 0);
  std::int64_t age = gap >= limits.own_gap_ns ? std::max(v.state_age_ns, gap) : v.state_age_ns;
  if (s.latched_by_rival) age = std::max(age, limits.ramp_after_ns + input.now_ns - s.rival_since_ns);
  if (age >= limits.disarm_after_ns) disarm(s);
  if (s.sample.enable && s.may_arm && input.presence.settled && !problem_old && !latched(s)) {
    s.armed = true;
    s.may_arm = false;
    s.gain = 0;
  }
  if (!s.armed) {
    v.status |= status_disarmed | fault_bits(s, input.now_ns);
    v.render = s.sample.enable ? Render::release : Render::zero;
    return v;
  }

  if (problem_lost) {
    s.gain = 0;
    v.render = Render::release;
    return v;
  }
  if (age >= limits.ramp_after_ns) {
    s.gain = moved(s.gain, dt, limits.ramp_down_ns, false);
    v.render = Render::hold;
    v.status |= status_ramping_down;
  } else if (age >= limits.hold_after_ns) {
    v.render = Render::hold;
    v.status |= status_holding;
  } else {
    s.gain = moved(s.gain, dt, limits.ramp_up_ns, true);
    v.render = problem_old ? Render::damp : Render::contact;
    if (s.gain < 1) v.status |= status_ramping_up;
  }
  v.gain = s.gain;
  return v;
}

void latch_not_finite(WatchdogState& state) noexcept {
  state.latched_by_force = true;
  disarm(state);
}

}  // namespace hapticd
