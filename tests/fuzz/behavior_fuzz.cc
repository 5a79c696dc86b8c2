// A BEHAVIOR lump, byte by byte; what loads runs.
#include "sim_workers/engine/acs/behavior.h"
#include "tests/fuzz/play.h"
#include "tests/support/level_builder.h"

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, std::size_t size) {
  using namespace comrad::doom;
  comrad::fuzz::be_quiet();
  if (size > 1 << 15) return 0;
  const auto behavior = acs::Behavior::load({data, size}, "fuzz");
  if (!behavior) return 0;
  static const std::shared_ptr<const Level> kRoom = test::one_room();
  World world(kRoom, comrad::fuzz::catalog(), *behavior);
  comrad::fuzz::start(world);
  comrad::fuzz::play(world, 6);
  return 0;
}
