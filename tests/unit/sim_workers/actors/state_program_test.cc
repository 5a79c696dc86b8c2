#include "sim_workers/engine/actors/state_program.h"

#include <gtest/gtest.h>

#include "tests/unit/sim_workers/actors/lump.h"

namespace comrad::doom::test {
namespace state_program_test {

State shown(int tics) {
  State state;
  state.sprite = 0;
  state.tics = static_cast<int16_t>(tics);
  return state;
}

struct Program {
  Program() : catalog(builtin_catalog()), type(catalog.derived(*catalog.find("ZombieMan"), "Mine")) {}
  Status finish(std::vector<StateTarget>* missing = nullptr) {
    return states.finish(&catalog, &type, missing);
  }
  int tics_at(uint32_t state) const { return catalog.state(state).tics; }

  ActorCatalog catalog;
  ActorType type;
  StateProgram states;
};

StateTarget target(std::string scope, std::string label, int offset = 0) {
  return {.scope = std::move(scope), .label = std::move(label), .offset = offset, .line = 4, .column = 9};
}

TEST(StateProgram, StatesFollowEachOtherUntilALinkEndsIt) {
  Program program;
  program.states.add_label("Spawn");
  program.states.add_state(shown(1));
  program.states.add_state(shown(2));
  EXPECT_TRUE(program.states.loop());
  program.states.add_label("See");
  program.states.add_state(shown(3));
  EXPECT_TRUE(program.states.wait());
  program.states.add_label("Melee");
  program.states.add_state(shown(4));
  EXPECT_TRUE(program.states.stop());
  program.states.add_label("Missile");
  program.states.add_state(shown(5));
  EXPECT_TRUE(program.states.go_to(target("", "Melee")));
  ASSERT_TRUE(program.finish().has_value());
  const uint32_t spawn = program.type.state(StateLabel::kSpawn);
  EXPECT_EQ(program.tics_at(spawn), 1);
  EXPECT_EQ(program.catalog.state(spawn).next, spawn + 1);
  EXPECT_EQ(program.catalog.state(spawn + 1).next, spawn);
  const uint32_t see = program.type.state(StateLabel::kSee);
  EXPECT_EQ(program.catalog.state(see).next, see);
  const uint32_t melee = program.type.state(StateLabel::kMelee);
  EXPECT_EQ(program.catalog.state(melee).next, kNoState);
  EXPECT_EQ(program.catalog.state(program.type.state(StateLabel::kMissile)).next, melee);
  EXPECT_EQ(program.type.state(StateLabel::kDeath),
            builtin_catalog()[*builtin_catalog().find("ZombieMan")].state(StateLabel::kDeath))
      << "labels that the type does not name are its parent's";
}

TEST(StateProgram, OneStateMayHaveSeveralLabels) {
  Program program;
  program.states.add_label("Melee");
  program.states.add_label("Missile");
  program.states.add_state(shown(6));
  EXPECT_TRUE(program.states.stop());
  ASSERT_TRUE(program.finish().has_value());
  EXPECT_EQ(program.type.state(StateLabel::kMelee), program.type.state(StateLabel::kMissile));
}

TEST(StateProgram, LabelsAloneLeadElsewhereOrNowhere) {
  Program program;
  program.states.add_label("XDeath");
  EXPECT_TRUE(program.states.stop());
  program.states.add_label("Melee");
  EXPECT_TRUE(program.states.go_to(target("Super", "Missile", 1)));
  ASSERT_TRUE(program.finish().has_value());
  EXPECT_EQ(program.type.state(StateLabel::kXDeath), kNoState);
  const ActorType& parent = builtin_catalog()[*builtin_catalog().find("ZombieMan")];
  EXPECT_EQ(program.type.state(StateLabel::kMelee), parent.state(StateLabel::kMissile) + 1);
}

TEST(StateProgram, LinksNeedAStateOrALabelBeforeThem) {
  StateProgram empty;
  EXPECT_FALSE(empty.loop());
  EXPECT_FALSE(empty.wait());
  EXPECT_FALSE(empty.stop());
  EXPECT_FALSE(empty.fail());
  EXPECT_FALSE(empty.go_to(target("", "See")));
  StateProgram twice;
  twice.add_label("Spawn");
  twice.add_state(shown(1));
  EXPECT_TRUE(twice.stop());
  EXPECT_FALSE(twice.stop()) << "the state has its link already";
}

TEST(StateProgram, FailMarksTheStateBeforeIt) {
  Program program;
  program.states.add_label("Pickup");
  program.states.add_state(shown(0));
  EXPECT_TRUE(program.states.fail());
  ASSERT_TRUE(program.finish().has_value());
  const State& state = program.catalog.state(program.type.state(StateLabel::kPickup));
  EXPECT_TRUE(state.fails);
  EXPECT_EQ(state.next, kNoState);
}

TEST(StateProgram, NamesThePlaceOfALinkThatLeadsNowhere) {
  struct Case {
    StateTarget to;
    const char* message;
  };
  const Case cases[] = {{target("", "Nowhere"), "4:9: no state label 'Nowhere'"},
                        {target("Super", "Nowhere"), "4:9: no state label 'Super::Nowhere'"},
                        {target("Cacodemon", "See"), "4:9: 'Cacodemon' is no ancestor"},
                        {target("NoActor", "See"), "4:9: 'NoActor' is no ancestor"},
                        {target("", "Spawn", 100000), "4:9: 'Spawn' has no state so many further on"}};
  for (const Case& bad : cases) {
    Program program;
    const std::size_t before = program.catalog.state_count();
    program.states.add_label("Spawn");
    program.states.add_state(shown(1));
    EXPECT_TRUE(program.states.go_to(bad.to));
    const Status status = program.finish();
    ASSERT_FALSE(status.has_value());
    EXPECT_EQ(status.error().message.rfind(bad.message, 0), 0u) << status.error().message;
    EXPECT_EQ(program.catalog.state_count(), before) << "nothing was added";
  }
}

TEST(StateProgram, ArgumentsKeepTheirLabelForDescendants) {
  Program program;
  PendingArg jump;
  jump.is_target = true;
  jump.target = target("", "Melee");
  PendingArg missing = jump;
  missing.target = target("", "Later");
  program.states.add_label("Melee");
  program.states.add_state(shown(1), {jump, missing});
  EXPECT_TRUE(program.states.stop());
  std::vector<StateTarget> later;
  ASSERT_TRUE(program.finish(&later).has_value());
  ASSERT_EQ(later.size(), 1u);
  EXPECT_EQ(later[0].label, "Later");
  const auto args = program.catalog.args(program.catalog.state(program.type.state(StateLabel::kMelee)));
  ASSERT_EQ(args.size(), 2u);
  EXPECT_EQ(args[0].kind, ActionArg::Kind::kState);
  EXPECT_EQ(static_cast<uint32_t>(args[0].a), program.type.state(StateLabel::kMelee));
  EXPECT_EQ(program.catalog.text(args[0].b), "melee");
  EXPECT_EQ(static_cast<uint32_t>(args[1].a), kNoState);
}

TEST(StateProgram, AJumpOverStatesStaysInsideTheProgram) {
  for (const int offset : {1, 2, -1, 50}) {
    Program program;
    PendingArg jump;
    jump.is_target = true;
    jump.target = target("", "", offset);
    program.states.add_label("Spawn");
    program.states.add_state(shown(1), {jump});
    program.states.add_state(shown(2));
    EXPECT_TRUE(program.states.stop());
    const Status status = program.finish();
    EXPECT_EQ(status.has_value(), offset == 1) << offset;
  }
}

}  // namespace state_program_test
}  // namespace comrad::doom::test
