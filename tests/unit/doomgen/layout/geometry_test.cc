#include "doomgen/layout/geometry.h"

#include <gtest/gtest.h>

#include <cmath>

namespace comrad::doomgen {
namespace geometry_test {

const Polygon kSquare = {{0, 0}, {100, 0}, {100, 100}, {0, 100}};

TEST(Geometry, SinesFromIntegersAgreeWithTheMathsLibrary) {
  for (int64_t denominator : {1, 3, 12, 17, 24, 360, 65536})
    for (int64_t numerator = -denominator; numerator <= 2 * denominator; numerator += 1 + denominator / 37) {
      const SineCosine turn = sine_cosine_of_turn(numerator, denominator);
      const double radians = 2 * M_PI * static_cast<double>(numerator) / static_cast<double>(denominator);
      ASSERT_NEAR(static_cast<double>(turn.sine) * 0x1p-30, std::sin(radians), 0x1p-27)
          << numerator << "/" << denominator;
      ASSERT_NEAR(static_cast<double>(turn.cosine) * 0x1p-30, std::cos(radians), 0x1p-27);
    }
}

TEST(Geometry, PolarPointsRoundToTheNearestUnit) {
  EXPECT_EQ(polar_point(2000, 0, 12), (Point{2000, 0}));
  EXPECT_EQ(polar_point(2000, 3, 12), (Point{0, 2000}));
  EXPECT_EQ(polar_point(2000, 6, 12), (Point{-2000, 0}));
  EXPECT_EQ(polar_point(2000, 1, 12), (Point{1732, 1000}));
  EXPECT_EQ(polar_point(1000, 5, 8), (Point{-707, -707}));
}

TEST(Geometry, AreaIsPositiveCounterClockwise) {
  EXPECT_EQ(twice_area(kSquare), 20000);
  EXPECT_EQ(twice_area(Polygon(kSquare.rbegin(), kSquare.rend())), -20000);
}

TEST(Geometry, DistanceToASegmentUsesItsEndsBeyondThem) {
  EXPECT_FALSE(nearer_than({50, 24}, {0, 0}, {100, 0}, 24));
  EXPECT_TRUE(nearer_than({50, 23}, {0, 0}, {100, 0}, 24));
  EXPECT_FALSE(nearer_than({103, 4}, {0, 0}, {100, 0}, 5));
  EXPECT_TRUE(nearer_than({102, 4}, {0, 0}, {100, 0}, 5));
  EXPECT_TRUE(nearer_than({-16384, 16384}, {-16384, -16384}, {-16383, 16384},
                          2));  // the largest map does not overflow
  EXPECT_FALSE(nearer_than({16384, 16384}, {-16384, -16384}, {-16383, 16384}, 16384));
}

TEST(Geometry, SegmentsTouchInEndsAndOverlaps) {
  EXPECT_TRUE(segments_touch({0, 0}, {10, 10}, {0, 10}, {10, 0}));
  EXPECT_TRUE(segments_touch({0, 0}, {10, 0}, {10, 0}, {20, 5}));
  EXPECT_TRUE(segments_touch({0, 0}, {10, 0}, {5, 0}, {15, 0}));
  EXPECT_TRUE(segments_touch({0, 0}, {10, 0}, {5, 0}, {5, 9}));
  EXPECT_FALSE(segments_touch({0, 0}, {10, 0}, {11, 0}, {15, 0}));
  EXPECT_FALSE(segments_touch({0, 0}, {10, 0}, {0, 1}, {10, 1}));
}

TEST(Geometry, ALineAlongTheEdgeOfABoxDoesNotCrossIt) {
  const Box box{{0, 0}, {32, 32}};
  EXPECT_FALSE(crosses_box({32, -10}, {32, 50}, box));
  EXPECT_TRUE(crosses_box({31, -10}, {31, 50}, box));
  EXPECT_TRUE(crosses_box({10, 10}, {12, 12}, box));   // wholly inside
  EXPECT_FALSE(crosses_box({50, 20}, {20, 50}, box));  // past the corner
  EXPECT_TRUE(crosses_box({40, 20}, {20, 40}, box));
}

TEST(Geometry, ClearanceCountsOutlineAndHoles) {
  const Region region{kSquare, {{{40, 40}, {60, 40}, {60, 60}, {40, 60}}}};
  EXPECT_TRUE(clear_inside(region, Point{20, 50}, 20));
  EXPECT_FALSE(clear_inside(region, Point{21, 50}, 20));
  EXPECT_FALSE(clear_inside(region, Point{50, 50}, 0)) << "inside the hole";
  EXPECT_FALSE(clear_inside(region, Point{120, 50}, 0)) << "outside";
}

TEST(Geometry, ABoxNeedsItsGapFree) {
  const Region region{kSquare, {}};
  EXPECT_TRUE(clear_inside(region, Box{{30, 30}, {70, 70}}, 30));
  EXPECT_FALSE(clear_inside(region, Box{{30, 30}, {70, 70}}, 31));
  EXPECT_FALSE(clear_inside(region, Box{{200, 200}, {220, 220}}, 1));
}

TEST(Geometry, RandomPointsKeepTheirClearanceAndFillTheRegion) {
  const Region region{kSquare, {}};
  Rng rng(7);
  Box seen{{100, 100}, {0, 0}};
  for (int i = 0; i < 2000; ++i) {
    const auto p = random_point(region, 20, rng);
    ASSERT_TRUE(p.has_value());
    ASSERT_TRUE(p->x >= 20 && p->x <= 80 && p->y >= 20 && p->y <= 80);
    seen.low = {std::min(seen.low.x, p->x), std::min(seen.low.y, p->y)};
    seen.high = {std::max(seen.high.x, p->x), std::max(seen.high.y, p->y)};
  }
  EXPECT_EQ(seen.low, (Point{20, 20}));
  EXPECT_EQ(seen.high, (Point{80, 80}));
  EXPECT_FALSE(random_point(region, 51, rng, 100).has_value());
}

}  // namespace geometry_test
}  // namespace comrad::doomgen
