#include "sim_workers/trace/trace_game.h"

#include "rollout_buffer/core/config_file_name.h"
#include "scenarios/spec/registry.h"
#include "scenarios/spec/vizdoom_config.h"
#include "sim_workers/engine/play/placement.h"
#include "sim_workers/env/doom_env.h"
#include "sim_workers/env/game_variables.h"
#include "sim_workers/env/vizdoom_game.h"

namespace comrad::trace {
namespace {

class VizdoomTrace final : public TraceGame {
 public:
  explicit VizdoomTrace(std::shared_ptr<const sim::VizdoomGame> game) : episode_(std::move(game)) {
    const scenarios::VizdoomConfig& config = episode_.game().config;
    title = config.path + " " + episode_.game().content.level->name + " skill " +
            std::to_string(config.rules.skill);
    buttons = config.buttons, button_names = config.button_names;
    if (config.seed) default_seed = *config.seed;
    iwad_path = episode_.game().iwad_path;
    art_paths = episode_.game().art_paths;
    render.status_bar = config.hud;
    render.weapon = config.weapon;
    render.crosshair = config.crosshair;
    render.screen_flashes = config.screen_flashes;
    warnings = episode_.game().content.warnings;
    warnings.insert(warnings.end(), config.buffer_warnings.begin(), config.buffer_warnings.end());
  }
  void reset(uint64_t seed) override { episode_.reset(seed); }
  double step(const doom::Buttons& pressed) override { return episode_.step(pressed); }
  bool finished() const override { return episode_.finished(); }
  doom::World& world() override { return episode_.world(); }
  double variable(const scenarios::GameVariable& which) const override { return episode_.variable(which); }

 private:
  sim::VizdoomEpisode episode_;
};

/// The first agent of a scenario; the others stand still.
class ScenarioTrace final : public TraceGame {
 public:
  explicit ScenarioTrace(std::shared_ptr<const sim::DoomGame> game)
      : environment_(game), pressed_(static_cast<std::size_t>(game->num_agents)) {
    const scenarios::ScenarioSpec& spec = game->spec;
    title = spec.name + " " + game->level->name + ", " + std::to_string(game->num_agents) +
            " agents, the first one's";
    for (const scenarios::ActionHead& head : spec.heads)
      for (const std::string& name : head.buttons) {
        buttons.push_back(scenarios::find_button(name).value());
        button_names.push_back(name);
      }
    render.status_bar = spec.hud;
    render.crosshair = spec.crosshair;
    render.screen_flashes = spec.screen_flashes;
    render.weapon = spec.weapon;
  }
  void reset(uint64_t seed) override { environment_.reset(seed); }
  double step(const doom::Buttons& pressed) override {
    pressed_[0] = pressed;
    environment_.press(pressed_);
    return environment_.last_step().reward[0];
  }
  bool finished() const override { return environment_.last_step().episode_over(); }
  doom::World& world() override { return environment_.world(); }
  double variable(const scenarios::GameVariable& which) const override {
    return sim::read_variable(environment_.world(), 0, which);
  }

 private:
  sim::DoomEnvironment environment_;
  std::vector<doom::Buttons> pressed_;
};

Expected<std::unique_ptr<TraceGame>> open_scenario(const GameOptions& options) {
  COMRAD_TRY_ASSIGN(const scenarios::ScenarioSpec spec, scenarios::load_scenario(options.target));
  sim::EnvironmentOptions environment;
  environment.scenario = options.target;
  environment.num_agents = spec.default_agents;
  environment.frame_skip = 1;
  std::optional<wad::WadFile> wad;
  if (!options.wad_path.empty()) {
    COMRAD_TRY_ASSIGN(wad, wad::WadFile::open(options.wad_path));
  } else {
    scenarios::LayoutRequest request;
    request.seed = options.layout_seed;
    request.num_agents = spec.default_agents;
    COMRAD_TRY_ASSIGN(const scenarios::GeneratedLayout layout,
                      scenarios::generate_layout(options.target, request));
    COMRAD_TRY_ASSIGN(
        wad,
        wad::WadFile::from_bytes(
            std::vector<uint8_t>(layout.wad.begin(), layout.wad.end()),
            layout.file.empty() ? options.target + " layout " + std::to_string(request.seed) : layout.file));
  }
  COMRAD_TRY_ASSIGN(const auto loaded, sim::load_doom_game(environment, *wad));
  auto game = std::make_shared<sim::DoomGame>(*loaded);
  game->no_monsters = options.no_monsters;
  std::unique_ptr<TraceGame> trace = std::make_unique<ScenarioTrace>(std::move(game));
  if (!options.wad_path.empty()) trace->art_paths.push_back(options.wad_path);
  return trace;
}

}  // namespace

Expected<std::unique_ptr<TraceGame>> open_trace_game(const GameOptions& options) {
  if (!names_vizdoom_config(options.target)) return open_scenario(options);
  COMRAD_TRY_ASSIGN(scenarios::VizdoomConfig config, scenarios::load_vizdoom_config(options.target));
  if (options.no_monsters) config.rules.no_monsters = true;
  if (options.no_timeout) config.timeout_tics = 0;
  COMRAD_TRY_ASSIGN(auto game, sim::load_vizdoom_game(std::move(config), options.wad_path));
  std::unique_ptr<TraceGame> trace = std::make_unique<VizdoomTrace>(std::move(game));
  return trace;
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
