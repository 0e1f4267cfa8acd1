// A problem that crosses a network is the same to single precision, or it is refused.
#include "server/edge/edge_problem.h"

#include <functional>
#include <limits>

#include <gtest/gtest.h>

#include "haptic/contact/problem_check.h"
#include "tests/support/contact_problems.h"
#include "tests/support/malloc_guard.h"

namespace hapticd {
namespace {

constexpr float nan = std::numeric_limits<float>::quiet_NaN();

// A sheet with an obstacle beside it, edges of a blade, and suction.
std::unique_ptr<CondensedProblem> whole_problem() {
  Random random(3);
  auto p = sheet_problem(random, {.nodes = 7, .per_triangle = 4, .friction = 0.3});
  p->step = 17;
  p->published_ns = 123'456'789;
  p->topology_changed = p->thinned = true;
  p->dropped_samples = 5;
  p->alarm_distance = 0.8e-3;
  for (int k = 0; k < 9; ++k) {
    PatchSample& s = p->sample[static_cast<std::size_t>(p->samples++)];
    s = {std::uint64_t(1) << 56 | std::uint64_t(4096 * (k / 3) + k),
         {-1, -1, -1},
         {1, 0, 0},
         Vec3(1e-3 * k, 2e-3, -1e-3),
         Vec3::UnitX(),
         0.1};
  }
  for (int n = 0; n < p->nodes; ++n) p->pull[static_cast<std::size_t>(n)] = 1e-3 * unit_vector(random);
  p->instrument[0].X_ref = {Vec3(1e-3, 2e-3, 3e-3), random_rotation(random)};
  p->instrument[0].coupling = {50, 1.25e-3, 2e-3};
  p->instrument[0].load << 1, 2, 3, 4, 5, 6;
  p->instrument[0].way << 6, 5, 4, 3, 2, 1;
  for (int k = 0; k < 2; ++k)
    p->edge[static_cast<std::size_t>(k)] = {
        edge_id(0, k), 0,   0,  {6, 7, 11, 12}, {0.2, 0.3, 0.4, 0.1}, Vec3::UnitX(), -Vec3::UnitZ(),
        0.1,           0.2, 0.3};
  p->edges = 2;
  return p;
}

double relative(double a, double b) { return std::abs(a - b) / std::max(std::abs(b), 1e-300); }

TEST(EdgeProblem, ArrivesAsItWasToSinglePrecision) {
  constexpr double single = 1.2e-7;
  const auto sent = whole_problem();
  auto got = std::make_unique<CondensedProblem>();
  PackedProblem packed;
  ASSERT_EQ(read_problem(packed.pack(*sent, 1), 1, *got), ProblemFault::none);
  EXPECT_EQ(got->step, sent->step);
  EXPECT_EQ(got->published_ns, sent->published_ns);
  EXPECT_EQ(got->renewal, sent->renewal);
  EXPECT_EQ(got->topology_changed, sent->topology_changed);
  EXPECT_EQ(got->thinned, sent->thinned);
  EXPECT_EQ(got->dropped_samples, sent->dropped_samples);
  EXPECT_EQ(got->alarm_distance, sent->alarm_distance);
  ASSERT_EQ(got->nodes, sent->nodes);
  ASSERT_EQ(got->samples, sent->samples);
  ASSERT_EQ(got->edges, sent->edges);
  const double size = 16e-3;
  for (int n = 0; n < sent->nodes; ++n) {
    const auto k = static_cast<std::size_t>(n);
    EXPECT_LT((got->x_free[k] - sent->x_free[k]).norm(), single * size);
    EXPECT_LT((got->x_now[k] - sent->x_now[k]).norm(), single * size);
    EXPECT_LT((got->pull[k] - sent->pull[k]).norm(), single * 1e-3);
  }
  for (int k = 0; k < sent->samples; ++k) {
    const PatchSample &a = got->sample[static_cast<std::size_t>(k)],
                      &b = sent->sample[static_cast<std::size_t>(k)];
    EXPECT_EQ(a.id, b.id);
    EXPECT_EQ(a.node, b.node);
    if (b.node[0] < 0)
      EXPECT_LT((a.free - b.free).norm(), single * size);
    else
      for (int i = 0; i < 3; ++i) EXPECT_NEAR(a.weight[i], b.weight[i], 2 * single);
    EXPECT_LT((a.outward - b.outward).norm(), 2 * single);
    EXPECT_LT(relative(a.friction, b.friction), single);
  }
  for (int i = 0; i < 3 * sent->nodes; ++i)
    for (int j = 0; j < 3 * sent->nodes; ++j) {
      const double error = std::abs(got->C()(i, j) - 0.5 * (sent->C()(i, j) + sent->C()(j, i)));
      EXPECT_LE(error, (i == j ? 2 * single : 0.5 / 32767 + 2 * single) *
                           std::sqrt(sent->C()(i, i) * sent->C()(j, j)));
      EXPECT_EQ(got->C()(i, j), got->C()(j, i));
    }
  const InstrumentReference &a = got->instrument[0], &b = sent->instrument[0];
  EXPECT_EQ(a.X_ref.p, b.X_ref.p);
  EXPECT_EQ(a.X_ref.q.coeffs(), b.X_ref.q.coeffs());
  EXPECT_EQ(a.coupling.stiffness, b.coupling.stiffness);
  EXPECT_EQ(a.load, b.load);
  EXPECT_EQ(a.way, b.way);
  for (int k = 0; k < sent->edges; ++k) {
    const EdgeSample &e = got->edge[static_cast<std::size_t>(k)],
                     &f = sent->edge[static_cast<std::size_t>(k)];
    EXPECT_EQ(e.id, f.id);
    EXPECT_EQ(e.node, f.node);
    EXPECT_EQ(e.weight, f.weight);
    EXPECT_EQ(e.place, f.place);
    EXPECT_EQ(e.viscosity, f.viscosity);
  }
}

TEST(EdgeProblem, TheLargestThatThereIsFits) {
  Random random(1);
  auto p = sheet_problem(random, {.nodes = 13});  // 169
  p->step = 1;
  ASSERT_LE(p->nodes, max_patch_nodes);
  p->samples = max_patch_samples;
  for (int k = 0; k < max_patch_samples; ++k) {
    PatchSample& s = p->sample[static_cast<std::size_t>(k)];
    s = p->sample[0];
    s.id = std::uint64_t(k) << 20;  // each a face of its own
  }
  auto got = std::make_unique<CondensedProblem>();
  PackedProblem packed;
  EXPECT_EQ(read_problem(packed.pack(*p, 1), 1, *got), ProblemFault::none);
}

TEST(EdgeProblem, ReadingAllocatesNothing) {
  const auto sent = whole_problem();
  auto got = std::make_unique<CondensedProblem>();
  PackedProblem packed;
  const hapticd_msg_EdgeProblem& m = packed.pack(*sent, 1);
  if (!MallocGuard::available()) GTEST_SKIP() << "no malloc guard in this build";
  const MallocGuard guard;
  read_problem(m, 1, *got);
  EXPECT_EQ(guard.allocations(), 0);
}

struct Malformed {
  const char* name;
  ProblemFault fault;
  std::function<void(hapticd_msg_EdgeProblem&)> make;
};

using M = hapticd_msg_EdgeProblem;
const Malformed malformed[] = {
    {"version", ProblemFault::version, [](M& m) { ++m.version; }},
    {"number", ProblemFault::counts, [](M& m) { m.number = 0; }},
    {"nodes", ProblemFault::counts, [](M& m) { ++m.nodes; }},
    {"many nodes", ProblemFault::counts, [](M& m) { m.nodes = 193; }},
    {"instruments", ProblemFault::counts, [](M& m) { m.instruments._length = 2; }},
    {"no instrument", ProblemFault::counts, [](M& m) { m.instruments._length = 0; }},
    {"positions", ProblemFault::counts, [](M& m) { --m.positions._length; }},
    {"pull", ProblemFault::counts, [](M& m) { --m.pull._length; }},
    {"compliance", ProblemFault::counts, [](M& m) { --m.shared._length; }},
    {"compliance's diagonal", ProblemFault::counts, [](M& m) { --m.own._length; }},
    {"compliance nowhere", ProblemFault::counts, [](M& m) { m.shared._buffer = nullptr; }},
    {"many edges", ProblemFault::counts, [](M& m) { m.edges._length = 33; }},
    {"many samples", ProblemFault::counts, [](M& m) { m.offsets._length = 2049; }},
    {"samples fewer", ProblemFault::counts, [](M& m) { --m.offsets._length; }},
    {"places fewer", ProblemFault::counts, [](M& m) { --m.places._length; }},
    {"a face fewer", ProblemFault::counts, [](M& m) { --m.faces._length; }},
    {"a face's samples", ProblemFault::counts, [](M& m) { m.faces._buffer[0].samples = 65535; }},
    {"no face's samples", ProblemFault::counts, [](M& m) { m.faces._buffer[1].samples = 0; }},
    {"a face that is none", ProblemFault::counts, [](M& m) { m.faces._buffer[0].node[0] = 255; }},
    {"ids not in order", ProblemFault::counts, [](M& m) { m.faces._buffer[1].first_id = 0; }},
    {"an id twice", ProblemFault::counts, [](M& m) { m.offsets._buffer[1] = m.offsets._buffer[0]; }},
    {"a node that is none", ProblemFault::unsound, [](M& m) { m.faces._buffer[0].node[1] = 200; }},
    {"an edge's node", ProblemFault::unsound, [](M& m) { m.edges._buffer[0].node[2] = 254; }},
    {"an edge's instrument", ProblemFault::unsound, [](M& m) { m.edges._buffer[0].instrument = 9; }},
    {"a weight", ProblemFault::unsound, [](M& m) { m.places._buffer[0] = nan; }},
    {"a position", ProblemFault::unsound, [](M& m) { m.positions._buffer[4] = nan; }},
    {"pull nan", ProblemFault::unsound, [](M& m) { m.pull._buffer[1] = nan; }},
    {"origin", ProblemFault::unsound, [](M& m) { m.origin[1] = std::numeric_limits<double>::infinity(); }},
    {"compliance nan", ProblemFault::unsound, [](M& m) { m.own._buffer[7] = nan; }},
    {"compliance infinite", ProblemFault::unsound,
     [](M& m) { m.own._buffer[7] = std::numeric_limits<float>::infinity(); }},
    {"compliance negative", ProblemFault::unsound, [](M& m) { m.own._buffer[0] *= -1; }},
    {"coupling", ProblemFault::unsound, [](M& m) { m.instruments._buffer[0].stiffness = -1; }},
    {"orientation", ProblemFault::unsound, [](M& m) { m.instruments._buffer[0].orientation[3] += 1; }},
    {"load", ProblemFault::unsound, [](M& m) { m.instruments._buffer[0].load[5] = nan; }},
    {"way", ProblemFault::unsound, [](M& m) { m.instruments._buffer[0].way[2] = nan; }},
    {"friction", ProblemFault::unsound, [](M& m) { m.faces._buffer[0].friction = -0.1f; }},
    {"outward", ProblemFault::unsound, [](M& m) { m.faces._buffer[0].outward[2] = 3; }},
    {"instruments' friction", ProblemFault::unsound, [](M& m) { m.instrument_friction = -1; }},
    {"alarm distance", ProblemFault::unsound,
     [](M& m) { m.alarm_distance = std::numeric_limits<double>::quiet_NaN(); }},
};

TEST(EdgeProblem, MalformedIsRefused) {
  const auto sent = whole_problem();
  auto got = std::make_unique<CondensedProblem>();
  for (const Malformed& how : malformed) {
    PackedProblem packed;
    M& m = packed.pack(*sent, 1);
    ASSERT_EQ(read_problem(m, 1, *got), ProblemFault::none);
    how.make(m);
    EXPECT_EQ(read_problem(m, 1, *got), how.fault) << how.name;
  }
}

TEST(EdgeProblem, AComplianceThatIsNoNumberIsSentAsOneThatIsRefused) {
  auto got = std::make_unique<CondensedProblem>();
  for (const double none :
       {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity()})
    for (const auto& [i, j] : {std::pair(0, 0), {4, 4}, {4, 1}, {1, 4}}) {
      auto sent = whole_problem();
      sent->C()(i, j) = none;
      PackedProblem packed;
      EXPECT_EQ(read_problem(packed.pack(*sent, 1), 1, *got), ProblemFault::unsound) << none << i << j;
    }
  // Nodes that are fixed move not at all.
  auto sent = whole_problem();
  sent->C().topRows(3).setZero();
  sent->C().leftCols(3).setZero();
  PackedProblem packed;
  ASSERT_EQ(read_problem(packed.pack(*sent, 1), 1, *got), ProblemFault::none);
  EXPECT_TRUE(got->C().topRows(3).isZero(0));
}

// Bits turned at random, where the wire has them: what is let through is sound.
TEST(EdgeProblem, WhateverIsReadIsSound) {
  Random random(11);
  const auto sent = whole_problem();
  auto got = std::make_unique<CondensedProblem>();
  int let_through = 0, refused = 0;
  PackedProblem packed;
  for (int run = 0; run < 3000; ++run) {
    M& m = packed.pack(*sent, 1);
    const auto turn = [&](void* begin, std::size_t bytes) {
      if (bytes == 0) return;
      std::uint8_t& byte = static_cast<std::uint8_t*>(begin)[random() % bytes];
      byte = static_cast<std::uint8_t>(byte ^ 1u << (random() % 8));
    };
    const auto in = [&](auto& sequence) {
      turn(sequence._buffer, sequence._length * sizeof *sequence._buffer);
    };
    for (std::uint64_t k = 0; k < 1 + random() % 3; ++k) switch (random() % 9) {
        case 0:
          in(m.instruments);
          break;
        case 1:
          in(m.positions);
          break;
        case 2:
          in(m.pull);
          break;
        case 3:
          in(m.faces);
          break;
        case 4:
          in(m.offsets);
          break;
        case 5:
          in(m.places);
          break;
        case 6:
          in(m.edges);
          break;
        case 7:
          in(m.own);
          break;
        default:
          in(m.shared);
      }
    const bool read = read_problem(m, 1, *got) == ProblemFault::none;
    ++(read ? let_through : refused);
    if (read) {
      EXPECT_TRUE(is_sound(*got));
    }
  }
  EXPECT_GT(let_through, 100);
  EXPECT_GT(refused, 100);
}

}  // namespace
}  // namespace hapticd
