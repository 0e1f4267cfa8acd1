#include "server/schedule/schedule_file.h"

#include <cmath>
#include <cstring>
#include <iterator>
#include <nlohmann/json.hpp>
#include <stdexcept>

#include "server/files/input_error.h"
#include "server/schedule/scene_fingerprint.h"

namespace hapticd {
namespace {

using nlohmann::json;

constexpr char magic[8] = {'H', 'A', 'P', 'T', 'I', 'C', 'S', 'C'};
constexpr std::uint32_t version = 4, byte_order = 0x01020304;
constexpr std::uint32_t longest_header = 1 << 20;
constexpr std::size_t buffered = 1 << 16;
enum class Kind : char { tick = 'T', step = 'S', end = 'E' };

// One description of a record's layout, for both directions.
template <typename Stream>
void pose(Stream& s, Pose& X) {
  for (int i = 0; i < 3; ++i) s.put(X.p[i]);
  for (int i = 0; i < 4; ++i) s.put(X.q.coeffs()[i]);
}

template <typename Stream>
void fields(Stream& s, DeviceFacts& d) {
  Presence& presence = d.input.presence;
  DeviceSample& sample = d.input.sample;
  for (bool* flag : {&presence.connected, &presence.new_client, &presence.conflict, &presence.rival,
                     &presence.settled, &d.input.taken, &d.retuned, &sample.enable})
    s.put(*flag);
  s.put(sample.sequence);
  s.put(sample.client_time_ns);
  s.put(sample.received_ns);
  pose(s, sample.pose);
  s.put(sample.buttons);
  if (d.retuned)
    for (double* x :
         {&d.tuning.max_force, &d.tuning.max_torque, &d.tuning.max_force_rate, &d.tuning.max_speed,
          &d.tuning.workspace_radius, &d.tuning.damping, &d.tuning.position_scale, &d.tuning.force_scale})
      s.put(*x);
  for (int i = 0; i < 3; ++i) s.put(d.force[i]);
  for (int i = 0; i < 3; ++i) s.put(d.torque[i]);
  s.put(d.status);
}

template <typename Stream>
void fields(Stream& s, TickFacts& t) {
  s.put(t.now_ns);
  s.put(t.period_ns);
  s.put(t.tick);
  s.put(t.problem);
  s.put(t.devices);
  s.expect(t.devices >= 1 && t.devices <= max_instruments, "a tick of no device, or of too many");
  for (int i = 0; i < t.devices; ++i) fields(s, t.device[i]);
}

template <typename Stream>
void fields(Stream& s, StepRecord& r) {
  s.put(r.action);
  s.put(r.adopted);
  s.put(r.failed);
  s.put(r.kind);
  s.put(r.body);
  s.put(r.asked_ns);
  s.put(r.step_ns);
  for (int i = 0; i < max_instruments; ++i) {
    InstrumentSample& sample = r.samples[i];
    s.put(sample.present);
    if (i > 0 && !sample.present) continue;
    pose(s, sample.pose);
    s.put(sample.phaco);
    s.put(sample.aspiration);
    s.put(sample.time);
    s.put(sample.vacuum);
  }
  s.put(r.problem);
  s.put(r.published_ns);
}

struct Appender {
  std::string& bytes;

  template <typename T>
  void put(const T& value) {
    static_assert(std::is_arithmetic_v<T> || std::is_enum_v<T>);
    const std::size_t at = bytes.size();
    bytes.resize(at + sizeof value);
    std::memcpy(bytes.data() + at, &value, sizeof value);
  }
  void expect(bool, const char*) {}
};

class Taker {
 public:
  Taker(const std::filesystem::path& file, std::string bytes) : file_(file), bytes_(std::move(bytes)) {}

  // Poses may be anything that a client sent; what was refused then is refused again.
  template <typename T>
  void put(T& value) {
    if constexpr (std::is_same_v<T, bool>) {
      std::uint8_t byte = 0;
      put(byte);
      if (byte > 1) fail("damaged: a flag is " + std::to_string(byte));
      value = byte != 0;
    } else {
      std::memcpy(&value, take(sizeof value), sizeof value);
    }
  }
  const char* take(std::size_t n) {
    if (n > bytes_.size() - at_) throw CutShort{};
    at_ += n;
    return bytes_.data() + at_ - n;
  }
  void expect(bool holds, const char* otherwise) const {
    if (!holds) fail(std::string("damaged: ") + otherwise);
  }
  bool more() const { return at_ < bytes_.size(); }
  void next_record() { ++record_; }
  [[noreturn]] void fail(const std::string& what) const { throw InputError(file_, record_, "", what); }

  struct CutShort {};

 private:
  std::filesystem::path file_;
  std::string bytes_;
  std::size_t at_ = 0;
  int record_ = 0;
};

json numbers(const Vec3& v) { return {v.x(), v.y(), v.z()}; }
json numbers(const Quat& q) { return {q.x(), q.y(), q.z(), q.w()}; }
double number(const json& j, std::size_t i) { return j.at(i).get<double>(); }
Vec3 vector_of(const json& j) { return Vec3(number(j, 0), number(j, 1), number(j, 2)); }
Quat quaternion_of(const json& j) { return Quat(number(j, 3), number(j, 0), number(j, 1), number(j, 2)); }

json to_json(const DeviceSettings& d) {
  json j{{"id", d.id},
         {"max_force", d.max_force},
         {"max_torque", d.max_torque},
         {"max_force_rate", d.max_force_rate},
         {"max_speed", d.max_speed},
         {"workspace_radius", d.workspace_radius},
         {"damping", d.damping},
         {"quantum", d.quantum},
         {"position_scale", d.position_scale},
         {"force_scale", d.force_scale},
         {"origin", numbers(d.origin)},
         {"frame", numbers(d.frame)},
         {"tool", numbers(d.tool)}};
  if (d.pivot) j["pivot"] = {{"point", numbers(d.pivot->point)}, {"axis", numbers(d.pivot->axis)}};
  return j;
}

DeviceSettings device_of(const json& j) {
  DeviceSettings d;
  d.id = j.at("id").get<std::uint32_t>();
  d.max_force = j.at("max_force").get<double>();
  d.max_torque = j.at("max_torque").get<double>();
  d.max_force_rate = j.at("max_force_rate").get<double>();
  d.max_speed = j.at("max_speed").get<double>();
  d.workspace_radius = j.at("workspace_radius").get<double>();
  d.damping = j.at("damping").get<double>();
  d.quantum = j.at("quantum").get<double>();
  d.position_scale = j.at("position_scale").get<double>();
  d.force_scale = j.at("force_scale").get<double>();
  d.origin = vector_of(j.at("origin"));
  d.frame = quaternion_of(j.at("frame"));
  d.tool = quaternion_of(j.at("tool"));
  if (j.contains("pivot"))
    d.pivot = Pivot{vector_of(j.at("pivot").at("point")), vector_of(j.at("pivot").at("axis"))};
  return d;
}

json header_of(const Scene& scene, const std::vector<DeviceSettings>& devices) {
  json of_devices = json::array();
  for (const DeviceSettings& d : devices) of_devices.push_back(to_json(d));
  json bodies = json::array();
  for (const SceneBody& b : scene.bodies)
    bodies.push_back({{"name", b.name},
                      {"simulated", b.simulated},
                      {"corotational", b.corotational},
                      {"dynamic", b.dynamic}});
  return {{"scene", scene.name},
          {"scene_file", std::filesystem::absolute(scene.file).string()},
          {"fingerprint", fingerprint(scene)},
          {"devices", of_devices},
          {"regions", scene.regions},
          {"choices",
           {{"compliance", scene.compliance},
            {"contact", scene.contact},
            {"friction", scene.friction},
            {"bodies", bodies}}}};
}

void read_tick(Taker& in, Schedule& out) {
  RecordedTick tick;
  fields(in, tick.facts);
  std::uint32_t asked = 0, kept = 0;
  in.put(asked);
  in.put(kept);
  if (kept > asked || kept > ClockAnswers::capacity) in.fail("damaged: too many answers of the clock");
  tick.asked = asked;
  tick.first = out.answers.size();
  tick.kept = kept;
  const char* bytes = in.take(kept * sizeof(std::int32_t));
  out.answers.resize(tick.first + kept);
  std::memcpy(out.answers.data() + tick.first, bytes, kept * sizeof(std::int32_t));
  out.ticks.push_back(tick);
}

}  // namespace

ScheduleWriter::ScheduleWriter(const std::filesystem::path& file, const Scene& scene,
                               const std::vector<DeviceSettings>& devices)
    : out_(file, std::ios::binary) {
  if (!out_) throw std::runtime_error("cannot write the schedule " + file.string());
  Appender out{buffer_};
  buffer_.assign(magic, sizeof magic);
  out.put(version);
  out.put(byte_order);
  const std::string header = header_of(scene, devices).dump();
  out.put(static_cast<std::uint32_t>(header.size()));
  buffer_ += header;
  flush();
  if (!out_) throw std::runtime_error("cannot write the schedule " + file.string());
}

void ScheduleWriter::write(const TickRecord& tick) {
  Appender out{buffer_};
  out.put(Kind::tick);
  TickFacts facts = tick.facts;
  fields(out, facts);
  out.put(static_cast<std::uint32_t>(tick.clock.count));
  out.put(static_cast<std::uint32_t>(tick.clock.kept()));
  for (std::size_t i = 0; i < tick.clock.kept(); ++i) out.put(tick.clock.left_ns[i]);
  if (buffer_.size() > buffered) flush();
}

void ScheduleWriter::write(const StepRecord& step) {
  Appender out{buffer_};
  out.put(Kind::step);
  StepRecord record = step;
  fields(out, record);
  if (buffer_.size() > buffered) flush();
}

void ScheduleWriter::flush() {
  out_.write(buffer_.data(), static_cast<std::streamsize>(buffer_.size()));
  out_.flush();
  buffer_.clear();
}

void ScheduleWriter::end(std::uint64_t ticks_lost, std::uint64_t steps_lost) {
  Appender out{buffer_};
  out.put(Kind::end);
  out.put(ticks_lost);
  out.put(steps_lost);
  flush();
}

Schedule read_schedule(const std::filesystem::path& file) {
  std::ifstream stream(file, std::ios::binary);
  if (!stream) throw InputError(file, 0, "", "cannot be read");
  Taker in(file, std::string(std::istreambuf_iterator<char>(stream), {}));
  Schedule out;
  out.file = file;
  try {
    if (std::memcmp(in.take(sizeof magic), magic, sizeof magic) != 0)
      in.fail("is no schedule (hapticd SCENE --schedule FILE writes one)");
    std::uint32_t number = 0, order = 0, length = 0;
    in.put(number);
    in.put(order);
    if (order != byte_order) in.fail("is of a machine with another byte order");
    if (number != version)
      in.fail("is of version " + std::to_string(number) + ", and this program reads " +
              std::to_string(version));
    in.put(length);
    if (length > longest_header) in.fail("damaged: its header is too long");
    out.header.assign(in.take(length), length);
  } catch (const Taker::CutShort&) {
    in.fail("is no schedule, or cut short in its header");
  }
  try {
    while (in.more()) {
      in.next_record();
      Kind kind{};
      in.put(kind);
      if (out.complete) in.fail("damaged: there is something behind its end");
      if (kind == Kind::tick) {
        read_tick(in, out);
      } else if (kind == Kind::step) {
        StepRecord step;
        fields(in, step);
        if (step.action > StepAction::publish_refresh) in.fail("damaged: an action that there is not");
        out.steps.push_back(step);
      } else if (kind == Kind::end) {
        in.put(out.ticks_lost);
        in.put(out.steps_lost);
        out.complete = true;
      } else {
        in.fail("damaged: a record that there is not");
      }
    }
  } catch (const Taker::CutShort&) {  // the run was killed: what came before the last record is whole
  }
  return out;
}

std::filesystem::path scene_of(const Schedule& schedule) {
  try {
    return json::parse(schedule.header).at("scene_file").get<std::string>();
  } catch (const json::exception&) {
    throw InputError(schedule.file, 0, "header", "damaged");
  }
}

Scene as_run(const Schedule& schedule, Scene scene) {
  try {
    const json header = json::parse(schedule.header), choices = header.at("choices");
    const json& bodies = choices.at("bodies");
    const auto other = [&]() -> InputError {
      return {schedule.file, 0, "scene",
              "is of another scene than " + scene.file.string() + ": of " +
                  header.at("scene_file").get<std::string>() + ", as it was then"};
    };
    if (bodies.size() != scene.bodies.size()) throw other();
    scene.plans = false;
    scene.regions = header.at("regions").get<int>();
    scene.compliance = choices.at("compliance").get<ComplianceMethod>();
    scene.contact = choices.at("contact").get<Renewal>();
    scene.friction = choices.at("friction").get<bool>();
    for (std::size_t b = 0; b < bodies.size(); ++b) {
      scene.bodies[b].simulated = bodies[b].at("simulated").get<bool>();
      scene.bodies[b].corotational = bodies[b].at("corotational").get<bool>();
      scene.bodies[b].dynamic = bodies[b].at("dynamic").get<bool>();
    }
    const json& devices = header.at("devices");
    if (devices.size() != scene.instruments.size()) throw other();
    for (std::size_t i = 0; i < devices.size(); ++i) scene.instruments[i].device = device_of(devices[i]);
    if (fingerprint(scene) != header.at("fingerprint").get<std::uint64_t>()) throw other();
    return scene;
  } catch (const json::exception&) {
    throw InputError(schedule.file, 0, "header", "damaged");
  }
}

}  // namespace hapticd
