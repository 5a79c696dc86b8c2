// What else a picture shows: see-through and moving surfaces, coloured and full light, palette flashes, texts
// and pictures of scripts. On the tiny IWAD, whose palette index i is the colour (i, 255 - i, i / 2).
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <functional>

#include "sim_workers/engine/render/renderer.h"
#include "sim_workers/engine/specials/movers.h"
#include "sim_workers/engine/tic/tic.h"
#include "tests/unit/sim_workers/render/open_level.h"
#include "tests/unit/sim_workers/render/tiny_iwad.h"

namespace comrad::doom {
namespace picture_effects_test {

using test::LevelBuilder;

constexpr int kWidth = 128, kHeight = 72, kPlane = kWidth * kHeight;
constexpr int kWall = 10, kFloor = 50, kCeiling = 60, kGrate = 80, kKit = 40, kLetter = 90, kBadge = 120;

struct Picture {
  std::vector<uint8_t> planar = std::vector<uint8_t>(3 * kPlane);
  std::array<int, 3> at(int x, int y) const {
    const auto i = static_cast<std::size_t>(y * kWidth + x);
    return {planar[i], planar[kPlane + i], planar[2 * kPlane + i]};
  }
  int red(int x, int y) const { return at(x, y)[0]; }
  auto count(int red) const { return std::count(planar.begin(), planar.begin() + kPlane, red); }
};

std::array<int, 3> color(int index) { return {index, 255 - index, index / 2}; }

/// The tiny IWAD, a grate with 32 open columns of 64, letters A and B, a picture BADGE, and what `more` adds.
std::shared_ptr<const ArtArchive> archive(const std::function<void(wad::test::WadBytes&)>& more = nullptr) {
  wad::test::WadBytes pwad;
  std::vector<uint8_t> grate(64 * 64, kGrate);
  for (std::size_t i = 0; i < grate.size(); ++i)
    if (i % 64 >= 32) grate[i] = 255;
  pwad.add("TX_START").add("GRATE", test::picture_lump(64, 64, 0, 0, grate)).add("TX_END");
  pwad.add("STCFN065", test::filled_picture(8, 8, kLetter))
      .add("STCFN066", test::filled_picture(8, 8, kLetter + 1));
  pwad.add("BADGE", test::filled_picture(16, 8, kBadge));
  if (more) more(pwad);
  return ArtArchive::from_bytes({test::tiny_iwad().build(), pwad.build()}).value();
}

Picture draw(const World& world, const std::shared_ptr<const ArtArchive>& art, RenderOptions options = {}) {
  options.status_bar = options.crosshair = options.weapon = false;
  auto renderer = Renderer::create(art, options);
  EXPECT_TRUE(renderer.has_value()) << renderer.error().message;
  Picture picture;
  const ViewRequest request{.world = &world, .player = 0, .destination = picture.planar.data()};
  (*renderer)->draw({&request, 1});
  return picture;
}

World make_world(std::shared_ptr<const Level> level) {
  World world(std::move(level), std::make_shared<const ActorCatalog>());
  reset_world(world, {.player_count = 1, .seed = 1});
  return world;
}

/// A room, and in front of the player a box of sector 1 whose lines carry `middle`.
std::shared_ptr<const Level> caged_room(const std::string& middle,
                                        const std::function<void(Level&)>& change = nullptr) {
  LevelBuilder builder;
  const uint32_t room = builder.sector(0, 128), cage = builder.sector(0, 128, 1);
  builder.room(room, -512, -512, 512, 512).island(cage, room, 128, -128, 384, 128).thing(1, 0, 0);
  Level level = *test::with_open_lines(builder.build());
  for (const Linedef& line : level.linedefs)
    if (line.back) level.sidedefs[line.front].middle = level.sidedefs[*line.back].middle = middle;
  if (change) change(level);
  return std::make_shared<const Level>(std::move(level));
}

/// Counts of one row of the picture by red value.
int in_row(const Picture& picture, int row, int red) {
  int count = 0;
  for (int x = 0; x < kWidth; ++x) count += picture.red(x, row) == red;
  return count;
}

TEST(PictureEffects, AGratingShowsWhatIsBehindItsHoles) {
  const Picture picture = draw(make_world(caged_room("GRATE")), archive());
  // 64 texels high it hangs from the ceiling, down to row 36 - 57.6 * 23 / 128 = 25.
  const int row = 12;
  EXPECT_GT(in_row(picture, row, kGrate), 20);
  EXPECT_GT(in_row(picture, row, kCeiling), 20);
  EXPECT_EQ(in_row(picture, 70, kGrate), 0) << "it hangs once and does not repeat down to the floor";
}

/// The palette's entry, whose red is its number, for shares of two entries in 64ths.
int mixed_of(const ArtArchive& art, int front, int front_share, int behind, int behind_share) {
  ArtArchive::Color wanted{};
  for (std::size_t channel = 0; channel < 3; ++channel) {
    const int sum =
        art.palette(0)[front][channel] * front_share + art.palette(0)[behind][channel] * behind_share;
    const int five = std::clamp(sum / 512, 0, 31);
    wanted[channel] = static_cast<uint8_t>(five * 8 + five / 4);
  }
  return art.nearest(wanted);
}

TEST(PictureEffects, ATranslucentGratingMixesWithWhatIsBehind) {
  const auto glass = caged_room("GRATE", [](Level& level) {
    for (Linedef& line : level.linedefs)
      if (line.back) line.alpha = 0.5f;
  });
  const auto art = archive();
  const Picture picture = draw(make_world(glass), art);
  const int mixed = mixed_of(*art, kGrate, 32, kCeiling, 32);
  EXPECT_GT(in_row(picture, 12, mixed), 20);
  EXPECT_EQ(in_row(picture, 12, kGrate), 0);
}

TEST(PictureEffects, SeeThroughAndPlainViewsDrawnTogetherAreAsAlone) {
  const auto glass = caged_room("GRATE", [](Level& level) {
    for (Linedef& line : level.linedefs) line.alpha = 0.5f;
  });
  const auto art = archive();
  std::vector<World> worlds;
  for (int i = 0; i < 37; ++i) {  // more than two passes
    worlds.push_back(make_world(i % 3 == 0 ? glass : caged_room(i % 3 == 1 ? "GRATE" : "-")));
    worlds.back().set_angle(worlds.back().body(0).id, static_cast<Angle>(i) * 0x01000000u);
  }
  RenderOptions options;
  options.status_bar = options.crosshair = options.weapon = false;
  auto renderer = Renderer::create(art, options);
  ASSERT_TRUE(renderer.has_value());
  std::vector<Picture> together(worlds.size());
  std::vector<ViewRequest> requests;
  for (std::size_t i = 0; i < worlds.size(); ++i)
    requests.push_back({.world = &worlds[i], .player = 0, .destination = together[i].planar.data()});
  (*renderer)->draw(requests);
  EXPECT_EQ((*renderer)->driver_error(), 0u);
  for (std::size_t i = 0; i < worlds.size(); ++i)
    EXPECT_EQ(together[i].planar, draw(worlds[i], art).planar) << "view " << i;
}

TEST(PictureEffects, SpritesBlendAsTheirStyleDefines) {
  LevelBuilder builder;
  builder.room(builder.sector(0, 128), -512, -512, 512, 512).thing(1, 0, 0);
  World world = make_world(builder.build());
  const auto art = archive();
  Actor& kit = world.spawn_unchecked(world.catalog().find("Stimpack").value(), to_fixed(64), 0, to_fixed(36));
  const auto seen = [&](RenderStyle style, float alpha) {
    kit.render_style = style, kit.alpha = alpha;
    return draw(world, art).red(64, 36);
  };
  const int behind = seen(RenderStyle::kNone, 1);
  EXPECT_EQ(behind, kWall);
  EXPECT_EQ(seen(RenderStyle::kNormal, 1), kKit);
  EXPECT_EQ(seen(RenderStyle::kTranslucent, 0.5f), mixed_of(*art, kKit, 32, behind, 32));
  EXPECT_EQ(seen(RenderStyle::kAdd, 1), mixed_of(*art, kKit, 64, behind, 64));
  EXPECT_EQ(seen(RenderStyle::kSubtract, 0.5f), mixed_of(*art, kKit, -32, behind, 64));
  EXPECT_EQ(seen(RenderStyle::kFuzzy, 1), mixed_of(*art, kKit, 0, behind, 44))
      << "three tenths of the light are gone";
}

TEST(PictureEffects, MovingSectorsAreSeenWhereTheyAreNow) {
  World world = make_world(caged_room("-"));
  const auto art = archive();
  const int opening_row = 30, step_row = 50;
  EXPECT_NE(draw(world, art).red(64, step_row), 20);
  world.state().sectors[1].floor_height = to_fixed(32);  // a lift comes up
  EXPECT_EQ(draw(world, art).red(64, step_row), 20) << "the step's texture";
  world.state().sectors[1].ceiling_height = to_fixed(32);  // and the door is shut
  EXPECT_EQ(draw(world, art).red(64, opening_row), 20);
}

TEST(PictureEffects, PolyobjectsAreSeenWhereTheyAreNow) {
  LevelBuilder builder;
  const uint32_t room = builder.sector(0, 128);
  builder.room(room, -512, -512, 512, 512).thing(1, 0, 0);
  builder.thing(9300, 384, 384, 7).thing(9301, 128, 0, 7);
  builder.pillar(room, 368, 320, 400, 448);  // lines 4 to 7, at its anchor
  builder.line(4).special = 1, builder.line(4).args = {7, 0, 0, 0, 0};
  World world = make_world(test::with_open_lines(builder.build()));
  ASSERT_EQ(world.state().movers.polyobjects.size(), 1u);
  const auto art = archive();
  // A block of 32 units starts 112 ahead: it reaches far below the foot of the room's wall.
  const Picture before = draw(world, art);
  EXPECT_EQ(before.red(64, 50), kWall);
  execute_mover_special(world, {.number = 4, .args = {7, 64, 64, 320, 0}});  // Polyobj_Move to the north
  const Buttons nothing;
  for (int tic = 0; tic < 80; ++tic) run_tic(world, {&nothing, 1});
  const Picture after = draw(world, art);
  EXPECT_EQ(after.red(64, 50), kFloor) << "it has moved aside";
}

TEST(PictureEffects, ColouredLightTintsWallsFloorsAndSprites) {
  LevelBuilder builder;
  const uint32_t room = builder.sector(0, 128);
  builder.sector_at(room).light_color = 0xFF8000, builder.sector_at(room).light = 255;
  builder.room(room, -512, -512, 512, 512).thing(1, 0, 0);
  World world = make_world(builder.build());
  world.spawn_unchecked(world.catalog().find("Stimpack").value(), to_fixed(64), 0, to_fixed(36));
  const auto art = archive();
  const Picture picture = draw(world, art);
  constexpr std::array<std::array<int, 3>, 3> kPlaces = {{{20, 36, kWall}, {64, 70, kFloor}, {64, 36, kKit}}};
  for (const auto& [x, y, index] : kPlaces) {
    // The nearest colour that the palette has.
    const std::array<int, 3> plain = color(index);
    const uint8_t tinted =
        art->nearest({static_cast<uint8_t>(plain[0]), static_cast<uint8_t>(plain[1] * 128 / 255), 0});
    EXPECT_EQ(picture.at(x, y), color(tinted)) << "index " << index;
  }
}

/// Light row r turns every colour into index 100 + r.
std::shared_ptr<const ArtArchive> light_meter() {
  return archive([](wad::test::WadBytes& pwad) {
    std::string colormap;
    for (int row = 0; row < 34; ++row) colormap += std::string(256, static_cast<char>(100 + row));
    pwad.add("COLORMAP", colormap);
  });
}

TEST(PictureEffects, FullBrightStatesIgnoreTheSectorsLight) {
  auto catalog = std::make_shared<ActorCatalog>();
  ActorType lamp;
  lamp.name = "TestLamp";
  const uint32_t bright = catalog->add_simple(lamp, "STIM", "A", -1, true);
  lamp.name = "TestStone";
  const uint32_t dull = catalog->add_simple(lamp, "STIM", "A", -1, false);
  LevelBuilder builder;
  const uint32_t room = builder.sector(0, 128);
  builder.sector_at(room).light = 64;
  builder.room(room, -512, -512, 512, 512).thing(1, 0, 0);
  World world(builder.build(), catalog);
  reset_world(world, {.player_count = 1, .seed = 1});
  const auto art = light_meter();
  Actor& actor = world.spawn_unchecked(bright, to_fixed(256), 0, to_fixed(40));
  EXPECT_EQ(draw(world, art).red(64, 35), 100) << "row 0";
  actor.removed = true;
  world.spawn_unchecked(dull, to_fixed(256), 0, to_fixed(40));
  EXPECT_GT(draw(world, art).red(64, 35), 110);
}

TEST(PictureEffects, LightFallsOffWithDistanceAndRisesWithAFlash) {
  LevelBuilder builder;
  const uint32_t room = builder.sector(0, 512);
  builder.sector_at(room).light = 128;
  builder.room(room, -1024, -1024, 1024, 1024).thing(1, 0, 0);
  World world = make_world(builder.build());
  const auto art = light_meter();
  const Picture picture = draw(world, art);
  for (int row = 46; row < 70; ++row)
    EXPECT_LE(picture.red(64, row + 1), picture.red(64, row)) << "nearer is brighter";
  EXPECT_LT(picture.red(64, 71), picture.red(64, 45));
  world.state().players[0].extra_light = 2;
  EXPECT_EQ(draw(world, art).red(64, 45), picture.red(64, 45) - 8) << "two steps of four rows";
}

TEST(PictureEffects, PainAndPickupsTakeAPalette) {
  const auto art = archive([](wad::test::WadBytes& pwad) {
    std::string palettes;  // palette p shows every index as (10 p, index, 0)
    for (int p = 0; p < kPaletteCount; ++p)
      for (int i = 0; i < 256; ++i) palettes += {static_cast<char>(10 * p), static_cast<char>(i), 0};
    pwad.add("PLAYPAL", palettes);
  });
  LevelBuilder builder;
  builder.room(builder.sector(0, 128), -512, -512, 512, 512).thing(1, 0, 0);
  World world = make_world(builder.build());
  EXPECT_EQ(draw(world, art).red(5, 5), 0);
  world.state().players[0].damage_flash = 20;
  EXPECT_EQ(draw(world, art).red(5, 5), 30) << "20 counts: the third red palette";
  RenderOptions calm;
  calm.screen_flashes = false;
  EXPECT_EQ(draw(world, art, calm).red(5, 5), 0);
  world.state().players[0].damage_flash = 0, world.state().players[0].bonus_flash = 6;
  EXPECT_EQ(draw(world, art).red(5, 5), 90) << "the first gold palette";
}

acs::HudMessage message(const std::string& text, double x, double y) {
  acs::HudMessage made;
  made.text = text, made.font = "SMALLFONT", made.color = 11;
  made.x = static_cast<Fixed>(x * kFracUnit), made.y = static_cast<Fixed>(y * kFracUnit);
  return made;
}

class HudMessages : public ::testing::Test {
 protected:
  void SetUp() override {
    LevelBuilder builder;
    builder.room(builder.sector(0, 128), -512, -512, 512, 512).thing(1, 0, 0);
    world_.emplace(make_world(builder.build()));
  }
  Picture show(std::vector<acs::HudMessage> messages) {
    world_->state().scripts.hud_messages = std::move(messages);
    return draw(*world_, art_);
  }
  /// Left, top, right and bottom of what has this red.
  static std::array<int, 4> box(const Picture& picture, int red) {
    std::array<int, 4> found{kWidth, kHeight, 0, 0};
    for (int y = 0; y < kHeight; ++y)
      for (int x = 0; x < kWidth; ++x)
        if (picture.red(x, y) == red)
          found = {std::min(found[0], x), std::min(found[1], y), std::max(found[2], x + 1),
                   std::max(found[3], y + 1)};
    return found;
  }
  std::optional<World> world_;
  std::shared_ptr<const ArtArchive> art_ = archive();
};

TEST_F(HudMessages, StandWhereTheScriptPutsThem) {
  // Unscaled text is laid out on 160x120: a letter of 8x8 is 6.4 x 4.8 pixels here.
  const std::array<int, 4> corner = box(show({message("AA", 0, 0)}), kLetter);
  EXPECT_EQ(corner[0], 0);
  EXPECT_EQ(corner[1], 0);
  EXPECT_NEAR(corner[2], 12.8, 1);
  EXPECT_NEAR(corner[3], 4.8, 1);
  const std::array<int, 4> far = box(show({message("AA", 1, 1)}), kLetter);
  EXPECT_EQ(far[2], kWidth);
  EXPECT_EQ(far[3], kHeight - 1)
      << "a line is nine rows high at least, as ViZDoom's own letters of that font";
  const std::array<int, 4> middle = box(show({message("AA", 0.5, 0.5)}), kLetter);
  EXPECT_NEAR(middle[0] + middle[2], kWidth, 2);
  EXPECT_NEAR(middle[1] + middle[3], kHeight, 2);
}

// ViZDoom 1.3.2 draws `||||||||||` in the small font as nothing, though the IWAD has a picture of that letter; text
// behind it begins a space of each later.
TEST_F(HudMessages, LeaveGapsForLettersBehindTheUnderscore) {
  constexpr int kBar = 100;
  art_ = archive([](wad::test::WadBytes& pwad) {
    pwad.add("STCFN124", test::filled_picture(4, 8, kBar))
        .add("STCFN078", test::filled_picture(9, 8, kLetter + 2));
  });
  const Picture picture = show({message("||||A|", 0, 0)});
  EXPECT_EQ(picture.count(kBar), 0);
  EXPECT_NEAR(box(picture, kLetter)[0], 4 * 5 * 0.8, 1) << "a space is half as wide as an N";
}

TEST_F(HudMessages, AreATexelAPixelOnLargerScreens) {
  world_->state().scripts.hud_messages = {message("A", 0, 0)};
  RenderOptions options;
  options.width = 320, options.height = 240;
  options.status_bar = options.crosshair = options.weapon = false;
  auto renderer = Renderer::create(art_, options);
  ASSERT_TRUE(renderer.has_value()) << renderer.error().message;
  std::vector<uint8_t> planar(3 * 320 * 240);
  const ViewRequest request{.world = &*world_, .player = 0, .destination = planar.data()};
  (*renderer)->draw({&request, 1});
  EXPECT_EQ(std::count(planar.begin(), planar.begin() + 320 * 240, kLetter), 8 * 8);
  EXPECT_EQ(planar[7 * 320 + 7], kLetter);
}

TEST_F(HudMessages, UseTheScriptsOwnScreenSize) {
  acs::HudMessage scaled = message("A", 320.1, 240.1);  // .1: upper left corner there
  scaled.hud_width = 640, scaled.hud_height = 480;
  const std::array<int, 4> found = box(show({scaled}), kLetter);
  EXPECT_EQ(found[0], kWidth / 2);
  EXPECT_EQ(found[1], kHeight / 2);
  EXPECT_NEAR(found[2] - found[0], 8.0 * kWidth / 640, 1);
}

TEST_F(HudMessages, BreakLinesAndLeaveOtherPlayersAlone) {
  acs::HudMessage lines = message("A\nBB", 0, 0);
  const Picture picture = show({lines});
  EXPECT_EQ(box(picture, kLetter)[1], 0);
  EXPECT_GE(box(picture, kLetter + 1)[1], 4) << "the second line";
  lines.player = 3;
  EXPECT_EQ(show({lines}).count(kLetter), 0);
}

TEST_F(HudMessages, FadeOutAndTypeOn) {
  acs::HudMessage fading = message("A", 0, 0);
  fading.kind = 1, fading.hold_tics = 10, fading.fade_out_tics = 20;
  const int behind = draw(*world_, art_).red(2, 2);
  fading.age_tics = 5;
  EXPECT_EQ(show({fading}).red(2, 2), kLetter);
  fading.age_tics = 20;
  const int half = show({fading}).red(2, 2);
  EXPECT_NEAR(half, (kLetter + behind) / 2, 2);
  fading.age_tics = 30;
  EXPECT_EQ(show({fading}).red(2, 2), behind);
  acs::HudMessage typed = message("AAAA", 0, 0);
  typed.kind = 2, typed.type_tics = 2 * kFracUnit, typed.hold_tics = 100;
  typed.age_tics = 4;
  const auto two = box(show({typed}), kLetter);
  typed.age_tics = 50;
  const auto four = box(show({typed}), kLetter);
  EXPECT_NEAR(two[2] * 2, four[2], 2);
}

TEST_F(HudMessages, TakeTheColourAsked) {
  acs::HudMessage red = message("A", 0, 0);
  red.color = 6;
  EXPECT_EQ(show({red}).count(kLetter), 0) << "its own letter colour is index 90";
  acs::HudMessage plain = message("\x1CgA\x1C-B", 0, 0);  // \cg red, \c- back to its own
  const Picture both = show({plain});
  EXPECT_EQ(both.count(kLetter), 0);
  EXPECT_GT(both.count(kLetter + 1), 0);
}

TEST_F(HudMessages, APictureAsFontIsDrawnForTheLetterA) {
  acs::HudMessage badge = message("A", 0, 0);
  badge.font = "BADGE";
  const std::array<int, 4> found = box(show({badge}), kBadge);
  EXPECT_EQ(found[0], 0);
  EXPECT_EQ(found[1], 0);
  EXPECT_NEAR(found[2], 16 * 0.8, 1);
  EXPECT_NEAR(found[3], 8 * 0.6, 1);
}

TEST_F(HudMessages, AreLeftOutWhereTextIsOff) {
  world_->state().scripts.hud_messages = {message("A", 0, 0)};
  RenderOptions options;
  options.hud_text = false;
  EXPECT_EQ(draw(*world_, art_, options).count(kLetter), 0);
}

TEST(Renderers, ShowTheSameButForRoundedEdges) {
  World world = make_world(caged_room("GRATE"));
  world.spawn_unchecked(world.catalog().find("Stimpack").value(), to_fixed(64), to_fixed(20), 0);
  const auto art = archive();
  std::string missing;
  bool compared = false;
  for (const RendererKind kind : {RendererKind::kOsmesa, RendererKind::kEgl}) {
    RenderOptions other;
    other.renderer = kind, other.status_bar = false;
    if (const auto found = Renderer::create(art, other); !found) {
      missing += found.error().message + "\n";
      continue;
    }
    compared = true;
    other.status_bar = true;
    for (int degrees = 0; degrees < 360; degrees += 15) {
      world.set_angle(world.body(0).id, degrees_to_angle(degrees));
      const Picture ours = draw(world, art), theirs = draw(world, art, other);
      int different = 0;
      for (std::size_t i = 0; i < kPlane; ++i) different += ours.planar[i] != theirs.planar[i];
      EXPECT_LT(different, kPlane / 40) << word_of(kind) << " at " << degrees << " degrees";
    }
  }
  if (!compared) GTEST_SKIP() << missing;
}

}  // namespace picture_effects_test
}  // namespace comrad::doom
