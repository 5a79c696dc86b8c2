// All 32 maps of Freedoom 2, if it is installed, and maps of every scenario's pools: from the player's start and from places
// all over the map, in every direction, no pixel is left undrawn; Freedoom lacks no texture of its maps.
#include <gtest/gtest.h>

#include <cstdio>
#include <cstdlib>

#include "doomgen/wad/iwad_search.h"
#include "rollout_buffer/core/rng.h"
#include "sim_workers/engine/map/level_loader.h"
#include "sim_workers/engine/play/placement.h"
#include "sim_workers/engine/render/art_archive.h"
#include "sim_workers/engine/render/renderer.h"
#include "sim_workers/engine/tic/tic.h"
#include "tests/support/played_scenario.h"

namespace comrad::doom {
namespace whole_views_test {

constexpr int kWidth = 160, kHeight = 120, kPlaces = 8, kDirections = 8;

/// Draws the map and counts pixels that nothing covered.
void look_around(Renderer& renderer, World& world, const std::string& map) {
  std::vector<uint8_t> picture(3 * kWidth * kHeight);
  Rng rng{uint64_t{32}};
  const ViewRequest request{.world = &world, .player = 0, .destination = picture.data()};
  int64_t holes = 0, views = 0;
  std::string worst;
  int64_t most = 0;
  const auto& things = world.level().things;
  for (int place = 0; place < kPlaces; ++place) {
    if (place > 0) {  // where a thing stands, there is floor
      const MapThing& thing = things[rng.next() % things.size()];
      const Sector& sector = world.sectors()[world.sector_at(thing.x, thing.y)];
      const Fixed floor = sector.floor_height;
      if (sector.ceiling_height - floor < to_fixed(56)) continue;  // shut: nobody's eye is there
      set_position(world, world.body(0).id, thing.x, thing.y, floor);
      world.state().players[0].view_z = floor + to_fixed(41);
    }
    for (int direction = 0; direction < kDirections; ++direction) {
      world.set_angle(world.body(0).id, degrees_to_angle(direction * 360 / kDirections + 3));
      renderer.draw({&request, 1});
      const int64_t here = renderer.undrawn_pixels();
      holes += here, ++views;
      if (here > most) {
        most = here;
        char text[96];
        std::snprintf(text, sizeof text, "at (%d, %d) looking %d", world.body(0).x >> kFracBits,
                      world.body(0).y >> kFracBits, direction * 360 / kDirections + 3);
        worst = text;
      }
    }
  }
  if (holes > 0)
    std::printf("%s: %lld pixels undrawn in %lld views, most (%lld) %s\n", map.c_str(),
                static_cast<long long>(holes), static_cast<long long>(views), static_cast<long long>(most),
                worst.c_str());
  EXPECT_EQ(holes, 0) << map;
}

TEST(WholeViews, OnEveryMapOfFreedoom) {
  const auto path = wad::find_iwad();
  if (!path) GTEST_SKIP() << path.error().message;
  const auto wad = wad::WadFile::open(*path);
  ASSERT_TRUE(wad.has_value()) << wad.error().message;
  const auto art = ArtArchive::open(*path);
  ASSERT_TRUE(art.has_value()) << art.error().message;
  RenderOptions options;
  options.width = kWidth, options.height = kHeight;
  auto renderer = Renderer::create(*art, options);
  ASSERT_TRUE(renderer.has_value()) << renderer.error().message;
  const auto catalog = std::make_shared<const ActorCatalog>();
  int maps = 0;
  for (int number = 1; number <= 32; ++number) {
    char name[8];
    std::snprintf(name, sizeof name, "MAP%02d", number);
    const auto level = load_level(*wad, name);
    if (!level) continue;
    for (const Sidedef& side : (*level)->sidedefs)
      for (const std::string* texture : {&side.top, &side.middle, &side.bottom})
        EXPECT_TRUE(texture->empty() || *texture == "-" || (*art)->has_surface(*texture))
            << name << " " << *texture;
    World world(*level, catalog);
    reset_world(world, {.player_count = 1, .seed = 1});
    const Status prepared = (*renderer)->prepare(*level, catalog);
    ASSERT_TRUE(prepared.has_value()) << name << ": " << prepared.error().message;
    look_around(**renderer, world, name);
    ++maps;
  }
  EXPECT_EQ(maps, 32);
}

TEST(WholeViews, OnMapsOfEveryScenario) {
  constexpr uint64_t kMaps = 5;
  const auto art = ArtArchive::open();
  if (!art) GTEST_SKIP() << art.error().message;
  RenderOptions options;
  options.width = kWidth, options.height = kHeight;
  auto renderer = Renderer::create(*art, options);
  ASSERT_TRUE(renderer.has_value()) << renderer.error().message;
  for (const std::string& name : scenarios::layout_recipes())
    for (uint64_t seed = 1; seed <= kMaps; ++seed) {
      sim::PlayedScenario play(name, {.layout_seed = seed});
      look_around(**renderer, play.world(), name + " " + std::to_string(seed));
    }
}

}  // namespace whole_views_test
}  // namespace comrad::doom
