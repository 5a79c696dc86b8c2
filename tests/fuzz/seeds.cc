// Writes the fuzzers' first inputs: small, whole and of every kind, made by the same builders as the tests
// use.
//   fuzz_seeds FOLDER
#include <filesystem>
#include <fstream>
#include <iostream>

#include "tests/support/behavior_builder.h"
#include "tests/support/binary_map_bytes.h"
#include "tests/support/wad_bytes.h"
#include "tests/unit/sim_workers/render/tiny_iwad.h"

namespace {

using comrad::bytecode::BuiltIn;
using comrad::bytecode::PCode;
using comrad::doom::acs::test::BehaviorBuilder;
using comrad::doom::acs::test::Container;
using comrad::wad::test::WadBytes;

std::filesystem::path folder;

template <typename Bytes>
void write(const std::string& fuzzer, const std::string& name, const Bytes& bytes) {
  std::filesystem::create_directories(folder / fuzzer);
  std::ofstream file(folder / fuzzer / name, std::ios::binary);
  file.write(reinterpret_cast<const char*>(bytes.data()), static_cast<std::streamsize>(bytes.size()));
  if (!file) std::cerr << "cannot write " << (folder / fuzzer / name) << '\n', std::exit(1);
}

const char* const kDecorate[] = {
    R"(actor Stag : BaronOfHell 15030 { Health 500 +BOSS DropItem "Clip" 128 5 DamageFactor "Taunt", 0.0
  States { Death: BOSS I 8 A_Scream BOSS J 8 ACS_NamedExecuteAlways("caught", 0, 1) stop } })",
    R"(const int kBolts = 2 * (3 + 4); enum { ONE = 1, TWO };
actor Turret : DoomImp 16000 { Health 140 Speed 0 +LOOKALLAROUND -PUSHABLE PainChance 0 Monster
  States { Missile: TROO EF 2 A_FaceTarget TROO G 2 A_CustomMissile("Bolt", 32, 0, random(-4, 4), CMF_AIMDIRECTION)
    TROO A random(2, 14) A_MonsterRefire(40, "See") goto Missile+1
  See: TROO A 2 bright fast A_Chase A_Jump(128, 2, "Missile") loop Wound: TNT1 A 0 offset(1, -2) goto Super::Death+1 } }
actor Bolt { Projectile Radius 6 Height 8 Speed 14 Damage (random(1,8)*2) RenderStyle Add Alpha 0.5 Scale 0.3
  Translation "112:127=176:191" States { Spawn: BAL1 AB 4 bright loop Death: BAL1 CDE 6 A_FadeOut(0.1) stop } })",
    R"(actor Berry : CustomInventory replaces HealthBonus { +INVENTORY.ALWAYSPICKUP Inventory.MaxAmount 3
  States { Spawn: BON1 "[\]" 6 loop Pickup: TNT1 A 0 A_JumpIfInventory("Clip", 1, "No") TNT1 A 0 stop No: TNT1 A 0 fail } }
actor Bow : Weapon { Weapon.AmmoType "Clip" Weapon.AmmoUse 1 Weapon.SlotNumber 2 Weapon.Kickback 10
  States { Ready: PISG A 1 A_WeaponReady loop Select: PISG A 0 A_Raise loop Deselect: PISG A 1 A_Lower loop
  Fire: PISG A 4 PISG B 6 A_FireBullets(5.6, 0, 7, 5, "BulletPuff", 1, 500) PISG C 0 A_ReFire goto Ready } }
actor Boots : PowerupGiver { Powerup.Type "Speed" Powerup.Duration -10 Powerup.Color "ff 00 00", 0.2 })",
    R"(actor Wide : Cacodemon 16001 { Radius 1e9 Height 1e9 Speed 1e9 FloatSpeed 1e9 MaxStepHeight 1e9 Mass 1e9 }
actor Wider : Wide 16002 { DeathHeight 1e9 ProjectilePassHeight -1e9 Gravity 1e9 PainChance 256 })",
};

/// A room as wide and as high as a map may be; a flyer hears players from its far end.
const char* const kWideRoom = R"(namespace = "zdoom";
thing { x = -31900.0; y = 0.0; type = 1; skill3 = true; coop = true; single = true; }
thing { x = -31900.0; y = 90.0; type = 2; skill3 = true; coop = true; single = true; }
thing { x = 31900.0; y = 0.0; height = 32000.0; angle = 180; type = 3005; skill3 = true; coop = true; single = true; }
thing { x = 0.0; y = 0.0; height = -32000.0; type = 3001; skill3 = true; coop = true; single = true; }
vertex { x = -32000.0; y = -256.0; } vertex { x = -32000.0; y = 256.0; } vertex { x = -2000.0; y = 256.0; } vertex { x = 28000.0; y = 256.0; }
vertex { x = 32000.0; y = 256.0; } vertex { x = 32000.0; y = -256.0; } vertex { x = 28000.0; y = -256.0; } vertex { x = -2000.0; y = -256.0; }
linedef { v1 = 0; v2 = 1; sidefront = 0; blocking = true; } linedef { v1 = 1; v2 = 2; sidefront = 0; blocking = true; }
linedef { v1 = 2; v2 = 3; sidefront = 0; blocking = true; } linedef { v1 = 3; v2 = 4; sidefront = 0; blocking = true; }
linedef { v1 = 4; v2 = 5; sidefront = 0; blocking = true; } linedef { v1 = 5; v2 = 6; sidefront = 0; blocking = true; }
linedef { v1 = 6; v2 = 7; sidefront = 0; blocking = true; } linedef { v1 = 7; v2 = 0; sidefront = 0; blocking = true; }
sidedef { sector = 0; texturemiddle = "brick6"; }
sector { texturefloor = "flat1"; textureceiling = "CEIL1_2"; heightfloor = -32000; heightceiling = 32000; }
)";

std::vector<uint8_t> arithmetic(Container container) {
  BehaviorBuilder code(container);
  code.function(2, 3, true, "sum");
  code.op(PCode::kPushScriptVar, {0})
      .op(PCode::kPushScriptVar, {1})
      .op(PCode::kAdd)
      .op(PCode::kReturnValue)
      .end_function();
  code.script(1, 1);
  const auto again = code.label();
  code.push(0).op(PCode::kAssignScriptVar, {2}).bind(again);
  code.push({3, 4}).op(PCode::kMultiply).push({1, 6}).op(PCode::kRandom).op(PCode::kAdd).store_global(1);
  if (code.chunked()) code.push({5, 6}).op(PCode::kCall, {0}).store_global(2);
  code.op(PCode::kIncScriptVar, {2})
      .op(PCode::kPushScriptVar, {2})
      .push(5)
      .op(PCode::kLess)
      .go(PCode::kIfGoto, again);
  code.op(PCode::kDelayDirect, {1}).op(PCode::kRestart).end();
  if (code.chunked()) code.array(3, {7, 8, 9});
  return code.build();
}

std::vector<uint8_t> actors(Container container) {
  BehaviorBuilder code(container);
  code.encrypt(container == Container::kPlain);
  code.script(1, 4).push_text("DoomImp").push({65536 * 50, 0, 0, 9, 64}).op(PCode::kSpawn).op(PCode::kDrop);
  code.push({9, 0, 5}).op(PCode::kSetActorProperty).push({9, 0}).op(PCode::kGetActorProperty).store_global(3);
  code.push_text("Shotgun").push(1).op(PCode::kGiveInventory).push_text("Shell").op(PCode::kCheckInventory);
  code.store_global(4).push({9, 65536, 0, 0, 0, 0}).call(BuiltIn::kSetActorVelocity, 6).op(PCode::kDrop);
  code.op(PCode::kBeginPrint)
      .push_text("\034Gstag ")
      .op(PCode::kPrintString)
      .push(98304)
      .op(PCode::kPrintFixed);
  code.op(PCode::kMoreHudMessage).push({1, 7, 2, 32768, 32768, 65536 * 2});
  code.op(PCode::kOptHudMessage).push(65536).op(PCode::kEndHudMessage);
  code.push({0, 9}).op(PCode::kThingCount).store_global(5).end();
  const auto yes = code.label(), no = code.label();
  code.script(2, 0, 2)
      .op(PCode::kPushScriptVar, {0})
      .case_sorted({{1, yes}, {5, no}})
      .op(PCode::kDrop)
      .bind(yes);
  code.push({9, 100, 6}).op(PCode::kLspec3, {177}).bind(no).end();
  code.named_script("answer", 0, 1).push(7).op(PCode::kSetResultValue).end();
  code.script(5, 1).push_text("answer").call(BuiltIn::kACS_NamedExecuteWithResult, 1).store_global(6);
  code.op(PCode::kBeginPrint)
      .push(5)
      .op(PCode::kPrintNumber)
      .op(PCode::kSaveString)
      .op(PCode::kStrLen)
      .store_global(7)
      .end();
  return code.build();
}

std::string png() {
  const auto u32 = [](uint32_t value) {
    std::string text;
    for (int shift = 24; shift >= 0; shift -= 8) text += static_cast<char>(value >> shift & 255);
    return text;
  };
  const auto chunk = [&](const std::string& tag, const std::string& body) {
    uint32_t crc = 0xFFFFFFFF;
    for (const char letter : tag + body) {
      crc ^= static_cast<uint8_t>(letter);
      for (int bit = 0; bit < 8; ++bit) crc = crc >> 1 ^ ((crc & 1) != 0 ? 0xEDB88320 : 0);
    }
    return u32(static_cast<uint32_t>(body.size())) + tag + body + u32(~crc);
  };
  std::string rows;
  for (int y = 0; y < 4; ++y) {
    rows += '\0';
    for (int x = 0; x < 4 * 4; ++x) rows += static_cast<char>(x * 16 + y);
  }
  uint32_t a = 1, b = 0;
  for (const char value : rows) a = (a + static_cast<uint8_t>(value)) % 65521, b = (b + a) % 65521;
  std::string stored = "\x78\x01\x01";
  const auto size = static_cast<uint16_t>(rows.size());
  for (const uint16_t half : {size, static_cast<uint16_t>(~size)})
    stored += static_cast<char>(half & 255), stored += static_cast<char>(half >> 8);
  stored += rows + u32(b << 16 | a);
  std::string head = u32(4) + u32(4);
  head += {8, 6, 0, 0, 0};
  return "\x89PNG\r\n\x1a\n" + chunk("IHDR", head) + chunk("grAb", u32(2) + u32(3)) + chunk("IDAT", stored) +
         chunk("IEND", "");
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 2) return std::cerr << "usage: fuzz_seeds FOLDER\n", 1;
  folder = argv[1];
  const std::string room = comrad::wad::test::square_room_text();

  write("finding", "wrong", std::string("!"));
  write("textmap", "room", room);
  write("textmap", "special",
        room +
            "thing { x = 100; y = 50; type = 3001; id = 4; special = 80; arg0 = 1; skill3 = true; "
            "coop = true; single = true; }\nsector { heightceiling = 64; special = 83; }\n");
  write("textmap", "wide", std::string(kWideRoom));
  for (std::size_t i = 0; i < std::size(kDecorate); ++i)
    write("decorate", "lump" + std::to_string(i), std::string(kDecorate[i]));
  int number = 0;
  for (const Container container : comrad::doom::acs::test::kContainers) {
    write("behavior", "sums" + std::to_string(number), arithmetic(container));
    if (container != Container::kOld) write("behavior", "actors" + std::to_string(number), actors(container));
    ++number;
  }
  for (int i = 0; i < 4; ++i) {
    std::string program;
    for (int place = 0; place < 500; ++place)
      program += static_cast<char>((place * 37 + place * place * (i + 3)) & 255);
    write("machine", "program" + std::to_string(i), program);
    write("link", "numbers" + std::to_string(i), program);
  }
  for (const char* order : {"status", "drain", "checkpoint"})
    write("join", order, std::string("\x03{\"do\":\"") + order + "\",\"host\":\"box\"}\n");
  write("frames", "requests", std::string("\0\x03\1\0\0\0\x20", 7) + std::string(600, '\1'));
  write("frames", "actions", std::string("\1") + std::string(200, '\0'));
  write("frames", "question",
        std::string("\x03{\"protocol\":1,\"link\":4,\"ask\":\"file\",\"name\":\"layouts/map.wad\"}"));
  write("frames", "offer",
        std::string(
            "\x04{\"scenario\":\"room\",\"iwad_checksum\":\"00ff\",\"files\":[{\"name\":\"a/b.wad\"}]}"));
  write("join", "page", std::string("\x03GET /metrics HTTP/1.1\r\nHost: localhost:9400\r\n\r\n"));
  write("join", "datagram", std::string("\0\1\x18\0", 4));  // a right one, and one number of it changed
  write("join", "answer", "\x01" + std::string(168, '\0'));
  write("join", "header", std::string("\x02\x30\0\7\x34\0\1", 7));

  const std::vector<uint8_t> scripts = actors(Container::kHiddenCompact);
  WadBytes wad;
  wad.add("DECORATE", kDecorate[0]).add("MAP01").add("TEXTMAP", room);
  wad.add("BEHAVIOR", std::string(scripts.begin(), scripts.end())).add("ENDMAP");
  write("wad", "udmf.wad", wad.build());
  write("wad", "doom.wad", comrad::wad::test::BinaryMapBytes().doom().build());
  write("wad", "hexen.wad", comrad::wad::test::BinaryMapBytes().hexen().build());

  using comrad::doom::test::filled_picture;
  write("picture", "columns", std::string(1, '\0') + filled_picture(8, 8, 5));
  write("picture", "holes",
        std::string(1, '\0') +
            comrad::doom::test::picture_lump(3, 3, 1, 2, {1, 255, 3, 255, 5, 255, 7, 8, 255}));
  write("picture", "png", std::string(1, '\1') + png());
  const std::vector<uint8_t> iwad = comrad::doom::test::tiny_iwad().build();
  write("picture", "iwad", std::string(1, '\2') + std::string(iwad.begin(), iwad.end()));

  write("config", "basic",
        std::string("# basic\ndoom_scenario_path = basic.wad\ndoom_map = map01\nliving_reward = -1.5\n"
                    "available_buttons =\n  {\n    MOVE_LEFT\n    MOVE_RIGHT\n    ATTACK\n  }\n"
                    "available_game_variables = { AMMO2 USER1 POSITION_X }\n"
                    "available_game_variables += { HEALTH }\nepisode_timeout = 300\ndoom_skill = 5\n"
                    "game_args += +sv_noautoaim 1\nmode = PLAYER\nscreen_resolution = RES_160X120\n"));
  return 0;
}
