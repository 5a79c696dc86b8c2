#include "sim_workers/engine/play/actor_catalog.h"

#include <gtest/gtest.h>

namespace comrad::doom {
namespace {

TEST(ActorCatalog, KnowsTheItemsByNameAndNumber) {
  const ActorCatalog catalog;
  const ActorType& stimpack = catalog[catalog.find("Stimpack").value()];
  EXPECT_EQ(stimpack.editor_number, 2011);
  EXPECT_EQ(stimpack.heal_amount, 10);
  EXPECT_EQ(stimpack.heal_limit, 100);
  EXPECT_EQ(catalog[catalog.find_editor_number(2012).value()].heal_amount, 25);
  EXPECT_EQ(catalog[catalog.find_editor_number(2014).value()].heal_limit, 200);
  EXPECT_EQ(catalog.find("Cacodemon"), std::nullopt);
  EXPECT_EQ(catalog.find_editor_number(-1), std::nullopt);
}

TEST(ActorCatalog, ANewTypeReplacesTheOneOfItsNameAndTakesNumbersOver) {
  ActorCatalog catalog;
  const std::size_t size = catalog.size();
  ActorType strong;
  strong.name = "Stimpack";
  strong.heal_amount = 50;
  EXPECT_EQ(catalog.add(strong), ActorCatalog().find("Stimpack"));
  EXPECT_EQ(catalog.size(), size);
  ActorType other;
  other.name = "Other";
  other.editor_number = 2012;
  const uint32_t index = catalog.add(other);
  EXPECT_EQ(catalog.find_editor_number(2012), index);
}

TEST(ActorCatalog, EveryFrameLeadsToAFrame) {
  const ActorCatalog catalog;
  for (uint32_t index = 0; index < catalog.size(); ++index)
    for (const ActorType::Frame& frame : catalog[index].frames)
      EXPECT_LT(frame.next, static_cast<int>(catalog[index].frames.size())) << catalog[index].name;
  const ActorType& player = catalog[catalog.find("Player").value()];
  ASSERT_EQ(player.frames.size(), kPlayerDeathFrame + 7u);
  EXPECT_EQ(player.frames.back().frame, 'N' - 'A');
}

TEST(PlayerStarts, AreTheNumbersOfEightPlayers) {
  EXPECT_EQ(player_of_start(1), 0);
  EXPECT_EQ(player_of_start(4), 3);
  EXPECT_EQ(player_of_start(4001), 4);
  EXPECT_EQ(player_of_start(4004), 7);
  EXPECT_EQ(player_of_start(5), std::nullopt);
  EXPECT_EQ(player_of_start(0), std::nullopt);
}

}  // namespace
}  // namespace comrad::doom
