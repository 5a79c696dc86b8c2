// The same lump in our machine and in the original engine: what scripts leave in the exported globals must
// agree. COMRAD_TEST_PYTHON names an interpreter with the vizdoom package (default: python3); without one the
// test is skipped.
#include <sys/wait.h>

#include <array>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <sstream>

#include "tests/support/scratch_folder.h"
#include "tests/support/vizdoom_python.h"
#include "tests/unit/doomgen/acs/program_runner.h"

namespace comrad::acs_compiler::test {
namespace vizdoom_parity_test {

constexpr int kTics = 30;

// Puts the lump into a square room, plays kTics tics and prints USER1 to USER60.
const char* const kPlayer = R"(
import os, struct, sys
import vizdoom

def write_wad(path, lumps):
    body, directory = b"", b""
    for name, data in lumps:
        directory += struct.pack("<ii8s", 12 + len(body), len(data), name.encode())
        body += data
    with open(path, "wb") as file:
        file.write(b"PWAD" + struct.pack("<ii", len(lumps), 12 + len(body)) + body + directory)

corners = [(-256, -256), (-256, 256), (256, 256), (256, -256)]
text = 'namespace = "zdoom";\nthing { x = 0.0; y = 0.0; angle = 90; type = 1; single = true; coop = true; dm = true; '
text += " ".join("skill%d = true;" % i for i in range(1, 6)) + " }\n"
for x, y in corners:
    text += "vertex { x = %d.0; y = %d.0; }\n" % (x, y)
for i in range(4):
    text += "linedef { v1 = %d; v2 = %d; sidefront = %d; blocking = true; }\n" % (i, (i + 1) % 4, i)
    text += 'sidedef { sector = 0; texturemiddle = "STARTAN3"; }\n'
text += 'sector { heightceiling = 128; texturefloor = "FLOOR0_1"; textureceiling = "CEIL1_1"; lightlevel = 200; }\n'

folder, tics = sys.argv[1], int(sys.argv[2])
os.chdir(folder)
read = lambda name: open(os.path.join(folder, name), "rb").read()
lumps = [("MAP01", b""), ("TEXTMAP", text.encode()), ("BEHAVIOR", read("main.o")), ("ENDMAP", b"")]
if os.path.exists("library.o"):
    lumps += [("A_START", b""), ("HELPERS", read("library.o")), ("A_END", b"")]
write_wad("room.wad", lumps)
game = vizdoom.DoomGame()
game.set_doom_game_path(os.path.join(os.path.dirname(vizdoom.__file__), "freedoom2.wad"))
game.set_doom_scenario_path(os.path.join(folder, "room.wad"))
game.set_doom_map("MAP01")
game.set_window_visible(False)
game.set_sound_enabled(False)
game.set_screen_resolution(vizdoom.ScreenResolution.RES_160X120)
users = [getattr(vizdoom.GameVariable, "USER%d" % i) for i in range(1, 61)]
game.set_available_game_variables(users)
game.set_available_buttons([vizdoom.Button.ATTACK])
game.init()
for _ in range(tics):
    game.make_action([0])
print("values", *[int(game.get_game_variable(user)) for user in users])
game.close()
)";

class VizdoomParity : public ::testing::Test {
 protected:
  void SetUp() override {
    const Expected<std::string> python = comrad::test::vizdoom_python();
    if (!python) GTEST_SKIP() << python.error().message;
    python_ = *python;
    folder_.write("play.py", kPlayer);
  }
  void write(const std::string& name, const std::vector<uint8_t>& bytes) const { folder_.write(name, bytes); }

  /// USER1 to USER60 (index 0 unused) after kTics tics of main.o in the original engine.
  std::array<int32_t, 61> play() const {
    std::array<int32_t, 61> values{};
    const std::string command = python_ + " " + (folder_ / "play.py").string() + " " + folder_.string() +
                                " " + std::to_string(kTics) + " 2> " + (folder_ / "errors.txt").string();
    std::FILE* pipe = ::popen(command.c_str(), "r");
    if (pipe == nullptr) {
      ADD_FAILURE() << "cannot start " << command;
      return values;
    }
    std::string output;
    std::array<char, 4096> buffer;
    for (std::size_t count; (count = std::fread(buffer.data(), 1, buffer.size(), pipe)) > 0;)
      output.append(buffer.data(), count);
    ::pclose(pipe);
    const std::size_t begin = output.rfind("values ");
    std::istringstream numbers(begin == std::string::npos ? "" : output.substr(begin + 7));
    int count = 0;
    for (std::size_t i = 1; i < values.size() && numbers >> values[i]; ++i) ++count;
    std::ifstream errors(folder_ / "errors.txt");
    EXPECT_EQ(count, 60) << output << std::string(std::istreambuf_iterator<char>(errors), {});
    return values;
  }

  std::string python_;
  const comrad::test::ScratchFolder folder_;
};

std::string declarations() {
  std::string text;
  for (int i = 1; i <= 60; ++i) text += "global int " + std::to_string(i) + ":u" + std::to_string(i) + ";\n";
  return text;
}

const char* const kProgram = R"(
#include "zcommon.acs"
#define LIMIT 10
int scores[2][3] = {{1, 2, 3}, {4, 5}};
int start = 100, zero;
str names[3] = {"imp", "demon", "a \\ b"};
world int 3:notes[];
global int 61:lists[];

function int factorial (int n) { if (n < 2) return 1; return n * factorial(n - 1); }
function int in_array (int n)
{
  int values[5], i;
  for (i = 0; i < 5; i++) values[i] = i * n;
  return values[4] + values[1];
}
function void count_up (int by) { zero += by; }
function int many (void)
{
  int a0 = 1, a1 = 2, a2 = 3, a3 = 4, a4 = 5, a5 = 6, a6 = 7, a7 = 8, a8 = 9, a9 = 10, b0 = 11, b1 = 12, b2 = 13;
  return a0 + a1 + a2 + a3 + a4 + a5 + a6 + a7 + a8 + a9 + b0 + b1 + b2;
}

script 1 OPEN
{
  int a = 13, b = 4, z, i, j;
  u1 = a + b; u2 = a - b; u3 = a * b; u4 = -a / b; u5 = -a % b;
  u6 = (a == b) + (a != b) * 2 + (a < b) * 4 + (a > b) * 8 + (a <= 13) * 16 + (a >= 14) * 32;
  u7 = (a & b) + ((a | b) << 8) + ((a ^ b) << 16);
  u8 = (a << b) + (-a >> 1);
  u9 = (a && z) + (a || z) * 2 + !a * 4 + !z * 8;
  u10 = ~a; u11 = -a;
  u12 = a ? b : z;
  for (i = 0; i < LIMIT; i++) { if (i % 2) continue; if (i > 6) break; u13 += i; }
  while (u14 < 7) u14++;
  until (u15 >= 7) u15 += 2;
  do { u16++; } while (u16 < 3);
  do { u17++; } until (u17 >= 3);
  switch (a) { case 1: u18 = 1; case 13: u18 += 10; case 14: u18 += 100; break; default: u18 = 5; }
  switch (names[1]) { case "imp": u19 = 1; break; case "demon": u19 = 2; break; }
  switch (b) { case 77: u20 = 1; break; default: u20 = 9; }
  u21 = factorial(10); u22 = in_array(6); u23 = many();
  count_up(4); count_up(5); u24 = zero;
  scores[1][2] = scores[0][1] + scores[1][1]; scores[1][0]++; scores[0][0] <<= 4; scores[0][2]--;
  for (i = 0; i < 2; i++) for (j = 0; j < 3; j++) u25 = u25 * 10 + scores[i][j];
  u26 = scores[0][0];
  notes[100] = 7; notes[100] *= 6; notes[5] = notes[100]++; u27 = notes[100] * 1000 + notes[5] + notes[99];
  lists[3] = 5; lists[3] ^= 1; u28 = lists[3] * 10 + ++lists[3];
  u29 = start++ + ++start; u30 = start-- - --start; u31 = (a += 5) * 100 + a; u32 = (scores[1][1] -= 2);
  u33 = 1.5 + 0x1F + 2_1101 + 'a' + '\n' + 0.1;
  u34 = FixedMul(1.5, 2.5); u35 = FixedDiv(9.0, 2.0); u36 = Sqrt(144) + VectorLength(3, 4) * 1000;
  u37 = Sin(0.125); u38 = Cos(0.3);
  u39 = StrLen(names[2]) * 100 + GetChar(names[2], 2);
  u40 = StrLen("a\n\t\"\\\cb\x41\101") * 1000 + GetChar("x\cY", 1) + GetChar("\\n", 1);
  u41 = StrLen(StrParam(s:"ab", d:-12, c:'x', f:1.5, x:255, b:5, i:7, s:StrParam(s:"in")));
  u42 = StrCmp("Imp", "Imp") + (StrICmp("imp", "IMP") == 0) * 2 + (StrCmp("a", "b") < 0) * 4;
  u43 = StrLen(StrLeft(names[1], 2)) + StrLen(StrMid(names[1], 1, 3)) * 10;
  u44 = GetLevelInfo(LEVELINFO_LEVELNUM) + PlayerCount() * 10;
  u45 = ACS_ExecuteWithResult(4, 6) + ACS_NamedExecuteWithResult("twice", 50) * 1000;
  ACS_Execute(3, 0, 5, 6, 7);
  ACS_NamedExecute("adder", 0, 100, 200, 300);
  ScriptWait(3);
  u46 = u47;
  NamedScriptWait("adder");
  u48 = u47;
  delay(2);
  u49 = Timer();
  int text[8]; StrCpy(a:text, "formation", 3); u50 = text[0] + text[4] * 1000 + StrLen(StrParam(a:text)) * 1000000;
  StrCpy(a:(lists, 10, 3), "abcdef"); u51 = lists[10] + lists[12] * 1000 + lists[13];
  u52 = Spawn("MapSpot", 64.0, 32.0, 8.0, 77, 64) + ThingCount(T_NONE, 77) * 10 + (GetActorX(77) >> 16) * 100;
  i = 96; Thing_Move(77, 77, 0); SetActorPosition(77, i << 16, 16.0, 0, FALSE);
  u53 = (GetActorX(77) >> 16) * 1000 + (GetActorY(77) >> 16) + IsTIDUsed(77) * 1000000;
  Thing_Remove(77); u54 = IsTIDUsed(77) + 10;
  u55 = ACS_ExecuteAlways;
}
script 2 ENTER
{
  GiveInventory("Clip", 30); TakeInventory("Clip", 10); u56 = CheckInventory("Clip");
  SetActorProperty(0, APROP_Health, 55); u57 = GetActorProperty(0, APROP_Health);
  Thing_ChangeTID(0, 900); u58 = ActivatorTID() * 10 + PlayerNumber();
  HudMessage(s:"tether ", d:3; HUDMSG_FADEOUT, 7, CR_GOLD, 0.5, 0.4, 2.0, 1.0);
  createtranslation(1, 16:47 = [0, 0, 0]:[255, 0, 0], 112:127 = 176:191, 0:255 = %[0.0, 0.0, 0.0]:[1.0, 1.0, 1.0]);
}
script 3 (int a, int b, int c) { delay(3); u47 += a + b + c; }
script "adder" (int a, int b, int c) { int wait = 9; delay(wait); u47 += a + b + c; }
script 4 (int a) { SetResultValue(a * 7); }
script "Twice" (int a) { SetResultValue(a * 2); }
script 5 OPEN { while (u59 < 1000) { u59++; delay(1); } }
script 6 OPEN { if (++u60 < 5) restart; terminate; u60 = 99; }
)";

TEST_F(VizdoomParity, ScriptsLeaveTheSameGlobals) {
  for (const std::string head : {"", "#encryptstrings\n"}) {
    const std::string source = head + declarations() + kProgram;
    doom::Level level = *doom::test::one_room();
    level.name = "MAP01";  // as the other engine's map
    ProgramRunner ours(source, {}, 1, std::make_shared<const doom::Level>(level));
    ours.tic(kTics);
    ASSERT_EQ(ours.error(), "");
    write("main.o", compiled(source));
    const std::array<int32_t, 61> theirs = play();
    int agreed = 0;
    for (std::size_t i = 1; i <= 60; ++i) {
      if (i == 59) {  // tics so far: the first action may come a tic later there
        EXPECT_NEAR(ours.global(i), theirs[i], 2);
        continue;
      }
      EXPECT_EQ(ours.global(i), theirs[i]) << "u" << i << (head.empty() ? "" : ", texts hidden");
      agreed += ours.global(i) == theirs[i] ? 1 : 0;
    }
    EXPECT_EQ(agreed, 59);
  }
}

TEST_F(VizdoomParity, LibrariesAreFoundByTheEngine) {
  const char* const library =
      "#library \"HELPERS\"\nint counter = 5; int table[3] = {7, 8, 9}; str words[2] = {\"one\", \"three\"}; "
      "str word = \"six\";\n"
      "function int twice (int n) { counter++; return n * 2; }\n"
      "function int length (int which) { return StrLen(words[which]) + StrLen(\"ab\") * 10 + StrLen(word) * "
      "100; }\n";
  CompileOptions options;
  options.reader = [&](const std::string& name, const std::string&) -> Expected<SourceFile> {
    return SourceFile{name, library};
  };
  const std::vector<uint8_t> library_lump = compiled(library);
  write("library.o", library_lump);
  const std::vector<uint8_t> main_lump = compiled(
      "#import \"helpers.acs\"\n" + declarations() +
          "str own = \"12345678\";\nscript 1 OPEN\n{\n  u1 = twice(21); u2 = counter; table[1] += 10; "
          "u3 = table[0] + table[1] * 100;\n  u4 = length(1); u5 = StrLen(own); twice(1); u6 = "
          "counter;\n}\n",
      options);
  write("main.o", main_lump);
  const std::array<int32_t, 61> theirs = play();
  ProgramRunner ours(
      load(main_lump, [&](std::string_view) { return std::span<const uint8_t>(library_lump); }));
  ours.tic(kTics);
  EXPECT_EQ(ours.error(), "");
  for (std::size_t i = 1; i <= 6; ++i) EXPECT_EQ(ours.global(i), theirs[i]) << "u" << i;
  EXPECT_EQ(theirs[1], 42);
  EXPECT_EQ(theirs[2], 6);
  EXPECT_EQ(theirs[3], 1807);
  EXPECT_EQ(theirs[4], 325);
  EXPECT_EQ(theirs[5], 8);
  EXPECT_EQ(theirs[6], 7);
}

}  // namespace vizdoom_parity_test
}  // namespace comrad::acs_compiler::test
