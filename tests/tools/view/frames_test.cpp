// Bytes that another program reads: by offset, as page/protocol.js does.
#include "tools/view/frames.h"

#include <gtest/gtest.h>

#include <cstring>

namespace hapticd {
namespace {

template <typename T>
T at(const std::string& bytes, std::size_t offset) {
  T value;
  std::memcpy(&value, bytes.data() + offset, sizeof value);
  return value;
}

TEST(ViewFrames, AMotionIsNodesThenStrain) {
  const std::string f = motion_frame(7, 1.5, std::vector<float>{1, 2, 3, 4, 5, 6}, std::vector<float>{8, 9});
  ASSERT_EQ(f.size(), 24u + 4 * 8);
  EXPECT_EQ(at<std::uint32_t>(f, 0), 3u);
  EXPECT_EQ(at<std::uint32_t>(f, 4), 7u);
  EXPECT_EQ(at<std::uint32_t>(f, 8), 2u);
  EXPECT_EQ(at<double>(f, 16), 1.5);
  EXPECT_EQ(at<float>(f, 24 + 4 * 5), 6);
  EXPECT_EQ(at<float>(f, 24 + 4 * 6), 8);
}

TEST(ViewFrames, ASurfaceIsTrianglesThenTheirKinds) {
  const std::vector<SurfaceFace> faces = {{{0, 1, 2}, 0, false}, {{3, 4, 5}, 5, true}, {{6, 7, 8}, 8, false}};
  const std::string f = surface_frame(1, 12, faces, std::vector<std::uint8_t>{0, 1, 1});
  ASSERT_EQ(f.size(), 24u + 3 * 12 + 3);
  EXPECT_EQ(at<std::uint32_t>(f, 0), 2u);
  EXPECT_EQ(at<std::uint32_t>(f, 8), 3u);
  EXPECT_EQ(at<std::uint32_t>(f, 12), 12u);
  EXPECT_EQ(at<std::uint32_t>(f, 24 + 12), 3u);
  EXPECT_EQ(f[24 + 36], 0);
  EXPECT_EQ(f[24 + 37], view_cut | view_loose);
  EXPECT_EQ(f[24 + 38], view_loose);
}

TEST(ViewFrames, ContactsBeginWithTheInstrumentsAndEndWithWhoPresses) {
  const std::vector<float> instruments(14, 1), contacts(21, 2);
  const std::vector<std::uint8_t> pressing{0, 255, 1, 255, 1, 0};
  const std::string f = contacts_frame(0, instruments, contacts, pressing);
  ASSERT_EQ(f.size(), 24u + 4 * 35 + 6);
  EXPECT_EQ(at<std::uint32_t>(f, 8), 3u);
  EXPECT_EQ(at<std::uint32_t>(f, 12), 2u);
  EXPECT_EQ(at<float>(f, 24 + 4 * 13), 1);
  EXPECT_EQ(at<float>(f, 24 + 4 * 14), 2);
  EXPECT_EQ(at<std::uint8_t>(f, 24 + 4 * 35 + 1), 255);
  EXPECT_EQ(at<std::uint8_t>(f, 24 + 4 * 35 + 5), 0);
}

}  // namespace
}  // namespace hapticd
