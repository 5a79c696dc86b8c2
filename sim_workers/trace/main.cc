// comrad-trace FILE.cfg|SCENARIO: plays one player's buttons and writes what came of it, tic by tic, in the
// columns of the reference traces. For comparing this engine with another.
#include <CLI/CLI.hpp>
#include <cstdio>
#include <string>
#include <string_view>
#include <vector>

#include "rollout_buffer/core/log.h"
#include "rollout_buffer/core/process.h"
#include "scenarios/tools/gallery_flags.h"
#include "sim_workers/env/observation.h"
#include "sim_workers/trace/gallery.h"
#include "sim_workers/trace/trace_run.h"

namespace comrad {
namespace {

int report(const Error& error) {
  std::fprintf(stderr, "comrad trace: error: %s\n", error.message.c_str());
  return exit_code(error);
}

/// comrad-trace --gallery DIR [SCENARIO...]: what `comrad scenarios --gallery` runs.
int run_gallery(int argc, char** argv) {
  scenarios::GalleryFlags flags;
  CLI::App app("Draws what the agents of each scenario see, side by side, one PNG for each scenario.",
               "comrad scenarios");
  scenarios::add_gallery_flags(app, flags);
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : 2;
  }
  if (flags.folder.empty())
    return report({ErrorCode::kBadInput, "--gallery needs a folder for the pictures: --gallery DIR"});
  const Expected<sim::ViewSize> view = sim::parse_view_size(flags.size);
  if (!view) return report(view.error());
  const trace::GalleryOptions options{.folder = flags.folder,
                                      .scenarios = flags.scenarios,
                                      .num_agents = flags.num_agents,
                                      .decisions = flags.decisions,
                                      .width = view->width,
                                      .height = view->height,
                                      .seed = flags.seed};
  const Expected<std::vector<std::string>> files = trace::draw_gallery(options);
  if (!files) return report(files.error());
  for (const std::string& file : *files) std::printf("%s\n", file.c_str());
  return 0;
}

int run(int argc, char** argv) {
  trace::RunOptions options;
  uint64_t seed = 0;
  std::string size = "160x120";
  CLI::App app(
      "Plays one player's buttons, tic by tic, and writes a CSV of the state after each. The exit code is 0 "
      "when "
      "the actions or the episode came to their end.",
      "comrad trace");
  app.add_option("game", options.game.target, "FILE.cfg of ViZDoom's kind, or a scenario")->required();
  app.add_option("--wad", options.game.wad_path,
                 "WAD to play instead of the cfg's; a scenario's layout (without: drawn with --layout_seed)");
  app.add_option("--layout_seed", options.game.layout_seed, "layout of a scenario without --wad")
      ->capture_default_str();
  auto* actions =
      app.add_option("--actions", options.actions_path,
                     "CSV with a row per tic: columns fwd, back, left, right, turnl, turnr, attack, speed, "
                     "use, jump, crouch, turn180, dyaw, dpitch, dfwd, dside, ViZDoom's names of buttons; "
                     "or another trace");
  app.add_option("--random", options.random_tics,
                 "so many tics of random actions with the game's own buttons")
      ->check(CLI::Range(int64_t{1}, int64_t{1'000'000'000}))
      ->excludes(actions);
  app.add_option("--start-from,--start_from", options.start_path,
                 "trace whose row 0 is the pose to start in");
  auto* seed_option = app.add_option("--seed", seed, "seed of the episode; default: the cfg's, else 42");
  app.add_flag("--no-monsters,--no_monsters", options.game.no_monsters,
               "nothing that counts as a monster appears");
  app.add_flag("--no-timeout,--no_timeout", options.game.no_timeout,
               "the cfg's episode_timeout does not end the episode");
  app.add_option("--out", options.out_path, "CSV file to write; default: standard output");
  app.add_option("--things", options.things_path,
                 "CSV file with every actor after each tic: t, id, name, x, y, z, angle, vx, vy, vz");
  app.add_option("--variables", options.variables,
                 "further columns: ViZDoom's names of game variables, for example ITEMCOUNT,USER1")
      ->delimiter(',');
  app.add_flag("--hash", options.with_hash, "a last column with the hash of the whole world");
  auto* frames =
      app.add_option("--frames", options.frames_folder, "folder for PNG pictures of the tics of --at");
  auto* at = app.add_option("--at", options.frame_tics, "tics to draw, for example 0,1,35")
                 ->delimiter(',')
                 ->check(CLI::NonNegativeNumber)
                 ->needs(frames);
  frames->needs(at);
  app.add_option("--size", size, "size of the pictures")->capture_default_str();
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : 2;
  }
  if (seed_option->count() > 0) options.seed = seed;
  const Expected<sim::ViewSize> view = sim::parse_view_size(size);
  if (!view) return report(view.error());
  options.frame_width = view->width, options.frame_height = view->height;
  const Status done = trace::run_trace(options);
  return done ? 0 : report(done.error());
}

}  // namespace
}  // namespace comrad

int main(int argc, char** argv) {
  comrad::prepare_process();
  (void)comrad::init_log("trace", "");  // to stderr, which cannot fail: a trace may go to stdout
  spdlog::set_pattern("comrad trace: %l: %v");
  spdlog::set_level(spdlog::level::warn);
  try {
    for (int i = 1; i < argc; ++i)
      if (const std::string_view word = argv[i]; word == "--gallery" || word.starts_with("--gallery="))
        return comrad::run_gallery(argc, argv);
    return comrad::run(argc, argv);
  } catch (const std::exception& failure) {  // from libraries; ours do not throw
    std::fprintf(stderr, "comrad trace: error: %s\n", failure.what());
    return 1;
  }
}
