// A whole WAD: directory, maps of every format, DECORATE, BEHAVIOR; what loads is played.
#include "sim_workers/env/game_content.h"
#include "tests/fuzz/play.h"

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, std::size_t size) {
  comrad::fuzz::be_quiet();
  if (size > 1 << 17) return 0;
  const auto wad = comrad::wad::WadFile::from_bytes(std::vector<uint8_t>(data, data + size), "fuzz.wad");
  if (!wad) return 0;
  const auto content = comrad::sim::load_game_content(*wad);
  if (!content) return 0;
  comrad::doom::World world(content->level, content->catalog, content->behavior);
  comrad::fuzz::start(world);
  comrad::fuzz::play(world, 8);
  return 0;
}
