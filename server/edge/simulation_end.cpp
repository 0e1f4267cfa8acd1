#include "server/edge/simulation_end.h"

#include <algorithm>
#include <array>
#include <nlohmann/json.hpp>

#include "haptic/clock.h"
#include "server/observe/log.h"

namespace hapticd {
namespace {

constexpr auto relaxed = std::memory_order_relaxed;
constexpr std::int64_t look_ns = 500'000;  // for a new problem, where no hands come
constexpr std::int64_t clock_every_ns = 20'000'000;
constexpr std::int64_t say_every_ns = 10'000'000'000;

std::span<const hapticd_msg_EdgeHand> hands_of(const hapticd_msg_EdgeHands& m) noexcept {
  return {m.hands._buffer, m.hands._length};
}

}  // namespace

SimulationEnd::SimulationEnd(const Participant& participant, const LinkSettings& settings,
                             Channel<CondensedProblem>& copies, Channel<InstrumentInputs>& told,
                             Channel<InstrumentInputs>* own)
    : settings_(settings),
      simulation_(own_number()),
      copies_(copies),
      told_(told),
      own_(own),
      hands_(participant),
      problems_(participant),
      clock_(participant),
      wait_(participant, hands_.handle()) {}

SimulationEnd::~SimulationEnd() { stop(); }

void SimulationEnd::start() {
  thread_.start(settings_, [this] { run(); });
}

void SimulationEnd::stop() noexcept { thread_.stop(); }

void SimulationEnd::run() {
  while (!thread_.stopping()) {
    wait_.until(monotonic_ns() + look_ns);
    const std::int64_t now = monotonic_ns();
    hear(now);
    if (writer_ != 0 && now - heard_ns_ >= edge_stays_ns) {
      writer_ = 0;
      edge_ = 0;
    }
    if (present_ && now - heard_ns_ >= hands_lost_ns) lose_hands();
    if (copies_.acquire() && writer_ != 0) send();
    const bool moved = own_ && own_->acquire();
    if (writer_ != 0 && (moved || now - clock_ns_ >= clock_every_ns)) answer(now);
    turns_.fetch_add(1, relaxed);
  }
  lose_hands();
}

void SimulationEnd::hear(std::int64_t now_ns) {
  hands_.take_each([&](const hapticd_msg_EdgeHands& m, const dds_sample_info_t& info) {
    if (m.world != settings_.world) return;
    if (!admit(m, info.publication_handle, now_ns)) {
      refused_.fetch_add(1, relaxed);
      return;
    }
    heard_ns_ = now_ns;
    asked_ns_ = m.sent_ns;
    newest_number_ = m.number;
    taken_.fetch_add(1, relaxed);
    tell(m, now_ns);
  });
}

bool SimulationEnd::admit(const hapticd_msg_EdgeHands& m, dds_instance_handle_t writer, std::int64_t now_ns) {
  if (m.version != edge_version || m.edge == 0) return false;
  if (!are_hands(hands_of(m), settings_.instruments)) return false;
  if (writer_ == 0) {
    writer_ = writer;
    edge_ = m.edge;
    newest_number_ = 0;
    edges_.fetch_add(1, relaxed);
    log(LogLevel::info, "edge", "an edge answers for device " + std::to_string(settings_.world),
        {{"device", settings_.world}});
  }
  if (writer == writer_ && m.edge == edge_) return m.number > newest_number_;
  others_.fetch_add(1, relaxed);
  if (other_said_ns_ == 0 || now_ns - other_said_ns_ >= say_every_ns) {
    other_said_ns_ = now_ns;
    log(LogLevel::warning, "second_edge",
        "a second edge for device " + std::to_string(settings_.world) +
            " is refused: the first has the tissue",
        {{"device", settings_.world}});
  }
  return false;
}

void SimulationEnd::tell(const hapticd_msg_EdgeHands& m, std::int64_t now_ns) {
  InstrumentInputs& all = told_.back() = read_hands(hands_of(m), 0, now_ns);
  present_ = false;
  for (int i = 0; i < settings_.instruments; ++i) {
    if (settings_.at_simulation[i]) all[i] = {};
    present_ = present_ || all[i].present;
  }
  told_.publish();
}

void SimulationEnd::answer(std::int64_t now_ns) {
  clock_ns_ = now_ns;
  hapticd_msg_EdgeClock m{};
  m.world = settings_.world;
  m.version = edge_version;
  m.simulation = simulation_;
  m.edge = edge_;
  m.number = ++answers_;
  m.sent_ns = asked_ns_;
  m.received_ns = heard_ns_;
  std::array<hapticd_msg_EdgeHand, max_instruments> hands;
  if (own_) {
    for (int i = 0; i < settings_.instruments; ++i)
      hands[static_cast<std::size_t>(i)] =
          hand_message(own_->front()[i], settings_.at_simulation[i], 0, now_ns);
    m.hands._buffer = hands.data();
    m.hands._length = m.hands._maximum = static_cast<std::uint32_t>(settings_.instruments);
  }
  m.answered_ns = monotonic_ns();
  clock_.write(m);
}

void SimulationEnd::lose_hands() {
  present_ = false;
  told_.back() = {};
  told_.publish();
}

void SimulationEnd::send() {
  const CondensedProblem& problem = copies_.front();
  hapticd_msg_EdgeProblem& m = packed_.pack(problem, settings_.instruments);
  m.world = settings_.world;
  m.scene = settings_.scene;
  m.simulation = simulation_;
  m.edge = edge_;
  // A world that begins again counts from one.
  if (problem.step <= newest_step_) number_base_ += newest_step_;
  newest_step_ = problem.step;
  m.number = number_base_ + problem.step;
  problems_.write(m);
  const std::size_t bytes = packed_.bytes();
  const std::int64_t now = monotonic_ns();
  if (first_sent_ns_.load(relaxed) == 0) first_sent_ns_.store(now, relaxed);
  last_sent_ns_.store(now, relaxed);
  sent_.fetch_add(1, relaxed);
  bytes_.fetch_add(bytes, relaxed);
  PatchSize& size = sizes_[static_cast<std::size_t>(problem.nodes) / 10];
  size.count.fetch_add(1, relaxed);
  size.samples.store(std::max(size.samples.load(relaxed), static_cast<std::uint32_t>(problem.samples)),
                     relaxed);
  size.bytes.store(std::max(size.bytes.load(relaxed), static_cast<std::uint32_t>(bytes)), relaxed);
}

nlohmann::json SimulationEnd::summary() const {
  const double span = 1e-9 * static_cast<double>(last_sent_ns_.load(relaxed) - first_sent_ns_.load(relaxed));
  const auto bytes = static_cast<double>(bytes_.load(relaxed));
  nlohmann::json patches = nlohmann::json::array();
  for (std::size_t k = 0; k < sizes_.size(); ++k)
    if (const PatchSize& s = sizes_[k]; s.count.load(relaxed) > 0)
      patches.push_back({{"nodes_from", 10 * k},
                         {"count", s.count.load(relaxed)},
                         {"samples_max", s.samples.load(relaxed)},
                         {"bytes_max", s.bytes.load(relaxed)}});
  return {{"problems_sent", sent_.load(relaxed)},
          {"bytes_sent", bytes_.load(relaxed)},
          {"mbit_per_s", span > 0 ? 8e-6 * bytes / span : 0.0},
          {"patches", patches},
          {"hands_taken", taken_.load(relaxed)},
          {"hands_refused", refused_.load(relaxed)},
          {"other_edges", others_.load(relaxed)},
          {"edges", edges_.load(relaxed)}};
}

}  // namespace hapticd
