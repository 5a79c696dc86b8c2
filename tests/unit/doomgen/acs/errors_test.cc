// What does not compile: where the message points, what it contains, and that nothing makes the compiler stumble.
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <string>

#include "doomgen/acs/compiler.h"
#include "rollout_buffer/core/rng.h"
#include "tests/support/scratch_folder.h"

namespace comrad::acs_compiler {
namespace errors_test {

std::string failure(const std::string& source, const CompileOptions& options = {}) {
  Expected<CompiledScript> script = compile(source, "test.acs", options);
  EXPECT_FALSE(script.has_value()) << source;
  return script ? "" : script.error().message;
}

std::size_t lines_of(const std::string& text) {
  return text.empty() ? 0 : 1 + static_cast<std::size_t>(std::count(text.begin(), text.end(), '\n'));
}

struct Case {
  const char *source, *message;
};

TEST(AcsErrors, SayWhereWhatAndWhatInstead) {
  const Case cases[] = {
      {"script 1 OPEN\n{\n  int x = ;\n}", "test.acs:3:11: \";\"; expected a value"},
      {"script 1 OPEN\n{\n  print(s:\"a\")\n}", "test.acs:4:1: \"}\"; expected \";\" behind print"},
      {"script 1 OPEN { x = 1; }", "test.acs:1:17: the unknown name \"x\"; expected a variable or constant"},
      {"script 1 OPEN { Givelnventory(\"Clip\", 1); }",
       "test.acs:1:17: the unknown function \"givelnventory\"; expected a function of the program or the "
       "game, perhaps "
       "GiveInventory"},
      {"script 1 OPEN { GiveInventory(\"Clip\"); }",
       "test.acs:1:17: \"giveinventory\" with 1 argument; expected 2"},
      {"script 1 OPEN { int x = CheckInventory(); }", "with 0 arguments; expected 1"},
      {"script 1 OPEN { Door_Open(1, 2, 3, 4, 5, 6); }", "\"door_open\" with 6 arguments; expected 0 to 5"},
      {"script 1 OPEN { int x = ClearInventory(); }",
       "the value of \"clearinventory\"; expected something that has a value"},
      {"script 1 OPEN { PlayerCount; }",
       "the function \"playercount\" without arguments; expected \"(\" behind it"},
      {"script 1 OPEN { 5 = 6; }",
       "test.acs:1:19: \"=\" behind what is no variable; expected a variable on its left"},
      {"script 1 OPEN { 5++; }", "test.acs:1:18: \"++\" on what is no variable; expected a variable"},
      {"script 1 OPEN { int a[4]; a = 1; }", "the array \"a\" without an index"},
      {"script 1 OPEN { int a; a[0] = 1; }", "\"a\" with an index"},
      {"int a[2][2]; script 1 OPEN { a[0] = 1; }", "\"a\" with 1 indices; expected 2"},
      {"script 1 OPEN { break; }", "test.acs:1:17: break outside of loops and switches"},
      {"script 1 OPEN { continue; }", "continue outside of loops"},
      {"script 1 OPEN { case 1: ; }", "case outside of a switch"},
      {"script 1 OPEN { switch (1) { case 1: case 1: ; } }", "test.acs:1:43: a second case 1 in one switch"},
      {"script 1 OPEN { switch (1) { default: default: ; } }", "a second default"},
      {"script 1 OPEN { int x; switch (1) { case x: ; } }",
       "a value that is not known before the program runs"},
      {"script 1 OPEN { int x; int x; }", "test.acs:1:28: a second variable \"x\" in the same block"},
      {"int x; int X; script 1 OPEN { }", "test.acs:1:12: a second variable \"x\""},
      {"script 1 OPEN {} script 1 ENTER {}", "a second script 1"},
      {"script \"A\" OPEN {} script \"a\" ENTER {}", "a second script \"a\""},
      {"function int f (void) { return 1; } function void f (void) {}", "a second function \"f\""},
      {"script 1 OPEN { return; }", "return in a script; expected terminate"},
      {"function void f (void) { return 1; }", "return with a value in a void function"},
      {"function int f (void) { return; }", "return without a value"},
      {"function void f (void) { terminate; }", "terminate in a function"},
      {"function void f (void) { delay(1); }", "\"Delay\" in a function; expected waiting only in scripts"},
      {"script 0 (void) {}", "script number 0; expected a number from 1 to 32767"},
      {"script 40000 (void) {}", "script number 40000"},
      {"script 1 {}", "\"{\"; expected \"(\" or a kind of script"},
      {"script 1 OPEN ENTER {}", "test.acs:1:15: a second kind of script: \"ENTER\"; expected one kind"},
      {"script 1 (int a) OPEN {}", "a script of kind \"open\" with 1 parameters; expected none"},
      {"script 1 (int a, int b, int c, int d, int e) {}", "with 5 parameters; expected at most 4"},
      {"script nowhere (void) {}", "\"nowhere\"; expected the number or the name of the script"},
      {"script 1 OPEN { print(q:5); }", "test.acs:1:23: \"q\"; expected a kind of item: s: d:"},
      {"script 1 OPEN { hudmessage(s:\"a\"; 0, 1, 2); }", "hudmessage with 3 numbers"},
      {"script 1 OPEN { print(a:5); }", "an item a: that is no array"},
      {"script 1 OPEN { int x; print(a:x); }", "\"x\" is no array"},
      {"world int 300:x;", "world variable 300; expected a number from 0 to 255"},
      {"global int 64:x;", "global variable 64; expected a number from 0 to 63"},
      {"global int 1:x = 5; script 1 OPEN {}", "a first value for a world or global variable"},
      {"int a[0];", "an array of 0 elements"},
      {"int a[];", "an array without a size"},
      {"int a[1000000];", "an array of 1000000 elements"},
      {"int a[2] = {1, 2, 3};", "more values than the array has room for"},
      {"int a[2] = {{1}};", "the array has no more dimensions"},
      {"int a = random(1, 2);", "a value that is not known before the program runs"},
      {"int a = 1 / 0;", "test.acs:1:11: a division by zero"},
      {"script 1 OPEN { int x; x = x % 0; }", "a division by zero"},
      {"#define", "the end of the file; expected the name of a constant"},
      {"#define X\nscript 1 OPEN {}", "#define X without a value"},
      {"#define X random(1, 2)\n", "a value that is not known before the program runs"},
      {"#define X 1\nint x;",
       "test.acs:2:5: \"x\"; expected the name of a variable; this one is a #define'd constant"},
      {"#frobnicate", "test.acs:1:2: the directive \"frobnicate\""},
      {"int if;", "this word is part of the language"},
      {"int a = \"x\ny", "test.acs:1:9: a text without an end; expected a closing \""},
      {"str a = \"x\ny\"; int 5;", "test.acs:2:9: the number \"5\""},
      {"str a = \"\\0\";", "an escape for character 0; expected a code from 1 to 255"},
      {"script 1 OPEN { int x = ACS_ExecuteWait(2, 0); }", "the value of \"acs_executewait\""},
      {"function void f (void) { ACS_NamedExecuteWait(\"x\"); }", "expected waiting only in scripts"},
      {"/* comment", "test.acs:1:1: a comment without an end; expected */"},
      {"int a = 'ab';", "test.acs:1:9: a character that is not one"},
      {"int a = 12ab;", "a number followed by \"a\""},
      {"int a = 99999999999;", "the number \"99999999999\"; expected one that fits 32 bits"},
      {"int a = 70000.5;", "expected a fixed-point number below 32768"},
      {"int a = 40_1;", "base 40 of a number"},
      {"int a = 2_;", "a number without digits"},
      {"int a = 5 @ 6;", "test.acs:1:11: the character \"@\""},
      {"script 1 OPEN { if (1) { }",
       "test.acs:1:27: the end of the file; expected \"}\" for the block of line 1"},
      {"script 1 OPEN {\nif (1) {\n}\nscript 2 OPEN {}",
       "test.acs:4:1: \"script\"; expected \"}\" for the block of line 1"},
      {"script 1 OPEN { else x(); }", "this else belongs to no if"},
      {"script 1 OPEN { do ; }", "expected while or until behind the body of do"},
      {"hello", "test.acs:1:1: \"hello\"; expected script, function, a variable or a directive"},
      {"function frog f (void) {}", "\"frog\"; expected the type of the result"},
      {"#include \"other.acs\"", "test.acs:1:10: the file \"other.acs\" cannot be read here"},
      {"#library \"toolongname\"", "the library name \"toolongname\""},
      {"script 1 OPEN { int x; delay(const: x); }", "expected a constant behind const:"},
      {"special 80:x(7, 9);", "a special of 9 arguments; expected at most 5"},
  };
  for (const Case& test : cases) {
    const std::string message = failure(test.source);
    EXPECT_NE(message.find(test.message), std::string::npos) << test.source << "\n  " << message;
    EXPECT_EQ(message.rfind("test.acs:", 0), 0u) << message;
  }
}

TEST(AcsErrors, AreReportedTogether) {
  const std::string message = failure(
      "script 1 OPEN\n{\n  int a = ;\n  b = 5;\n  print(s \"x\");\n  a = 1;\n  if (a { a = 2; }\n  "
      "Frob(1);\n}\n"
      "int 5;\nscript 2 OPEN { c(); }\n");
  for (const char* const part : {"test.acs:3:11", "test.acs:4:3", "test.acs:5:9", "test.acs:7:9",
                                 "test.acs:8:3", "test.acs:10:5", "test.acs:11:17"})
    EXPECT_NE(message.find(part), std::string::npos) << part << "\n" << message;
  std::string many = "script 1 OPEN {\n";
  for (int i = 0; i < 100; ++i) many += "unknown" + std::to_string(i) + " = 1;\n";
  EXPECT_EQ(lines_of(failure(many + "}")), 21u) << "twenty and the note that it gives up";
  CompileOptions one;
  one.errors_max = 1;
  EXPECT_EQ(lines_of(failure(many + "}", one)), 1u);
}

TEST(AcsErrors, WarningsDoNotStopCompilation) {
  const Expected<CompiledScript> script = compile(
      "int a[2];\nscript 1 OPEN\n{\n  a[5] = 1;\n  a[0] == 1;\n  if (1) { int x; }\n  x = 010;\n  "
      "print(s:\"\\z\");\n}",
      "w.acs");
  ASSERT_TRUE(script.has_value()) << script.error().message;
  std::string all;
  for (const std::string& warning : script->warnings) all += warning + "\n";
  for (const char* const part :
       {"w.acs:4:3: index 5 lies outside", "w.acs:5:8: a statement that does nothing",
        "w.acs:7:3: \"x\" is used outside the block", "w.acs:7:7: a leading zero",
        "w.acs:8:12: \\z is no escape"})
    EXPECT_NE(all.find(part), std::string::npos) << part << "\n" << all;
}

std::string repeat(const std::string& text, int count) {
  std::string result;
  for (int i = 0; i < count; ++i) result += text;
  return result;
}

TEST(AcsLimits, AreReportedNotReached) {
  const auto expect = [](const std::string& source, const char* part) {
    const std::string message = failure(source);
    EXPECT_NE(message.find(part), std::string::npos) << message.substr(0, 400);
  };
  expect("int a = " + repeat("(", 100000) + "1" + repeat(")", 100000) + ";", "deep inside each other");
  expect("int a = " + repeat("-", 100001) + "1;", "deep inside each other");
  expect("script 1 OPEN { int x = " + repeat("x+", 100000) + "x; }", "an expression of more than");
  expect("script 1 OPEN " + repeat("{", 50000) + repeat("}", 50000), "deep inside each other");
  expect("script 1 OPEN {" + repeat("if (1) ", 50000) + ";}", "deep inside each other");
  expect("script 1 OPEN { int x; x" + repeat("[x", 50000) + ";}", "deep inside each other");
  expect("script 1 OPEN { int x; x = " + repeat("x ? ", 50000) + ";}", "deep inside each other");
  expect("int a = " + repeat("{", 50000) + ";", "expected a value");
  expect("int a[2] = " + repeat("{", 50000) + ";", "the array has no more dimensions");
  expect("int " + std::string(1000, 'x') + ";", "a name of 1000 letters");
  expect("str s = \"" + std::string(40000, 'x') + "\";", "a text of 40000 bytes");
  expect("int a[256][256][2];", "an array of more than");
  expect("int a[60000], b[60000];", "arrays of more than");
  std::string source = "script 1 OPEN {";
  for (int i = 0; i < 300; ++i) source += "int v" + std::to_string(i) + ";";
  expect(source + "}", "more than 255 variables in one script or function");
  source.clear();
  for (int i = 0; i < 129; ++i) source += "int v" + std::to_string(i) + ";";
  expect(source, "more than 128 variables of the map");
  source = "script 1 OPEN { str s;";
  for (int i = 0; i < 33000; ++i) source += "s=\"" + std::to_string(i) + "\";";
  expect(source + "}", "more than 32768 different texts");
  CompileOptions small;
  small.source_bytes_max = 100;
  EXPECT_NE(failure(std::string(200, ' '), small).find("more than 100 bytes"), std::string::npos);
}

// ---- files

class AcsFiles : public ::testing::Test {
 protected:
  void SetUp() override {
    std::filesystem::create_directories(folder_ / "lib");
    std::filesystem::create_directories(folder_ / "headers");
  }
  std::string write(const std::string& name, const std::string& text) { return folder_.write(name, text); }
  const comrad::test::ScratchFolder folder_;
};

TEST_F(AcsFiles, AreIncludedFromBesideAndFromFolders) {
  write("lib/inner.acs", "#include \"more.acs\"\n#define INNER MORE + 1\n");
  write("lib/more.acs", "#define MORE 41\n");
  write("headers/common.h", "#define SHARED 2\n");
  const std::string path = write(
      "main.acs",
      "#include \"lib/inner.acs\"\n#include \"common.h\"\nint x = INNER * SHARED;\nscript 1 OPEN { x++; }\n");
  const Expected<CompiledScript> script = compile_file(path, {(folder_ / "headers").string()});
  EXPECT_TRUE(script.has_value()) << script.error().message;
  EXPECT_EQ(compile_file((folder_ / "none.acs").string()).error().code, ErrorCode::kNotFound);
}

TEST_F(AcsFiles, ErrorsNameTheIncludedFile) {
  const std::string inner = write("lib/inner.acs", "\nint x = ;\n");
  const std::string path = write("main.acs", "#include \"lib/inner.acs\"\n");
  const Expected<CompiledScript> script = compile_file(path);
  ASSERT_FALSE(script.has_value());
  EXPECT_NE(script.error().message.find("lib/inner.acs:2:9: \";\"; expected a value"), std::string::npos)
      << script.error().message;
}

TEST_F(AcsFiles, NothingOutsideIsRead) {
  write("secret.acs", "int secret = 1;\n");
  std::filesystem::create_directories(folder_ / "project");
  std::filesystem::create_symlink(folder_ / "secret.acs", folder_ / "project" / "link.acs");
  for (const std::string name :
       {"../secret.acs", "link.acs", "/etc/passwd", "missing.acs", "", "..\\\\secret.acs"}) {
    const std::string path = write("project/main.acs", "#include \"" + name + "\"\nscript 1 OPEN {}\n");
    const Expected<CompiledScript> script = compile_file(path);
    ASSERT_FALSE(script.has_value()) << name;
    EXPECT_NE(script.error().message.find("main.acs:1:10: "), std::string::npos) << script.error().message;
  }
}

TEST_F(AcsFiles, ThatIncludeThemselvesAreStopped) {
  const std::string path = write("main.acs", "#include \"main.acs\"\n");
  const Expected<CompiledScript> script = compile_file(path);
  ASSERT_FALSE(script.has_value());
  EXPECT_NE(script.error().message.find("include each other more than 16 deep"), std::string::npos)
      << script.error().message;
  std::string wide;
  for (int i = 0; i < 20; ++i) wide += "#include \"wide.acs\"\n";
  const Expected<CompiledScript> exploding = compile_file(write("wide.acs", wide));
  ASSERT_FALSE(exploding.has_value());
}

TEST_F(AcsFiles, LibrariesAreImportedByName) {
  write(
      "lib/helpers.acs",
      "#library \"HELPERS\"\n#libdefine SHARED 7\n#define PRIVATE 8\nint counter; int table[5]; int unused;\n"
      "function int twice (int n) { return n * 2; }\nfunction void unused_one (void) {}\n"
      "script 900 (void) { counter++; }\n");
  const std::string path =
      write("main.acs",
            "#import \"lib/helpers.acs\"\nscript 1 OPEN { int x = twice(SHARED); counter = x; table[2] = "
            "x; }\n");
  const Expected<CompiledScript> script = compile_file(path);
  ASSERT_TRUE(script.has_value()) << script.error().message;
  const std::string bytes(script->behavior.begin(), script->behavior.end());
  for (const char* const part : {"LOAD", "HELPERS", "MIMP", "counter", "AIMP", "table", "FNAM", "twice"})
    EXPECT_NE(bytes.find(part), std::string::npos) << part;
  for (const char* const part : {"unused", "unused_one"})
    EXPECT_EQ(bytes.find(part), std::string::npos) << part;
  EXPECT_FALSE(
      compile_file(write("second.acs", "#import \"lib/helpers.acs\"\nint x = PRIVATE;\n")).has_value());
  write("lib/plain.acs", "int a;\n");
  const Expected<CompiledScript> plain = compile_file(write("third.acs", "#import \"lib/plain.acs\"\n"));
  ASSERT_FALSE(plain.has_value());
  EXPECT_NE(plain.error().message.find("an imported file without #library"), std::string::npos);
}

// ---- hostile sources

const char* const kSample =
    "#include \"zcommon.acs\"\n#define COUNT 5\nint a[2][3] = {{1, 2}, {3}}; str t = \"x\\n\"; global int "
    "1:g;\n"
    "function int f (int n) { if (n < 2) return 1; return n * f(n - 1); }\n"
    "script \"main\" (int p) NET\n{\n  int i; int b[4] = {1, 2, 3};\n  for (i = 0; i < COUNT; i++) { a[i % "
    "2][1] += f(i) << 1; }\n"
    "  switch (a[0][1]) { case 5: delay(3); break; default: g = i ? 1.5 : 'c'; }\n"
    "  HudMessage(s:t, d:g, a:(b, 0, 2); HUDMSG_FADEOUT, 1, CR_RED, 0.5, 0.5, 3.0, 0.5);\n"
    "  createtranslation(1, 16:47=[0,0,0]:[255,0,0], 1:2=3:4, 5:6=%[1,2,3]:[4,5,6]);\n"
    "  do { i--; } until (i <= 0); Door_Open(1, 16); ACS_NamedExecuteWithResult(\"main\", StrCpy(a:b, "
    "t));\n}\n";

TEST(AcsFuzz, SurvivesAnySource) {
  ASSERT_TRUE(compile(kSample, "sample.acs").has_value()) << compile(kSample, "sample.acs").error().message;
  const std::string sample = kSample;
  constexpr std::string_view kPieces[] = {
      "{",      "}",        "(",     ")",       "[",       "]",  ";",      ",",  "\"",      "'",        "#",
      "script", "function", "int",   "=",       "++",      "<<", "?",      ":",  "case",    "0x",       "1.",
      "\\",     "/*",       "world", "#import", "#define", "a:", "return", "\0", "special", "strparam("};
  int compiled_count = 0;
  for (uint64_t seed = 0; seed < 3000; ++seed) {
    Rng rng{RngKey(seed)};
    std::string source = sample;
    const uint32_t change_count = 1 + rng.below(6);
    for (uint32_t i = 0; i < change_count; ++i) {
      const std::size_t place = rng.below(static_cast<uint32_t>(source.size()));
      switch (rng.below(4)) {
        case 0:
          source[place] = static_cast<char>(rng.below(256));
          break;
        case 1:
          source.erase(place, 1 + rng.below(20));
          break;
        case 2:
          source.insert(place, kPieces[rng.below(std::size(kPieces))]);
          break;
        default:
          source.insert(place, source.substr(rng.below(static_cast<uint32_t>(source.size())), rng.below(60)));
          break;
      }
      if (source.empty()) source = " ";
    }
    const Expected<CompiledScript> script = compile(source, "fuzz.acs");
    compiled_count += script.has_value() ? 1 : 0;
    if (!script) {
      ASSERT_EQ(script.error().message.rfind("fuzz.acs:", 0), 0u) << "seed " << seed << "\n"
                                                                  << script.error().message;
    }
  }
  EXPECT_GT(compiled_count, 0);
  EXPECT_LT(compiled_count, 3000);
}

}  // namespace errors_test
}  // namespace comrad::acs_compiler
