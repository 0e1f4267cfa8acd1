// hapticd._client: the C library (tools/client_library) for Python. Motions are played by the library's own 1
// kHz thread, without the interpreter's lock.
#include <haptic_client.h>
#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <time.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <memory>
#include <string>
#include <thread>
#include <vector>

namespace py = pybind11;

namespace {

using Rows = py::array_t<double, py::array::c_style | py::array::forcecast>;

constexpr std::int64_t period_ns = 1'000'000;
constexpr std::int64_t settle_slots = 100;  // rendered without a status bit before a motion begins

std::int64_t now_ns() {
  timespec t;
  clock_gettime(CLOCK_MONOTONIC, &t);
  return 1'000'000'000 * t.tv_sec + t.tv_nsec;
}

struct Error : std::runtime_error {
  using std::runtime_error::runtime_error;
};

// A motion, one row a millisecond, and what came back for each row that was sent.
class Motion {
 public:
  Motion(std::vector<haptic_pose> poses)
      : poses_(std::move(poses)), forces_(poses_.size()), sent_(poses_.size()) {}

  static int read(void* self, haptic_pose* pose) { return static_cast<Motion*>(self)->next(*pose); }
  static void write(void* self, const haptic_force* force) { static_cast<Motion*>(self)->keep(*force); }

  bool done() const { return done_.load(); }
  bool begun() const { return begun_.load(); }
  int result() const { return result_.load(); }
  const std::vector<haptic_pose>& poses() const { return poses_; }
  const haptic_force& force(std::size_t k) const { return forces_[k]; }
  bool sent(std::size_t k) const { return sent_[k]; }

 private:
  int next(haptic_pose& pose) {
    const std::int64_t slot = slot_at(now_ns());
    if (!begun_.load()) {
      pose = poses_.front();
      if (settled_ < settle_slots) return 0;
      first_ = slot;
      begun_.store(true);
    }
    k_ = slot - first_;
    if (k_ >= static_cast<std::int64_t>(poses_.size())) {
      k_ = -1;
      done_.store(true);
      return 1;
    }
    pose = poses_[static_cast<std::size_t>(k_)];
    sent_[static_cast<std::size_t>(k_)] = true;
    return 0;
  }
  // Wake-ups are late by less than a slot, or skip one; the earliest tell where the grid is.
  std::int64_t slot_at(std::int64_t now) {
    if (settled_ == 0) grid_ns_ = now;
    const std::int64_t slot = settled_ == 0 ? 0 : std::max(slot_ + 1, (now - grid_ns_) / period_ns);
    grid_ns_ = std::min(grid_ns_, now - slot * period_ns);
    return slot_ = slot;
  }
  void keep(const haptic_force& force) {
    result_.store(force.result);
    if (!begun_.load()) settled_ = force.status == 0 ? settled_ + 1 : 0;
    if (k_ >= 0) forces_[static_cast<std::size_t>(k_)] = force;
  }

  const std::vector<haptic_pose> poses_;
  std::vector<haptic_force> forces_;
  std::vector<char> sent_;
  std::int64_t grid_ns_ = 0, slot_ = 0, first_ = 0;
  std::int64_t k_ = -1, settled_ = 0;  // row that was sent; answers in a row that were all well
  std::atomic<bool> begun_{false}, done_{false};
  std::atomic<int> result_{HAPTIC_CONNECTING};
};

haptic_pose pose_of(const double* row, py::ssize_t columns, std::uint32_t buttons, bool enable) {
  haptic_pose pose = HAPTIC_POSE_INIT;
  for (py::ssize_t i = 0; i < 3; ++i) pose.position[i] = row[i];
  for (py::ssize_t i = 3; i < columns; ++i) pose.orientation[i - 3] = row[i];
  pose.buttons = buttons;
  pose.enable = enable;
  return pose;
}

class Device {
 public:
  Device(const std::string& device, std::uint32_t domain, std::uint32_t device_id, const std::string& keys,
         bool open_network, bool realtime, const std::string& station) {
    haptic_options options = HAPTIC_OPTIONS_INIT;
    haptic_error error = HAPTIC_ERROR_INIT;
    options.device = device.c_str();
    options.domain = domain;
    options.device_id = device_id;
    if (!keys.empty()) options.keys = keys.c_str();
    if (!station.empty()) options.station = station.c_str();
    options.flags = (open_network ? HAPTIC_OPEN_NETWORK : 0u) | (realtime ? 0u : HAPTIC_ORDINARY_PRIORITY);
    if (haptic_open(&options, &client_, &error) != HAPTIC_OK) throw Error(error.message);
    check(haptic_start(client_, nullptr));
  }
  ~Device() { close(); }
  Device(const Device&) = delete;
  Device& operator=(const Device&) = delete;

  void close() {
    const py::gil_scoped_release released;
    haptic_close(std::exchange(client_, nullptr));
  }

  void set_pose(const Rows& pose, std::uint32_t buttons, bool enable) {
    if (pose.ndim() != 1 || (pose.size() != 3 && pose.size() != 7))
      throw Error("a pose is (x, y, z) in metres, or with a quaternion (qx, qy, qz, qw)");
    const haptic_pose own = pose_of(pose.data(), pose.size(), buttons, enable);
    check(haptic_set_pose(open(), &own));
  }

  py::tuple force() {
    haptic_force f = HAPTIC_FORCE_INIT;
    const haptic_result result = haptic_get_force(open(), &f);
    return py::make_tuple(array(f.force), array(f.torque), f.status, static_cast<int>(result),
                          explained(result));
  }

  py::dict state() {
    const haptic_state s = counts();
    py::dict out;
    out["result"] = s.result;
    out["meaning"] = explained(static_cast<haptic_result>(s.result));
    out["sent"] = s.sent;
    out["answered"] = s.answered;
    out["silences"] = s.silences;
    out["strange_forces"] = s.strange_forces;
    out["longest_silence_ms"] = s.longest_silence_ms;
    out["realtime"] = s.realtime;
    return out;
  }

  py::dict play(const Rows& motion,
                const py::array_t<std::uint32_t, py::array::c_style | py::array::forcecast>& buttons,
                double arm_timeout) {
    const py::ssize_t n = motion.ndim() == 2 ? motion.shape(0) : 0, columns = n > 0 ? motion.shape(1) : 0;
    if (n == 0 || (columns != 3 && columns != 7))
      throw Error(
          "a motion is an array of n rows, a millisecond apart: x, y, z in metres, or with qx, qy, qz, qw");
    if (buttons.size() != 0 && buttons.size() != n)
      throw Error("buttons: one for each row of the motion, or none");
    std::vector<haptic_pose> poses;
    for (py::ssize_t i = 0; i < n; ++i)
      poses.push_back(pose_of(motion.data(i, 0), columns, buttons.size() ? buttons.data()[i] : 0, true));
    Motion played(std::move(poses));
    const double of_sent = run(played, arm_timeout);
    py::dict out = told(played);
    out["answered_of_sent"] = of_sent;
    return out;
  }

 private:
  haptic_client* open() const {
    if (!client_) throw Error("the device is closed");
    return client_;
  }
  void check(haptic_result result) const {
    if (result < 0) throw Error(explained(result));
  }
  std::string explained(haptic_result result) const {
    char text[1024];
    haptic_explain(client_, result, text, sizeof text);
    return text;
  }
  static py::array_t<double> array(const double (&v)[3]) { return py::array_t<double>(3, v); }

  haptic_state counts() const {
    haptic_state s = HAPTIC_STATE_INIT;
    check(haptic_get_state(open(), &s));
    return s;
  }

  // Returns the share of the motion's states that were answered, late ones too.
  double run(Motion& motion, double arm_timeout) {
    haptic_callbacks callbacks = HAPTIC_CALLBACKS_INIT;
    callbacks.read = &Motion::read;
    callbacks.write = &Motion::write;
    callbacks.user = &motion;
    check(haptic_stop(open()));
    check(haptic_start(client_, &callbacks));
    bool interrupted = false, failed = false;
    haptic_state before = counts();   // of the motion itself, but for some milliseconds
    std::int64_t fine_ns = now_ns();  // of the motion the newest good answer; before it, of its preparation
    while (!motion.done() && !interrupted && !failed) {
      {
        const py::gil_scoped_release released;
        std::this_thread::sleep_for(std::chrono::milliseconds(5));
      }
      interrupted = PyErr_CheckSignals() != 0;
      if (!motion.begun()) before = counts();
      if (motion.result() == HAPTIC_CONNECTING || (motion.begun() && motion.result() == HAPTIC_OK))
        fine_ns = now_ns();
      failed = static_cast<double>(now_ns() - fine_ns) > 1e9 * arm_timeout;
    }
    const haptic_state after = counts();
    const auto result = static_cast<haptic_result>(motion.result());  // before the thread's end is one
    {
      const py::gil_scoped_release released;
      haptic_stop(client_);
    }
    if (interrupted) throw py::error_already_set();
    check(haptic_start(client_, nullptr));
    if (!failed)
      return static_cast<double>(after.answered - before.answered) /
             static_cast<double>(std::max<std::uint64_t>(1, after.sent - before.sent));
    check(result);
    throw Error(
        "the daemon answers, but renders no force for this device: is that the scene's device_id, and may it "
        "arm? (Device.status has the bits)");
  }

  static py::dict told(const Motion& motion) {
    const auto n = static_cast<py::ssize_t>(motion.poses().size());
    py::array_t<double> force({n, py::ssize_t{3}}), torque({n, py::ssize_t{3}});
    py::array_t<std::uint32_t> status(n);
    py::array_t<bool> sent(n), on_time(n);
    for (py::ssize_t k = 0; k < n; ++k) {
      const haptic_force& f = motion.force(static_cast<std::size_t>(k));
      for (py::ssize_t i = 0; i < 3; ++i) {
        force.mutable_at(k, i) = f.force[i];
        torque.mutable_at(k, i) = f.torque[i];
      }
      status.mutable_at(k) = f.status;
      sent.mutable_at(k) = motion.sent(static_cast<std::size_t>(k));
      on_time.mutable_at(k) = f.answered != 0;
    }
    py::dict out;
    out["force"] = force;
    out["torque"] = torque;
    out["status"] = status;
    out["sent"] = sent;
    out["on_time"] = on_time;
    return out;
  }

  haptic_client* client_ = nullptr;
};

}  // namespace

PYBIND11_MODULE(_client, m) {
  py::register_exception<Error>(m, "Error", PyExc_RuntimeError);
  py::class_<Device>(m, "Device")
      .def(py::init<const std::string&, std::uint32_t, std::uint32_t, const std::string&, bool, bool,
                    const std::string&>())
      .def("close", &Device::close)
      .def("set_pose", &Device::set_pose)
      .def("force", &Device::force)
      .def("state", &Device::state)
      .def("play", &Device::play);
}
