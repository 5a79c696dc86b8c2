#include "sim_workers/trace/trace_game.h"

#include <spdlog/fmt/fmt.h>

#include <limits>
#include <optional>

#include "rollout_buffer/core/config_file_name.h"
#include "scenarios/spec/registry.h"
#include "scenarios/spec/vizdoom_scenario.h"
#include "sim_workers/engine/play/placement.h"

namespace comrad::trace {
namespace {

/// The game of `spec`, without monsters where they are not wanted.
Expected<std::unique_ptr<TraceGame>> open_game(const GameOptions& options, int num_agents,
                                               const scenarios::ScenarioSpec& spec, const wad::WadFile& wad) {
  const sim::EnvironmentOptions environment{
      .scenario = options.target, .wad_path = {}, .num_agents = num_agents, .frame_skip = 1};
  COMRAD_TRY_ASSIGN(const auto loaded, sim::load_doom_game(environment, spec, wad));
  auto game = std::make_shared<sim::DoomGame>(*loaded);
  game->no_monsters = options.no_monsters;
  return std::make_unique<TraceGame>(std::move(game));
}

Expected<std::unique_ptr<TraceGame>> open_cfg(const GameOptions& options) {
  COMRAD_TRY_ASSIGN(scenarios::VizdoomConfig config, scenarios::load_vizdoom_config(options.target));
  const std::vector<std::string> names = std::move(config.button_names);
  config.button_names = {
      "ATTACK"};  // heads are not played: any button may be pressed, and more than heads hold
  if (!options.wad_path.empty()) {
    if (const auto opened = wad::WadFile::open(options.wad_path); !opened) return opened.error();
    config.scenario_path = options.wad_path;
  }
  if (options.no_timeout || config.timeout_tics == 0) config.timeout_tics = std::numeric_limits<int>::max();
  COMRAD_TRY_ASSIGN(const scenarios::ScenarioSpec spec, scenarios::vizdoom_scenario(config));
  const std::string path = spec.folder + "/" + spec.wad;
  COMRAD_TRY_ASSIGN(const wad::WadFile wad, wad::WadFile::open(path));
  COMRAD_TRY_ASSIGN(auto trace, open_game(options, 1, spec, wad));
  trace->title = fmt::format("{} {} skill {}", config.path, trace->world().level().name, config.rules.skill);
  trace->buttons = config.buttons, trace->button_names = names;
  if (config.seed) trace->default_seed = *config.seed;
  if (!config.scenario_path.empty()) trace->art_paths.push_back(path);
  return trace;
}

Expected<std::unique_ptr<TraceGame>> open_scenario(const GameOptions& options) {
  COMRAD_TRY_ASSIGN(const scenarios::ScenarioSpec spec, scenarios::load_scenario(options.target));
  std::optional<wad::WadFile> wad;
  if (!options.wad_path.empty()) {
    COMRAD_TRY_ASSIGN(wad, wad::WadFile::open(options.wad_path));
  } else {
    scenarios::LayoutRequest request;
    request.seed = options.layout_seed;
    request.num_agents = spec.default_agents;
    COMRAD_TRY_ASSIGN(const scenarios::GeneratedLayout layout,
                      scenarios::generate_layout(options.target, request));
    COMRAD_TRY_ASSIGN(wad, wad::WadFile::from_bytes(
                               std::vector<uint8_t>(layout.wad.begin(), layout.wad.end()),
                               layout.file.empty() ? fmt::format("{} layout {}", options.target, request.seed)
                                                   : layout.file));
  }
  COMRAD_TRY_ASSIGN(auto trace, open_game(options, spec.default_agents, spec, *wad));
  trace->title = fmt::format("{} {}, {} agents, the first one's", spec.name, trace->world().level().name,
                             spec.default_agents);
  for (const scenarios::ActionHead& head : spec.heads)
    for (const std::string& name : head.buttons) {
      trace->buttons.push_back(scenarios::find_button(name).value());
      trace->button_names.push_back(name);
    }
  if (!options.wad_path.empty()) trace->art_paths.push_back(options.wad_path);
  return trace;
}

}  // namespace

TraceGame::TraceGame(std::shared_ptr<const sim::DoomGame> game)
    : environment_(game), pressed_(static_cast<std::size_t>(game->num_agents)) {
  const scenarios::ScenarioSpec& spec = game->spec;
  iwad_path = spec.iwad;
  render.status_bar = spec.hud;
  render.crosshair = spec.crosshair;
  render.screen_flashes = spec.screen_flashes;
  render.weapon = spec.weapon;
  warnings = spec.warnings;
}

double TraceGame::step(const doom::Buttons& buttons_held) {
  pressed_[0] = buttons_held;
  environment_.press(pressed_);
  return environment_.exact_reward()[0];
}

double TraceGame::variable(const scenarios::GameVariable& which) const {
  if (environment_.game().spec.is_vizdoom && which.kind == scenarios::VariableKind::kHealth)
    return environment_.world().body(0).health;
  return environment_.read(0, which);
}

Expected<std::unique_ptr<TraceGame>> open_trace_game(const GameOptions& options) {
  return names_vizdoom_config(options.target) ? open_cfg(options) : open_scenario(options);
}

void set_pose(doom::World& world, const Pose& pose) {
  doom::Actor* const body = world.body_of(0);
  if (body == nullptr) return;
  set_position(world, body->id, pose.x, pose.y, pose.z);
  world.set_angle(body->id, pose.angle);
  body->pitch = pose.pitch;
  body->velocity_x = pose.velocity_x;
  body->velocity_y = pose.velocity_y;
  body->velocity_z = pose.velocity_z;
}

}  // namespace comrad::trace
