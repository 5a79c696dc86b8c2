// comrad-bench-render: how many agent views a second one core draws. Prints one JSON object.
//   comrad-bench-render [--scene arena|room|walk] [--players N] [--no_pictures] [--seconds S] [--views N]
//                       [--size WxH] [--renderer painter|osmesa] [--steps] [--picture PREFIX] [--wad FILE --map NAME]
// arena (default): a star-shaped hall with pillars, kits and tether sprites, viewers spread over it.
// room: one world of 2048 x 2048 units with 20 walking monsters; each decision is 4 tics and a view per
// player. walk: a map of the IWAD (--map, default MAP01) along a walk of one player, which is played before
// the clock starts.
#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "doomgen/wad/iwad_search.h"
#include "rollout_buffer/core/clock.h"
#include "rollout_buffer/core/rng.h"
#include "sim_workers/engine/map/level_loader.h"
#include "sim_workers/engine/play/actor_states.h"
#include "sim_workers/engine/play/placement.h"
#include "sim_workers/engine/play/spawning.h"
#include "sim_workers/engine/render/art_archive.h"
#include "sim_workers/engine/render/png_image.h"
#include "sim_workers/engine/render/renderer.h"
#include "sim_workers/engine/tic/tic.h"
#include "sim_workers/engine/world/world.h"

namespace comrad::doom {
namespace {

constexpr int kRadius = 2000, kPillars = 100, kKits = 80, kTetherNodes = 30, kCorners = 24;

/// Adds a ring of walls whose inside (or, for a pillar, outside) belongs to sector 0.
void add_ring(const std::vector<std::pair<int, int>>& points, const char* texture, Level* level) {
  const auto first = static_cast<uint32_t>(level->vertices.size());
  const auto count = static_cast<uint32_t>(points.size());
  for (const auto& [x, y] : points) level->vertices.push_back({to_fixed(x), to_fixed(y)});
  for (uint32_t i = 0; i < count; ++i) {
    Sidedef side;
    side.top = side.bottom = "-", side.middle = texture;
    level->sidedefs.push_back(side);
    Linedef line;
    line.start = first + i, line.end = first + (i + 1) % count;
    line.flags = kLineBlocking;
    line.front = static_cast<uint32_t>(level->sidedefs.size() - 1);
    level->linedefs.push_back(line);
  }
}

std::shared_ptr<const Level> make_arena(Rng* rng) {
  Level level;
  level.name = "BENCH";
  Sector sector;
  sector.ceiling_height = to_fixed(384);
  sector.floor_texture = "FLAT1", sector.ceiling_texture = "CEIL1_2", sector.light = 200;
  level.sectors.push_back(sector);
  const auto uniform = [&](int low, int high) {
    return low + static_cast<int>(rng->next() % static_cast<uint64_t>(high - low + 1));
  };
  std::vector<std::pair<int, int>> star;
  for (int i = 0; i < kCorners; ++i) {  // clockwise: the inside lies to the right
    const double angle = -2 * 3.14159265358979 * i / kCorners, reach = uniform(kRadius * 6 / 10, kRadius);
    star.emplace_back(static_cast<int>(reach * std::cos(angle)), static_cast<int>(reach * std::sin(angle)));
  }
  add_ring(star, "BRICK6", &level);
  for (int i = 0; i < kPillars; ++i) {
    const int x = uniform(-1300, 1300), y = uniform(-1300, 1300), w = uniform(24, 64), h = uniform(24, 64);
    if (std::abs(x) < 256 && std::abs(y) < 256) continue;
    if (x * x + y * y > 1100 * 1100) continue;
    add_ring({{x - w, y - h}, {x + w, y - h}, {x + w, y + h}, {x - w, y + h}}, "ASHWALL6", &level);
  }
  for (int player = 1; player <= 2; ++player) {
    MapThing start;
    start.editor_number = player;
    start.x = to_fixed(player * 64 - 96);
    start.flags = 0xFFFFFFFFu;
    level.things.push_back(start);
  }
  complete_level(level);
  return std::make_shared<const Level>(std::move(level));
}

void write_pictures(const std::string& prefix, std::span<const uint8_t> frames, int count, int width,
                    int height) {
  const std::size_t plane = static_cast<std::size_t>(width) * static_cast<std::size_t>(height);
  for (int v = 0; v < count; ++v)
    (void)write_png(fmt::format("{}_{}.png", prefix, v),
                    frames.subspan(3 * plane * static_cast<std::size_t>(v), 3 * plane), width, height);
}

/// One world with monsters that walk; `players` views a decision, or none.
int run_room(Renderer* renderer, const RenderOptions& options, int players, double seconds,
             const std::string& picture) {
  constexpr int kHalf = 1024, kMonsters = 20;
  Level level;
  level.name = "ROOM";
  Sector sector;
  sector.ceiling_height = to_fixed(256);
  sector.floor_texture = "FLAT1", sector.ceiling_texture = "CEIL1_2", sector.light = 200;
  level.sectors.push_back(sector);
  add_ring({{-kHalf, -kHalf}, {-kHalf, kHalf}, {kHalf, kHalf}, {kHalf, -kHalf}}, "BRICK6", &level);
  const auto add_thing = [&](int number, int x, int y, int angle) {
    MapThing thing;
    thing.editor_number = number;
    thing.x = to_fixed(x), thing.y = to_fixed(y), thing.angle_degrees = angle;
    thing.flags =
        0xFFFFFFFFu & ~(kThingDormant | kThingAmbush | kThingFriend | kThingInvisible | kThingShadow);
    level.things.push_back(thing);
  };
  for (int player = 0; player < players; ++player)
    add_thing(player < 4 ? player + 1 : 4001 + player - 4, -700 + 200 * player, -600, 90);
  complete_level(level);
  const auto shared = std::make_shared<const Level>(std::move(level));
  const auto catalog = std::make_shared<const ActorCatalog>();
  World world(shared, catalog);
  Rng rng{uint64_t{7}};
  const uint32_t monster = catalog->find("DoomImp").value_or(0);
  const auto start = [&](uint64_t seed) {
    reset_world(world, {.player_count = players, .seed = seed});
    for (int i = 0; i < kMonsters; ++i) {
      const auto id =
          spawn_actor(world, monster, to_fixed(static_cast<int>(rng.next() % 1801) - 900),
                      to_fixed(static_cast<int>(rng.next() % 1801) - 900), 0, static_cast<Angle>(rng.next()));
      Actor* const actor = id ? world.actor(*id) : nullptr;
      if (actor == nullptr) continue;
      actor->target_id = world.body(i % players).id;  // awake: they walk
      set_label(world, *actor, StateLabel::kSee);
    }
    for (int player = 0; player < players; ++player) {  // all over the room, looking anywhere
      world.state().players[static_cast<std::size_t>(player)].god_mode = true;
      for (int attempt = 0; attempt < 100; ++attempt)
        if (try_teleport(world, world.body(player).id, to_fixed(static_cast<int>(rng.next() % 1801) - 900),
                         to_fixed(static_cast<int>(rng.next() % 1801) - 900)))
          break;
      world.set_angle(world.body(player).id, static_cast<Angle>(rng.next()));
    }
  };
  start(1);
  std::vector<uint8_t> frames(std::size_t{3} * options.width * options.height * players);
  std::vector<ViewRequest> requests;
  if (renderer != nullptr) {
    if (const Status prepared = renderer->prepare(shared, catalog); !prepared) {
      std::fprintf(stderr, "comrad-bench-render: %s\n", prepared.error().message.c_str());
      return 1;
    }
    for (int player = 0; player < players; ++player)
      requests.push_back(
          {.world = &world,
           .player = player,
           .destination = frames.data() + std::size_t{3} * options.width * options.height * player});
    renderer->draw(requests);  // shaders compile
  }
  std::vector<Buttons> buttons(static_cast<std::size_t>(players));
  uint64_t steps = 0;
  const auto decide = [&] {
    for (Buttons& pressed : buttons)
      pressed = {.forward = (rng.next() & 1) != 0,
                 .backward = (rng.next() & 3) == 0,
                 .turn_left = (rng.next() & 3) == 0,
                 .turn_right = (rng.next() & 3) == 0};
    for (int tic = 0; tic < 4; ++tic) run_tic(world, buttons);
    if (renderer != nullptr) renderer->draw(requests);
    if (++steps % 250 == 0) start(steps);
  };
  for (int i = 0; i < 300; ++i) decide();  // sprites load, buffers grow
  if (!picture.empty()) write_pictures(picture, frames, players, options.width, options.height);
  steps = 0;
  const Stopwatch clock(CLOCK_PROCESS_CPUTIME_ID);
  while (clock.elapsed() < seconds)
    for (int i = 0; i < 16; ++i) decide();
  const double count = static_cast<double>(steps) * players, cpu = clock.cpu_elapsed();
  std::printf(
      "{\"bench\": \"render\", \"scene\": \"room\", \"players\": %d, \"pictures\": %s, \"decisions_per_s\": "
      "%.0f, "
      "\"decisions_per_cpu_s\": %.0f, \"cpu_us_per_decision\": %.1f, \"world_tics_per_cpu_s\": %.0f, "
      "\"width\": %d, "
      "\"height\": %d}\n",
      players, renderer != nullptr ? "true" : "false", count / clock.elapsed(), count / cpu,
      cpu * 1e6 / count, 4.0 * static_cast<double>(steps) / cpu, options.width, options.height);
  return 0;
}

/// Views of a map along the walk of a player who runs ahead and turns where it gets no farther.
int run_walk(Renderer& renderer, const RenderOptions& options, const std::shared_ptr<const Level>& level,
             double seconds, const std::string& picture) {
  const auto catalog = std::make_shared<const ActorCatalog>();
  if (const Status prepared = renderer.prepare(level, catalog); !prepared) {
    std::fprintf(stderr, "comrad-bench-render: %s\n", prepared.error().message.c_str());
    return 1;
  }
  World world(level, catalog);
  reset_world(world, {.player_count = 1, .seed = 3});
  world.state().players[0].god_mode = true;
  struct Place {
    Fixed x, y, z, view_z;
    Angle angle;
  };
  std::vector<Place> walk;
  Rng rng{uint64_t{11}};
  int turning = 0;
  bool left = false;
  for (int tic = 0; tic < 8000 && !world.level_exited(); ++tic) {
    Buttons pressed{.forward = true, .speed = true};
    const Actor before = world.body(0);
    if (turning > 0) --turning, (left ? pressed.turn_left : pressed.turn_right) = true;
    pressed.use = tic % 16 == 0;
    run_tic(world, {&pressed, 1});
    const Actor& body = world.body(0);
    const bool stuck = std::abs(body.x - before.x) + std::abs(body.y - before.y) < to_fixed(4);
    if (turning == 0 && (stuck || rng.next() % 64 == 0))
      turning = 5 + static_cast<int>(rng.next() % 20), left = (rng.next() & 1) != 0;
    if (tic % 4 == 0) walk.push_back({body.x, body.y, body.z, world.player(0).view_z, body.angle});
  }
  std::vector<uint8_t> frame(std::size_t{3} * options.width * options.height);
  const ViewRequest request{.world = &world, .player = 0, .destination = frame.data()};
  uint64_t drawn = 0;
  const auto show = [&](const Place& place) {
    set_position(world, world.body(0).id, place.x, place.y, place.z);
    world.set_angle(world.body(0).id, place.angle);
    world.state().players[0].view_z = place.view_z;
    renderer.draw({&request, 1});
    ++drawn;
  };
  for (std::size_t i = 0; i < walk.size(); ++i) {
    show(walk[i]);
    if (!picture.empty() && i % 200 == 0)
      write_pictures(fmt::format("{}_{}", picture, i), frame, 1, options.width, options.height);
  }
  drawn = 0;
  const Stopwatch clock(CLOCK_PROCESS_CPUTIME_ID);
  while (clock.elapsed() < seconds)
    for (const Place& place : walk) show(place);
  const double count = static_cast<double>(drawn), cpu = clock.cpu_elapsed();
  std::printf(
      "{\"bench\": \"render\", \"scene\": \"walk\", \"map\": \"%s\", \"places\": %zu, \"views_per_s\": %.0f, "
      "\"views_per_cpu_s\": %.0f, \"cpu_us_per_view\": %.1f, \"width\": %d, \"height\": %d}\n",
      level->name.c_str(), walk.size(), count / clock.elapsed(), count / cpu, cpu * 1e6 / count,
      options.width, options.height);
  return 0;
}

int run(int argc, char** argv) {
  double seconds = 3;
  int players = 2;
  bool pictures = true;
  std::string scene = "arena";
  int view_count = 32;
  bool step = false;
  std::string picture, wad_path, map_name;
  RenderOptions options;
  for (int i = 1; i < argc; ++i) {
    const std::string flag = argv[i];
    const auto value = [&] { return i + 1 < argc ? argv[++i] : ""; };
    if (flag == "--seconds")
      seconds = std::atof(value());
    else if (flag == "--views")
      view_count = std::atoi(value());
    else if (flag == "--steps")
      step = true;
    else if (flag == "--picture")
      picture = value();
    else if (flag == "--wad")
      wad_path = value();
    else if (flag == "--map")
      map_name = value();
    else if (flag == "--scene")
      scene = value();
    else if (flag == "--players")
      players = std::clamp(std::atoi(value()), 1, 8);
    else if (flag == "--renderer")
      options.renderer =
          std::string_view(value()) == "osmesa" ? RendererKind::kOsmesa : RendererKind::kPainter;
    else if (flag == "--no_pictures")
      pictures = false;
    else if (flag == "--size" && std::sscanf(value(), "%dx%d", &options.width, &options.height) == 2)
      continue;
    else {
      std::fprintf(stderr, "comrad-bench-render: unknown or incomplete flag %s\n", flag.c_str());
      return 2;
    }
  }
  const auto fail = [](const Error& error) {
    std::fprintf(stderr, "comrad-bench-render: %s\n", error.message.c_str());
    return 1;
  };
  if (scene == "room" && !pictures) return run_room(nullptr, options, players, seconds, picture);
  auto art = ArtArchive::open({}, {});
  if (!art) return fail(art.error());
  auto renderer = Renderer::create(*art, options);
  if (!renderer) return fail(renderer.error());
  if (scene == "room") return run_room(renderer->get(), options, players, seconds, picture);
  if (scene == "walk" && wad_path.empty()) {
    auto found = wad::find_iwad();
    if (!found) return fail(found.error());
    wad_path = *found;
    if (map_name.empty()) map_name = "MAP01";
  }
  Rng rng{uint64_t{7}};
  std::shared_ptr<const Level> level = make_arena(&rng);
  if (!wad_path.empty()) {
    auto wad = wad::WadFile::open(wad_path);
    if (!wad) return fail(wad.error());
    auto loaded = load_level(*wad, map_name);
    if (!loaded) return fail(loaded.error());
    level = *loaded;
  }
  if (scene == "walk") return run_walk(**renderer, options, level, seconds, picture);
  if (scene != "arena")
    return fail({ErrorCode::kBadInput, "unknown scene '" + scene + "': arena, room or walk"});
  auto catalog = std::make_shared<ActorCatalog>();
  ActorType node;
  node.name = "BenchNode", node.scale_x = node.scale_y = 0.13f;
  node.flags.set(ActorFlag::kNoGravity), node.flags.set(ActorFlag::kNoBlockmap);
  const uint32_t node_type = catalog->add_simple(node, "APLS", "A", -1, true);
  const uint32_t stimpack = catalog->find("Stimpack").value_or(0),
                 medikit = catalog->find("Medikit").value_or(0);
  if (const Status prepared = (*renderer)->prepare(level, catalog); !prepared) return fail(prepared.error());

  std::vector<World> worlds;
  const int world_count = (view_count + 1) / 2;
  const auto place = [&] { return to_fixed(static_cast<int>(rng.next() % 2001) - 1000); };
  for (int w = 0; w < world_count; ++w) {
    World world(level, catalog);
    reset_world(world, {.player_count = 2, .seed = static_cast<uint64_t>(w)});
    for (int i = 0; i < kKits; ++i)
      (void)spawn_actor(world, i % 4 ? stimpack : medikit, place(), place(), 0, 0);
    // The first player anywhere, the second near it as a tether would keep it.
    for (int attempt = 0; attempt < 100; ++attempt)
      if (try_teleport(world, world.body(0).id, place(), place())) break;
    const Actor first = world.body(0);
    for (int attempt = 0; attempt < 100; ++attempt)
      if (try_teleport(world, world.body(1).id, first.x + place() / 4, first.y + place() / 4)) break;
    for (int player = 0; player < 2; ++player)
      world.set_angle(world.body(player).id, static_cast<Angle>(rng.next()));
    const Actor a = world.body(0), b = world.body(1);
    for (int i = 0; i < kTetherNodes; ++i) {
      const auto along = [&](Fixed from, Fixed to) {
        return static_cast<Fixed>(from + (static_cast<int64_t>(to) - from) * (i + 1) / (kTetherNodes + 1));
      };
      spawn_actor(world, node_type, along(a.x, b.x), along(a.y, b.y), to_fixed(20), 0, 0, true);
    }
    worlds.push_back(std::move(world));
  }
  const std::size_t bytes = std::size_t{3} * options.width * options.height;
  std::vector<uint8_t> frames(bytes * static_cast<std::size_t>(view_count));
  std::vector<ViewRequest> requests;
  for (int v = 0; v < view_count; ++v)
    requests.push_back({.world = &worlds[static_cast<std::size_t>(v / 2)],
                        .player = v % 2,
                        .destination = frames.data() + bytes * static_cast<std::size_t>(v)});

  (*renderer)->draw(requests);  // shaders compile, buffers grow
  if (!picture.empty()) write_pictures(picture, frames, view_count, options.width, options.height);
  uint64_t drawn = 0;
  const Stopwatch clock(CLOCK_PROCESS_CPUTIME_ID);
  std::vector<Buttons> buttons(2);
  while (clock.elapsed() < seconds) {
    for (World& world : worlds) {
      for (int player = 0; player < 2 && !step; ++player)
        world.set_angle(world.body(player).id, world.body(player).angle + degrees_to_angle(7));
      for (int tic = 0; tic < 4 && step; ++tic) {
        for (Buttons& pressed : buttons)
          pressed = {.forward = (rng.next() & 1) != 0, .turn_left = (rng.next() & 1) != 0};
        run_tic(world, buttons);
      }
    }
    (*renderer)->draw(requests);
    drawn += requests.size();
  }
  const double cpu = clock.cpu_elapsed(), count = static_cast<double>(drawn);
  std::printf(
      "{\"bench\": \"render\", \"views_per_s\": %.0f, \"views_per_cpu_s\": %.0f, \"cpu_us_per_view\": %.1f, "
      "\"width\": %d, \"height\": %d, \"views_per_draw\": %d, \"with_tics\": %s}\n",
      count / clock.elapsed(), count / cpu, cpu * 1e6 / count, options.width, options.height, view_count,
      step ? "true" : "false");
  return 0;
}

}  // namespace
}  // namespace comrad::doom

int main(int argc, char** argv) { return comrad::doom::run(argc, argv); }
