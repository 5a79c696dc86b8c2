// Prints a hash of the painter's pictures of each scenario, and of every .cfg game of the folders named, after decisions by
// chance, and of maps of each scenario: what compilers_test.sh compares between compilers.
//   view_hashes [FOLDER with .cfg games]...
#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "rollout_buffer/core/checksum.h"
#include "rollout_buffer/core/files.h"
#include "rollout_buffer/core/rng.h"
#include "scenarios/spec/registry.h"
#include "scenarios/spec/scenario_spec.h"
#include "sim_workers/env/doom_env.h"

namespace comrad {
namespace {

constexpr int kViews = 77, kMaps = 20;

/// Plays `game` by chance and hashes kViews pictures.
Status hash_views(const std::string& name, std::shared_ptr<const sim::DoomGame> game,
                  const std::vector<std::string>& wads) {
  constexpr sim::ViewSize kSize = sim::kObservationSize;
  COMRAD_TRY_ASSIGN(const std::unique_ptr<doom::Renderer> renderer, sim::make_renderer(*game, wads, kSize));
  sim::DoomEnvironment environment(game);
  const EnvShape& shape = environment.shape();
  std::vector<int32_t> choice(static_cast<std::size_t>(shape.num_agents * shape.head_count));
  Rng rng{uint64_t{1993}};
  std::vector<uint8_t> picture(std::size_t{3} * kSize.width * kSize.height);
  uint64_t hash = 0;
  environment.reset(42);
  for (int view = 0; view < kViews; ++view) {
    for (int decision = 0; decision < 3; ++decision) {
      if (environment.last_step().episode_over()) environment.reset(rng.next());
      for (std::size_t place = 0; place < choice.size(); ++place)
        choice[place] = static_cast<int32_t>(rng.below(
            static_cast<uint32_t>(shape.head_sizes[place % static_cast<std::size_t>(shape.head_count)])));
      environment.step(choice);
    }
    const doom::ViewRequest request{&environment.world(), view % shape.num_agents, picture.data()};
    renderer->draw({&request, 1});
    hash = hash * 31 + checksum64(std::as_bytes(std::span(picture)));
  }
  std::printf("%s %d views %016llx\n", name.c_str(), kViews, static_cast<unsigned long long>(hash));
  return {};
}

Status hash_game(const std::string& name, const std::string& scenario, const std::string& wad, int agents) {
  COMRAD_TRY_ASSIGN(const auto game,
                    sim::load_doom_game({.scenario = scenario, .wad_path = wad, .num_agents = agents}));
  return hash_views(name, game, {wad});
}

Status hash_scenario(const std::string& name, const std::filesystem::path& folder) {
  COMRAD_TRY_ASSIGN(const scenarios::ScenarioSpec spec, scenarios::load_scenario(name));
  scenarios::LayoutRequest request;
  request.num_agents = spec.default_agents;
  uint64_t hash = 0;
  for (int map = 0; map < kMaps; ++map) {
    request.seed = static_cast<uint64_t>(map);
    COMRAD_TRY_ASSIGN(const scenarios::GeneratedLayout drawn, scenarios::generate_layout(name, request));
    hash = hash * 31 + checksum64(std::as_bytes(std::span(drawn.wad)));
  }
  std::printf("%s %d maps %016llx\n", name.c_str(), kMaps, static_cast<unsigned long long>(hash));
  request.seed = 42;
  COMRAD_TRY_ASSIGN(const scenarios::GeneratedLayout layout, scenarios::generate_layout(name, request));
  const std::string path = folder / (name + ".wad");
  COMRAD_TRY(write_file_atomically(path, layout.wad, /*durable=*/false));
  return hash_game(name, name, path, spec.default_agents);
}

int run(int argc, char** argv) {
  char pattern[] = "/tmp/view_hashes.XXXXXX";
  if (::mkdtemp(pattern) == nullptr) return 1;
  const std::filesystem::path folder = pattern;
  Status status;
  for (const std::string& name : scenarios::layout_recipes())
    if (status) status = hash_scenario(name, folder);
  for (int i = 1; i < argc && status; ++i) {
    std::vector<std::string> games;
    for (const auto& entry : std::filesystem::directory_iterator(argv[i]))
      if (entry.path().extension() == ".cfg") games.push_back(entry.path());
    std::ranges::sort(games);
    for (const std::string& path : games) {
      const auto spec = scenarios::load_scenario(path);
      if (status && !spec) status = spec.error();
      if (status)
        status = hash_game(std::filesystem::path(path).stem(), path, spec->folder + "/" + spec->wad,
                           spec->default_agents);
    }
  }
  std::error_code ignored;
  std::filesystem::remove_all(folder, ignored);
  if (!status) std::fprintf(stderr, "view_hashes: %s\n", status.error().message.c_str());
  return status ? 0 : 1;
}

}  // namespace
}  // namespace comrad

int main(int argc, char** argv) { return comrad::run(argc, argv); }
