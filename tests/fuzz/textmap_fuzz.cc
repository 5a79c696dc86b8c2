// The text of a UDMF map; what loads is played and drawn.
#include "sim_workers/engine/map/level_loader.h"
#include "sim_workers/engine/render/renderer.h"
#include "tests/fuzz/play.h"
#include "tests/unit/sim_workers/render/tiny_iwad.h"

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
  comrad::doom::RenderOptions options;
  options.width = 64, options.height = 40, options.status_bar = false;
  static const auto renderer =
      comrad::doom::Renderer::create(comrad::doom::test::tiny_archive(), options).value();
  static std::vector<uint8_t> picture(3 * 64 * 40);
  for (const int player : {0, 1}) {
    const comrad::doom::ViewRequest request{&world, player, picture.data()};
    renderer->draw({&request, 1});
  }
  return 0;
}
