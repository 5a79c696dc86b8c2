#include <spdlog/fmt/fmt.h>

#include "sim_workers/engine/render/art_archive.h"
#include "sim_workers/env/doom_env.h"

namespace comrad::sim {
namespace {

Error bad_input(std::string message) { return Error{ErrorCode::kBadInput, std::move(message)}; }

doom::RenderOptions render_options(const scenarios::ScenarioSpec& spec, ViewSize size, RendererKind kind) {
  doom::RenderOptions render;
  render.width = size.width;
  render.height = size.height;
  render.renderer = kind;
  render.status_bar = spec.hud;
  render.crosshair = spec.crosshair;
  render.screen_flashes = spec.screen_flashes;
  render.weapon = spec.weapon;
  return render;
}

}  // namespace

Expected<std::unique_ptr<doom::Renderer>> make_renderer(const DoomGame& game,
                                                        const std::vector<std::string>& wads, ViewSize size,
                                                        RendererKind kind) {
  COMRAD_TRY_ASSIGN(auto art, doom::ArtArchive::open(game.spec.iwad, wads));
  COMRAD_TRY_ASSIGN(std::unique_ptr<doom::Renderer> renderer,
                    doom::Renderer::create(art, render_options(game.spec, size, kind)));
  COMRAD_TRY(renderer->prepare(game.level, game.catalog));
  return renderer;
}

Expected<std::unique_ptr<DoomEnvironmentSet>> make_doom_environment_set(const EnvironmentOptions& options) {
  if (options.count < 1 || options.count > 4096)
    return bad_input(fmt::format("num_envs_per_worker is {}; it must lie in 1..4096", options.count));
  COMRAD_TRY_ASSIGN(const ViewSize render_size, parse_view_size(options.render_size));
  const Resize filter = options.resize;
  if (filter == Resize::kNone && render_size != kObservationSize)
    return bad_input("render_size " + options.render_size +
                     " needs resize=nearest or resize=area to become 128x72");
  if (filter != Resize::kNone && !can_resize())
    return Error{ErrorCode::kUnsupported,
                 "this build cannot resize views; draw at 128x72, or use the trainer's simulator"};
  std::shared_ptr<LayoutLibrary> library;
  std::shared_ptr<const DoomGame> game;
  if (options.layouts.empty()) {
    COMRAD_TRY_ASSIGN(game, load_doom_game(options));
  } else {
    COMRAD_TRY_ASSIGN(library, LayoutLibrary::create(options));
    COMRAD_TRY_ASSIGN(game, library->game(0));
  }
  // Layouts of one scenario bring the same pictures; those of a pool's last WAD win.
  COMRAD_TRY_ASSIGN(std::unique_ptr<doom::Renderer> renderer,
                    make_renderer(*game, options.wads(), render_size, options.renderer));
  return std::make_unique<DoomEnvironmentSet>(std::move(game), std::move(renderer), options.count,
                                              render_size, filter, std::move(library));
}

Expected<std::unique_ptr<EnvironmentSet>> make_doom_environments(const EnvironmentOptions& options) {
  COMRAD_TRY_ASSIGN(std::unique_ptr<DoomEnvironmentSet> set, make_doom_environment_set(options));
  return std::unique_ptr<EnvironmentSet>(std::move(set));
}

}  // namespace comrad::sim
