// Both ends of a link over Cyclone, in one process, on loopback: what reaches the haptic loop, and what never
// does.
#include <unistd.h>

#include <chrono>
#include <functional>
#include <thread>

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "haptic/clock.h"
#include "server/edge/edge_end.h"
#include "server/edge/simulation_end.h"
#include "tests/support/contact_problems.h"

namespace hapticd {
namespace {

constexpr std::int64_t ms = 1'000'000;
const LinkSettings settings{.world = 3, .scene = 99, .instruments = 1, .keep_off = {}};

void pause(int milliseconds) { std::this_thread::sleep_for(std::chrono::milliseconds(milliseconds)); }

bool soon(const std::function<bool()>& done) {
  for (int i = 0; i < 5000; ++i, pause(1))
    if (done()) return true;
  return false;
}

std::unique_ptr<CondensedProblem> some_problem() {
  Random random(3);
  return sheet_problem(random, {});
}

// The simulation's half: its channels and its end.
struct Simulation {
  Participant participant;
  Channel<CondensedProblem> copies;
  Channel<InstrumentInputs> inputs, own;
  SimulationEnd end;
  std::uint64_t number = 0;

  explicit Simulation(const Domain& domain, const LinkSettings& of = settings)
      : participant(domain), end(participant, of, copies, inputs, of.at_simulation[0] ? &own : nullptr) {
    end.start();
  }
  void publish() {
    copy_in_use(*some_problem(), copies.back());
    copies.back().step = ++number;
    copies.back().published_ns = monotonic_ns();
    copies.publish();
  }
  std::uint64_t figure(const char* name) const { return end.summary().at(name).get<std::uint64_t>(); }
};

struct Edge {
  Participant participant;
  Channel<InstrumentInputs> inputs, others;
  Channel<CondensedProblem> problems;
  EdgeEnd end;

  explicit Edge(const Domain& domain, const LinkSettings& of = settings)
      : participant(domain), end(participant, of, inputs, problems, &others) {
    end.start();
  }
  void hold(const Vec3& p, std::int64_t age_ns = 0) {
    InstrumentInput& in = inputs.back()[0];
    in.present = true;
    in.X.p = p;
    in.received_ns = monotonic_ns() - age_ns;
    in.sequence = 5;
    in.buttons = pedal_phaco;
    inputs.publish();
  }
  std::uint64_t refused(const char* why) const {
    return end.summary().at("problems_refused").at(why).get<std::uint64_t>();
  }
  std::uint64_t taken() const { return end.summary().at("problems_taken").get<std::uint64_t>(); }
};

// A writer that says what it likes.
struct Liar {
  Participant participant;
  Writer<hapticd_msg_EdgeProblem> problems;
  Writer<hapticd_msg_EdgeHands> hands;
  Writer<hapticd_msg_EdgeClock> clock;
  PackedProblem packed;

  explicit Liar(const Domain& domain)
      : participant(domain), problems(participant), hands(participant), clock(participant) {}
};

struct EdgeLink : testing::Test {
  Domain domain{static_cast<std::uint32_t>(getpid()) % 200, read_dds_profile("loopback")};

  // Whether a problem comes through in the next seconds, one being published every few milliseconds.
  static bool passes(Simulation& simulation, Edge& edge) {
    const std::uint64_t before = edge.taken();
    return soon([&] {
      simulation.publish();
      pause(2);
      return edge.taken() > before + 2;
    });
  }
};

TEST_F(EdgeLink, AProblemArrivesWithItsAge) {
  Simulation simulation(domain);
  Edge edge(domain);
  ASSERT_TRUE(passes(simulation, edge));
  ASSERT_TRUE(edge.problems.acquire());
  const std::int64_t begun = monotonic_ns();
  simulation.publish();
  ASSERT_TRUE(
      soon([&] { return edge.problems.acquire() && edge.problems.front().published_ns >= begun - ms; }));
  // One machine has one clock: the bound is what its round trip is off by.
  const auto clock = edge.end.summary().at("clock");
  EXPECT_LE(std::abs(clock.at("offset_ms").get<double>()), clock.at("error_ms").get<double>() + 1e-3);
  EXPECT_LE(edge.problems.front().published_ns, monotonic_ns());
  EXPECT_EQ(edge.problems.front().nodes, some_problem()->nodes);
}

TEST_F(EdgeLink, HandsArriveInTheSimulationsTimeAndGoWithSilence) {
  Simulation simulation(domain);
  Edge edge(domain);
  ASSERT_TRUE(soon([&] { return edge.end.summary().at("clock").at("known").get<bool>(); }));
  edge.hold(Vec3(1, 2, 3));
  ASSERT_TRUE(soon([&] { return simulation.inputs.acquire() && simulation.inputs.front()[0].present; }));
  const InstrumentInput in = simulation.inputs.front()[0];
  EXPECT_EQ(in.X.p, Vec3(1, 2, 3));
  EXPECT_EQ(in.sequence, 5u);
  EXPECT_EQ(in.buttons, std::uint32_t{pedal_phaco});
  EXPECT_NEAR(1e-6 * static_cast<double>(in.received_ns), 1e-6 * static_cast<double>(monotonic_ns()), 100);
  edge.end.stop();
  EXPECT_TRUE(soon([&] { return simulation.inputs.acquire() && !simulation.inputs.front()[0].present; }));
}

// A mentor's edge: device 1 is answered there, device 0 beside the simulation.
TEST_F(EdgeLink, EachSideHearsTheHandsOfTheOther) {
  LinkSettings both = settings;
  both.instruments = 2;
  both.at_simulation[0] = true;
  Simulation simulation(domain, both);
  Edge edge(domain, both);
  const auto hold = [](Channel<InstrumentInputs>& inputs, const Vec3& p) {
    for (int i = 0; i < 2; ++i) {
      InstrumentInput& in = inputs.back()[i];
      in.present = true;
      in.X.p = p;
      in.received_ns = monotonic_ns();
    }
    inputs.publish();
  };
  ASSERT_TRUE(soon([&] {
    simulation.publish();
    hold(simulation.own, Vec3(1, 2, 3));
    hold(edge.inputs, Vec3(4, 5, 6));
    simulation.inputs.acquire();
    edge.others.acquire();
    return simulation.inputs.front()[1].present && edge.others.front()[0].present;
  }));
  EXPECT_EQ(edge.others.front()[0].X.p, Vec3(1, 2, 3));
  EXPECT_EQ(simulation.inputs.front()[1].X.p, Vec3(4, 5, 6));
  // Neither is told of its own.
  EXPECT_FALSE(edge.others.front()[1].present);
  EXPECT_FALSE(simulation.inputs.front()[0].present);
  // A hand whose loop stands is not told of for long, though its link goes on.
  EXPECT_TRUE(soon([&] {
    hold(edge.inputs, Vec3(4, 5, 6));
    edge.others.acquire();
    return !edge.others.front()[0].present;
  }));
  EXPECT_TRUE(simulation.inputs.acquire() && simulation.inputs.front()[1].present);
}

TEST_F(EdgeLink, AHandOfA100MillisecondsAgoIsThereWithItsAge) {
  Simulation simulation(domain);
  Liar liar(domain);
  hapticd_msg_EdgeHand hand{};
  hand.present = true;
  hand.orientation[3] = 1;
  hapticd_msg_EdgeHands m{};
  m.world = settings.world;
  m.version = edge_version;
  m.edge = 12;
  m.hands._buffer = &hand;
  m.hands._length = m.hands._maximum = 1;
  EXPECT_TRUE(soon([&] {
    ++m.number;
    m.sent_ns = monotonic_ns();
    hand.received_ns = m.sent_ns - 100 * ms;
    liar.hands.write(m);
    return simulation.inputs.acquire() && simulation.inputs.front()[0].present;
  }));
  const std::int64_t age = monotonic_ns() - simulation.inputs.front()[0].received_ns;
  EXPECT_GE(age, 100 * ms);
  EXPECT_LE(age, 200 * ms);
}

TEST_F(EdgeLink, AnotherScenesProblemsAreRefused) {
  LinkSettings other = settings;
  other.scene = 98;
  Simulation simulation(domain, other);
  Edge edge(domain);
  EXPECT_TRUE(soon([&] {
    simulation.publish();
    pause(2);
    return edge.refused("scene") > 0;
  }));
  EXPECT_EQ(edge.taken(), 0u);
}

TEST_F(EdgeLink, OfTwoEdgesTheFirstHasTheWorldAndTheOtherNoProblem) {
  Simulation simulation(domain);
  Edge first(domain);
  ASSERT_TRUE(passes(simulation, first));
  Edge second(domain);
  EXPECT_TRUE(soon([&] {
    simulation.publish();
    pause(2);
    return second.refused("other_edge") > 0;
  }));
  EXPECT_EQ(second.taken(), 0u);
  EXPECT_TRUE(soon([&] { return simulation.figure("other_edges") > 0; }));
  // With the first gone, silent for half a second, the second has it.
  first.end.stop();
  EXPECT_TRUE(passes(simulation, second));
}

TEST_F(EdgeLink, OfTwoSimulationsTheFirstIsHeardAndTheOtherIsARival) {
  Simulation simulation(domain);
  Edge edge(domain);
  ASSERT_TRUE(passes(simulation, edge));
  EXPECT_FALSE(edge.end.rival(monotonic_ns()));
  Simulation second(domain);
  EXPECT_TRUE(soon([&] {
    simulation.publish();
    second.publish();
    pause(2);
    return edge.end.rival(monotonic_ns());
  }));
  EXPECT_GT(edge.refused("rival"), 0u);
}

TEST_F(EdgeLink, ASimulationThatBeginsAgainCountsOn) {
  Simulation simulation(domain);
  Edge edge(domain);
  ASSERT_TRUE(passes(simulation, edge));
  ASSERT_TRUE(edge.problems.acquire());
  const std::uint64_t before = edge.problems.front().step;
  simulation.number = 0;
  ASSERT_TRUE(passes(simulation, edge));
  ASSERT_TRUE(edge.problems.acquire());
  EXPECT_GT(edge.problems.front().step, before);
}

struct LyingSimulation : EdgeLink {
  Edge edge{domain};
  Liar liar{domain};
  Reader<hapticd_msg_EdgeHands> listener{liar.participant};
  std::uint64_t edge_number = 0;
  std::int64_t ahead_ns = 0;  // of its clock

  // Answers hands as a simulation does, and sends a problem edited so.
  void turn(const std::function<void(hapticd_msg_EdgeProblem&)>& edit) {
    listener.take_each([&](const hapticd_msg_EdgeHands& m, const dds_sample_info_t&) {
      edge_number = m.edge;
      hapticd_msg_EdgeClock c{};
      c.world = settings.world;
      c.version = edge_version;
      c.simulation = 7;
      c.edge = m.edge;
      c.number = m.number;
      c.sent_ns = m.sent_ns;
      c.received_ns = c.answered_ns = monotonic_ns() + ahead_ns;
      liar.clock.write(c);
    });
    auto problem = some_problem();
    problem->step = ++number_;
    problem->published_ns = monotonic_ns() + ahead_ns;
    hapticd_msg_EdgeProblem& m = liar.packed.pack(*problem, 1);
    m.world = settings.world;
    m.scene = settings.scene;
    m.simulation = 7;
    m.edge = edge_number;
    edit(m);
    liar.problems.write(m);
    pause(2);
  }
  bool refuses(const char* why, const std::function<void(hapticd_msg_EdgeProblem&)>& edit) {
    const std::uint64_t before = edge.refused(why), taken = edge.taken();
    const bool refused = soon([&] {
      turn(edit);
      return edge.refused(why) > before + 3;
    });
    EXPECT_EQ(edge.taken(), taken) << why;
    return refused;
  }

 private:
  std::uint64_t number_ = 0;
};

TEST_F(LyingSimulation, NothingMalformedStaleOrForeignReachesTheLoop) {
  const auto honest = [](hapticd_msg_EdgeProblem&) {};
  ASSERT_TRUE(soon([&] {
    turn(honest);
    return edge.taken() > 0;
  }));
  EXPECT_TRUE(refuses("version", [](hapticd_msg_EdgeProblem& m) { ++m.version; }));
  EXPECT_TRUE(refuses("counts", [](hapticd_msg_EdgeProblem& m) { ++m.nodes; }));
  EXPECT_TRUE(refuses("unsound", [](hapticd_msg_EdgeProblem& m) { m.own._buffer[0] = -1; }));
  EXPECT_TRUE(refuses("scene", [](hapticd_msg_EdgeProblem& m) { ++m.scene; }));
  EXPECT_TRUE(refuses("other_edge", [](hapticd_msg_EdgeProblem& m) { ++m.edge; }));
  EXPECT_TRUE(refuses("number", [](hapticd_msg_EdgeProblem& m) { m.number = 1; }));
  EXPECT_TRUE(refuses("clock", [](hapticd_msg_EdgeProblem& m) { m.published_ns += 5'000 * ms; }));
  EXPECT_TRUE(refuses("rival", [](hapticd_msg_EdgeProblem& m) { ++m.simulation; }));
  EXPECT_TRUE(soon([&] {
    const std::uint64_t before = edge.taken();
    turn(honest);
    return edge.taken() > before;
  }));
}

TEST_F(LyingSimulation, AnOldProblemIsPassedOnWithItsAge) {
  ahead_ns = 3'600'000 * ms;  // another machine's clock
  ASSERT_TRUE(soon([&] {
    turn([](hapticd_msg_EdgeProblem& m) { m.published_ns -= 150 * ms; });
    return edge.taken() > 3;
  }));
  ASSERT_TRUE(edge.problems.acquire());
  const std::int64_t age = monotonic_ns() - edge.problems.front().published_ns;
  EXPECT_GE(age, 149 * ms);  // the safety table goes by this
  EXPECT_LE(age, 1000 * ms);
}

TEST_F(EdgeLink, HandsThatAreNoneChangeNothing) {
  Simulation simulation(domain);
  Liar liar(domain);
  hapticd_msg_EdgeHand hand{};
  std::uint64_t number = 0;
  const auto send = [&](const std::function<void(hapticd_msg_EdgeHands&)>& edit) {
    hand = {};
    hand.present = true;
    hand.orientation[3] = 1;
    hand.position[0] = 0.5;
    hapticd_msg_EdgeHands m{};
    m.world = settings.world;
    m.version = edge_version;
    m.edge = 12;
    m.number = ++number;
    hand.received_ns = m.sent_ns = monotonic_ns();
    m.hands._buffer = &hand;
    m.hands._length = m.hands._maximum = 1;
    edit(m);
    liar.hands.write(m);
    pause(1);
  };
  const auto honest = [](hapticd_msg_EdgeHands&) {};
  ASSERT_TRUE(soon([&] {
    send(honest);
    return simulation.inputs.acquire() && simulation.inputs.front()[0].present;
  }));
  const std::function<void(hapticd_msg_EdgeHands&)> lies[] = {
      [](hapticd_msg_EdgeHands& m) { ++m.version; },
      [](hapticd_msg_EdgeHands& m) { m.hands._buffer[0].position[1] = std::nan(""); },
      [](hapticd_msg_EdgeHands& m) { m.hands._buffer[0].position[1] = 1e9; },
      [](hapticd_msg_EdgeHands& m) { m.hands._buffer[0].orientation[0] = 2; },
      [](hapticd_msg_EdgeHands& m) { m.hands._buffer[0].vacuum = -1; },
      [](hapticd_msg_EdgeHands& m) { m.number = 1; },
      [](hapticd_msg_EdgeHands& m) { ++m.edge; },
  };
  for (const auto& lie : lies) {
    const std::uint64_t refused = simulation.figure("hands_refused");
    EXPECT_TRUE(soon([&] {
      send([&](hapticd_msg_EdgeHands& m) {
        m.hands._buffer[0].position[0] = 0.7;
        lie(m);
      });
      return simulation.figure("hands_refused") > refused;
    }));
    simulation.inputs.acquire();
    EXPECT_NE(simulation.inputs.front()[0].X.p.x(), 0.7);
  }
  // An hour old, or from the future: nobody is there, or there now.
  EXPECT_TRUE(soon([&] {
    send([](hapticd_msg_EdgeHands& m) { m.hands._buffer[0].received_ns -= 3'600'000 * ms; });
    return simulation.inputs.acquire() && !simulation.inputs.front()[0].present;
  }));
  EXPECT_TRUE(soon([&] {
    send([](hapticd_msg_EdgeHands& m) { m.hands._buffer[0].received_ns += 3'600'000 * ms; });
    return simulation.inputs.acquire() && simulation.inputs.front()[0].present;
  }));
  EXPECT_LE(simulation.inputs.front()[0].received_ns, monotonic_ns());
}

}  // namespace
}  // namespace hapticd
