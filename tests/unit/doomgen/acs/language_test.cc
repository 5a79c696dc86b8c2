// Programs compiled by us and run in our machine.
#include <functional>
#include <map>
#include <optional>
#include <span>

#include "rollout_buffer/core/text.h"
#include "tests/unit/doomgen/acs/program_runner.h"

namespace comrad::acs_compiler::test {
namespace language_test {

struct Case {
  const char* expression;
  int32_t value;
};

// Each expression is computed twice: by the compiler, from constants, and by the machine, from variables.
TEST(AcsExpressions, GiveTheSameValueFoldedAndRun) {
  const Case cases[] = {{"A + B", 17},
                        {"A - B", 9},
                        {"A * B", 52},
                        {"A / B", 3},
                        {"A % B", 1},
                        {"-A / B", -3},
                        {"-A % B", -1},
                        {"A == B", 0},
                        {"A == 13", 1},
                        {"A != B", 1},
                        {"A < B", 0},
                        {"B < A", 1},
                        {"A > B", 1},
                        {"A <= 13", 1},
                        {"A <= B", 0},
                        {"A >= 14", 0},
                        {"B >= 4", 1},
                        {"A & B", 4},
                        {"A | B", 13},
                        {"A ^ 7", 10},
                        {"A << B", 208},
                        {"A >> 2", 3},
                        {"-A >> 1", -7},
                        {"A && Z", 0},
                        {"A && B", 1},
                        {"Z || B", 1},
                        {"Z || Z", 0},
                        {"!A", 0},
                        {"!Z", 1},
                        {"~A", -14},
                        {"-A", -13},
                        {"- -A", 13},
                        {"+A", 13},
                        {"A ? B : 99", 4},
                        {"Z ? B : A ? 5 : 6", 5},
                        {"A + B * 2", 21},
                        {"(A + B) * 2", 34},
                        {"A - B - 1", 8},
                        {"A << 1 + 1", 52},
                        {"A & B == 4", 1},
                        {"A | B & Z", 13},
                        {"A ^ B | 2", 11},
                        {"1 || 0 && 0", 1},
                        {"A < B == Z", 1},
                        {"-A * -B", 52},
                        {"2147483647 + A", -2147483636},
                        {"!A == Z", 1}};
  for (const Case& test : cases) {
    EXPECT_EQ(evaluate(test.expression, "#define A 13\n#define B 4\n#define Z 0"), test.value)
        << test.expression;
    EXPECT_EQ(evaluate(test.expression, "int A = 13; int B = 4; int Z = 0;"), test.value) << test.expression;
    EXPECT_EQ(run("int A = 13, B = 4, Z; result = " + std::string(test.expression) + ";"), test.value)
        << test.expression;
  }
}

TEST(AcsExpressions, EvaluateBothSidesOfLogicalOperators) {
  const char* const count = "int calls; function int yes (void) { calls++; return 1; }";
  EXPECT_EQ(run("int x = yes() || yes(); x = !yes() && yes(); result = calls;", count), 4);
}

TEST(AcsLiterals, AreReadInEveryNotation) {
  const Case cases[] = {{"200", 200},
                        {"0x1F", 31},
                        {"0xFFFFFFFF", -1},
                        {"0b101", 5},
                        {"0o17", 15},
                        {"2_1101", 13},
                        {"8_17", 15},
                        {"16_fF", 255},
                        {"36_z", 35},
                        {"1.5", 98304},
                        {"0.1", 6553},
                        {"-2.25", -147456},
                        {"32767.99999", 2147483647},
                        {"-2147483648", INT32_MIN},
                        {"'a'", 97},
                        {"'\\n'", 10},
                        {"'\\''", 39},
                        {"'\\x41'", 65},
                        {"'\\101'", 65},
                        {"'\\0'", 0},
                        {"0.", 0},
                        {"3. + 2.5", 360448},
                        {"-ACS_NamedExecute * 100 - ACS_NamedExecuteAlways", 3945},
                        {"SCROLL_AND_CARRY * 10 + TEXFLAG_MIDDLE + CHAN_5", 27},
                        {"ML_BLOCKEVERYTHING | ML_BLOCKHITSCAN", 0x8008000},
                        {"MF_SHOOTABLE | MF_ICECORPSE", INT32_MIN + 4},
                        {"T_ROCKET * 1000000 + T_BARREL * 1000 + T_CACODEMONSHOT", 127125126},
                        {"TRUE + true", 2},
                        {"ACS_ExecuteAlways + door_open", 237},
                        {"APROP_Health + aprop_speed", 1}};
  for (const Case& test : cases) EXPECT_EQ(evaluate(test.expression), test.value) << test.expression;
}

TEST(AcsVariables, ChangeByEveryAssignmentInEveryScope) {
  struct Assignment {
    const char* statement;
    int32_t value;
  };
  const Assignment cases[] = {{"V = 5", 5},   {"V += 5", 25},  {"V -= 5", 15}, {"V *= 5", 100},
                              {"V /= 3", 6},  {"V %= 3", 2},   {"V &= 6", 4},  {"V |= 3", 23},
                              {"V ^= 6", 18}, {"V <<= 2", 80}, {"V >>= 2", 5}, {"V++", 21},
                              {"V--", 19},    {"++V", 21},     {"--V", 19}};
  struct Place {
    const char *name, *outside, *inside;
  };
  const Place places[] = {{"v", "", "int v;"},
                          {"v", "int v;", ""},
                          {"v", "world int 7:v;", ""},
                          {"v", "global int 7:v;", ""},
                          {"v[2]", "", "int v[4];"},
                          {"v[2]", "int v[4];", ""},
                          {"v[2]", "world int 7:v[];", ""},
                          {"v[2]", "global int 7:v[];", ""},
                          {"v[1][0][2]", "", "int v[2][2][3];"},
                          {"v[1][0][2]", "int v[2][2][3];", ""},
                          {"v[i - 2]", "int v[4];", "int i = 4;"}};
  for (const Assignment& test : cases) {
    for (const Place& place : places) {
      std::string statement = test.statement;
      statement.replace(statement.find('V'), 1, place.name);
      const std::string begin = std::string(place.inside) + place.name + " = 20;";
      EXPECT_EQ(run(begin + statement + "; result = " + place.name + ";", place.outside), test.value)
          << statement << " with " << place.outside << place.inside;
      // The same as a part of an expression; ++ and -- behind the variable give the old value.
      const bool is_postfix = statement.ends_with("++") || statement.ends_with("--");
      EXPECT_EQ(run(begin + "result = 1000 + (" + statement + ");", place.outside),
                1000 + (is_postfix ? 20 : test.value))
          << statement << " with " << place.outside << place.inside;
    }
  }
}

TEST(AcsVariables, AssignFromRightToLeft) {
  EXPECT_EQ(run("int a, b, c[2]; a = b = c[1] = 7; result = a * 100 + b * 10 + c[1];"), 777);
}

TEST(AcsVariables, HaveFirstValues) {
  EXPECT_EQ(evaluate("a * 100 + b * 10 + c", "int a = 1, b; int c = 1 + 2 * 3;"), 107);
  EXPECT_EQ(run("int a = 3, b = a + 1; fixed f = 1.0; result = b + f;"), 65540);
  EXPECT_EQ(evaluate("m[0][0] * 1000 + m[0][2] * 100 + m[1][0] * 10 + m[1][2]",
                     "int m[2][3] = {{1, 2, 3}, {4, 5}};"),
            1340);
  EXPECT_EQ(evaluate("m[0][2] * 10 + m[1][0]", "int m[2][3] = {1, 2, 3, 4};"), 34);
  EXPECT_EQ(evaluate("m[2]", "int m[] = {4, 5, 6};"), 6);
  EXPECT_EQ(run("int a[3] = {1, 2, result + 3}; result = a[0] + a[1] * 10 + a[2] * 100;"), 321);
  EXPECT_EQ(evaluate("StrLen(t[1]) * 10 + StrLen(s)", "str t[2] = {\"a\", \"four\"}; str s = \"xyz\";"), 43);
}

TEST(AcsVariables, OfInnerBlocksHideThoseOfOuterOnes) {
  EXPECT_EQ(run("int x = 1; { int x = 2; result = x; } result = result * 10 + x;"), 21);
  EXPECT_EQ(run("for (int i = 0; i < 3; i++) result += i; for (int i = 0; i < 3; i++) result += i;"), 6);
  EXPECT_EQ(run("if (1) { int x = 5; } result = x;"), 5) << "as the community's compiler allows";
}

TEST(AcsControl, RunsBranchesAndLoops) {
  EXPECT_EQ(run("if (1) result = 1; else result = 2;"), 1);
  EXPECT_EQ(run("if (0) result = 1; else if (0) result = 2; else result = 3;"), 3);
  EXPECT_EQ(run("if (1) if (0) result = 1; else result = 2;"), 2) << "else belongs to the nearest if";
  EXPECT_EQ(run("int i; while (i < 5) i++; result = i;"), 5);
  EXPECT_EQ(run("int i; until (i == 5) i++; result = i;"), 5);
  EXPECT_EQ(run("int i = 9; do i++; while (i < 5); result = i;"), 10);
  EXPECT_EQ(run("int i; do { i++; } until (i >= 5); result = i;"), 5);
  EXPECT_EQ(run("int i; for (i = 0; i < 5; i++) result += i;"), 10);
  EXPECT_EQ(run("int i, j; for (i = 0, j = 10; i < j; i++, j--) result++;"), 5);
  EXPECT_EQ(run("for (;;) { result++; if (result == 4) break; }"), 4);
  EXPECT_EQ(run("while (TRUE) { if (++result > 6) break; }"), 7);
  EXPECT_EQ(run("int i; for (i = 0; i < 10; i++) { if (i % 2) continue; result += i; }"), 20);
  EXPECT_EQ(run("int i; while (i < 10) { i++; if (i > 3) continue; result++; }"), 3);
  EXPECT_EQ(run("int i; do { i++; if (i == 2) continue; result++; } while (i < 4);"), 3);
  EXPECT_EQ(run("int i, j; for (i = 0; i < 3; i++) for (j = 0; j < 3; j++) { if (j == 1) break; result++; }"),
            3);
  EXPECT_EQ(run(";;; result = 1;;"), 1);
}

TEST(AcsControl, SwitchesWithFallThroughAndDefault) {
  const auto chosen = [](int value) {
    return run(
        "switch (" + std::to_string(value) +
        " + result)\n{\n  case 5: result += 1;\n  case -2: result += 10; break;\n"
        "  case 3 + 4: result += 100; break;\n  default: result += 1000;\n  case 1: result += 10000;\n}");
  };
  EXPECT_EQ(chosen(5), 11);
  EXPECT_EQ(chosen(-2), 10);
  EXPECT_EQ(chosen(7), 100);
  EXPECT_EQ(chosen(1), 10000);
  EXPECT_EQ(chosen(99), 11000);
  EXPECT_EQ(run("switch (5) { case 1: result = 1; }"), 0);
  EXPECT_EQ(run("switch (5) { default: result = 2; }"), 2);
  EXPECT_EQ(
      run("int i; for (i = 0; i < 6; i++) { switch (i) { case 2: continue; case 4: break; } result += i; }"),
      13);
  EXPECT_EQ(run("switch (1) { case 1: switch (2) { case 2: result = 5; break; } result++; }"), 6);
  EXPECT_EQ(run("str s = \"b\"; switch (s) { case \"a\": result = 1; break; case \"b\": result = 2; }"), 2);
}

TEST(AcsControl, TerminatesAndRestarts) {
  EXPECT_EQ(run("result = 1; terminate; result = 2;"), 1);
  EXPECT_EQ(run("if (++result < 5) restart;"), 5);
}

TEST(AcsFunctions, TakeAndGiveValues) {
  EXPECT_EQ(evaluate("sum(3, 4) * sum(1, 1)", "function int sum (int a, int b) { return a + b; }"), 14);
  EXPECT_EQ(evaluate("late(4)",
                     "function int late (int a) { return even(a); }"
                     "function int even (int a) { if (a == 0) return 1; return odd(a - 1); }"
                     "function int odd (int a) { if (a == 0) return 0; return even(a - 1); }"),
            1);
  EXPECT_EQ(evaluate("factorial(10)",
                     "function int factorial (int n) { if (n < 2) return 1; return n * factorial(n - 1); }"),
            3628800);
  EXPECT_EQ(run("add(5); add(6); result = total;",
                "int total; function void add (int n) { total += n; if (n == 6) return; total++; }"),
            12);
  EXPECT_EQ(run("result = StrLen(name());", "function str name (void) { return \"four\"; }"), 4);
  EXPECT_EQ(run("f(); f(); result = f();",
                "function int f (void) { int a[3]; int b; a[1]++; b += 2; return a[1] + b; }"),
            3)
      << "every call has its own variables";
  EXPECT_EQ(evaluate("none()", "function int none (void) { }"), 0);
}

TEST(AcsScripts, StartByTheirKind) {
  ProgramRunner game(
      "global int 1:a; global int 2:b; global int 3:c; global int 4:d;\n"
      "script 1 OPEN { a = 1; }\n"
      "script 2 ENTER { b = PlayerNumber() + 10; }\n"
      "script \"Named one\" OPEN { c = 3; }\n"
      "script 3 (void) { d = 4; }\n");
  game.tic();
  EXPECT_EQ(game.error(), "");
  EXPECT_EQ(game.global(1), 1);
  EXPECT_EQ(game.global(2), 10);
  EXPECT_EQ(game.global(3), 3);
  EXPECT_EQ(game.global(4), 0);
}

TEST(AcsScripts, KeepTheirKindsAndFlags) {
  const auto behavior =
      load(compiled("script 1 OPEN {} script 2 ENTER CLIENTSIDE {} script 3 RETURN NET {} script 4 RESPAWN "
                    "{} script 5 DEATH {}\n"
                    "script 6 LIGHTNING {} script 7 UNLOADING {} script 8 (int gone) DISCONNECT {} script 9 "
                    "(int a, int b, int c) EVENT {}\n"
                    "script 10 (int a, int b, int c, int d) NET CLIENTSIDE {} script <<0>> (void) {} script "
                    "11 KILL {} script 12 REOPEN {}\n"
                    "script \"X\" (int a) {} script 32767 (void) {}\n"));
  using doom::acs::ScriptType;
  const auto expect = [&](int number, ScriptType type, int args, bool net, bool clientside) {
    const doom::acs::Script* script = behavior->find_script(number);
    ASSERT_NE(script, nullptr) << number;
    EXPECT_EQ(script->type, type) << number;
    EXPECT_EQ(script->arg_count, args) << number;
    EXPECT_EQ(script->is_net, net) << number;
    EXPECT_EQ(script->is_clientside, clientside) << number;
  };
  expect(1, ScriptType::kOpen, 0, false, false);
  expect(2, ScriptType::kEnter, 0, false, true);
  expect(3, ScriptType::kReturn, 0, true, false);
  expect(4, ScriptType::kRespawn, 0, false, false);
  expect(5, ScriptType::kDeath, 0, false, false);
  expect(6, ScriptType::kLightning, 0, false, false);
  expect(7, ScriptType::kUnloading, 0, false, false);
  expect(8, ScriptType::kDisconnect, 1, false, false);
  expect(9, ScriptType::kEvent, 3, false, false);
  expect(10, ScriptType::kClosed, 4, true, true);
  expect(0, ScriptType::kClosed, 0, false, false);
  expect(11, ScriptType::kKill, 0, false, false);
  expect(12, ScriptType::kReopen, 0, false, false);
  expect(32767, ScriptType::kClosed, 0, false, false);
  ASSERT_NE(behavior->find_script("x"), nullptr);
  EXPECT_EQ(behavior->find_script("x")->arg_count, 1);
}

TEST(AcsScripts, WaitAndCallEachOther) {
  ProgramRunner game(
      "global int 1:tics; global int 2:sum; global int 3:answer; global int 4:after;\n"
      "script 1 OPEN { while (tics < 100) { tics++; delay(1); } }\n"
      "script 2 OPEN\n{\n"
      "  ACS_Execute(3, 0, 5, 6, 7);\n"
      "  ACS_NamedExecute(\"adder\", 0, 100, 200, 300);\n"
      "  answer = ACS_ExecuteWithResult(4, 6) + ACS_NamedExecuteWithResult(\"twice\", 50);\n"
      "  delay(const: 3);\n"
      "  ScriptWait(3);\n"
      "  NamedScriptWait(\"adder\");\n"
      "  after = sum;\n"
      "}\n"
      "script 3 (int a, int b, int c) { delay(10); sum += a + b + c; }\n"
      "script \"adder\" (int a, int b, int c) { int wait = 20; delay(wait); sum += a + b + c; }\n"
      "script 4 (int a) { SetResultValue(a * 7); }\n"
      "script \"Twice\" (int a) { SetResultValue(a * 2); }\n");
  game.tic(5);
  EXPECT_EQ(game.error(), "");
  EXPECT_EQ(game.global(1), 5);
  EXPECT_EQ(game.global(3), 142);
  EXPECT_EQ(game.global(2), 0);
  game.tic(10);
  EXPECT_EQ(game.global(2), 18);
  EXPECT_EQ(game.global(4), 0);
  game.tic(20);
  EXPECT_EQ(game.error(), "");
  EXPECT_EQ(game.global(2), 618);
  EXPECT_EQ(game.global(4), 618);
}

TEST(AcsScripts, WaitForTheScriptsThatTheyStart) {
  ProgramRunner game(
      "global int 1:sum; global int 2:first; global int 3:second; int five = 5;\n"
      "script 2 OPEN\n{\n"
      "  ACS_ExecuteWait(3, 0, five, 6, 7);\n  first = sum;\n"
      "  ACS_NamedExecuteWait(\"adder\", 0, 100);\n  second = sum;\n}\n"
      "script 3 (int a, int b, int c) { delay(10); sum += a + b + c; }\n"
      "script \"adder\" (int a) { delay(10); sum += a; }\n");
  game.tic(5);
  EXPECT_EQ(game.global(2), 0);
  game.tic(10);
  EXPECT_EQ(game.global(2), 18);
  EXPECT_EQ(game.global(3), 0);
  game.tic(15);
  EXPECT_EQ(game.error(), "");
  EXPECT_EQ(game.global(3), 118);
}

TEST(AcsScripts, MayHaveMoreThanTwentyVariables) {
  std::string body, sum = "0";
  for (int i = 0; i < 100; ++i) {
    body += "int v" + std::to_string(i) + " = " + std::to_string(i) + ";\n";
    sum += " + v" + std::to_string(i);
  }
  EXPECT_EQ(run(body + "result = " + sum + ";"), 4950);
  EXPECT_EQ(evaluate("f()", "function int f (void) {" + body + "return " + sum + "; }"), 4950);
}

std::string printed(const std::string& items, const std::string& outside = {}) {
  ProgramRunner game(outside + "\nscript 1 ENTER { Print(" + items + "); }");
  game.tic();
  EXPECT_EQ(game.error(), "");
  return game.message();
}

TEST(AcsTexts, PrintEveryKindOfItem) {
  EXPECT_EQ(
      printed("s:\"tether \", d:-42, c:' ', i:7, c:'x', f:1.5, s:\" \", x:255, c:' ', b:10, c:' ', n:1"),
      "tether -42 7x1.5 FF 1010 Player 1");
  EXPECT_EQ(printed("s:\"one \" \"two\"\n  \" three\""), "one two three");
  EXPECT_EQ(printed("s:\"one\ntwo\r\nthree\", d:4"), "one\ntwo\nthree4") << "a text goes over a line's end";
  EXPECT_EQ(printed("s:\"a\\\"b\\\\c\\ta\\nb\""), "a\"b\\c\ta\nb");
  EXPECT_EQ(printed("s:\"\\cGred\""), "\x1CGred");
  EXPECT_EQ(printed("s:NAME, d:COUNT", "#define NAME \"imp\" \" x\"\n#define COUNT 3 * 2"), "imp x6");
  EXPECT_EQ(printed("s:StrParam(s:\"a\", d:1, s:StrParam(s:\"b\")), s:\"c\""), "a1bc");
  EXPECT_EQ(printed("s:TRUE ? \"yes\" : \"no\""), "yes");
}

TEST(AcsTexts, PrintAndFillArraysOfCharacters) {
  const char* const arrays =
      "int a[6] = {'w', 'o', 'r', 'd', 0, 'x'}; int m[2][4] = {{'a', 'b'}, {'c', 'd', 'e'}};";
  EXPECT_EQ(printed("a:a", arrays), "word");
  EXPECT_EQ(printed("a:(a, 1, 2)", arrays), "or");
  EXPECT_EQ(printed("a:(a, 2)", arrays), "rd");
  EXPECT_EQ(printed("a:m[1]", arrays), "cde");
  ProgramRunner game(
      "global int 1:r; int a[8]; world int 3:w[]; global int 5:g[];\n"
      "script 1 ENTER\n{\n  int s[8];\n  r = StrCpy(a:a, \"formation\", 3);\n  r = r * 10 + StrCpy(a:(w, 2), "
      "\"abc\");\n"
      "  r = r * 10 + StrCpy(a:(g, 0, 2), \"abc\"); StrCpy(a:s, \"loc\");\n"
      "  Print(a:a, s:\"-\", a:(w, 2), s:\"-\", a:g, s:\"-\", a:s);\n}");
  game.tic();
  EXPECT_EQ(game.error(), "");
  EXPECT_EQ(game.message(), "mation-abc-ab-loc");
  EXPECT_EQ(game.global(1), 110);
}

TEST(AcsTexts, HudMessagesCarryTheirNumbers) {
  ProgramRunner game(
      "script 1 ENTER\n{\n  SetFont(\"BIGFONT\");\n  SetHudSize(640, 400, TRUE);\n"
      "  HudMessage(s:\"hold \", d:3; HUDMSG_FADEOUT | HUDMSG_LOG, 7, CR_GOLD, 320.4, 100.0, 2.0, 1.0);\n"
      "  HudMessageBold(s:\"all\"; HUDMSG_PLAIN, 8, CR_RED, 0.5, 0.25, 0);\n}");
  game.tic();
  EXPECT_EQ(game.error(), "");
  ASSERT_EQ(game.machine().hud_messages.size(), 2u);
  for (const doom::acs::HudMessage& message : game.machine().hud_messages) {
    const bool first = message.id == 7;
    EXPECT_EQ(message.text, first ? "hold 3" : "all");
    EXPECT_EQ(message.font, "BIGFONT");
    EXPECT_EQ(message.hud_width, 640);
    EXPECT_EQ(message.kind, first ? 1 : 0);
    EXPECT_EQ(message.color, first ? 5 : 6);
    EXPECT_EQ(message.x, first ? 20997734 : 32768) << "320.4 as the language's fixed point";
    EXPECT_EQ(message.hold_tics, first ? 70 : 0);
    EXPECT_EQ(message.fade_out_tics, first ? 35 : 0);
    EXPECT_EQ(message.player, first ? 0 : -1);
  }
}

TEST(AcsCalls, ReachTheGame) {
  EXPECT_EQ(evaluate("Sqrt(144) * 1000 + VectorLength(3, 4) * 100 + (FixedMul(1.5, 2.0) >> 16) * 10 + "
                     "(FixedDiv(9.0, 2.0) >> 16)"),
            12534);
  EXPECT_EQ(evaluate("PlayerCount() + (Sin(0.25) >> 16) + (Cos(0) >> 16)"), 3);
  EXPECT_EQ(
      evaluate("StrCmp(StrLeft(\"formation\", 4), \"form\") + StrICmp(\"A\", \"a\") + GetChar(\"xyz\", 1)"),
      'y');
  EXPECT_EQ(run("int i; for (i = 0; i < 100; i++) { int r = Random(3, 5); if (r < 3 || r > 5) result = 1; }"),
            0);
  EXPECT_EQ(evaluate("Random(4, 4) + Random(result + 6, 6)"), 10);
  EXPECT_EQ(evaluate("IsTIDUsed(UniqueTID())"), 0);
  EXPECT_EQ(run("result = Spawn(\"MapSpot\", 0, 0, 0, 77); result = result * 10 + ThingCount(T_NONE, 77) + "
                "IsTIDUsed(77);"
                "Thing_Remove(77);"),
            12);
  EXPECT_EQ(run("result = Spawn(\"MapSpot\", 8.0, result, 0, 5, 64) ; result += GetActorX(5) >> 16;"), 9);
  EXPECT_EQ(run("SpawnForced(\"MapSpot\", 16.0, 0, 0, 6, 0); SetActorPosition(6, 24.0, 0, 0, 0); result = "
                "GetActorX(6) >> 16;"),
            24);
  EXPECT_EQ(run("SpawnForced(\"MapSpot\", 16.0, 0, 0); SpawnForced(\"MapSpot\", 16.0, 0, 0, 6); result = "
                "IsTIDUsed(6);"),
            1);
}

TEST(AcsCalls, ReachActivatorsThings) {
  ProgramRunner game(
      "global int 1:a; global int 2:b; global int 3:c; global int 4:d;\n"
      "script 1 ENTER\n{\n"
      "  GiveInventory(\"Clip\", 30); TakeInventory(\"Clip\", 10); a = CheckInventory(\"Clip\");\n"
      "  SetActorProperty(0, APROP_Health, 55); b = GetActorProperty(0, APROP_HEALTH);\n"
      "  Thing_ChangeTID(0, 900); c = ActivatorTID();\n"
      "  SetActorVelocity(0, 2.0, 0, 0, FALSE, FALSE); d = GetActorVelX(900) >> 16;\n}");
  const int32_t before = 50;
  game.tic();
  EXPECT_EQ(game.error(), "");
  EXPECT_EQ(game.global(1), before + 20);
  EXPECT_EQ(game.global(2), 55);
  EXPECT_EQ(game.global(3), 900);
  EXPECT_EQ(game.global(4), 2);
}

TEST(AcsCalls, SpecialsTakeConstantsVariablesAndGiveResults) {
  const char* const scripts =
      "script 2 (int a, int b, int c) { result = a * 100 + b * 10 + c; }\n"
      "script 3 (void) { result = 5; }\n"
      "script 4 (int a, int b, int c) { SetResultValue(a + b + c); }\n";
  const auto after = [&](const std::string& body) {
    ProgramRunner game("global int 1:result;\n" + std::string(scripts) + "script 1 OPEN {" + body + "}");
    game.tic(3);
    EXPECT_EQ(game.error(), "");
    return game.global(1);
  };
  EXPECT_EQ(after("ACS_Execute(2, 0, 1, 2, 3);"), 123);
  EXPECT_EQ(after("int x = 4; ACS_Execute(2, 0, x, 2, x - 1);"), 423);
  EXPECT_EQ(after("ACS_Execute(3);"), 5);
  EXPECT_EQ(after("ACS_Execute(const: 2, 0, 9, 8, 7);"), 987);
  EXPECT_EQ(after("result = ACS_ExecuteWithResult(4, 1, 2, 3) * 2;"), 12);
  EXPECT_EQ(after("int x = Thing_Remove(12345); result = x + 40;"), 40);
}

// As ViZDoom runs UDMF's `special = 80; arg0str = "boom";` when the thing dies.
TEST(AcsCalls, ThingsOfTheMapNameScripts) {
  doom::MapThing imp;
  imp.special = 80, imp.arg0_text = "BOOM";
  doom::test::LevelBuilder room;
  room.room(room.sector(0, 128), -512, -512, 512, 512).thing(1, 0, 0).thing(3001, 200, 0, 0, 9, imp);
  ProgramRunner game(
      "global int 1:result; script \"boom\" (void) { result = 7; } script 1 OPEN { Thing_Destroy(9); }\n", {},
      1, room.build());
  game.tic(3);
  EXPECT_EQ(game.error(), "");
  EXPECT_EQ(game.global(1), 7);
}

// ViZDoom 1.3.2 moves a ball by 20 until the tic after the one that makes it, 10 a tic afterwards.
TEST(AcsCalls, WhatAScriptSpawnsActsInTheSameTic) {
  ProgramRunner game(
      "global int 1:first; global int 2:second;\n"
      "script 1 ENTER { SpawnProjectile(0, \"DoomImpBall\", 0, 80, 0, 0, 9); int x = GetActorX(9); "
      "delay(1);\n"
      "  first = GetActorX(9) - x; delay(1); second = GetActorX(9) - x; }\n");
  game.tic(3);
  EXPECT_EQ(game.error(), "");
  EXPECT_EQ(game.global(1), 20 << 16);
  EXPECT_EQ(game.global(2), 30 << 16);
}

// Measured in ViZDoom: Thing_Destroy runs the special of the thing, here a script by its name.
TEST(AcsCalls, NamedScriptsAreSpecialsOfThings) {
  const auto after_death = [](const std::string& special) {
    ProgramRunner game(
        "global int 1:result; script 1 OPEN { Spawn(\"DoomImp\", 64.0, 0, 0, 7); SetThingSpecial(7, " +
        special +
        "); Thing_Destroy(7); }\n"
        "script \"Boom\" (int id, int more) { result += 1000 + id + more; }\nscript 3 (int id) { result += "
        "id; }\n");
    game.tic(5);
    EXPECT_EQ(game.error(), "");
    return game.global(1);
  };
  EXPECT_EQ(after_death("ACS_ExecuteAlways, 3, 0, 8"), 8);
  EXPECT_EQ(after_death("ACS_NamedExecute, \"boom\", 0, 8"), 1008);
  EXPECT_EQ(after_death("ACS_NamedExecuteAlways, \"Boom\", 0, 8, 5"), 1013);
  EXPECT_EQ(after_death("-43, \"Boom\", 0, 8"), 1008);
  EXPECT_EQ(after_death("ACS_NamedExecuteWithResult, \"Boom\", 8, 5"), 1013);
  EXPECT_EQ(after_death("ACS_NamedExecute, \"absent\", 0, 8"), 0);
  EXPECT_EQ(after_death("-200, \"Boom\", 0, 8"), 0);
}

TEST(AcsPrograms, ImportLibrariesThatImportLibraries) {
  CompileOptions options;
  options.reader = [](const std::string& name, const std::string&) -> Expected<SourceFile> {
    if (name == "lib1.acs")
      return SourceFile{name,
                        "#library \"lib1\"\n#import \"lib2.acs\"\n"
                        "int mode = NOTHING; function int f (int a) { return a + mode + g(); }"};
    return SourceFile{name,
                      "#library \"lib2\"\n#import \"lib1.acs\"\n#libdefine NOTHING -1\n"
                      "int secret = 5; function int g (void) { return secret; }"};
  };
  const std::string source = "#import \"lib1.acs\"\nint x = NOTHING; int secret;\n";
  const auto behavior =
      load(compiled(source + "function int g (void) { return 1; } script 1 OPEN { x = f(2); }", options));
  EXPECT_EQ(behavior->map_variables()[0], -1);
  EXPECT_NE(failure(source + "script 1 OPEN { x = g(); }", options).find("the unknown function \"g\""),
            std::string::npos)
      << "functions of a library's library need an #import";
}

// A map, the library that it imports, the library of the library, and one that LOADACS names.
TEST(AcsLibraries, ShareFunctionsVariablesArraysTextsAndScripts) {
  std::map<std::string, std::string> sources = {
      {"base",
       "#library \"base\"\nglobal int 9:base_opened; int calls; str motto = \"deep\";\n"
       "function int base (int n) { calls++; if (n > 0) return base(n - 1) + 1; return 10; }\n"
       "script \"Base\" OPEN { base_opened = 1; }\n"},
      {"helpers",
       "#library \"helpers\"\n#import \"base\"\nglobal int 8:sum; int counter = 5; int table[3] = {7, 8, "
       "9};\n"
       "str words[2] = {\"one\", \"three\"}; str word = \"six\";\n"
       "function int twice (int n) { counter++; int local[2]; local[1] = n; return base(local[1]) * 2; }\n"
       "function str text (int which) { if (which < 2) return words[which]; if (which == 2) return word; "
       "return motto; }\n"
       "function int choose (int n) { switch (n) { case 1: return 11; case 2: return 22; } return calls; }\n"
       "script \"Adder\" (int a) { delay(2); sum += a + table[0]; }\nscript 1 OPEN { sum = 1000; }\n"},
      {"extra", "#library \"extra\"\nglobal int 7:extra;\nscript 77 OPEN { extra = StrLen(\"12345\"); }\n"}};
  CompileOptions options;
  options.reader = [&](const std::string& name, const std::string&) -> Expected<SourceFile> {
    return SourceFile{name, sources.at(name)};
  };
  std::map<std::string, std::vector<uint8_t>> lumps;
  for (const auto& [name, source] : sources) lumps[name] = compiled(source, options);
  const auto libraries = [&](std::string_view name) -> std::optional<std::span<const uint8_t>> {
    const auto found = lumps.find(lower_case(name));
    if (found == lumps.end()) return std::nullopt;
    return found->second;
  };
  std::string source = "#import \"helpers\"\nint mine = 3; str own = \"12345678\";\n";
  for (int i = 1; i <= 9; ++i) source += "global int " + std::to_string(i) + ":u" + std::to_string(i) + ";\n";
  source +=
      "script 1 OPEN\n{\n  u1 = twice(3); u2 = counter * 100 + mine; table[1] += u1; u3 = table[0] * 100 + "
      "table[1];\n"
      "  u4 = StrLen(text(1)) * 1000 + StrLen(text(2)) * 100 + StrLen(own) * 10 + StrCmp(text(3), "
      "\"deep\");\n"
      "  u5 = choose(2) * 100 + choose(3);\n  ACS_NamedExecuteWait(\"adder\", 0, 30);\n  u6 = u8;\n}\n";
  ProgramRunner game(load(compiled(source, options), libraries, {"EXTRA", "absent"}));
  game.tic(10);
  EXPECT_EQ(game.error(), "");
  EXPECT_EQ(game.global(1), 26);
  EXPECT_EQ(game.global(2), 603);
  EXPECT_EQ(game.global(3), 734);
  EXPECT_EQ(game.global(4), 5380);
  EXPECT_EQ(game.global(5), 2204);
  EXPECT_EQ(game.global(6), 37) << "the map's script 1 counts, not the library's";
  EXPECT_EQ(game.global(7), 5) << "LOADACS";
  EXPECT_EQ(game.global(9), 1) << "the library's library has begun";

  // Measured in ViZDoom: scripts that open the game begin with the map's, and the newest runs first.
  lumps["order"] = compiled(
      "#library \"order\"\nglobal int 1:n; global int 2:a; global int 3:b;\n"
      "script 200 OPEN { a = ++n; } script \"Lib\" OPEN { b = ++n; } script 1 OPEN { n += 100; }\n");
  ProgramRunner order(load(compiled("global int 1:n; global int 4:c; global int 5:d;\n"
                                    "script 1 OPEN { c = ++n; } script 100 OPEN { d = ++n; }\n"),
                           libraries, {"order"}));
  order.tic();
  EXPECT_EQ(order.global(2) * 1000 + order.global(3) * 100 + order.global(5) * 10 + order.global(4), 1234);

  lumps.erase("base");
  ProgramRunner without(load(compiled(source, options), libraries));
  without.tic(2);
  EXPECT_NE(without.error().find("calls \"base\" of a library that is not loaded"), std::string::npos)
      << without.error();
  lumps["base"] = {'A', 'C', 'S', 'E', 9, 9, 9, 9, 0, 0, 0, 0, 0, 0, 0, 0,
                   0,   0,   0,   0,   0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0};
  const auto broken = doom::acs::Behavior::load(compiled(source, options), "TEST", libraries);
  ASSERT_FALSE(broken.has_value());
  EXPECT_EQ(broken.error().message.rfind("TEST library base: BEHAVIOR at 0x4: ", 0), 0u)
      << broken.error().message;
}

TEST(AcsPrograms, DefineConstantsAndSpecials) {
  EXPECT_EQ(evaluate("LAST", "#define FIRST 3\n#libdefine NEXT FIRST + 1\n#define LAST (NEXT) * 2\n"), 8);
  EXPECT_EQ(evaluate("data[SIZE - 1]", "#define SIZE 1 << 2\nint data[SIZE] = {1, 2, 3, SIZE};"), 4);
  EXPECT_EQ(evaluate("Root(81)", "special -48:Root(1), 80:Start(1, 5);"), 9);
  EXPECT_EQ(
      evaluate("true", "#include \"zcommon.acs\"\n#nocompact\n#nowadauthor\n#region \"x\"\n#endregion\n"), 1);
  EXPECT_EQ(evaluate("FALSE + T_NONE", "int t_none = 5;"), 5) << "a variable hides a built-in constant";
}

TEST(AcsPrograms, HideTheirTextsWhenAsked) {
  const std::string source = "script 1 ENTER { Print(s:\"top secret\", s:\"!\"); }";
  const std::vector<uint8_t> plain = compiled(source), hidden = compiled("#encryptstrings\n" + source);
  const auto holds = [](const std::vector<uint8_t>& lump) {
    return std::string(lump.begin(), lump.end()).find("secret") != std::string::npos;
  };
  EXPECT_TRUE(holds(plain));
  EXPECT_FALSE(holds(hidden));
  ProgramRunner game("#encryptstrings\n" + source);
  game.tic();
  EXPECT_EQ(game.message(), "top secret!");
}

TEST(AcsPrograms, GiveTheSameBytesEveryTime) {
  const std::string source =
      "int a = 3; str names[2] = {\"x\", \"y\"};\nfunction int f (int q) { return q * a; }\n"
      "script \"n\" OPEN { Print(s:names[0], d:f(7)); switch (a) { case 3: delay(5); break; default: "
      "Door_Open(1, 16); } }\n";
  const std::vector<uint8_t> first = compiled(source);
  for (int i = 0; i < 3; ++i) EXPECT_EQ(compiled(source), first);
  uint64_t hash = 14695981039346656037u;
  for (const uint8_t byte : first) hash = (hash ^ byte) * 1099511628211u;
  EXPECT_EQ(first.size() % 4, 0u);
  EXPECT_EQ(std::string(first.begin(), first.begin() + 4), std::string("ACS\0", 4));
  const uint32_t directory = first[4] | first[5] << 8 | first[6] << 16;
  EXPECT_EQ(std::string(first.begin() + directory - 4, first.begin() + directory), "ACSE");
}

}  // namespace language_test
}  // namespace comrad::acs_compiler::test
