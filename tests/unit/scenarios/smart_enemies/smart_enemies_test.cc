// Smart Enemies: what its demons do when hunters come together. The rest is in demon_hunt/demon_hunt_test.cc.
#include <gtest/gtest.h>

#include "tests/unit/scenarios/demon_hunt/demon_hunt.h"

namespace comrad::sim {
namespace smart_enemies_test {

constexpr const char* kScenario = "smart_enemies";
constexpr int kFastNow = 32, kFastEvents = 33;

struct Game : test::DemonHunt {
  Game() : DemonHunt(kScenario) {}
};

TEST(SmartEnemies, TwoHuntersNearMakeADemonFastAndShielded) {
  Game game;
  game.arrange(500, 520);  // 512 is the distance
  EXPECT_EQ(game.user(kFastNow), 0);
  EXPECT_EQ(game.demon()->health, 100);
  EXPECT_EQ(game.demon()->speed, doom::to_fixed(21));
  game.arrange(500, 500);
  EXPECT_EQ(game.user(kFastNow), 1);
  EXPECT_EQ(game.user(kFastEvents), 1);
  EXPECT_EQ(game.demon()->health, 500);
  EXPECT_EQ(game.demon()->speed, doom::to_fixed(70));
}

TEST(SmartEnemies, HitsDrainTheShieldFirstAndWhatIsLeftOfItGoes) {
  Game game;
  game.hurt(*game.demon(), 30);
  game.arrange(400, 400);
  ASSERT_EQ(game.demon()->health, 470);
  game.hurt(*game.demon(), 150);
  game.arrange(400, 700);
  EXPECT_EQ(game.demon()->health, 70) << "converging does not pay";
  game.arrange(400, 400);
  ASSERT_EQ(game.demon()->health, 470);
  game.hurt(*game.demon(), 420);
  game.arrange(400, 700);
  EXPECT_EQ(game.demon()->health, 50) << "the shield was gone";
}

}  // namespace smart_enemies_test
}  // namespace comrad::sim
