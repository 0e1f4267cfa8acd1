// A tape of ticks. Byte 0 of the tape: the scene. Each tick: a byte of flags, then what these say.
#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <memory>

#include "haptic/haptic_step.h"
#include "tests/fuzz/targets.h"
#include "tests/support/one_device.h"

namespace hapticd {
namespace {

constexpr std::int64_t ms = 1'000'000;
constexpr double spacing = 1e-3;  // of the sheet's nodes [m]
constexpr int side = 4;
constexpr std::size_t most_ticks = 400;

enum Flag : std::uint8_t {
  taken = 1,  // a state comes: 3 positions in 0.1 mm, one byte each, and the flag below
  enabled = 2,
  doubles = 4,       // … its pose as seven doubles instead, anything they may be
  numbered = 8,      // … its number as 8 bytes, instead of the next
  gone = 16,         // no client
  other = 32,        // a conflict; with `taken`, a new client
  late = 64,         // a byte more: so many ms pass
  republished = 128  // the simulation publishes: a byte of flags (topology, age, not finite, a second daemon)
};

class Tape {
 public:
  explicit Tape(FuzzInput bytes) : bytes_(bytes) {}
  bool over() const { return bytes_.empty(); }
  template <typename T>
  T next() {
    T value{};
    const std::size_t n = std::min(sizeof(T), bytes_.size());
    std::memcpy(&value, bytes_.data(), n);
    bytes_ = bytes_.subspan(n);
    return value;
  }

 private:
  FuzzInput bytes_;
};

// A sheet of soft nodes at z = 0, two samples in each of its squares, with friction or without.
void make_sheet(CondensedProblem& p, double friction, Renewal renewal) {
  p.step = 1;
  p.instrument[0].X_ref.p = Vec3(1.5 * spacing, 1.5 * spacing, 2 * spacing);
  p.renewal = renewal;
  p.alarm_distance = 2 * spacing;
  p.instrument[0].coupling = {.stiffness = 300, .rotational_stiffness = 0.03, .damping_time = 2e-3};
  p.nodes = side * side;
  for (int n = 0; n < p.nodes; ++n) p.x_free[n] = p.x_now[n] = spacing * Vec3(n % side, n / side, 0);
  p.C().setZero();
  for (int a = 0; a < p.nodes; ++a)
    for (int b = 0; b < p.nodes; ++b)
      p.C().block<3, 3>(3 * a, 3 * b) =
          0.02 * std::exp(-(p.x_now[a] - p.x_now[b]).norm() / spacing) * Mat3::Identity();
  p.samples = 0;
  for (int i = 0; i + 1 < side; ++i)
    for (int j = 0; j + 1 < side; ++j)
      for (int k = 0; k < 2; ++k) {
        const int n = i * side + j;
        PatchSample& s = p.sample[static_cast<std::size_t>(p.samples++)];
        s.id = static_cast<std::uint64_t>(p.samples);
        s.node = k == 0 ? std::array<std::int32_t, 3>{n, n + 1, n + side}
                        : std::array<std::int32_t, 3>{n + 1, n + side + 1, n + side};
        s.weight = {0.4, 0.3, 0.3};
        s.outward = Vec3::UnitZ();
        s.friction = friction;
      }
}

Instrument tip() {
  Primitive ball;
  ball.name = "tip";
  ball.shape = Shape::sphere;
  ball.radius = 1e-3;
  Instrument instrument;
  instrument.primitives.push_back(ball);
  return instrument;
}

DeviceSettings device_of(std::uint8_t kind) {
  DeviceSettings d;
  d.max_force = 3.3;
  d.max_torque = kind & 4 ? 0.1 : 0;
  d.max_force_rate = 200;
  d.max_speed = 2;
  d.damping = 4;
  d.position_scale = kind & 8 ? 0.1 : 1;
  d.force_scale = kind & 16 ? 50 : 1;
  d.frame = Quat(Eigen::AngleAxisd(kind & 32 ? 1.0 : 0.0, Vec3(1, 2, 3).normalized()));
  return d;
}

void read_state(Tape& tape, std::uint8_t flags, DeviceSample& s) {
  s.sequence = flags & numbered ? tape.next<std::uint64_t>() : s.sequence + 1;
  s.enable = flags & enabled;
  if (flags & doubles) {
    for (int i = 0; i < 3; ++i) s.pose.p[i] = tape.next<double>();
    for (int i = 0; i < 4; ++i) s.pose.q.coeffs()[i] = tape.next<double>();
    s.buttons = tape.next<std::uint32_t>();
  } else {
    for (int i = 0; i < 3; ++i) s.pose.p[i] = 1e-4 * tape.next<std::int8_t>();
    s.pose.q = Quat::Identity();
    s.buttons = 0;
  }
}

// True: from now on a second daemon is heard.
bool republish(Tape& tape, std::int64_t now_ns, CondensedProblem& p) {
  const auto what = tape.next<std::uint8_t>();
  ++p.step;
  p.published_ns = now_ns - ms * (what >> 4);
  p.topology_changed = what & 1;
  p.thinned = what & 32;
  for (int n = 0; n < p.nodes; ++n)
    p.x_free[n].z() = what & 2 ? std::numeric_limits<double>::quiet_NaN() : what & 4 ? 5e-4 : 0;
  return what & 8;
}

// What may be sent, whatever came: the table of haptic/README.md.
void check(const DeviceSettings& d, const ForceSample& f, const ForceSample& before, std::int64_t period_ns) {
  constexpr double rounding = 1 + 1e-9;
  demand(f.force.allFinite() && f.torque.allFinite(), "a force is finite");
  demand(f.force.norm() <= rounding * d.max_force, "a force keeps the device's maximum");
  demand(f.torque.norm() <= rounding * d.max_torque, "a torque keeps the device's maximum");
  const bool zero = f.force.isZero(0) && f.torque.isZero(0);
  const double step = d.max_force_rate * 1e-9 * static_cast<double>(period_ns);
  // Only a client that left or asked for it, and numbers that are none, end a force in a step.
  demand((zero && (f.status & status_disarmed)) || (f.force - before.force).norm() <= rounding * step + 1e-12,
         "a force changes by its slew limit");
  if (f.status & status_disarmed) demand(zero, "without right no force");
  if (f.status & (status_latched | status_problem_lost))
    demand(zero || f.force.norm() <= before.force.norm(), "without right a force only falls");
}

}  // namespace

void fuzz_device(FuzzInput input) {
  Tape tape(input);
  const auto kind = tape.next<std::uint8_t>();
  const DeviceSettings device = device_of(kind);
  const Instrument instrument = tip();
  static const auto problem = std::make_unique<CondensedProblem>();
  make_sheet(*problem, kind & 1 ? 0.3 : 0, kind & 2 ? Renewal::frozen : Renewal::renewed);
  const auto state = std::make_unique<HapticState>();
  HapticOptions options;
  options.viscous.step = 0.02;
  options.passivity_control = kind & 64;

  std::int64_t now_ns = 1000 * ms;
  problem->published_ns = now_ns;
  HapticInput in;
  ForceSample before;
  for (std::size_t tick = 0; tick < most_ticks && !tape.over(); ++tick) {
    const auto flags = tape.next<std::uint8_t>();
    now_ns += ms * (flags & late ? 1 + tape.next<std::uint8_t>() : 1);
    if (flags & republished) in.device[0].presence.rival = republish(tape, now_ns, *problem);
    in.now_ns = now_ns;
    in.device[0].presence.connected = !(flags & gone);
    in.device[0].taken = flags & taken;
    in.device[0].presence.conflict = !in.device[0].taken && flags & other;
    in.device[0].presence.new_client = in.device[0].taken && (tick == 0 || flags & other);
    if (in.device[0].taken) {
      read_state(tape, flags, in.device[0].sample);
      in.device[0].sample.received_ns = now_ns - ms / 2;
    }
    const ForceSample f = haptic_step(problem.get(), instrument, device, options, in, *state);
    check(device, f, before, options.watchdog.period_ns);
    instrument_input(device, options.watchdog, state->device[0].watchdog, now_ns);
    before = f;
  }
}

}  // namespace hapticd
