// The text of a UDMF map; what loads is played.
#include "sim_workers/engine/map/level_loader.h"
#include "tests/fuzz/play.h"

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, std::size_t size) {
  comrad::fuzz::be_quiet();
  if (size > 1 << 16) return 0;
  const auto map =
      comrad::wad::parse_udmf(std::string_view(reinterpret_cast<const char*>(data), size), "fuzz");
  if (!map) return 0;
  const auto level = comrad::doom::make_level(*map, "MAP01", "fuzz");
  if (!level) return 0;
  comrad::doom::World world(*level, comrad::fuzz::catalog());
  comrad::fuzz::start(world);
  comrad::fuzz::play(world, 20);
  return 0;
}
