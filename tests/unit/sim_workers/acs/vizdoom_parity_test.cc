// The same small programs in ViZDoom and here, USER variables compared tic by tic. Skipped where the Python
// package vizdoom cannot be had (tests/support/vizdoom_python.h).
#include <gtest/gtest.h>

#include <cstdio>
#include <cstdlib>
#include <functional>
#include <sstream>

#include "rollout_buffer/core/files.h"
#include "sim_workers/engine/acs/machine.h"
#include "sim_workers/engine/map/level_loader.h"
#include "sim_workers/engine/tic/tic.h"
#include "sim_workers/engine/world/world.h"
#include "tests/support/behavior_builder.h"
#include "tests/support/scratch_folder.h"
#include "tests/support/vizdoom_python.h"
#include "tests/support/wad_bytes.h"

namespace comrad::doom::acs::test {
namespace vizdoom_parity_test {

using Row = std::array<int64_t, 61>;  // USER numbers; 0 stays empty

/// A room of 2048 units with its own sector in one corner (tag 5), a spot and a monster.
std::string room_text() {
  std::string text = "namespace = \"zdoom\";\n";
  const auto thing = [&](int type, int x, int y, int angle, int id) {
    text += "thing { x = " + std::to_string(x) + ".0; y = " + std::to_string(y) +
            ".0; angle = " + std::to_string(angle) + "; type = " + std::to_string(type) +
            "; id = " + std::to_string(id) +
            "; skill1 = true; skill2 = true; skill3 = true; skill4 = true; skill5 = true; single = true; "
            "coop = true; "
            "dm = true; class1 = true; }\n";
  };
  thing(1, 0, 0, 90, 0), thing(9001, 500, -500, 45, 30), thing(3002, -600, 600, 135, 31),
      thing(2012, 600, 600, 0, 32);
  for (const auto& [x, y] : {std::pair{-1024, -1024},
                             {-1024, 1024},
                             {1024, 1024},
                             {1024, -1024},
                             {-900, -900},
                             {-900, -700},
                             {-700, -700},
                             {-700, -900}})
    text += "vertex { x = " + std::to_string(x) + ".0; y = " + std::to_string(y) + ".0; }\n";
  for (int i = 0; i < 4; ++i)
    text += "linedef { v1 = " + std::to_string(i) + "; v2 = " + std::to_string((i + 1) % 4) +
            "; sidefront = " + std::to_string(i) + "; blocking = true; id = " + std::to_string(60 + i) +
            "; }\n";
  for (int i = 0; i < 4; ++i)
    text += "linedef { v1 = " + std::to_string(4 + i) + "; v2 = " + std::to_string(4 + (i + 1) % 4) +
            "; sidefront = " + std::to_string(4 + 2 * i) + "; sideback = " + std::to_string(5 + 2 * i) +
            "; twosided = true; }\n";
  for (int i = 0; i < 4; ++i) text += "sidedef { sector = 0; texturemiddle = \"BRICK6\"; }\n";
  for (int i = 0; i < 4; ++i)
    text +=
        "sidedef { sector = 1; texturebottom = \"BRICK6\"; texturetop = \"BRICK6\"; }\n"
        "sidedef { sector = 0; texturebottom = \"BRICK6\"; texturetop = \"BRICK6\"; }\n";
  text +=
      "sector { texturefloor = \"FLOOR4_8\"; textureceiling = \"CEIL1_2\"; heightceiling = 512; lightlevel = "
      "200; }\n"
      "sector { texturefloor = \"FLAT1\"; textureceiling = \"CEIL1_2\"; heightfloor = 24; heightceiling = "
      "256; "
      "lightlevel = 120; id = 5; }\n";
  return text;
}

/// USER1 to USER60 of ViZDoom after each tic.
std::vector<Row> play_in_vizdoom(const std::string& python, const std::vector<uint8_t>& wad, int tics) {
  const comrad::test::ScratchFolder folder;
  const std::string errors = (folder / "errors.txt").string();
  const std::string command = python + " " COMRAD_SOURCE_DIR "/tests/parity/user_variables.py " +
                              folder.write("map.wad", wad) + " " + std::to_string(tics) + " 2>" + errors;
  std::vector<Row> rows;
  FILE* pipe = ::popen(command.c_str(), "r");
  if (pipe == nullptr) {
    ADD_FAILURE() << "cannot start " << command;
    return rows;
  }
  std::string output;
  char buffer[4096];
  while (std::fgets(buffer, sizeof(buffer), pipe) != nullptr) output += buffer;
  EXPECT_EQ(::pclose(pipe), 0) << command << "\n" << read_file(errors).value_or("");
  std::istringstream lines(output);
  for (std::string line; std::getline(lines, line);) {
    std::istringstream numbers(line);
    Row row{};
    for (std::size_t i = 1; i < row.size(); ++i) numbers >> row[i];
    rows.push_back(row);
  }
  return rows;
}

/// Our own rows, one per tic.
std::vector<Row> play_here(const std::vector<uint8_t>& behavior_bytes, int tics, std::string* error) {
  const auto map = wad::parse_udmf(room_text(), "room");
  EXPECT_TRUE(map.has_value()) << (map ? "" : map.error().message);
  const auto level = make_level(*map, "MAP01", "room");
  EXPECT_TRUE(level.has_value());
  const auto behavior = Behavior::load(behavior_bytes, "parity");
  EXPECT_TRUE(behavior.has_value()) << (behavior ? "" : behavior.error().message);
  World world(*level, std::make_shared<const ActorCatalog>(), *behavior);
  reset_world(world, {});
  std::vector<Row> rows;
  for (int tic = 0; tic < tics; ++tic) {
    run_tic(world, {});
    Row row{};
    for (int i = 1; i <= 60; ++i) row[static_cast<std::size_t>(i)] = world.exported(i);
    rows.push_back(row);
  }
  *error = world.state().scripts.last_error;
  return rows;
}

/// `names` of the USER numbers for messages. Rows are compared from the first tic in which both clocks
/// (USER60, which every program counts up) say the same.
void compare(const BehaviorBuilder& program, int tics,
             const std::function<std::string(int)>& names = nullptr) {
  const std::vector<uint8_t> behavior = program.build();
  wad::test::WadBytes wad;
  wad.add("MAP01")
      .add("TEXTMAP", room_text())
      .add("BEHAVIOR", std::string(behavior.begin(), behavior.end()))
      .add("ENDMAP");
  const Expected<std::string> python = comrad::test::vizdoom_python();
  if (!python) GTEST_SKIP() << python.error().message;
  const std::vector<Row> reference = play_in_vizdoom(*python, wad.build(), tics);
  ASSERT_EQ(reference.size(), static_cast<std::size_t>(tics));
  std::string error;
  const std::vector<Row> ours = play_here(behavior, tics + 4, &error);
  EXPECT_EQ(error, "");
  std::size_t shift = 0;
  while (shift < 4 && ours[shift][60] != reference[0][60]) ++shift;
  ASSERT_LT(shift, 4u) << "the clocks never agree: " << reference[0][60] << " and " << ours[0][60];
  int shown = 0;
  for (std::size_t tic = 0; tic < reference.size() && shown < 12; ++tic)
    for (int i = 1; i <= 60; ++i) {
      const auto user = static_cast<std::size_t>(i);
      if (ours[tic + shift][user] == reference[tic][user]) continue;
      ADD_FAILURE() << "tic " << tic << " USER" << i << (names ? " (" + names(i) + ")" : "") << ": ViZDoom "
                    << reference[tic][user] << ", here " << ours[tic + shift][user];
      ++shown;
    }
}

/// A clock in USER60.
void add_clock(BehaviorBuilder& code) {
  code.script(90, 1);
  const auto again = code.label();
  code.bind(again).op(PCode::kIncGlobalVar, {60}).op(PCode::kDelayDirect, {1}).go(PCode::kGoto, again);
}

constexpr int32_t kNumbers[] = {0,       1,         -1,        2,          -2,     3,      7,
                                -7,      31,        33,        100,        -100,   65536,  -65536,
                                98304,   -98304,    131071,    1 << 20,    12345,  -54321, 999999,
                                1 << 30, INT32_MAX, INT32_MIN, 0x7FFF0000, -65535, 255};

/// total = total * 31 + what is on the stack; the total is USER `user`.
void fold(BehaviorBuilder& code, int user) {
  code.op(PCode::kPushGlobalVar, {user}).push(31).op(PCode::kMultiply).op(PCode::kAdd);
  code.op(PCode::kAssignGlobalVar, {user});
}

TEST(VizdoomParity, Arithmetic) {
  const PCode codes[] = {PCode::kAdd,        PCode::kSubtract,    PCode::kMultiply,       PCode::kDivide,
                         PCode::kModulus,    PCode::kEqual,       PCode::kNotEqual,       PCode::kLess,
                         PCode::kGreater,    PCode::kLessOrEqual, PCode::kGreaterOrEqual, PCode::kAndLogical,
                         PCode::kOrLogical,  PCode::kAndBitwise,  PCode::kOrBitwise,      PCode::kEorBitwise,
                         PCode::kLeftShift,  PCode::kRightShift,  PCode::kFixedMul,       PCode::kFixedDiv,
                         PCode::kVectorAngle};
  const PCode unary[] = {PCode::kUnaryMinus, PCode::kNegateLogical, PCode::kNegateBinary, PCode::kSin,
                         PCode::kCos};
  const BuiltIn functions[] = {BuiltIn::kSqrt, BuiltIn::kFixedSqrt};
  BehaviorBuilder code(Container::kPlain);
  add_clock(code);
  code.script(1, 1);
  int user = 1;
  for (const PCode operation : codes) {
    for (const int32_t a : kNumbers)
      for (const int32_t b : kNumbers) {
        const bool divides = operation == PCode::kDivide || operation == PCode::kModulus;
        if (divides && (b == 0 || (a == INT32_MIN && b == -1))) continue;
        // How far a shift of more than 31 goes is the processor's; angles are compared where they are
        // well defined.
        if ((operation == PCode::kLeftShift || operation == PCode::kRightShift) && (b < 0 || b > 31))
          continue;
        if (operation == PCode::kVectorAngle &&
            (std::abs(int64_t{a}) > 999999 || std::abs(int64_t{b}) > 999999))
          continue;
        code.push({a, b}).op(operation);
        if (operation == PCode::kVectorAngle) code.push(64).op(PCode::kAdd).push(7).op(PCode::kRightShift);
        fold(code, user);
      }
    ++user;
  }
  for (const PCode operation : unary) {
    for (const int32_t a : kNumbers) {
      code.push(a).op(operation);
      // Doom's table and the C library's sine differ in the last bits.
      if (operation == PCode::kSin || operation == PCode::kCos)
        code.push(32).op(PCode::kAdd).push(9).op(PCode::kRightShift);
      fold(code, user);
    }
    ++user;
  }
  for (const BuiltIn function : functions) {
    for (const int32_t a : kNumbers)
      if (a >= 0) code.push(a).call(function, 1), fold(code, user);
    ++user;
  }
  code.end();
  compare(code, 3, [&](int i) {
    return i <= static_cast<int>(std::size(codes))
               ? std::string(bytecode::kPCodes[static_cast<std::size_t>(codes[i - 1])].name)
               : "unary " + std::to_string(i);
  });
}

/// Every letter of the text whose number is on the stack goes into USER `user`.
void fold_text(BehaviorBuilder& code, int user) {
  code.op(PCode::kAssignScriptVar, {9});
  code.op(PCode::kPushScriptVar, {9}).op(PCode::kStrLen), fold(code, user);
  for (int letter = 0; letter < 14; ++letter) {
    code.op(PCode::kPushScriptVar, {9}).push(letter).call(BuiltIn::kGetChar, 2);
    fold(code, user);
  }
}

TEST(VizdoomParity, ConversionsAndTexts) {
  BehaviorBuilder code(Container::kHiddenCompact);
  add_clock(code);
  code.script(1, 1);
  const auto converted = [&](PCode print, int32_t value, int user) {
    code.op(PCode::kBeginPrint).push(value).op(print).op(PCode::kSaveString);
    fold_text(code, user);
  };
  for (const int32_t value : kNumbers) {
    if (value != INT32_MIN) converted(PCode::kPrintNumber, value, 1);  // ViZDoom prints no number there
    converted(PCode::kPrintHex, value, 2);
    converted(PCode::kPrintBinary, value, 3);
    converted(PCode::kPrintFixed, value, 4);
  }
  converted(PCode::kPrintCharacter, 'x', 5);
  const char* texts[] = {"", "a", "Imp", "imp", "Impss", "formation", "FORMATION", "zzz"};
  int user = 10;
  for (const BuiltIn function : {BuiltIn::kStrCmp, BuiltIn::kStrICmp}) {
    for (const char* a : texts)
      for (const char* b : texts) {
        code.push_text(a).push_text(b).call(function, 2).op(PCode::kDuplicate).push(0).op(PCode::kGreater);
        code.op(PCode::kSwap).push(0).op(PCode::kLess).op(PCode::kSubtract);
        fold(code, user);
        code.push_text(a).push_text(b).push(3).call(function, 3).push(0).op(PCode::kEqual);
        fold(code, user + 1);
      }
    user += 2;
  }
  for (const char* text : texts)
    for (const int32_t count : {-1, 0, 1, 3, 100}) {
      code.push_text(text).push(count).call(BuiltIn::kStrLeft, 2), fold_text(code, 20);
      code.push_text(text).push(count).call(BuiltIn::kStrRight, 2), fold_text(code, 21);
      if (count < 0) continue;
      for (const int32_t start : {0, 2, 50})
        code.push_text(text).push({start, count}).call(BuiltIn::kStrMid, 3), fold_text(code, 22);
    }
  for (const char* text : texts)
    for (const int32_t place : {0, 1, 8, 9, 30})
      code.push_text(text).push(place).call(BuiltIn::kGetChar, 2), fold(code, 23);
  // A text inside a text.
  code.op(PCode::kBeginPrint).push_text("a").op(PCode::kPrintString);
  code.op(PCode::kBeginPrint).push(7).op(PCode::kPrintNumber).op(PCode::kSaveString).op(PCode::kPrintString);
  code.push('c').op(PCode::kPrintCharacter).op(PCode::kSaveString), fold_text(code, 24);
  code.end();
  compare(code, 3);
}

TEST(VizdoomParity, ThingsSectorsAndInventory) {
  BehaviorBuilder code(Container::kCompact);
  add_clock(code);
  code.script(1, 4);
  int user = 1;
  const auto store = [&] { code.store_global(user++); };
  for (const char* type :
       {"DoomImp", "Cyberdemon", "LostSoul", "ExplosiveBarrel", "BaronOfHell", "TechLamp"}) {
    code.push_text(type).push({-400 * 65536, 300 * 65536, 0, 70, 64}).call(BuiltIn::kSpawnForced, 6), store();
    for (const int32_t property : {0, 1, 32, 35, 36, 17, 3, 15})
      code.push({70, property}).op(PCode::kGetActorProperty), fold(code, user);
    ++user;
    for (const char* flag :
         {"SOLID", "SHOOTABLE", "NOGRAVITY", "FLOAT", "COUNTKILL", "BOSS", "MISSILEMORE", "NOBLOOD"})
      code.push(70).push_text(flag).call(BuiltIn::kCheckFlag, 2), fold(code, user);
    ++user;
    code.push(70).op(PCode::kLspec1, {133});       // Thing_Destroy
    code.push({70, 0}).op(PCode::kLspec2, {176});  // Thing_ChangeTID
  }
  // Counting, places, turns.
  code.push_text("Demon").push(0).op(PCode::kThingCountName), store();
  code.push({0, 31}).op(PCode::kThingCount), store();
  code.push({8, 0}).op(PCode::kThingCount), store();
  for (const PCode query : {PCode::kGetActorX, PCode::kGetActorY, PCode::kGetActorZ, PCode::kGetActorAngle,
                            PCode::kGetActorFloorZ, PCode::kGetActorCeilingZ})
    for (const int32_t thing : {0, 30, 31, 32, 99}) code.push(thing).op(query), fold(code, user);
  ++user;
  code.push({31, -800 * 65536, -800 * 65536, 24 * 65536, 0}).op(PCode::kSetActorPosition), store();
  code.push(31).op(PCode::kGetActorFloorZ), store();
  code.push({31, 0, 0, 0, 0}).op(PCode::kSetActorPosition), store();  // the player stands there
  code.push({31, 5000 * 65536, 0, 0, 0}).op(PCode::kSetActorPosition), store();
  code.push(31).op(PCode::kGetActorX), store();
  code.push({0, 16384}).op(PCode::kSetActorAngle).push(0).op(PCode::kGetActorAngle), store();
  code.push({5, 0, 0}).op(PCode::kGetSectorFloorZ), store();
  code.push({0, -800, -800}).op(PCode::kGetSectorFloorZ), store();
  code.push({5, 0, 0}).op(PCode::kGetSectorCeilingZ), store();
  code.push(5).op(PCode::kGetSectorLightLevel), store();
  code.push(31).call(BuiltIn::kIsTIDUsed, 1), store();
  code.push(99).call(BuiltIn::kIsTIDUsed, 1), store();
  for (const int32_t thing : {0, 30, 31, 32, 99})
    code.push(thing).op(PCode::kClassifyActor), fold(code, user);
  ++user;
  // What a player carries.
  const auto count = [&](const char* item) { code.push_text(item).op(PCode::kCheckInventory), store(); };
  code.op(PCode::kClearInventory);
  count("Clip"), count("Pistol"), count("Fist");
  code.push_text("ClipBox").push(6).op(PCode::kGiveInventory), count("Clip");
  code.push_text("Shotgun").push(1).op(PCode::kGiveInventory), count("Shell");
  code.push_text("Shell").push(1000).op(PCode::kGiveInventory), count("Shell");
  code.push_text("Shell").push(7).op(PCode::kTakeInventory), count("Shell");
  code.push_text("Shell")
      .push(9999)
      .op(PCode::kSetAmmoCapacity)
      .push_text("Shell")
      .op(PCode::kGetAmmoCapacity),
      store();
  code.push_text("GreenArmor").push(1).op(PCode::kGiveInventory), count("BasicArmor");
  code.push_text("Health").push(30).op(PCode::kGiveInventory), count("Health");
  code.push_text("RedCard").push(1).op(PCode::kGiveInventory), count("RedCard");
  code.op(PCode::kPlayerCount), fold(code, user);
  code.op(PCode::kPlayerNumber), fold(code, user);
  code.op(PCode::kGameSkill), fold(code, user);
  code.op(PCode::kPlayerHealth), fold(code, user);
  code.op(PCode::kPlayerArmorPoints), fold(code, user);
  code.end();
  ASSERT_LT(user, 60);
  compare(code, 4);
}

TEST(VizdoomParity, DelaysWaitsAndOrder) {
  BehaviorBuilder code(Container::kPlain);
  add_clock(code);
  // Who runs when: each start leaves its mark behind those before it.
  const auto mark = [&](int32_t value) { code.push(value), fold(code, 1); };
  code.script(1, 1);
  mark(1);
  code.op(PCode::kDelayDirect, {3});
  mark(2);
  code.push({3, 0, 5, 6, 7}).op(PCode::kLspec5, {80});  // ACS_Execute 3
  mark(3);
  code.op(PCode::kScriptWaitDirect, {3});
  mark(4);
  code.op(PCode::kPushGlobalVar, {60}).store_global(2).end();
  code.script(2, 4);
  mark(11);
  code.op(PCode::kDelayDirect, {1});
  mark(12);
  code.op(PCode::kDelayDirect, {1});
  mark(13);
  code.push({4, 0, 1, 0, 0}).op(PCode::kLspec5, {226});  // ACS_ExecuteAlways 4, three at once
  code.push({4, 0, 2, 0, 0}).op(PCode::kLspec5, {226});
  code.push({4, 0, 3, 0, 0}).op(PCode::kLspec5, {226});
  code.op(PCode::kDelayDirect, {10});
  code.push({6, 0, 4, 0, 0}).op(PCode::kLspec5Result, {84}).store_global(4);  // ACS_ExecuteWithResult
  code.push({5, 0, 0, 0, 0}).op(PCode::kLspec5, {80}).op(PCode::kDelayDirect, {4});
  code.push({5, 0}).op(PCode::kLspec2, {82});  // ACS_Terminate
  mark(14);
  code.end();
  code.script(3, 0, 3);
  code.op(PCode::kPushScriptVar, {0}).op(PCode::kPushScriptVar, {1}).op(PCode::kAdd), fold(code, 1);
  code.op(PCode::kDelayDirect, {5});
  mark(21);
  code.end();
  code.script(4, 0, 3).op(PCode::kPushScriptVar, {0}), fold(code, 1);
  code.op(PCode::kPushScriptVar, {0}).op(PCode::kDelay).op(PCode::kPushScriptVar, {0}), fold(code, 3);
  code.end();
  code.script(5);
  const auto again = code.label();
  code.bind(again).op(PCode::kIncGlobalVar, {5}).op(PCode::kDelayDirect, {1}).go(PCode::kGoto, again);
  code.script(6, 0, 3)
      .op(PCode::kPushScriptVar, {0})
      .push(10)
      .op(PCode::kMultiply)
      .op(PCode::kSetResultValue)
      .end();
  compare(code, 60);
}

}  // namespace vizdoom_parity_test
}  // namespace comrad::doom::acs::test
