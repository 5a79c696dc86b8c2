#include "sim_workers/env/observation.h"

#include <gtest/gtest.h>

#include <vector>

namespace comrad::sim {
namespace observation_test {

TEST(ViewSizeText, IsWidthTimesHeight) {
  EXPECT_EQ(*parse_view_size("160x120"), (ViewSize{160, 120}));
  for (const char* text :
       {"", "160", "160x", "x120", "160x120x3", "0x0", "15x120", "160x5000", "-160x120", "160 x 120"})
    EXPECT_FALSE(parse_view_size(text)) << text;
}

/// [3, 144, 256]: every second pixel of a row and column differs, the planes differ by 50.
std::vector<uint8_t> twice_the_size() {
  std::vector<uint8_t> picture(3 * 144 * 256);
  for (int plane = 0; plane < 3; ++plane)
    for (int y = 0; y < 144; ++y)
      for (int x = 0; x < 256; ++x)
        picture[(plane * 144 + y) * 256 + x] = static_cast<uint8_t>(50 * plane + 4 * (x % 2) + 8 * (y % 2));
  return picture;
}

TEST(ResizePlanes, NearestTakesOnePixelOfFourAndAreaTheirMean) {
  const std::vector<uint8_t> source = twice_the_size();
  std::vector<uint8_t> small(3 * 72 * 128, 255);
  resize_planes(source.data(), {256, 144}, Resize::kNearest, small.data());
  for (int plane = 0; plane < 3; ++plane)
    for (int i = 0; i < 72 * 128; ++i) ASSERT_EQ(small[plane * 72 * 128 + i], 50 * plane);
  resize_planes(source.data(), {256, 144}, Resize::kArea, small.data());
  for (int plane = 0; plane < 3; ++plane)
    for (int i = 0; i < 72 * 128; ++i) ASSERT_EQ(small[plane * 72 * 128 + i], 50 * plane + 6);
}

TEST(ResizePlanes, NearestOf160x120TakesTheRowsThatTheReferenceTakes) {
  std::vector<uint8_t> source(3 * 120 * 160), small(3 * 72 * 128);
  for (int y = 0; y < 120; ++y) std::fill_n(source.begin() + y * 160, 160, static_cast<uint8_t>(y));
  resize_planes(source.data(), {160, 120}, Resize::kNearest, small.data());
  for (int y = 0; y < 72; ++y) ASSERT_EQ(small[y * 128], y * 120 / 72) << y;
}

}  // namespace observation_test
}  // namespace comrad::sim
