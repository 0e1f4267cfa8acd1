#include "server/edge/edge_end.h"

#include <algorithm>
#include <nlohmann/json.hpp>

#include "haptic/clock.h"
#include "server/dds/borrowed.h"
#include "server/observe/log.h"

namespace hapticd {
namespace {

constexpr auto relaxed = std::memory_order_relaxed;
constexpr std::int64_t period_ns = 1'000'000;  // of hands
constexpr std::int64_t say_every_ns = 10'000'000'000;
constexpr std::int64_t rival_stays_ns = 500'000'000;
constexpr std::int64_t still_heard_ns = 100'000'000;  // five steps of the simulation
// By so much more than the clocks' error may a problem come from the future: threads are put aside meanwhile.
constexpr std::int64_t ahead_ns = 1'000'000;

constexpr const char* reasons[] = {"version",    "counts", "unsound", "scene",
                                   "other_edge", "number", "clock",   "rival"};
constexpr const char* words[] = {
    "problems of another version of hapticd are refused: use one version on both machines",
    "malformed problems are refused",
    "unsound problems are refused",
    "the simulation runs another scene, or answers other devices: give both the same scene file (with "
    "`model: auto`, pin simulation.contact), and hapticd --edge-devices what haptic edge has as --devices",
    "the simulation has another edge: this one does not arm until that one is gone",
    "problems that come late or twice are refused",
    "problems from the future are refused: the clock of the simulation's machine was changed",
    "a second simulation writes this world's problems: nothing is armed while both are heard"};

}  // namespace

EdgeEnd::EdgeEnd(const Participant& participant, const LinkSettings& settings,
                 Channel<InstrumentInputs>& instruments, Channel<CondensedProblem>& problems,
                 Channel<InstrumentInputs>* others)
    : settings_(settings),
      edge_(own_number()),
      instruments_(instruments),
      problems_(problems),
      others_(others),
      problem_reader_(participant),
      clock_reader_(participant),
      hands_(participant),
      wait_(participant, problem_reader_.handle(), clock_reader_.handle()) {}

EdgeEnd::~EdgeEnd() { stop(); }

void EdgeEnd::start() {
  thread_.start(settings_, [this] { run(); });
}

void EdgeEnd::stop() noexcept { thread_.stop(); }

void EdgeEnd::run() {
  std::int64_t next = monotonic_ns();
  while (!thread_.stopping()) {
    wait_.until(next);
    const std::int64_t now = monotonic_ns();
    hear_clock(now);
    hear_problems(now);
    if (now >= next) {
      send_hands(now);
      next = std::max(next + period_ns, now);
    }
    turns_.fetch_add(1, relaxed);
  }
}

void EdgeEnd::hear_clock(std::int64_t now_ns) {
  clock_reader_.take_each([&](const hapticd_msg_EdgeClock& m, const dds_sample_info_t&) {
    if (m.world != settings_.world || m.version != edge_version || m.edge != edge_) return;
    if (simulation_ != 0 && m.simulation != simulation_) return;
    if (clock_.note({m.sent_ns, m.received_ns, m.answered_ns, now_ns})) {
      offset_ns_.store(clock_.ns(), relaxed);
      round_trip_ns_.store(clock_.round_trip_ns(), relaxed);
    }
    if (others_ && simulation_ != 0 && clock_.known() && m.number > newest_answer_) hear_others(m, now_ns);
  });
  clock_known_.store(clock_.known(), relaxed);
  error_ns_.store(clock_.known() ? clock_.error_ns(now_ns) : 0, relaxed);
}

// Those that are no hands change nothing.
void EdgeEnd::hear_others(const hapticd_msg_EdgeClock& m, std::int64_t now_ns) {
  const std::span<const hapticd_msg_EdgeHand> hands{m.hands._buffer, m.hands._length};
  if (!are_hands(hands, settings_.instruments)) return;
  newest_answer_ = m.number;
  InstrumentInputs& all = others_->back() = read_hands(hands, clock_.ours(0), now_ns);
  for (int i = 0; i < settings_.instruments; ++i)
    if (!settings_.at_simulation[i]) all[i] = {};
  others_->publish();
}

void EdgeEnd::hear_problems(std::int64_t now_ns) {
  problem_reader_.take_each([&](const hapticd_msg_EdgeProblem& m, const dds_sample_info_t& info) {
    if (m.world != settings_.world) return;
    if (!keep(m.simulation, info.publication_handle, now_ns)) {
      // One whose predecessor has fallen silent takes its place soon; two that are heard are rivals.
      if (now_ns - heard_ns_ < still_heard_ns) rival_ns_.store(now_ns, relaxed);
      refuse(Refusal::rival, now_ns);
    } else if (const std::optional<Refusal> why = take(m, now_ns)) {
      refuse(*why, now_ns);
    }
  });
}

// Whether the simulation is the one that is kept, which it becomes when there is none.
bool EdgeEnd::keep(std::uint64_t simulation, dds_instance_handle_t writer, std::int64_t now_ns) {
  if (writer_ == 0 || (writer != writer_ && now_ns - heard_ns_ >= edge_stays_ns)) {
    // Another machine may have another clock.
    if (simulation != simulation_) clock_.forget();
    writer_ = writer;
    simulation_ = simulation;
    newest_number_ = newest_answer_ = 0;
    simulations_.fetch_add(1, relaxed);
    log(LogLevel::info, "simulation", "a simulation is heard for device " + std::to_string(settings_.world),
        {{"device", settings_.world}});
  }
  if (writer != writer_ || simulation != simulation_) return false;
  heard_ns_ = now_ns;
  return true;
}

std::optional<EdgeEnd::Refusal> EdgeEnd::take(const hapticd_msg_EdgeProblem& m, std::int64_t now_ns) {
  if (m.version != edge_version) return Refusal::version;
  if (m.scene != settings_.scene) return Refusal::scene;
  if (m.edge != edge_) return Refusal::other_edge;
  if (m.number <= newest_number_) return Refusal::number;
  if (!clock_.known()) return Refusal::clock;
  CondensedProblem& problem = problems_.back();
  switch (read_problem(m, settings_.instruments, problem)) {
    case ProblemFault::none:
      break;
    case ProblemFault::version:
      return Refusal::version;
    case ProblemFault::counts:
      return Refusal::counts;
    case ProblemFault::unsound:
      return Refusal::unsound;
  }
  const std::int64_t published = clock_.ours(m.published_ns);
  if (published > now_ns + clock_.error_ns(now_ns) + ahead_ns) return Refusal::clock;
  problem.published_ns = std::min(published, now_ns);
  // A simulation that starts again counts from one; the haptic loop knows problems by rising numbers.
  passed_on_ += m.number - newest_number_;
  newest_number_ = m.number;
  problem.step = passed_on_;
  problem.known_sound = true;  // read_problem looked
  problems_.publish();
  taken_.fetch_add(1, relaxed);
  delay_.record(now_ns - problem.published_ns);
  return {};
}

void EdgeEnd::refuse(Refusal why, std::int64_t now_ns) {
  const auto k = static_cast<std::size_t>(why);
  refused_[k].fetch_add(1, relaxed);
  // Those before the first round trip, and what a network does.
  if (why == Refusal::number || (why == Refusal::clock && !clock_.known())) return;
  if (said_ns_[k] != 0 && now_ns - said_ns_[k] < say_every_ns) return;
  said_ns_[k] = now_ns;
  log(LogLevel::warning, std::string("problem_refused"), words[k], {{"why", reasons[k]}});
}

void EdgeEnd::send_hands(std::int64_t now_ns) {
  instruments_.acquire();
  hapticd_msg_EdgeHands m{};
  std::vector<hapticd_msg_EdgeHand> hands;
  m.world = settings_.world;
  m.version = edge_version;
  m.edge = edge_;
  m.number = ++hands_number_;
  for (int i = 0; clock_.known() && i < settings_.instruments; ++i) {
    const InstrumentInput& in = instruments_.front()[i];
    hands.push_back(hand_message(in, !settings_.at_simulation[i], clock_.ours(0), now_ns));
  }
  m.hands = borrowed<decltype(m.hands)>(hands);
  m.sent_ns = monotonic_ns();
  hands_.write(m);
  sent_.fetch_add(1, relaxed);
}

bool EdgeEnd::rival(std::int64_t now_ns) const noexcept {
  const std::int64_t came = rival_ns_.load(relaxed);
  return came != 0 && now_ns - came < rival_stays_ns;
}

nlohmann::json EdgeEnd::summary() const {
  const HistogramSnapshot delay = delay_.snapshot();
  nlohmann::json refused = nlohmann::json::object();
  for (std::size_t k = 0; k < refused_.size(); ++k) refused[reasons[k]] = refused_[k].load(relaxed);
  return {{"problems_taken", taken_.load(relaxed)},
          {"problems_refused", refused},
          {"link_delay_ms",
           {{"p50", 1e-6 * delay.percentile(50)},
            {"p99", 1e-6 * delay.percentile(99)},
            {"max", 1e-6 * static_cast<double>(delay.max)}}},
          {"clock",
           {{"known", clock_known_.load(relaxed)},
            {"offset_ms", 1e-6 * static_cast<double>(offset_ns_.load(relaxed))},
            {"error_ms", 1e-6 * static_cast<double>(error_ns_.load(relaxed))},
            {"round_trip_ms", 1e-6 * static_cast<double>(round_trip_ns_.load(relaxed))}}},
          {"simulations", simulations_.load(relaxed)},
          {"hands_sent", sent_.load(relaxed)}};
}

}  // namespace hapticd
