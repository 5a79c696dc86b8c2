#include "sim_workers/engine/acs/behavior.h"

#include <gtest/gtest.h>

#include "tests/support/behavior_builder.h"

namespace comrad::doom::acs::test {
namespace behavior_test {

Expected<std::shared_ptr<const Behavior>> load_bytes(const std::vector<uint8_t>& bytes) {
  return Behavior::load(bytes, "MAP01");
}

TEST(Behavior, ReadsScriptsAndStringsOfEveryContainer) {
  for (const Container container : kContainers) {
    BehaviorBuilder code(container);
    code.text("first"), code.text("second");
    code.script(7, 1, 0).end();
    const uint32_t second = code.address();
    code.script(300, 4, 3).push(12).end();
    const auto behavior = load_bytes(code.build());
    ASSERT_TRUE(behavior.has_value()) << behavior.error().message;
    const Behavior& loaded = **behavior;
    EXPECT_EQ(loaded.compact(), code.compact());
    ASSERT_EQ(loaded.scripts().size(), 2u);
    EXPECT_EQ(loaded.scripts()[0].type, ScriptType::kOpen);
    EXPECT_EQ(loaded.scripts()[1].number, 300);
    EXPECT_EQ(loaded.scripts()[1].type, ScriptType::kEnter);
    EXPECT_EQ(loaded.scripts()[1].arg_count, 3);
    EXPECT_EQ(loaded.scripts()[1].address, second);
    EXPECT_EQ(loaded.scripts()[1].variable_count, 20);
    ASSERT_EQ(loaded.strings().size(), 2u);
    EXPECT_EQ(loaded.strings()[1], "second");
    EXPECT_EQ(loaded.find_script(7), &loaded.scripts()[0]);
    EXPECT_EQ(loaded.find_script(8), nullptr);
  }
}

TEST(Behavior, ReadsFunctionsNamesVariablesAndArrays) {
  BehaviorBuilder code(Container::kHiddenCompact);
  code.named_script("Round Start", 1, 2).end();
  code.script(4, 0, 0, 31).local_arrays({10, 5}).end();
  code.function(2, 3, true, "double");
  code.local_arrays({7}).op(PCode::kReturnVoid).end_function();
  code.map_variable(3, -9).array(5, {1, 2, 3});
  const auto behavior = load_bytes(code.build());
  ASSERT_TRUE(behavior.has_value()) << behavior.error().message;
  const Behavior& loaded = **behavior;
  EXPECT_EQ(loaded.find_script("ROUND start"), &loaded.scripts()[0]);
  EXPECT_EQ(loaded.scripts()[0].number, -1);
  EXPECT_EQ(loaded.scripts()[1].variable_count, 31 + 15);
  EXPECT_EQ(loaded.scripts()[1].arrays[1].offset, 41);
  ASSERT_EQ(loaded.functions().size(), 1u);
  EXPECT_EQ(loaded.functions()[0].name, "double");
  EXPECT_TRUE(loaded.functions()[0].returns_value);
  EXPECT_EQ(loaded.functions()[0].variable_count, 3 + 7);
  EXPECT_EQ(loaded.functions()[0].arrays[0].offset, 5) << "behind arguments and variables";
  EXPECT_EQ(loaded.map_variables()[3], -9);
  EXPECT_EQ(loaded.array_of(5), 0);
  EXPECT_EQ(loaded.array_of(3), -1);
  EXPECT_EQ(loaded.arrays()[0].initial, (std::vector<int32_t>{1, 2, 3}));
}

TEST(Behavior, DecryptsStrings) {
  BehaviorBuilder code(Container::kPlain);
  code.text(""), code.text("Cacodemon"), code.text("\034Gkeep apart");
  code.encrypt().script(1).end();
  const auto behavior = load_bytes(code.build());
  ASSERT_TRUE(behavior.has_value()) << behavior.error().message;
  EXPECT_EQ((*behavior)->strings()[0], "");
  EXPECT_EQ((*behavior)->strings()[1], "Cacodemon");
  EXPECT_EQ((*behavior)->strings()[2], "\034Gkeep apart");
}

TEST(Behavior, ReadsFlagsAndJumpTargets) {
  BehaviorBuilder code(Container::kCompact);
  code.script(2).end();
  const auto target = code.label();
  code.bind(target).script(3).end().jump_target(target);
  code.chunk("SFLG", {3, 0, 1, 0});
  const auto behavior = load_bytes(code.build());
  ASSERT_TRUE(behavior.has_value());
  EXPECT_FALSE((*behavior)->scripts()[0].is_net);
  EXPECT_TRUE((*behavior)->scripts()[1].is_net);
  ASSERT_EQ((*behavior)->jumps().size(), 1u);
  EXPECT_EQ((*behavior)->jumps()[0], (*behavior)->scripts()[1].address);
}

TEST(Behavior, TakesAStubForAnEmptyOne) {
  std::vector<uint8_t> stub = {'A', 'C', 'S', 0, 8, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0};
  const auto behavior = load_bytes(stub);
  ASSERT_TRUE(behavior.has_value());
  EXPECT_TRUE((*behavior)->scripts().empty());
  EXPECT_TRUE(load_bytes({}).has_value());
}

struct BadLump {
  const char* what;
  const char* message;  // part of the error
  void (*bend)(std::vector<uint8_t>&);
};

TEST(Behavior, NamesTheOffsetOfWhatIsBroken) {
  const BadLump cases[] = {
      {"magic", "none of ACS0", [](std::vector<uint8_t>& lump) { lump[3] = 'x'; }},
      {"directory", "outside the lump", [](std::vector<uint8_t>& lump) { lump[7] = 1; }},
      {"script address", "begins outside",
       [](std::vector<uint8_t>& lump) {
         const std::string text(lump.begin(), lump.end());
         lump[text.find("SPTR") + 8 + 7] = 0x7F;
       }},
      {"chunk size", "runs out of the lump",
       [](std::vector<uint8_t>& lump) {
         const std::string text(lump.begin(), lump.end());
         lump[text.find("STRL") + 7] = 0x7F;
       }},
      {"string count", "does not fit",
       [](std::vector<uint8_t>& lump) {
         const std::string text(lump.begin(), lump.end());
         lump[text.find("STRL") + 8 + 7] = 0x7F;
       }},
      {"string offset", "runs out of its chunk",
       [](std::vector<uint8_t>& lump) {
         const std::string text(lump.begin(), lump.end());
         lump[text.find("STRL") + 8 + 12 + 3] = 0x7F;
       }},
      {"array size", "elements",
       [](std::vector<uint8_t>& lump) {
         const std::string text(lump.begin(), lump.end());
         lump[text.find("ARAY") + 8 + 7] = 0x7F;
       }},
  };
  for (const BadLump& bad : cases) {
    BehaviorBuilder code(Container::kCompact);
    code.text("text");
    code.script(1).end().array(1, {5, 6});
    std::vector<uint8_t> lump = code.build();
    ASSERT_TRUE(load_bytes(lump).has_value());
    bad.bend(lump);
    const auto behavior = load_bytes(lump);
    ASSERT_FALSE(behavior.has_value()) << bad.what;
    EXPECT_EQ(behavior.error().code, ErrorCode::kBadFormat);
    EXPECT_NE(behavior.error().message.find("MAP01: BEHAVIOR at 0x"), std::string::npos)
        << behavior.error().message;
    EXPECT_NE(behavior.error().message.find(bad.message), std::string::npos) << behavior.error().message;
  }
}

}  // namespace behavior_test
}  // namespace comrad::doom::acs::test
