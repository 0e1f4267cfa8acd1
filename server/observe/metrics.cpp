#include "server/observe/metrics.h"

#include <cstdio>

namespace hapticd {
namespace {

constexpr int first_octave = 12, last_octave = 27;

std::string number(double x) {
  char text[40];
  std::snprintf(text, sizeof text, "%.9g", x);
  return text;
}

// A label's value, as the format wants it.
std::string escaped(const std::string& text) {
  std::string out;
  for (char c : text) {
    if (c == '\\' || c == '"') out += '\\';
    out += c == '\n' ? ' ' : c;
  }
  return out;
}

class Page {
 public:
  Page(const std::string& station, const std::vector<MetricsSource>& devices)
      : station_(station.empty() ? "" : "station=\"" + escaped(station) + "\""), devices_(devices) {}

  void one(const std::string& name, const char* type, const char* help, const std::string& labels,
           double value) {
    head(name, type, help);
    const std::string all = labels + (labels.empty() || station_.empty() ? "" : ",") + station_;
    text_ += name + (all.empty() ? "" : "{" + all + "}") + " " + number(value) + "\n";
  }

  void information(const std::string& name, const char* help) {
    head(name, "gauge", help);
    for (const MetricsSource& d : devices_)
      text_ += name + "{" + label(d) + ",instrument=\"" + escaped(d.instrument) + "\",world=\"" +
               std::to_string(d.world) + "\"} 1\n";
  }

  template <typename T>
  void each(const std::string& name, const char* type, const char* help, T MetricsSource::*value) {
    head(name, type, help);
    for (const MetricsSource& d : devices_)
      text_ += name + "{" + label(d) + "} " + number(static_cast<double>(d.*value)) + "\n";
  }

  void histogram(const std::string& name, const char* help, HistogramSnapshot MetricsSource::*value) {
    head(name, "histogram", help);
    for (const MetricsSource& d : devices_) {
      const HistogramSnapshot& h = d.*value;
      std::uint64_t below = 0;
      int bin = 0;
      const auto bucket = [&](std::int64_t bound_ns) {
        for (; bin < histogram_bin(bound_ns); ++bin) below += h.bin[static_cast<std::size_t>(bin)];
        text_ += name + "_bucket{" + label(d) + ",le=\"" + number(1e-9 * static_cast<double>(bound_ns)) +
                 "\"} " + std::to_string(below) + "\n";
      };
      for (int k = first_octave; k <= last_octave; ++k) {
        bucket(std::int64_t{1} << k);
        bucket(std::int64_t{3} << (k - 1));
      }
      text_ += name + "_bucket{" + label(d) + ",le=\"+Inf\"} " + std::to_string(h.count) + "\n";
      text_ += name + "_sum{" + label(d) + "} " + number(1e-9 * h.sum) + "\n";
      text_ += name + "_count{" + label(d) + "} " + std::to_string(h.count) + "\n";
    }
  }

  // The largest since the start, of a histogram.
  void largest(const std::string& name, const char* help, HistogramSnapshot MetricsSource::*value) {
    head(name, "gauge", help);
    for (const MetricsSource& d : devices_)
      text_ += name + "{" + label(d) + "} " + number(1e-9 * static_cast<double>((d.*value).max)) + "\n";
  }

  std::string text() { return std::move(text_); }

 private:
  std::string label(const MetricsSource& d) const {
    return "device=\"" + std::to_string(d.device_id) + "\"" + (station_.empty() ? "" : ",") + station_;
  }
  void head(const std::string& name, const char* type, const char* help) {
    text_ += "# HELP " + name + " " + help + "\n# TYPE " + name + " " + type + "\n";
  }

  const std::string station_;
  const std::vector<MetricsSource>& devices_;
  std::string text_;
};

}  // namespace

std::string prometheus_text(const ProcessMetrics& process, const std::vector<MetricsSource>& devices) {
  using M = MetricsSource;
  Page p(process.station, devices);
  p.one("hapticd_info", "gauge", "The program.", "version=\"" + escaped(process.version) + "\"", 1);
  p.information("hapticd_device_info", "A device: its instrument, and the world that it shares with others.");
  p.one("hapticd_uptime_seconds", "gauge", "Since the start.", "", process.uptime_s);
  p.one("hapticd_resident_bytes", "gauge", "Memory held.", "", process.resident_bytes);
  p.one("hapticd_grants_refused", "gauge", "What of the real-time set-up the system refused.", "",
        process.grants_refused);
  p.one("hapticd_packets_refused_total", "counter", "RTPS messages that Cyclone was not given.", "",
        static_cast<double>(process.packets_refused));
  p.one("hapticd_dds_lines_total", "counter", "Warnings and errors of Cyclone, logged or not.", "",
        static_cast<double>(process.dds_lines));
  p.one("hapticd_log_lines_lost_total", "counter", "Log lines that could not be written at once.", "",
        static_cast<double>(process.lines_lost));

  p.histogram("hapticd_haptic_wake_seconds",
              "Lateness of a haptic tick against its intended time; missed slots too.", &M::wake);
  p.histogram("hapticd_haptic_step_seconds", "The haptic step, of ticks with a contact solve.", &M::solve);
  p.histogram("hapticd_haptic_state_age_seconds", "Age of the device state that a tick answers.",
              &M::state_age);
  p.histogram("hapticd_simulation_step_seconds", "Computing one simulation step.", &M::step);
  p.largest("hapticd_haptic_wake_seconds_max", "The largest lateness since the start.", &M::wake);
  p.largest("hapticd_simulation_step_seconds_max", "The longest simulation step since the start.", &M::step);
  p.largest("hapticd_problem_age_seconds_max", "The oldest contact problem that a tick used.",
            &M::problem_age);

  const char* counter = "counter";
  p.each("hapticd_haptic_ticks_total", counter, "Haptic ticks; each sent a force.", &M::ticks);
  p.each("hapticd_haptic_slots_missed_total", counter, "Slots that passed during a late or long tick.",
         &M::missed);
  p.each("hapticd_haptic_deadline_misses_total", counter, "Ticks that ended after the next slot.",
         &M::deadline_misses);
  p.each("hapticd_haptic_answered_total", counter, "Ticks with a new valid device state.", &M::answered);
  p.each("hapticd_states_rejected_total", counter, "Device states that were refused.", &M::rejected);
  p.each("hapticd_conflicts_total", counter, "Times that a second client wrote for the device.",
         &M::conflicts);
  p.each("hapticd_foreign_forces_total", counter, "Forces that somebody else wrote for the device.",
         &M::foreign_forces);
  p.each("hapticd_solver_caps_total", counter, "Contact solves that ended at their cap or deadline.",
         &M::solver_caps);
  p.each("hapticd_simulation_steps_total", counter, "Simulation steps.", &M::steps);
  p.each("hapticd_simulation_overruns_total", counter, "Simulation steps left out.", &M::overruns);
  p.each("hapticd_elements_removed_total", counter, "Tetrahedra destroyed.", &M::removed);
  p.each("hapticd_fragments_aspirated_total", counter, "Fragments sucked out.", &M::aspirated);
  p.each("hapticd_references_adopted_total", counter, "Bases of the factorisation taken into use.",
         &M::references);
  p.each("hapticd_references_failed_total", counter, "Bases that could not be made.", &M::references_failed);
  p.each("hapticd_page_faults_total", counter, "Of the haptic thread since it was first armed.",
         &M::page_faults);
  p.each("hapticd_recording_dropped_total", counter, "Ticks that the recording has not.",
         &M::recording_dropped);

  const char* gauge = "gauge";
  p.each("hapticd_armed", gauge, "1: a client feels forces.", &M::armed);
  p.each("hapticd_second_daemon", gauge,
         "1: no force, since somebody else writes the device's forces, or did.", &M::second_daemon);
  p.each("hapticd_simulation_rate_hertz", gauge, "Simulation steps per second since the start.",
         &M::simulation_rate_hz);
  p.each("hapticd_force_peak_newtons", gauge, "The largest force sent since the start.", &M::force_peak_n);
  p.each("hapticd_penetration_max_metres", gauge, "The deepest overlap after a solve, in the scene.",
         &M::penetration_max_m);
  return p.text();
}

}  // namespace hapticd
