// The script machine from inside: the input chooses instructions rather than bytes, so that most programs run
// on. Half way a snapshot is taken; it must continue exactly as the world does.
#include "sim_workers/engine/acs/behavior.h"
#include "sim_workers/engine/acs/machine.h"
#include "tests/fuzz/play.h"
#include "tests/support/behavior_builder.h"
#include "tests/support/level_builder.h"

namespace {

using namespace comrad::doom;
using acs::test::BehaviorBuilder;
using comrad::bytecode::PCode;

class Input {
 public:
  Input(const uint8_t* data, std::size_t size) : data_(data), size_(size) {}
  bool empty() const { return place_ >= size_; }
  uint8_t byte() { return empty() ? 0 : data_[place_++]; }
  /// Mostly small numbers, sometimes thing ids and fixed-point ones, sometimes anything.
  int32_t number() {
    const uint8_t kind = byte();
    if (kind < 160) return kind % 24;
    if (kind < 190) return static_cast<int8_t>(byte());
    if (kind < 220) return static_cast<int8_t>(byte()) * 65536;
    if (kind < 240) return 100 + byte() % 8;
    uint32_t value = 0;
    for (int i = 0; i < 4; ++i) value = value << 8 | byte();
    return static_cast<int32_t>(value);
  }

 private:
  const uint8_t* data_;
  std::size_t size_, place_ = 0;
};

void write_code(BehaviorBuilder& code, Input& input, int length) {
  std::vector<BehaviorBuilder::Label> labels;
  for (int i = 0; i < 4; ++i) labels.push_back(code.label());
  std::size_t bound = 0;
  for (int i = 0; i < length && !input.empty(); ++i) {
    const uint8_t choice = input.byte();
    if (choice < 90) {
      code.push(input.number());
    } else if (choice < 110) {
      const auto function =
          static_cast<comrad::bytecode::BuiltIn>(input.byte() % comrad::bytecode::kBuiltInCount);
      const int count = input.byte() % 8;
      for (int arg = 0; arg < count; ++arg) code.push(input.number());
      code.call(function, count);
    } else if (choice < 120) {
      code.go(choice % 2 == 0 ? PCode::kIfGoto : PCode::kIfNotGoto, labels[input.byte() % labels.size()]);
    } else if (choice < 126 && bound < labels.size()) {
      code.bind(labels[bound++]);
    } else if (choice < 132) {
      code.op(PCode::kDelayDirect, {input.byte() % 3});
    } else {
      const auto number =
          (static_cast<uint32_t>(input.byte()) << 1 | (choice & 1)) % comrad::bytecode::kPCodeCount;
      const auto which = static_cast<PCode>(number);
      // What ends everything at once tests little, and a table of cases is behavior_fuzz's.
      if (which == PCode::kTerminate || which == PCode::kRestart || which == PCode::kCaseGotoSorted) continue;
      const std::string_view operands = comrad::bytecode::kPCodes[number].operands;
      const uint32_t pops = comrad::bytecode::kPCodes[number].pops;
      for (uint32_t pop = 0; pop < pops && pop < 10; ++pop)
        if ((input.byte() & 3) != 0) code.push(input.number());
      std::vector<int32_t> values;
      for (std::size_t operand = 0; operand < operands.size(); ++operand) values.push_back(input.number());
      code.op(which, values);
    }
  }
  while (bound < labels.size()) code.bind(labels[bound++]);
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, std::size_t size) {
  comrad::fuzz::be_quiet();
  if (size < 8 || size > 4096) return 0;
  Input input(data, size);
  BehaviorBuilder code(acs::test::kContainers[1 + input.byte() % 4]);
  for (const char* text :
       {"Clip", "DoomImp", "Medikit", "Shotgun", "Spawn", "SMALLFONT", "%x \034Gtext", "", "answer",
        "FLOOR4_8", "Cacodemon", "MapSpot", "DoomImpBall", "SOLID", "Death.Fire", "LostSoul"})
    code.text(text);
  code.function(2, 4, true, "sum");
  write_code(code, input, 24);
  code.push(1).op(PCode::kReturnValue).end_function();
  code.named_script("answer", 0, 3);
  write_code(code, input, 30);
  code.end();
  const int types[] = {1, 4, 0, 3};
  for (int script = 0; script < 4; ++script) {
    code.script(script + 1, types[script], script == 2 ? 3 : 0, 24).local_arrays({8});
    write_code(code, input, 60);
    code.end();
  }
  code.array(5, {1, 2, 3, 4, 5, 6, 7, 8});
  const auto behavior = acs::Behavior::load(code.build(), "fuzz");
  if (!behavior) return 0;
  static const std::shared_ptr<const Level> kRoom = [] {
    test::LevelBuilder builder;
    const uint32_t room = builder.sector(0, 256, 3);
    const uint32_t plate = builder.sector(8, 256, 4);
    builder.room(room, -512, -512, 512, 512).island(plate, room, 64, 64, 192, 192);
    builder.thing(1, -128, 0)
        .thing(2, 128, 0, 180)
        .thing(9001, 0, 200, 90, 100)
        .thing(3001, 300, -300, 0, 101);
    builder.thing(2012, -300, -300, 0, 102).thing(9001, -200, 200, 45, 103);
    builder.line(1).id = 5;
    return builder.build();
  }();
  World world(kRoom, comrad::fuzz::catalog(), *behavior);
  comrad::fuzz::start(world, 5'000);
  comrad::fuzz::play(world, 4);
  World snapshot = world;
  comrad::fuzz::play(world, 6, 0x123457);
  comrad::fuzz::play(snapshot, 6, 0x123457);
  comrad::fuzz::require(world.hash() == snapshot.hash());
  return 0;
}
