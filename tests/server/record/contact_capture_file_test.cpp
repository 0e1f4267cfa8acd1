// A captured problem comes back bit for bit and gives the same force; a damaged file is refused by name.
#include "server/record/contact_capture_file.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <fstream>

#include "server/files/input_error.h"
#include "tests/support/contact_problems.h"

namespace hapticd {
namespace {

namespace fs = std::filesystem;

class CaptureFile : public testing::Test {
 protected:
  void SetUp() override {
    directory_ = fs::temp_directory_path() / ("capture_test_" + std::to_string(getpid()));
    fs::create_directories(directory_);
    file_ = directory_ / "000001.contact";
  }
  void TearDown() override { fs::remove_all(directory_); }

  // A press with friction: the state of a loop and its next solve.
  std::unique_ptr<CapturedProblem> pressed(Renewal renewal) {
    Random random(3);
    SheetSettings sheet;
    sheet.friction = 0.4;
    auto captured = std::make_unique<CapturedProblem>();
    captured->instruments = {sphere_instrument(3e-3)};
    captured->instruments[0].primitives.push_back(make_convex(
        "wedge", {Vec3(0, 0, 9e-3), Vec3(1e-3, 0, 9e-3), Vec3(0, 1e-3, 9e-3), Vec3(0, 0, 10e-3)}, {}));
    ContactCapture& c = captured->capture;
    copy_in_use(*sheet_problem(random, sheet), c.problem);
    c.problem.renewal = renewal;
    c.problem.instrument[0].X_ref = {Vec3(0, 0, 2.8e-3), Quat::Identity()};
    c.period = 1e-3;
    c.linearisations = 2;
    c.margin = 0.2e-3;
    c.tolerance = 1e-9;
    for (int tick = 0; tick < 20; ++tick) solve(*captured, c.state, tick);
    ContactState after = c.state;
    const ContactSolution out = solve(*captured, after, 20);
    c.status = out.status;
    c.residual = out.residual;
    c.wrench = out.wrench[0];
    return captured;
  }

  ContactSolution solve(CapturedProblem& p, ContactState& state, int tick) {
    p.capture.X = Pose{Vec3(1e-5 * tick, 0, 2.8e-3 - 2e-6 * tick), Quat::Identity()};
    return again(p, state);
  }

  ContactSolution again(const CapturedProblem& p, ContactState& state) {
    ContactOptions options;
    options.linearisations = p.capture.linearisations;
    options.margin = p.capture.margin;
    options.coulomb.tolerance = p.capture.tolerance;
    state.frozen_step = 0;
    return solve_contact(p.capture.problem, p.instruments, p.capture.X, p.capture.period, options, state,
                         *scratch_);
  }

  std::string bytes() const {
    std::ifstream in(file_, std::ios::binary);
    return {std::istreambuf_iterator<char>(in), {}};
  }
  void expect_refused(const std::string& content, const std::string& word) {
    std::ofstream(file_, std::ios::binary | std::ios::trunc) << content;
    try {
      read_capture(file_);
      FAIL() << "was read: " << word;
    } catch (const InputError& e) {
      EXPECT_NE(std::string(e.what()).find(word), std::string::npos) << e.what();
      EXPECT_NE(std::string(e.what()).find("000001.contact"), std::string::npos) << e.what();
    }
  }

  fs::path directory_, file_;
  std::unique_ptr<ContactScratch> scratch_ = std::make_unique<ContactScratch>();
};

TEST_F(CaptureFile, RoundTripGivesTheSameBytesAndTheSameForce) {
  for (const Renewal renewal : {Renewal::renewed, Renewal::frozen}) {
    const auto captured = pressed(renewal);
    ASSERT_GT(captured->capture.wrench[0].norm(), 1e-4);
    write_capture(file_, captured->instruments, captured->capture);
    const std::string first = bytes();
    const auto read = read_capture(file_);
    ContactState state = read->capture.state;
    EXPECT_EQ(again(*read, state).wrench[0], captured->capture.wrench[0]);
    write_capture(file_, read->instruments, read->capture);
    EXPECT_EQ(bytes(), first);
    EXPECT_LT(first.size(), 1'000'000u);
  }
}

// A file of version 7 without the number of instruments, their incisions, the friction between them, who is
// present and who is outside, the edge samples, and of each remembered contact primitive, instrument (an i32
// each), the other's anchor and the advance, is one of version 1.
TEST_F(CaptureFile, Version1IsReadWithPrimitive0) {
  const auto captured = pressed(Renewal::renewed);
  const ContactMemory& memory = captured->capture.state.memory;
  ASSERT_GT(memory.count, 3);
  for (int k = 0; k < memory.count; ++k) ASSERT_EQ(memory.entry[k].primitive, 0);
  write_capture(file_, captured->instruments, captured->capture);
  std::string old = bytes();
  constexpr std::size_t result = 8 + 8 + 4 + 8 + 1 + 8 + 48, entry = 8 + 4 + 4 + 3 * 24 + 8 + 1;
  const std::size_t present = old.size() - result - 1;
  old.erase(present, 1);
  const std::size_t outside = present - 56 - 1;
  old.erase(outside, 1);
  const std::size_t first = outside - 48 - static_cast<std::size_t>(memory.count) * entry;
  for (int k = memory.count - 1; k >= 0; --k) {
    const std::size_t at = first + static_cast<std::size_t>(k) * entry;
    old.erase(at + 16 + 2 * 24, 24 + 8);
    old.erase(at + 8, 8);
  }
  old.erase(first - 4 - 4, 4);
  constexpr std::size_t header = 16 + 4, settings = 8 + 8 + 56 + 1 + 1 + 8 + 24;
  std::size_t shape = 4 + 4;
  for (const Primitive& p : captured->instruments[0].primitives)
    shape += 4 + 8 + 8 + 56 + 4 + 24 * p.vertices.size() + 4 + 32 * p.planes.size();
  constexpr std::size_t incision = 24 + 24 + 3 * 8;
  old.erase(header + shape + incision + settings, 8);
  old.erase(header + shape, incision);
  old.erase(16, 4);
  old[8] = 1;
  std::ofstream(file_, std::ios::binary | std::ios::trunc) << old;
  const auto read = read_capture(file_);
  for (int k = 0; k < memory.count; ++k) {
    EXPECT_EQ(read->capture.state.memory.entry[k].id, memory.entry[k].id);
    EXPECT_EQ(read->capture.state.memory.entry[k].primitive, 0);
  }
  ContactState state = read->capture.state;
  EXPECT_EQ(again(*read, state).wrench[0], captured->capture.wrench[0]);
}

// A sample remembered with two primitives comes back with both; one the instrument does not have is refused.
TEST_F(CaptureFile, PrimitivesOfContactsComeBack) {
  const auto captured = pressed(Renewal::renewed);
  ContactMemory& memory = captured->capture.state.memory;
  memory.entry[memory.count] = memory.entry[memory.count - 1];
  memory.entry[memory.count++].primitive = 1;
  write_capture(file_, captured->instruments, captured->capture);
  const auto read = read_capture(file_);
  ASSERT_EQ(read->capture.state.memory.count, memory.count);
  EXPECT_EQ(read->capture.state.memory.entry[memory.count - 1].primitive, 1);
  memory.entry[memory.count - 1].primitive = 2;
  write_capture(file_, captured->instruments, captured->capture);
  EXPECT_THROW(read_capture(file_), InputError);
}

// A blade's edge at its limit comes back with its advance, and with the same force.
TEST_F(CaptureFile, EdgesComeBackWithTheirAdvance) {
  const auto captured = pressed(Renewal::renewed);
  CondensedProblem& p = captured->capture.problem;
  p.edges = 1;
  p.edge[0] = {edge_id(0, 0), 0, 0,   {6, 7, 11, 12}, {0.2, 0.3, 0.4, 0.1}, Vec3(0, 0, -3e-3), -Vec3::UnitZ(),
               1e-3,          0, 0.02};
  ContactState& state = captured->capture.state;
  for (int tick = 0; tick < 20; ++tick) solve(*captured, state, 20 + tick);
  const ContactMemory::Entry* known = state.memory.find(edge_id(0, 0), 0);
  ASSERT_NE(known, nullptr);
  ASSERT_GT(known->advance, 1e-6);
  write_capture(file_, captured->instruments, captured->capture);
  const auto read = read_capture(file_);
  ASSERT_EQ(read->capture.problem.edges, 1);
  EXPECT_EQ(read->capture.state.memory.find(edge_id(0, 0), 0)->advance, known->advance);
  ContactState own = state, other = read->capture.state;
  EXPECT_EQ(again(*read, other).wrench[0], again(*captured, own).wrench[0]);
}

// A shaft pressed against its ring, and what the ring remembers.
TEST_F(CaptureFile, IncisionsComeBack) {
  const auto captured = pressed(Renewal::renewed);
  captured->instruments[0].incision = {Vec3(0.1e-3, 0, 50e-3), Vec3::UnitZ(), 0.05e-3, 700, 0.2};
  ContactState& state = captured->capture.state;
  for (int tick = 0; tick < 20; ++tick) solve(*captured, state, 20 + tick);
  ASSERT_NE(state.memory.find(std::uint64_t{0xffff} << 48, 0), nullptr);
  write_capture(file_, captured->instruments, captured->capture);
  const auto read = read_capture(file_);
  const Incision& ring = read->instruments[0].incision;
  EXPECT_EQ(ring.at, captured->instruments[0].incision.at);
  EXPECT_EQ(ring.stiffness, 700);
  EXPECT_EQ(ring.friction, 0.2);
  ContactState own = state, other = read->capture.state;
  EXPECT_EQ(again(*read, other).wrench[0], again(*captured, own).wrench[0]);
}

TEST_F(CaptureFile, DamagedFilesAreRefusedByName) {
  const auto captured = pressed(Renewal::renewed);
  write_capture(file_, captured->instruments, captured->capture);
  const std::string good = bytes();
  expect_refused("", "ends in the middle");
  expect_refused("something else altogether", "is not a captured contact problem");
  expect_refused(good.substr(0, good.size() / 2), "ends in the middle");
  expect_refused(good + "x", "longer");
  std::string other = good;
  other[8] = 8;
  expect_refused(other, "version 8");
  other = good;
  other[12] = 9;
  expect_refused(other, "byte order");
  other = good;
  other[17] = 1;  // 256 instruments more
  expect_refused(other, "instruments");
  other = good;
  other[21] = 1;  // 256 primitives more
  expect_refused(other, "primitives");
  EXPECT_THROW(read_capture(directory_ / "absent.contact"), InputError);
}

// Whatever byte is changed: read or refused, never more.
TEST_F(CaptureFile, AnyByteMayBeWrong) {
  const auto captured = pressed(Renewal::renewed);
  write_capture(file_, captured->instruments, captured->capture);
  const std::string good = bytes();
  Random random(8);
  int refused = 0;
  for (int trial = 0; trial < 400; ++trial) {
    std::string other = good;
    const auto at = trial < 100 ? static_cast<std::size_t>(trial) : random() % good.size();
    other[at] = static_cast<char>(random());
    std::ofstream(file_, std::ios::binary | std::ios::trunc) << other;
    try {
      read_capture(file_);
    } catch (const InputError&) {
      ++refused;
    }
  }
  EXPECT_GT(refused, 20);
}

TEST_F(CaptureFile, DirectoryListsItsCapturesInOrder) {
  EXPECT_THROW(capture_files(directory_), InputError);
  EXPECT_THROW(capture_files(directory_ / "absent"), InputError);
  for (const char* name : {"000002.contact", "000001.contact", "note.txt"})
    std::ofstream(directory_ / name) << "";
  const auto files = capture_files(directory_);
  ASSERT_EQ(files.size(), 2u);
  EXPECT_EQ(files[0].filename(), "000001.contact");
}

}  // namespace
}  // namespace hapticd
