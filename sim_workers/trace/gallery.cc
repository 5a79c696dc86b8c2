#include "sim_workers/trace/gallery.h"

#include <algorithm>
#include <filesystem>
#include <span>

#include "rollout_buffer/core/files.h"
#include "rollout_buffer/core/rng.h"
#include "scenarios/spec/registry.h"
#include "scenarios/spec/scenario_spec.h"
#include "sim_workers/engine/render/png_image.h"
#include "sim_workers/engine/render/renderer.h"
#include "sim_workers/env/doom_env.h"
#include "sim_workers/oracle/oracle.h"

namespace comrad::trace {
namespace {

constexpr int kGapPixels = 4;
constexpr int kColumns = 7;  ///< of games.png

/// Plays until the picture's moment: the oracle, or chance where there is none.
void play(const GalleryOptions& options, sim::DoomEnvironment& environment) {
  Expected<sim::OraclePlayer> oracle = sim::OraclePlayer::create(environment.game());
  const EnvShape& shape = environment.shape();
  std::vector<int32_t> choice(static_cast<std::size_t>(shape.num_agents * shape.head_count));
  Rng rng(RngKey(options.seed).split("gallery"));
  oracle ? oracle->reset(environment, options.seed) : environment.reset(options.seed);
  for (int64_t decision = 0; decision < options.decisions && !environment.last_step().episode_over();
       ++decision) {
    if (oracle) {
      oracle->step(environment);
      continue;
    }
    for (std::size_t place = 0; place < choice.size(); ++place)
      choice[place] = static_cast<int32_t>(rng.below(
          static_cast<uint32_t>(shape.head_sizes[place % static_cast<std::size_t>(shape.head_count)])));
    environment.step(choice);
  }
}

using Views = std::vector<std::vector<uint8_t>>;  ///< each [3, height, width]

/// Writes views in rows of `columns` as one picture, white between them.
Status write_tiles(const std::string& file, const Views& views, int columns, const GalleryOptions& options) {
  const int count = static_cast<int>(views.size());
  columns = std::min(columns, count);
  const int step_x = options.width + kGapPixels, step_y = options.height + kGapPixels;
  const int width = columns * step_x - kGapPixels;
  const int height = (count + columns - 1) / columns * step_y - kGapPixels;
  std::vector<uint8_t> joined(static_cast<std::size_t>(3) * height * width, 255);
  for (int view = 0; view < count; ++view)
    for (int plane = 0; plane < 3; ++plane)
      for (int y = 0; y < options.height; ++y)
        std::copy_n(views[static_cast<std::size_t>(view)].begin() +
                        (static_cast<std::ptrdiff_t>(plane) * options.height + y) * options.width,
                    options.width,
                    joined.begin() +
                        (static_cast<std::ptrdiff_t>(plane) * height + view / columns * step_y + y) * width +
                        view % columns * step_x);
  return doom::write_png(file, joined, width, height);
}

/// What each agent of a scenario sees, and the file that shows it.
struct DrawnRow {
  std::string file;
  Views views;
};

Expected<DrawnRow> draw_row(const std::string& name, const GalleryOptions& options) {
  COMRAD_TRY_ASSIGN(const scenarios::ScenarioSpec spec, scenarios::load_scenario(name));
  const int agents = options.num_agents > 0 ? options.num_agents : spec.default_agents;
  scenarios::LayoutRequest request;
  request.num_agents = agents;
  COMRAD_TRY_ASSIGN(const scenarios::GeneratedLayout layout, scenarios::generate_layout(name, request));
  const std::vector<uint8_t> bytes(layout.wad.begin(), layout.wad.end());
  COMRAD_TRY_ASSIGN(const wad::WadFile wad,
                    wad::WadFile::from_bytes(bytes, layout.file.empty() ? name : layout.file));
  sim::EnvironmentOptions environment_options;
  environment_options.scenario = name;
  environment_options.num_agents = agents;
  COMRAD_TRY_ASSIGN(const auto game, sim::load_doom_game(environment_options, wad));

  // The art of the WAD comes from a file.
  const std::string path = options.folder + "/." + spec.name + ".wad";
  COMRAD_TRY(write_file_atomically(path, layout.wad, /*durable=*/false));
  const auto made = sim::make_renderer(*game, {path}, {options.width, options.height});
  std::error_code ignored;
  std::filesystem::remove(path, ignored);
  if (!made) return made.error();
  const std::unique_ptr<doom::Renderer>& renderer = *made;

  sim::DoomEnvironment environment(game);
  play(options, environment);
  Views views(static_cast<std::size_t>(agents));
  std::vector<doom::ViewRequest> requests;
  for (int agent = 0; agent < agents; ++agent) {
    auto& view = views[static_cast<std::size_t>(agent)];
    view.resize(static_cast<std::size_t>(3) * options.width * options.height);
    requests.push_back({&environment.world(), agent, view.data()});
  }
  renderer->draw(requests);
  const std::string file = options.folder + "/" + spec.name + ".png";
  COMRAD_TRY(write_tiles(file, views, agents, options));
  return DrawnRow{file, std::move(views)};
}

}  // namespace

Expected<std::vector<std::string>> draw_gallery(const GalleryOptions& options) {
  std::error_code failure;
  std::filesystem::create_directories(options.folder, failure);
  if (failure) return Error{ErrorCode::kSystem, options.folder + ": " + failure.message()};
  std::vector<std::string> files;
  Views tiles;
  for (const std::string& name :
       options.scenarios.empty() ? scenarios::list_scenarios() : options.scenarios) {
    COMRAD_TRY_ASSIGN(DrawnRow row, draw_row(name, options));
    files.push_back(std::move(row.file));
    tiles.push_back(std::move(row.views.back()));
  }
  if (tiles.size() > 1) {
    files.push_back(options.folder + "/games.png");
    COMRAD_TRY(write_tiles(files.back(), tiles, kColumns, options));
  }
  return files;
}

}  // namespace comrad::trace
