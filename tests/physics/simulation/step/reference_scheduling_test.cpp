// Reference factors are asked for one at a time, and come into use where they still fit.
#include "physics/simulation/step/reference_scheduling.h"

#include <gtest/gtest.h>

#include "tests/support/mesh_shapes.h"

namespace hapticd {
namespace {

constexpr double h = 0.02;

class Scheduling : public testing::Test {
 protected:
  Scheduling() {
    BodySettings b{"block", true, box_mesh(Vec3(0.02, 0.02, 0.02), 3, 3, 3), {5000, 0.4, 1000, 5, 0.002}, {},
                   0,       true};
    b.fixed_nodes = b.mesh.group("bottom")->nodes;
    ComplianceOptions options;
    options.synchronous_reference = false;
    bodies.emplace_back(std::move(b), h, Vec3::Zero(), ComplianceMethod::zone, options);
    bodies[0].compliance->move_zone(std::vector<int>{20, 21, 22});
    bodies[0].compliance->update(bodies[0].state);
  }

  void end_steps(int count) {
    for (int i = 0; i < count; ++i) scheduling.end_step(0, false);
  }
  // Asked for, made, and handed back `steps` later.
  void hand_back(int steps) {
    scheduling.want(0);
    std::vector<ReferenceJob> jobs = scheduling.wanted(bodies);
    ASSERT_EQ(jobs.size(), 1u);
    jobs[0].reference->make();
    end_steps(steps);
    scheduling.adopt(std::move(jobs[0]));
  }

  Bodies bodies;
  ReferenceScheduling scheduling{1};
};

TEST_F(Scheduling, OneAtATimeAndTwoStepsApart) {
  scheduling.want(0);
  EXPECT_TRUE(scheduling.wanted(bodies).empty()) << "the first steps after the start are a rest, too";
  end_steps(2);
  hand_back(7);
  scheduling.want(0);
  EXPECT_TRUE(scheduling.wanted(bodies).empty()) << "one is under way";
  EXPECT_EQ(scheduling.take_over(bodies), 1);
  EXPECT_EQ(scheduling.progress(0).last_steps, 7);
  EXPECT_TRUE(scheduling.wanted(bodies).empty());
  end_steps(1);
  EXPECT_TRUE(scheduling.wanted(bodies).empty());
  end_steps(1);
  EXPECT_EQ(scheduling.wanted(bodies).size(), 1u);
}

TEST_F(Scheduling, WhatAStepOvertookIsDropped) {
  end_steps(2);
  hand_back(3);
  scheduling.made_by_step(0);
  EXPECT_EQ(scheduling.take_over(bodies), 0);
  EXPECT_FALSE(scheduling.progress(0).under_way || scheduling.progress(0).outdated);
}

TEST_F(Scheduling, OneThatFailedIsAskedForAgain) {
  end_steps(2);
  scheduling.want(0);
  std::vector<ReferenceJob> jobs = scheduling.wanted(bodies);
  jobs[0].failed = true;
  scheduling.adopt(std::move(jobs[0]));
  EXPECT_EQ(scheduling.take_over(bodies), 0);
  EXPECT_FALSE(scheduling.progress(0).under_way);
  for (int i = 0; i < 2; ++i) scheduling.end_step(0, true);
  EXPECT_EQ(scheduling.wanted(bodies).size(), 1u);
}

TEST_F(Scheduling, ThatOfABodyAsleepWaitsUntilItWakes) {
  end_steps(2);
  hand_back(3);
  bodies[0].asleep = bodies[0].free.ahead = true;
  EXPECT_EQ(scheduling.take_over(bodies), 0);
  EXPECT_TRUE(scheduling.progress(0).under_way && bodies[0].free.ahead);
  bodies[0].asleep = false;
  EXPECT_EQ(scheduling.take_over(bodies), 1);
  EXPECT_FALSE(scheduling.progress(0).under_way || bodies[0].free.ahead);
}

}  // namespace
}  // namespace hapticd
