// comrad-bench-render: how many agent views a second one core draws, on an arena of the size that training
// uses: a star-shaped hall with pillars, kits and tether sprites, viewers spread over it. Prints one JSON
// object.
//   comrad-bench-render [--seconds S] [--views N] [--size WxH] [--steps] [--picture FILE.ppm] [--wad FILE
//   --map NAME]
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <ctime>
#include <memory>
#include <string>
#include <vector>

#include "rollout_buffer/core/rng.h"
#include "sim_workers/engine/map/level_loader.h"
#include "sim_workers/engine/play/world.h"
#include "sim_workers/engine/render/art_archive.h"
#include "sim_workers/engine/render/renderer.h"

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

int run(int argc, char** argv) {
  double seconds = 3;
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
  auto art = ArtArchive::open({}, {});
  if (!art) return fail(art.error());
  auto renderer = Renderer::create(*art, options);
  if (!renderer) return fail(renderer.error());
  Rng rng{uint64_t{7}};
  std::shared_ptr<const Level> level = make_arena(&rng);
  if (!wad_path.empty()) {
    auto wad = wad::WadFile::open(wad_path);
    if (!wad) return fail(wad.error());
    auto loaded = load_level(*wad, map_name);
    if (!loaded) return fail(loaded.error());
    level = *loaded;
  }
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
    world.reset({.player_count = 2, .seed = static_cast<uint64_t>(w)}, nullptr);
    for (int i = 0; i < kKits; ++i) (void)world.spawn(i % 4 ? stimpack : medikit, place(), place(), 0, 0);
    // The first player anywhere, the second near it as a tether would keep it.
    for (int attempt = 0; attempt < 100; ++attempt)
      if (world.try_teleport(world.body(0).id, place(), place())) break;
    const Actor first = world.body(0);
    for (int attempt = 0; attempt < 100; ++attempt)
      if (world.try_teleport(world.body(1).id, first.x + place() / 4, first.y + place() / 4)) break;
    for (int player = 0; player < 2; ++player)
      world.set_angle(world.body(player).id, static_cast<Angle>(rng.next()));
    const Actor a = world.body(0), b = world.body(1);
    for (int i = 0; i < kTetherNodes; ++i) {
      const auto along = [&](Fixed from, Fixed to) {
        return static_cast<Fixed>(from + (static_cast<int64_t>(to) - from) * (i + 1) / (kTetherNodes + 1));
      };
      world.spawn(node_type, along(a.x, b.x), along(a.y, b.y), to_fixed(20), 0, 0, true);
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
  if (!picture.empty()) {
    for (int v = 0; v < view_count; ++v) {
      const std::string path = picture + "_" + std::to_string(v) + ".ppm";
      std::FILE* file = std::fopen(path.c_str(), "wb");
      if (file == nullptr) return fail({ErrorCode::kSystem, "cannot write " + path});
      std::fprintf(file, "P6 %d %d 255\n", options.width, options.height);
      const std::size_t plane = bytes / 3;
      for (std::size_t i = 0; i < plane; ++i)
        for (std::size_t channel = 0; channel < 3; ++channel)
          std::fputc(frames[bytes * static_cast<std::size_t>(v) + channel * plane + i], file);
      std::fclose(file);
    }
  }
  uint64_t drawn = 0;
  const auto start = std::chrono::steady_clock::now();
  const auto cpu_seconds = [] {
    timespec now{};
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now);
    return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
  };
  const double cpu_start = cpu_seconds();
  double elapsed = 0;
  std::vector<Buttons> buttons(2);
  while (elapsed < seconds) {
    for (World& world : worlds) {
      for (int player = 0; player < 2 && !step; ++player)
        world.set_angle(world.body(player).id, world.body(player).angle + degrees_to_angle(7));
      for (int tic = 0; tic < 4 && step; ++tic) {
        for (Buttons& pressed : buttons)
          pressed = {.forward = (rng.next() & 1) != 0, .turn_left = (rng.next() & 1) != 0};
        world.tic(buttons);
      }
    }
    (*renderer)->draw(requests);
    drawn += requests.size();
    elapsed = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  }
  const double cpu = cpu_seconds() - cpu_start, count = static_cast<double>(drawn);
  std::printf(
      "{\"bench\": \"render\", \"views_per_s\": %.0f, \"views_per_cpu_s\": %.0f, \"cpu_us_per_view\": %.1f, "
      "\"width\": %d, \"height\": %d, \"views_per_draw\": %d, \"with_tics\": %s}\n",
      count / elapsed, count / cpu, cpu * 1e6 / count, options.width, options.height, view_count,
      step ? "true" : "false");
  return 0;
}

}  // namespace
}  // namespace comrad::doom

int main(int argc, char** argv) { return comrad::doom::run(argc, argv); }
