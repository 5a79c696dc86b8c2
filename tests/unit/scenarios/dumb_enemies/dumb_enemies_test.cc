// Dumb Enemies: what its demons do when hunters come together. The rest is in demon_hunt/demon_hunt_test.cc.
#include <gtest/gtest.h>

#include "tests/unit/scenarios/demon_hunt/demon_hunt.h"

namespace comrad::sim {
namespace dumb_enemies_test {

constexpr const char* kScenario = "dumb_enemies";
constexpr int kSlowNow = 32, kSlowEvents = 33;

struct Game : test::DemonHunt {
  Game() : DemonHunt(kScenario) {}
};

TEST(DumbEnemies, TwoHuntersNearMakeADemonSlowAndFrail) {
  Game game;
  game.arrange(500, 520);  // 512 is the distance
  EXPECT_EQ(game.user(kSlowNow), 0);
  EXPECT_EQ(game.demon()->health, 500);
  EXPECT_EQ(game.demon()->speed, doom::to_fixed(70));
  game.arrange(500, 500);
  EXPECT_EQ(game.user(kSlowNow), 1);
  EXPECT_EQ(game.user(kSlowEvents), 1);
  EXPECT_EQ(game.demon()->health, 100);
  EXPECT_EQ(game.demon()->speed, doom::to_fixed(21));
}

TEST(DumbEnemies, BeingSlowNeverCreatesHealth) {
  Game game;
  game.arrange(400, 700);
  game.hurt(*game.demon(), 200);
  ASSERT_EQ(game.demon()->health, 300);
  game.arrange(400, 400);
  EXPECT_EQ(game.demon()->health, 100);
  game.hurt(*game.demon(), 40);
  game.arrange(400, 700);
  EXPECT_EQ(game.demon()->health, 260) << "as much armour as was taken from it";
  game.hurt(*game.demon(), 200);
  ASSERT_EQ(game.demon()->health, 60);
  game.arrange(400, 400);
  EXPECT_EQ(game.demon()->health, 60);
  game.arrange(400, 700);
  EXPECT_EQ(game.demon()->health, 60);
}

}  // namespace dumb_enemies_test
}  // namespace comrad::sim
