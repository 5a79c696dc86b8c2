// A DECORATE lump; the actors that it makes are put into a room with two players.
#include "sim_workers/engine/actors/decorate.h"
#include "sim_workers/engine/play/spawning.h"
#include "tests/fuzz/play.h"
#include "tests/support/level_builder.h"

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, std::size_t size) {
  using namespace comrad::doom;
  comrad::fuzz::be_quiet();
  if (size > 1 << 15) return 0;
  auto catalog = std::make_shared<ActorCatalog>(*comrad::fuzz::catalog());
  const std::size_t known = catalog->size();
  std::vector<std::string> warnings;
  const std::string_view text(reinterpret_cast<const char*>(data), size);
  if (!parse_decorate(text, "fuzz", catalog.get(), &warnings)) {
    comrad::fuzz::require(catalog->size() == known);
    return 0;
  }
  static const std::shared_ptr<const Level> kRoom = test::one_room();
  World world(kRoom, catalog);
  comrad::fuzz::start(world);
  const uint32_t end = static_cast<uint32_t>(std::min(catalog->size(), known + 12));
  for (uint32_t type = static_cast<uint32_t>(known); type < end; ++type) {
    if ((*catalog)[type].is_player) continue;
    const int place = static_cast<int>(type - known);
    spawn_actor(world, type, to_fixed(-400 + 70 * place), to_fixed(100), kOnFloor, 0);
  }
  comrad::fuzz::play(world, 12);
  return 0;
}
