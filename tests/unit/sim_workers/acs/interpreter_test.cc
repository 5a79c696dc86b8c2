#include "sim_workers/engine/acs/interpreter.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>

#include "sim_workers/engine/acs/script_calls.h"
#include "sim_workers/engine/tic/tic.h"
#include "tests/unit/sim_workers/acs/script_world.h"

namespace comrad::doom::acs::test {
namespace interpreter_test {

constexpr int32_t kNumbers[] = {0,  1,  -1,  2,     -2,     3,     7,         -7,
                                31, 32, 100, 65536, -65536, 98304, INT32_MAX, INT32_MIN};

int32_t wrapped(int64_t value) { return static_cast<int32_t>(static_cast<uint64_t>(value)); }

struct Binary {
  PCode code;
  std::function<int32_t(int32_t, int32_t)> plain;
};

const std::vector<Binary>& binaries() {
  using P = PCode;
  static const std::vector<Binary> all = {
      {P::kAdd, [](int32_t a, int32_t b) { return wrapped(int64_t{a} + b); }},
      {P::kSubtract, [](int32_t a, int32_t b) { return wrapped(int64_t{a} - b); }},
      {P::kMultiply, [](int32_t a, int32_t b) { return wrapped(int64_t{a} * b); }},
      {P::kDivide, [](int32_t a, int32_t b) { return wrapped(int64_t{a} / b); }},
      {P::kModulus, [](int32_t a, int32_t b) { return wrapped(int64_t{a} % b); }},
      {P::kEqual, [](int32_t a, int32_t b) { return int32_t{a == b}; }},
      {P::kNotEqual, [](int32_t a, int32_t b) { return int32_t{a != b}; }},
      {P::kLess, [](int32_t a, int32_t b) { return int32_t{a < b}; }},
      {P::kGreater, [](int32_t a, int32_t b) { return int32_t{a > b}; }},
      {P::kLessOrEqual, [](int32_t a, int32_t b) { return int32_t{a <= b}; }},
      {P::kGreaterOrEqual, [](int32_t a, int32_t b) { return int32_t{a >= b}; }},
      {P::kAndLogical, [](int32_t a, int32_t b) { return int32_t{a && b}; }},
      {P::kOrLogical, [](int32_t a, int32_t b) { return int32_t{a || b}; }},
      {P::kAndBitwise, [](int32_t a, int32_t b) { return a & b; }},
      {P::kOrBitwise, [](int32_t a, int32_t b) { return a | b; }},
      {P::kEorBitwise, [](int32_t a, int32_t b) { return a ^ b; }},
      {P::kLeftShift,
       [](int32_t a, int32_t b) { return static_cast<int32_t>(static_cast<uint32_t>(a) << (b & 31)); }},
      {P::kRightShift, [](int32_t a, int32_t b) { return a >> (b & 31); }},
      {P::kFixedMul, [](int32_t a, int32_t b) { return wrapped((int64_t{a} * b) >> 16); }},
  };
  return all;
}

TEST(Interpreter, ComputesAsPlainArithmeticDoes) {
  for (const Container container : kContainers) {
    for (const Binary& binary : binaries()) {
      BehaviorBuilder code(container);
      code.script(1, kOpen);
      int32_t index = 0;
      std::vector<int32_t> expected;
      const bool divides = binary.code == PCode::kDivide || binary.code == PCode::kModulus;
      for (const int32_t a : kNumbers)
        for (const int32_t b : kNumbers) {
          if (divides && b == 0) continue;
          // Results go to a world array: there are more of them than variables.
          code.push(index++).push(a).push(b).op(binary.code).op(PCode::kAssignWorldArray, {1});
          expected.push_back(binary.plain(a, b));
        }
      code.end();
      ScriptWorld game(code);
      game.tic();
      ASSERT_EQ(game.error(), "");
      const std::vector<int32_t>& results = game.machine().world_arrays[1];
      EXPECT_EQ(results, expected) << bytecode::kPCodes[static_cast<std::size_t>(binary.code)].name;
    }
  }
}

TEST(Interpreter, ComputesUnaryOperationsAndRoots) {
  for (const Container container : {Container::kPlain, Container::kCompact}) {
    for (const int32_t a : kNumbers) {
      const auto unary = [&](PCode code) {
        return evaluate(container, [&](BehaviorBuilder& out) { out.push(a).op(code); });
      };
      EXPECT_EQ(unary(PCode::kUnaryMinus), wrapped(-int64_t{a}));
      EXPECT_EQ(unary(PCode::kNegateLogical), a == 0);
      EXPECT_EQ(unary(PCode::kNegateBinary), ~a);
      EXPECT_EQ(unary(PCode::kSin), fine_sine(static_cast<uint32_t>(a) << 16));
      EXPECT_EQ(unary(PCode::kCos), fine_cosine(static_cast<uint32_t>(a) << 16));
      EXPECT_EQ(evaluate(container, [&](BehaviorBuilder& out) { out.push(a).call(BuiltIn::kSqrt, 1); }),
                a <= 0 ? 0 : static_cast<int32_t>(std::sqrt(static_cast<double>(a))));
      EXPECT_EQ(evaluate(container, [&](BehaviorBuilder& out) { out.push(a).call(BuiltIn::kFixedSqrt, 1); }),
                a <= 0 ? 0 : static_cast<int32_t>(std::lround(std::sqrt(a / 65536.0) * 65536.0)));
    }
  }
  EXPECT_EQ(evaluate(Container::kCompact,
                     [](BehaviorBuilder& out) {
                       out.push({98304, 32768}).op(PCode::kFixedDiv);
                     }),
            3 * 65536);
  EXPECT_EQ(evaluate(Container::kCompact,
                     [](BehaviorBuilder& out) {
                       out.push({-5, 0}).op(PCode::kFixedDiv);
                     }),
            INT32_MIN);
  EXPECT_EQ(evaluate(Container::kCompact,
                     [](BehaviorBuilder& out) {
                       out.push({3 << 16, 4 << 16}).call(BuiltIn::kVectorLength, 2);
                     }),
            5 << 16);
  // What ViZDoom answers.
  struct VectorCase {
    int32_t x, y, angle;
  };
  for (const VectorCase& known : {VectorCase{65536, 0, 0},
                                  {0, 65536, 16383},
                                  {-65536, 0, 32767},
                                  {0, -65536, 49152},
                                  {65536, 65536, 8192},
                                  {3, 4, 8192},
                                  {100000, -300000, 52509},
                                  {0, 0, 0}})
    EXPECT_EQ(evaluate(Container::kCompact,
                       [&](BehaviorBuilder& out) {
                         out.push({known.x, known.y}).op(PCode::kVectorAngle);
                       }),
              known.angle)
        << known.x << " " << known.y;
  EXPECT_EQ(evaluate(Container::kCompact,
                     [](BehaviorBuilder& out) {
                       out.push({INT32_MAX, INT32_MAX}).call(BuiltIn::kVectorLength, 2);
                     }),
            -1257966797);
}

TEST(Interpreter, PushesConstantsOfEverySize) {
  EXPECT_EQ(evaluate(Container::kCompact, [](BehaviorBuilder& out) { out.op(PCode::kPushByte, {200}); }),
            200);
  EXPECT_EQ(evaluate(Container::kHiddenCompact,
                     [](BehaviorBuilder& out) {
                       out.op(PCode::kPush2Bytes, {1, 2}).op(PCode::kPush3Bytes, {3, 4, 5});
                       out.op(PCode::kPush4Bytes, {6, 7, 8, 9}).op(PCode::kPush5Bytes, {10, 11, 12, 13, 14});
                       out.op(PCode::kPushBytes, {15, 16, 255});
                       for (int i = 0; i < 16; ++i) out.op(PCode::kAdd);
                     }),
            16 * 17 / 2 + 255);
  EXPECT_EQ(evaluate(Container::kOld, [](BehaviorBuilder& out) { out.push(-123456789); }), -123456789);
  EXPECT_EQ(evaluate(Container::kPlain,
                     [](BehaviorBuilder& out) {
                       out.push(5).op(PCode::kDuplicate).op(PCode::kMultiply).push(7).op(PCode::kSwap);
                       out.op(PCode::kSubtract);
                     }),
            7 - 25);
}

// ---- variables

struct VariableFamily {
  const char* name;
  PCode assign, push, add, sub, mul, div, mod, inc, dec, bit_and, eor, bit_or, left, right;
  bool array;
};

const VariableFamily kFamilies[] = {
    {"script", PCode::kAssignScriptVar, PCode::kPushScriptVar, PCode::kAddScriptVar, PCode::kSubScriptVar,
     PCode::kMulScriptVar, PCode::kDivScriptVar, PCode::kModScriptVar, PCode::kIncScriptVar,
     PCode::kDecScriptVar, PCode::kAndScriptVar, PCode::kEorScriptVar, PCode::kOrScriptVar,
     PCode::kLeftShiftScriptVar, PCode::kRightShiftScriptVar, false},
    {"map", PCode::kAssignMapVar, PCode::kPushMapVar, PCode::kAddMapVar, PCode::kSubMapVar, PCode::kMulMapVar,
     PCode::kDivMapVar, PCode::kModMapVar, PCode::kIncMapVar, PCode::kDecMapVar, PCode::kAndMapVar,
     PCode::kEorMapVar, PCode::kOrMapVar, PCode::kLeftShiftMapVar, PCode::kRightShiftMapVar, false},
    {"world", PCode::kAssignWorldVar, PCode::kPushWorldVar, PCode::kAddWorldVar, PCode::kSubWorldVar,
     PCode::kMulWorldVar, PCode::kDivWorldVar, PCode::kModWorldVar, PCode::kIncWorldVar, PCode::kDecWorldVar,
     PCode::kAndWorldVar, PCode::kEorWorldVar, PCode::kOrWorldVar, PCode::kLeftShiftWorldVar,
     PCode::kRightShiftWorldVar, false},
    {"global", PCode::kAssignGlobalVar, PCode::kPushGlobalVar, PCode::kAddGlobalVar, PCode::kSubGlobalVar,
     PCode::kMulGlobalVar, PCode::kDivGlobalVar, PCode::kModGlobalVar, PCode::kIncGlobalVar,
     PCode::kDecGlobalVar, PCode::kAndGlobalVar, PCode::kEorGlobalVar, PCode::kOrGlobalVar,
     PCode::kLeftShiftGlobalVar, PCode::kRightShiftGlobalVar, false},
    {"script array", PCode::kAssignScriptArray, PCode::kPushScriptArray, PCode::kAddScriptArray,
     PCode::kSubScriptArray, PCode::kMulScriptArray, PCode::kDivScriptArray, PCode::kModScriptArray,
     PCode::kIncScriptArray, PCode::kDecScriptArray, PCode::kAndScriptArray, PCode::kEorScriptArray,
     PCode::kOrScriptArray, PCode::kLeftShiftScriptArray, PCode::kRightShiftScriptArray, true},
    {"map array", PCode::kAssignMapArray, PCode::kPushMapArray, PCode::kAddMapArray, PCode::kSubMapArray,
     PCode::kMulMapArray, PCode::kDivMapArray, PCode::kModMapArray, PCode::kIncMapArray, PCode::kDecMapArray,
     PCode::kAndMapArray, PCode::kEorMapArray, PCode::kOrMapArray, PCode::kLeftShiftMapArray,
     PCode::kRightShiftMapArray, true},
    {"world array", PCode::kAssignWorldArray, PCode::kPushWorldArray, PCode::kAddWorldArray,
     PCode::kSubWorldArray, PCode::kMulWorldArray, PCode::kDivWorldArray, PCode::kModWorldArray,
     PCode::kIncWorldArray, PCode::kDecWorldArray, PCode::kAndWorldArray, PCode::kEorWorldArray,
     PCode::kOrWorldArray, PCode::kLeftShiftWorldArray, PCode::kRightShiftWorldArray, true},
    {"global array", PCode::kAssignGlobalArray, PCode::kPushGlobalArray, PCode::kAddGlobalArray,
     PCode::kSubGlobalArray, PCode::kMulGlobalArray, PCode::kDivGlobalArray, PCode::kModGlobalArray,
     PCode::kIncGlobalArray, PCode::kDecGlobalArray, PCode::kAndGlobalArray, PCode::kEorGlobalArray,
     PCode::kOrGlobalArray, PCode::kLeftShiftGlobalArray, PCode::kRightShiftGlobalArray, true},
};

TEST(Interpreter, EveryKindOfVariableTakesEveryOperation) {
  for (const Container container : {Container::kPlain, Container::kHiddenCompact}) {
    for (const VariableFamily& family : kFamilies) {
      BehaviorBuilder code(container);
      constexpr int32_t kNumber = 3;  // of the variable or array
      code.array(kNumber, {0, 0, 0});
      code.script(1, kOpen).local_arrays({1, 1, 1, 4});
      int32_t expected = 0;
      const auto with = [&](PCode op, int32_t operand) {
        if (family.array) code.push(2);
        code.push(operand).op(op, {kNumber});
      };
      const auto alone = [&](PCode op) {
        if (family.array) code.push(2);
        code.op(op, {kNumber});
      };
      with(family.assign, 1000), expected = 1000;
      with(family.add, 23), expected += 23;
      with(family.sub, 3), expected -= 3;
      with(family.mul, 7), expected *= 7;
      with(family.div, 3), expected /= 3;
      with(family.mod, 901), expected %= 901;
      alone(family.inc), ++expected;
      alone(family.inc), ++expected;
      alone(family.dec), --expected;
      with(family.left, 4), expected <<= 4;
      with(family.bit_or, 5), expected |= 5;
      with(family.eor, 0x1234), expected ^= 0x1234;
      with(family.bit_and, 0xFFF7), expected &= 0xFFF7;
      with(family.right, 2), expected >>= 2;
      alone(family.push);
      code.store_global(1).end();
      ScriptWorld game(code);
      game.tic();
      EXPECT_EQ(game.error(), "") << family.name;
      EXPECT_EQ(game.global(1), expected) << family.name;
    }
  }
}

TEST(Interpreter, ArraysEndWhereTheyEnd) {
  BehaviorBuilder code(Container::kCompact);
  code.array(3, {5, 6, 7});
  code.script(1, kOpen);
  code.push(3).op(PCode::kPushMapArray, {3}).store_global(1);  // reads 0
  code.push(-1).push(9).op(PCode::kAssignMapArray, {3});       // goes nowhere
  code.push(0).op(PCode::kPushMapArray, {3}).store_global(2);
  code.push(4000).op(PCode::kPushWorldArray, {9}).store_global(3);  // never written: 0
  code.push(1).store_global(4).end();
  ScriptWorld game(code);
  game.world.state().globals[1] = 99;
  game.tic();
  EXPECT_EQ(game.error(), "");
  EXPECT_EQ(game.global(1), 0);
  EXPECT_EQ(game.global(2), 5);
  EXPECT_EQ(game.global(3), 0);
  EXPECT_EQ(game.global(4), 1);
}

// ---- jumps and functions

TEST(Interpreter, LoopsAndBranches) {
  for (const Container container : kContainers) {
    BehaviorBuilder code(container);
    code.script(1, kOpen);
    const auto again = code.label(), done = code.label();
    code.push(10).op(PCode::kAssignScriptVar, {0});
    code.bind(again).op(PCode::kPushScriptVar, {0}).go(PCode::kIfNotGoto, done);
    code.op(PCode::kPushScriptVar, {0}).op(PCode::kAddMapVar, {5}).op(PCode::kDecScriptVar, {0});
    code.push(1).go(PCode::kIfGoto, again);
    code.bind(done).op(PCode::kPushMapVar, {5}).store_global(1).end();
    ScriptWorld game(code);
    game.tic();
    EXPECT_EQ(game.error(), "");
    EXPECT_EQ(game.global(1), 55);
  }
}

TEST(Interpreter, SwitchesFindTheirCase) {
  for (const Container container : {Container::kPlain, Container::kCompact}) {
    for (const bool sorted : {false, true}) {
      for (const int32_t value : {-5, 0, 3, 4, 1000}) {
        BehaviorBuilder code(container);
        if (sorted) code.op(PCode::kNop);  // the table is not aligned by chance
        code.script(1, kOpen);
        const auto minus = code.label(), three = code.label(), thousand = code.label();
        code.push(value);
        if (sorted) {
          code.case_sorted({{-5, minus}, {3, three}, {1000, thousand}});
        } else {
          code.case_goto(3, three).case_goto(-5, minus).case_goto(1000, thousand);
        }
        code.op(PCode::kDrop).push(77).store_global(1).end();
        code.bind(minus).push(1).store_global(1).end();
        code.bind(three).push(2).store_global(1).end();
        code.bind(thousand).push(3).store_global(1).end();
        ScriptWorld game(code);
        game.tic();
        EXPECT_EQ(game.error(), "");
        EXPECT_EQ(game.global(1), value == -5 ? 1 : value == 3 ? 2 : value == 1000 ? 3 : 77) << value;
      }
    }
  }
}

TEST(Interpreter, FunctionsHaveTheirOwnVariablesAndMayCallThemselves) {
  for (const Container container : {Container::kPlain, Container::kHiddenCompact}) {
    BehaviorBuilder code(container);
    const int32_t factorial = code.function(1, 1, true, "factorial");
    const auto recurse = code.label();
    code.op(PCode::kPushScriptVar, {0}).push(1).op(PCode::kGreater).go(PCode::kIfGoto, recurse);
    code.push(1).op(PCode::kReturnValue);
    code.bind(recurse)
        .op(PCode::kPushScriptVar, {0})
        .op(PCode::kPushScriptVar, {0})
        .push(1)
        .op(PCode::kSubtract);
    code.op(PCode::kCall, {factorial}).op(PCode::kMultiply).op(PCode::kReturnValue).end_function();
    code.script(1, kOpen).push(11).op(PCode::kAssignScriptVar, {0});
    code.push(10).op(PCode::kCall, {factorial}).store_global(1);
    code.push(4).op(PCode::kCallDiscard, {factorial});
    code.push(5).op(PCode::kPushFunction, {factorial}).op(PCode::kCallStack).store_global(2);
    code.op(PCode::kPushScriptVar, {0}).store_global(3).end();
    ScriptWorld game(code);
    game.tic();
    EXPECT_EQ(game.error(), "");
    EXPECT_EQ(game.global(1), 3628800);
    EXPECT_EQ(game.global(2), 120);
    EXPECT_EQ(game.global(3), 11);
    EXPECT_TRUE(game.machine().threads.empty());
  }
}

TEST(Interpreter, JumpsToTargetsFromTheStack) {
  BehaviorBuilder code(Container::kCompact);
  const auto first = code.label(), second = code.label();
  code.jump_target(first).jump_target(second);
  code.script(1, kOpen).push(1).op(PCode::kGotoStack);
  code.bind(first).push(1).store_global(1).end();
  code.bind(second).push(2).store_global(1).end();
  ScriptWorld game(code);
  game.tic();
  EXPECT_EQ(game.global(1), 2);
}

TEST(Interpreter, RandomStaysInItsRangeAndReachesItsEnds) {
  BehaviorBuilder code(Container::kCompact);
  code.script(1, kOpen);
  const auto again = code.label();
  code.bind(again).op(PCode::kPushScriptVar, {0});
  code.push({-3, 4}).op(PCode::kRandom).op(PCode::kAssignWorldArray, {0});
  code.op(PCode::kPushScriptVar, {0}).push(1000).op(PCode::kAdd);
  code.op(PCode::kRandomDirect, {9, 7}).op(PCode::kAssignWorldArray, {0});
  code.op(PCode::kPushScriptVar, {0}).push(2000).op(PCode::kAdd);
  code.op(PCode::kRandomDirectB, {250, 255}).op(PCode::kAssignWorldArray, {0});
  code.op(PCode::kIncScriptVar, {0}).op(PCode::kPushScriptVar, {0}).push(500).op(PCode::kLess);
  code.go(PCode::kIfGoto, again);
  code.push({INT32_MIN, INT32_MAX}).op(PCode::kRandom).op(PCode::kDrop).end();
  ScriptWorld game(code);
  game.tic();
  ASSERT_EQ(game.error(), "");
  const auto& drawn = game.machine().world_arrays[0];
  const auto ends = [&](std::size_t from) {
    const auto [low, high] = std::minmax_element(drawn.begin() + static_cast<std::ptrdiff_t>(from),
                                                 drawn.begin() + static_cast<std::ptrdiff_t>(from) + 500);
    return std::pair(*low, *high);
  };
  EXPECT_EQ(ends(0), std::pair(-3, 4));
  EXPECT_EQ(ends(1000), std::pair(7, 9));
  EXPECT_EQ(ends(2000), std::pair(250, 255));
}

// ---- texts

std::string printed(const std::function<void(BehaviorBuilder&)>& write,
                    Container container = Container::kCompact) {
  BehaviorBuilder code(container);
  code.array(4, {'a', 'b', 'c', 'd', 0, 'z'});
  code.script(1, kEnter).op(PCode::kBeginPrint);
  write(code);
  code.op(PCode::kEndPrint).end();
  ScriptWorld game(code);
  game.tic();
  EXPECT_EQ(game.error(), "");
  return game.machine().hud_messages.empty() ? "nothing" : game.machine().hud_messages[0].text;
}

TEST(Interpreter, PrintsEveryKindOfValue) {
  EXPECT_EQ(printed([](BehaviorBuilder& out) {
              out.push_text("tether ").op(PCode::kPrintString).push(-42).op(PCode::kPrintNumber);
              out.push(' ').op(PCode::kPrintCharacter).push(98304).op(PCode::kPrintFixed);
              out.push(' ').op(PCode::kPrintCharacter).push(-1).op(PCode::kPrintHex);
              out.push(' ').op(PCode::kPrintCharacter).push(10).op(PCode::kPrintBinary);
            }),
            "tether -42 1.5 FFFFFFFF 1010");
  EXPECT_EQ(printed([](BehaviorBuilder& out) { out.push(0).op(PCode::kPrintName); }), "Player 1");
  EXPECT_EQ(printed([](BehaviorBuilder& out) { out.push({0, 4}).op(PCode::kPrintMapCharArray); }), "abcd");
  EXPECT_EQ(printed([](BehaviorBuilder& out) { out.push({0, 4, 1, 2}).op(PCode::kPrintMapChRange); }), "bc");
  EXPECT_EQ(printed([](BehaviorBuilder& out) { out.push({5, 4}).op(PCode::kPrintMapCharArray); }), "z");
}

TEST(Interpreter, BuildsTextsInsideTexts) {
  // "a" + strparam("b" + number) + "c"
  const auto nested = [](BehaviorBuilder& out) {
    out.push_text("a").op(PCode::kPrintString);
    out.op(PCode::kBeginPrint).push_text("b").op(PCode::kPrintString).push(7).op(PCode::kPrintNumber);
    out.op(PCode::kSaveString).op(PCode::kPrintString);
    out.push_text("c").op(PCode::kPrintString);
  };
  EXPECT_EQ(printed(nested), "ab7c");
}

int32_t text_number(BehaviorBuilder& out, std::string_view text) { return out.text(text); }

TEST(Interpreter, HandlesTexts) {
  const auto number = [](const std::function<void(BehaviorBuilder&)>& write) {
    return evaluate(Container::kCompact, write);
  };
  EXPECT_EQ(number([](BehaviorBuilder& out) { out.push_text("twelve bytes").op(PCode::kStrLen); }), 12);
  EXPECT_EQ(number([](BehaviorBuilder& out) {
              out.push(text_number(out, "xyz")).push(1).call(BuiltIn::kGetChar, 2);
            }),
            'y');
  EXPECT_EQ(number([](BehaviorBuilder& out) { out.push_text("xyz").push(3).call(BuiltIn::kGetChar, 2); }), 0);
  const auto compare = [&](BuiltIn function, const char* a, const char* b) {
    return number([&](BehaviorBuilder& out) { out.push_text(a).push_text(b).call(function, 2); });
  };
  EXPECT_EQ(compare(BuiltIn::kStrCmp, "Imp", "Imp"), 0);
  EXPECT_LT(compare(BuiltIn::kStrCmp, "Imp", "imp"), 0);
  EXPECT_EQ(compare(BuiltIn::kStrICmp, "Imp", "iMP"), 0);
  EXPECT_GT(compare(BuiltIn::kStrICmp, "Impss", "Imps"), 0);
  EXPECT_EQ(number([](BehaviorBuilder& out) {
              out.push_text("abcX").push_text("abcY").push(3).call(BuiltIn::kStrCmp, 3);
            }),
            0);
  const auto part = [](BuiltIn function, std::initializer_list<int32_t> args) {
    return printed([&](BehaviorBuilder& out) {
      out.push_text("formation")
          .push(args)
          .call(function, 1 + static_cast<int>(args.size()))
          .op(PCode::kPrintString);
    });
  };
  EXPECT_EQ(part(BuiltIn::kStrLeft, {4}), "form");
  EXPECT_EQ(part(BuiltIn::kStrRight, {3}), "ion");
  EXPECT_EQ(part(BuiltIn::kStrMid, {4, 3}), "ati");
  EXPECT_EQ(part(BuiltIn::kStrMid, {7, 100}), "on");
  EXPECT_EQ(part(BuiltIn::kStrLeft, {-4}), "formation");
  EXPECT_EQ(part(BuiltIn::kStrRight, {-4}), "formation");
  EXPECT_EQ(part(BuiltIn::kStrMid, {2, -1}), "rmation");
  EXPECT_EQ(part(BuiltIn::kStrMid, {-2, 4}), "");
}

TEST(Interpreter, CopiesTextsIntoArrays) {
  // place, array, offset, capacity, text, offset in the text
  const auto copied = [](int32_t offset, int32_t capacity, int32_t text_offset) {
    BehaviorBuilder code(Container::kCompact);
    code.array(4, std::vector<int32_t>(8, '.'));
    code.script(1, kEnter);
    code.push({0, 4, offset, capacity}).push_text("scout").push(text_offset).op(PCode::kStrCpyToMapChRange);
    code.store_global(1).end();
    ScriptWorld game(code);
    game.tic();
    EXPECT_EQ(game.error(), "");
    std::string result(1, static_cast<char>('0' + game.global(1)));
    for (const int32_t letter : game.machine().map_arrays[0])
      result += letter == 0 ? '0' : static_cast<char>(letter);
    return result;
  };
  EXPECT_EQ(copied(0, 8, 0), "1scout0..");
  EXPECT_EQ(copied(2, 3, 0), "0..sco...");
  EXPECT_EQ(copied(1, 8, 3), "1.ut0....");
  EXPECT_EQ(copied(-1, 8, 0), "0........");
}

TEST(Interpreter, TextsBuiltForEverDoNotPileUp) {
  BehaviorBuilder code(Container::kCompact);
  code.script(1, kOpen);
  const auto again = code.label();
  code.bind(again).op(PCode::kBeginPrint).op(PCode::kPushScriptVar, {0}).op(PCode::kPrintNumber);
  code.op(PCode::kSaveString).op(PCode::kAssignMapVar, {1});
  code.op(PCode::kIncScriptVar, {0}).op(PCode::kPushScriptVar, {0}).push(50).op(PCode::kModulus);
  code.go(PCode::kIfGoto, again);
  code.op(PCode::kDelayDirect, {1}).go(PCode::kGoto, again);
  ScriptWorld game(code);
  game.tic(200);
  EXPECT_EQ(game.error(), "");
  EXPECT_LT(game.machine().dynamic_strings.size(), 700u);
  EXPECT_EQ(string_at(game.world, game.machine().map_variables[1]), "9999");
}

// ---- what is wrong stops the script, and only that

struct Broken {
  const char* message;
  std::function<void(BehaviorBuilder&)> write;
};

TEST(Interpreter, StopsABrokenScriptWithItsNameAndAddress) {
  const Broken cases[] = {
      {"the stack is empty", [](BehaviorBuilder& out) { out.op(PCode::kAdd); }},
      {"the stack is empty", [](BehaviorBuilder& out) { out.push(1).call(BuiltIn::kStrCmp, 2); }},
      {"the stack is empty",
       [](BehaviorBuilder& out) { out.op(PCode::kBeginPrint).op(PCode::kEndHudMessage); }},
      {"the stack is full",
       [](BehaviorBuilder& out) {
         const auto again = out.label();
         out.bind(again).push(1).go(PCode::kGoto, again);
       }},
      {"outside the lump", [](BehaviorBuilder& out) { out.op(PCode::kGoto, {0x7FFFFFFF}); }},
      {"outside the lump", [](BehaviorBuilder& out) { out.push(1).op(PCode::kIfGoto, {-4}); }},
      {"divides by zero",
       [](BehaviorBuilder& out) {
         out.push({4, 0}).op(PCode::kDivide);
       }},
      {"divides by zero", [](BehaviorBuilder& out) { out.push(0).op(PCode::kModMapVar, {2}); }},
      {"there is no script variable 20", [](BehaviorBuilder& out) { out.op(PCode::kPushScriptVar, {20}); }},
      {"there is no map variable 128", [](BehaviorBuilder& out) { out.op(PCode::kIncMapVar, {128}); }},
      {"there is no global variable 64", [](BehaviorBuilder& out) { out.op(PCode::kIncGlobalVar, {64}); }},
      {"there is no map array 7", [](BehaviorBuilder& out) { out.push(0).op(PCode::kPushMapArray, {7}); }},
      {"there is no local array 0",
       [](BehaviorBuilder& out) { out.push(0).op(PCode::kPushScriptArray, {0}); }},
      {"of a world or global array",
       [](BehaviorBuilder& out) {
         out.push({1 << 30, 5}).op(PCode::kAssignGlobalArray, {1});
       }},
      {"there is no function 9", [](BehaviorBuilder& out) { out.op(PCode::kCall, {9}); }},
      {"of a library that is not loaded", [](BehaviorBuilder& out) { out.op(PCode::kCall, {1}); }},
      {"too deep", [](BehaviorBuilder& out) { out.op(PCode::kCall, {0}); }},
      {"returns from no function", [](BehaviorBuilder& out) { out.op(PCode::kReturnVoid); }},
      {"there is no jump target 0", [](BehaviorBuilder& out) { out.push(0).op(PCode::kGotoStack); }},
      {"not begun", [](BehaviorBuilder& out) { out.op(PCode::kEndPrint); }},
      {"too many texts at once",
       [](BehaviorBuilder& out) {
         const auto again = out.label();
         out.bind(again).op(PCode::kBeginPrint).go(PCode::kGoto, again);
       }},
      {"a text of more than 65536 bytes",
       [](BehaviorBuilder& out) {
         out.op(PCode::kBeginPrint);
         const auto again = out.label();
         out.bind(again).push_text(std::string(200, 'x')).op(PCode::kPrintString).go(PCode::kGoto, again);
       }},
      {"without a Delay",
       [](BehaviorBuilder& out) {
         const auto again = out.label();
         out.bind(again).go(PCode::kGoto, again);
       }},
      {"does not support", [](BehaviorBuilder& out) { out.op(PCode::kWriteToIni); }},
  };
  for (const Container container : {Container::kPlain, Container::kHiddenCompact}) {
    for (const Broken& broken : cases) {
      BehaviorBuilder code(container);
      code.function(0, 2, false, "endless");
      code.op(PCode::kCall, {0}).op(PCode::kReturnVoid).end_function();
      code.function(0, 0, false, "elsewhere", true);
      code.end_function().script(31, kOpen).push(5).op(PCode::kDrop);
      broken.write(code);
      code.end();
      code.script(2, kOpen).push(1).store_global(2).end();
      ScriptWorld game(code);
      game.tic();
      EXPECT_NE(game.error().find("TEST: script 31 at 0x"), std::string::npos) << game.error();
      EXPECT_NE(game.error().find(broken.message), std::string::npos)
          << broken.message << " / " << game.error();
      EXPECT_EQ(game.global(2), 1) << "other scripts continue";
      EXPECT_TRUE(game.machine().threads.empty());
    }
  }
}

TEST(Interpreter, RefusesCodeThatRunsOutOfTheLump) {
  std::vector<uint8_t> lump(40, 0);
  std::copy_n("ACS\0", 4, lump.begin());
  lump[4] = 8;  // directory: one script at the last two bytes
  lump[8] = 1, lump[12] = 0xE9, lump[13] = 0x03, lump[16] = 38;
  auto behavior = Behavior::load(lump, "TEST");
  ASSERT_TRUE(behavior.has_value()) << behavior.error().message;
  World world(doom::test::one_room(), shared_catalog(), *behavior);
  reset_world(world, {});
  run_tic(world, {});
  EXPECT_NE(world.state().scripts.last_error.find("runs out of the lump"), std::string::npos);
}

TEST(Interpreter, CountsScriptsThatNeverYield) {
  BehaviorBuilder code(Container::kCompact);
  code.script(1, kOpen);
  const auto again = code.label();
  code.bind(again).go(PCode::kGoto, again);
  ScriptWorld game(code);
  game.tic(3);
  EXPECT_EQ(game.machine().runaway_count, 1);
}

TEST(Interpreter, CalledResultsShareTheirCallersInstructions) {
  // Script 1 requests results of script 2 for ever; each answer is quick, all of them are not.
  BehaviorBuilder code(Container::kCompact);
  code.named_script("answer").push(7).op(PCode::kSetResultValue).end();
  code.script(1, kOpen);
  const auto again = code.label();
  code.bind(again).push_text("answer").call(BuiltIn::kACS_NamedExecuteWithResult, 1).store_global(1);
  code.go(PCode::kGoto, again);
  ScriptWorld game(code);
  game.tic();
  EXPECT_EQ(game.global(1), 7);
  EXPECT_GE(game.machine().runaway_count, 1);
  EXPECT_TRUE(game.machine().threads.empty());
}

// Probe: OPEN scripts 2, "Zzz", 1 and "Aaa", in this order, each write their digit behind the others. ViZDoom 1.3.2
// reads 1342 after the first tic (the script that was started last runs first), 321 for "Zzz", "Aaa", "Mmm".
TEST(Interpreter, NamedScriptsStartInTheirOrderAndBeforeNumberedOnes) {
  BehaviorBuilder code(Container::kCompact);
  const auto digit = [&](int32_t value) {
    code.op(PCode::kPushGlobalVar, {1})
        .push(10)
        .op(PCode::kMultiply)
        .push(value)
        .op(PCode::kAdd)
        .store_global(1)
        .end();
  };
  code.script(2, kOpen), digit(1);
  code.named_script("Zzz", kOpen), digit(2);
  code.script(1, kOpen), digit(3);
  code.named_script("Aaa", kOpen), digit(4);
  ScriptWorld game(code);
  EXPECT_EQ(game.tic().global(1), 1342);
}

TEST(Interpreter, TheTableHasEveryNumber) {
  for (std::size_t code = 0; code < bytecode::kPCodeCount; ++code)
    EXPECT_FALSE(bytecode::kPCodes[code].name.empty());
  EXPECT_EQ(bytecode::kPCodes[245].name, "SetActorProperty");
  EXPECT_EQ(bytecode::kPCodes[283].name, "SetActorPosition");
  EXPECT_EQ(bytecode::kPCodes[351].name, "CallFunc");
  EXPECT_EQ(bytecode::kPCodes[382].name, "Lspec5ExResult");
  for (uint64_t value :
       {uint64_t{0}, uint64_t{1}, uint64_t{15}, uint64_t{16}, uint64_t{1} << 62, UINT64_MAX}) {
    const uint64_t root = integer_root(value);
    EXPECT_LE(root * root, value);
    EXPECT_TRUE(root == UINT32_MAX || (root + 1) * (root + 1) > value);
  }
}

}  // namespace interpreter_test
}  // namespace comrad::doom::acs::test
