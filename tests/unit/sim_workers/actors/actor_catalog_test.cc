#include "sim_workers/engine/actors/actor_catalog.h"

#include <gtest/gtest.h>

#include "tests/unit/sim_workers/actors/lump.h"

namespace comrad::doom::test {
namespace actor_catalog_test {

ActorType named(const ActorCatalog& catalog, std::string_view parent, std::string_view name,
                int32_t number = -1) {
  ActorType type = catalog.derived(*catalog.find(parent), name);
  type.editor_number = number;
  return type;
}

TEST(ActorCatalog, FindsNamesInAnyCase) {
  const ActorCatalog& catalog = builtin_catalog();
  ASSERT_TRUE(catalog.find("zombieMAN").has_value());
  EXPECT_EQ(catalog.find("zombieMAN"), catalog.find("ZombieMan"));
  EXPECT_EQ(catalog.find("Player"), catalog.find("DoomPlayer"));
  EXPECT_FALSE(catalog.find("").has_value());
  EXPECT_FALSE(catalog.find("Zombie Man").has_value());
}

TEST(ActorCatalog, FindsAncestorsOnly) {
  const ActorCatalog& catalog = builtin_catalog();
  const uint32_t spectre = *catalog.find("Spectre"), demon = *catalog.find("Demon");
  EXPECT_TRUE(catalog.is_a(spectre, demon));
  EXPECT_TRUE(catalog.is_a(spectre, spectre));
  EXPECT_TRUE(catalog.is_a(spectre, "Actor"));
  EXPECT_FALSE(catalog.is_a(demon, spectre));
  EXPECT_FALSE(catalog.is_a(kNoType, demon));
  EXPECT_FALSE(catalog.is_a(demon, "NoSuchActor"));
}

TEST(ActorCatalog, TheNewestTypeHasTheEditorNumber) {
  ActorCatalog catalog = builtin_catalog();
  const uint32_t first = catalog.add(named(catalog, "Demon", "First", 20000));
  EXPECT_EQ(catalog.find_editor_number(20000), first);
  const uint32_t second = catalog.add(named(catalog, "Demon", "Second", 20000));
  EXPECT_EQ(catalog.find_editor_number(20000), second);
  EXPECT_FALSE(catalog.find_editor_number(-1).has_value());
  EXPECT_FALSE(catalog.find_editor_number(20001).has_value());
}

TEST(ActorCatalog, ATypeOfTheSameNameKeepsItsIndexAndLosesItsNumber) {
  ActorCatalog catalog = builtin_catalog();
  const uint32_t first = catalog.add(named(catalog, "Demon", "Mine", 20000));
  const uint32_t again = catalog.add(named(catalog, "DoomImp", "MINE", 20001));
  EXPECT_EQ(first, again);
  EXPECT_EQ(catalog[first].parent, *catalog.find("DoomImp"));
  EXPECT_FALSE(catalog.find_editor_number(20000).has_value());
  EXPECT_EQ(catalog.find_editor_number(20001), first);
}

TEST(ActorCatalog, DescendantsInheritNumbersOfTheBodyButNotOfTheEditor) {
  const ActorCatalog& catalog = builtin_catalog();
  const ActorType child = catalog.derived(*catalog.find("Cyberdemon"), "Calf");
  EXPECT_EQ(child.health, 4000);
  EXPECT_EQ(child.radius, to_fixed(40));
  EXPECT_EQ(child.editor_number, -1);
  EXPECT_EQ(child.spawn_id, 0);
  EXPECT_EQ(child.replaces, kNoType);
  EXPECT_EQ(child.name, "Calf");
  const ActorType gun = catalog.derived(*catalog.find("Shotgun"), "Gun");
  EXPECT_EQ(gun.weapon.slot, -1) << "the player's own list names the Shotgun, not its descendants";
  EXPECT_EQ(gun.weapon.ammo_type, catalog.find("Shell"));
}

TEST(ActorCatalog, ReplacementsFollowEachOther) {
  ActorCatalog catalog = builtin_catalog();
  const uint32_t imp = *catalog.find("DoomImp");
  EXPECT_EQ(catalog.replacement(imp), imp);
  ActorType second = named(catalog, "DoomImp", "Imp2");
  second.replaces = imp;
  const uint32_t imp2 = catalog.add(second);
  EXPECT_EQ(catalog.replacement(imp), imp2);
  ActorType third = named(catalog, "DoomImp", "Imp3");
  third.replaces = imp2;
  const uint32_t imp3 = catalog.add(third);
  EXPECT_EQ(catalog.replacement(imp2), imp3);
  EXPECT_EQ(catalog.replacement(imp), imp3);
  EXPECT_EQ(catalog.replacement(imp3), imp3);
}

TEST(ActorCatalog, SpritesTextsAndTranslationsAreStoredOnce) {
  ActorCatalog catalog = builtin_catalog();
  const uint32_t sprite = catalog.add_sprite("zzzz");
  EXPECT_EQ(catalog.sprite_name(sprite), "ZZZZ");
  EXPECT_EQ(catalog.add_sprite("ZZZZ"), sprite);
  EXPECT_EQ(catalog.sprite_name(0), "TNT1");
  EXPECT_EQ(catalog.add_text("word"), catalog.add_text("word"));
  EXPECT_NE(catalog.add_text("word"), catalog.add_text("Word"));
  std::array<uint8_t, 256> table = catalog.translation(0);
  EXPECT_EQ(catalog.add_translation(table), 0);
  std::swap(table[1], table[2]);
  const uint8_t own = catalog.add_translation(table);
  EXPECT_NE(own, 0);
  EXPECT_EQ(catalog.add_translation(table), own);
  for (int shade = 3; shade < 300; ++shade) {
    table[static_cast<std::size_t>(shade) % 256] ^= 0x55;
    catalog.add_translation(table);
  }
  table[9] = 77, table[10] = 78;
  EXPECT_EQ(catalog.add_translation(table), 0) << "there may be 255 of them";
}

TEST(ActorCatalog, HoldsSixteenDamageTypesOfALump) {
  ActorCatalog catalog = builtin_catalog();
  EXPECT_EQ(catalog.find_damage_type("FIRE"), DamageType::kFire);
  EXPECT_EQ(catalog.find_damage_type("None"), DamageType::kNormal);
  EXPECT_FALSE(catalog.find_damage_type("Taunt").has_value());
  const auto taunt = catalog.add_damage_type("Taunt");
  ASSERT_TRUE(taunt.has_value());
  EXPECT_EQ(catalog.find_damage_type("tAUNT"), taunt);
  EXPECT_EQ(catalog.damage_type_name(*taunt), "Taunt");
  EXPECT_EQ(catalog.damage_type_name(DamageType::kFire), "fire");
  EXPECT_EQ(catalog.add_damage_type("Fire"), DamageType::kFire);
  for (int i = 1; i < 16; ++i) EXPECT_TRUE(catalog.add_damage_type("own" + std::to_string(i)).has_value());
  EXPECT_FALSE(catalog.add_damage_type("seventeenth").has_value());
}

TEST(ActorCatalog, ReportsWhoseStartAnEditorNumberIs) {
  EXPECT_EQ(player_of_start(1), 0);
  EXPECT_EQ(player_of_start(4), 3);
  EXPECT_EQ(player_of_start(4001), 4);
  EXPECT_EQ(player_of_start(4004), 7);
  for (const int32_t number : {0, 5, 11, 4000, 4005})
    EXPECT_FALSE(player_of_start(number).has_value()) << number;
}

}  // namespace actor_catalog_test
}  // namespace comrad::doom::test
