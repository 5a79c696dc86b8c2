// comrad-sim-watch: a simulator process of an evaluation that shows what it plays to `comrad watch` or `comrad play`, or that
// plays recorded episodes again.

#include <algorithm>
#include <cstdio>
#include <cstring>
#include <opencv2/core.hpp>

#include "rollout_buffer/core/flags.h"
#include "rollout_buffer/core/log.h"
#include "rollout_buffer/core/process.h"
#include "rollout_buffer/shm/is_stopping.h"
#include "sim_workers/watch/live_view.h"
#include "sim_workers/watch/recorded_play.h"
#include "sim_workers/worker/sim_program.h"

namespace {

using namespace comrad;

/// What both ways of playing take.
struct ViewFlags {
  std::string page, size = "640x360";
  sim::LiveViewOptions options;

  void add_to(Flags& flags) {
    flags.add("--page", page, "the abstract socket of the program that shows it").required();
    flags.add("--view_size", size, "of one agent's view");
    flags.add("--pictures_per_s", options.pictures_per_s, "at most").range(0.1, 70);
  }
};

Expected<std::unique_ptr<sim::LiveView>> view_of(ViewFlags flags, const sim::EnvironmentOptions& environment,
                                                 const sim::DoomGame& game,
                                                 std::function<bool()> is_stopping) {
  COMRAD_TRY_ASSIGN(flags.options.size, sim::parse_view_size(flags.size));
  COMRAD_TRY_ASSIGN(sim::PageLink link, sim::PageLink::connect(flags.page));
  return sim::LiveView::create(flags.options, environment, game, std::move(link), std::move(is_stopping));
}

/// Plays the folder's episodes round and round, until the page leaves.
Status replay(const std::string& folder, const ViewFlags& flags) {
  COMRAD_TRY_ASSIGN(const std::vector<sim::RecordedEpisode> episodes, sim::read_recorded_episodes(folder));
  const sim::EnvironmentOptions options = sim::options_of(episodes);
  COMRAD_TRY_ASSIGN(const auto library, sim::LayoutLibrary::create(options));
  COMRAD_TRY_ASSIGN(const auto game, library->game(0));
  COMRAD_TRY_ASSIGN(const auto view, view_of(flags, options, *game, [] { return false; }));
  sim::DoomEnvironment environment(game);
  environment.choose_from(library);
  environment.show_to(view.get());
  for (std::size_t at = 0; !view->is_left(); at = (at + 1) % episodes.size()) {
    const sim::RecordedEpisode& episode = episodes[at];
    const auto layout = std::ranges::find(options.layouts, episode.wad) - options.layouts.begin();
    COMRAD_TRY(environment.choose_layout(static_cast<int>(layout)));
    environment.reset(episode.seed);
    const std::size_t per_decision = episode.decisions == 0 ? 0 : episode.choices.size() / episode.decisions;
    for (std::size_t decision = 0;
         decision < episode.decisions && !environment.last_step().episode_over() && !view->is_left();
         ++decision)
      environment.step(std::span(episode.choices).subspan(decision * per_decision, per_decision));
  }
  return {};
}

int replay_program(int argc, char** argv) {
  prepare_process();
  Flags flags("Plays recorded episodes again; comrad watch starts it.", "comrad-sim-watch");
  ViewFlags view;
  std::string folder;
  flags.add("--recorded", folder, "folder of comrad eval --episodes_dir").required();
  view.add_to(flags);
  if (const std::optional<int> code = flags.parse(argc, argv)) return *code;
  if (!init_log("comrad-sim-watch", "")) return kExitFailed;
  const Status done = replay(folder, view);
  if (done) return kExitDone;
  std::fprintf(stderr, "comrad-sim-watch: error: %s\n", done.error().message.c_str());
  return exit_code(done.error());
}

}  // namespace

int main(int argc, char** argv) {
  cv::setNumThreads(1);  // a picture is small: handing its parts to threads costs more than they save
  if (std::any_of(argv, argv + argc,
                  [](const char* word) { return std::strncmp(word, "--recorded", 10) == 0; }))
    return replay_program(argc, argv);
  shm::WorkerShell shell({.name = "comrad-sim-watch",
                          .role = "sim",
                          .description =
                              "A simulator process of an evaluation that shows its one environment to a "
                              "page; comrad watch and comrad play start it."});
  ViewFlags flags;
  flags.add_to(shell.flags());
  shell.flags().add("--people", flags.options.people, "agents that people play").separated_by(',');
  std::unique_ptr<sim::LiveView> view;
  const shm::Arena* arena = nullptr;
  return sim::run_sim_program(
      argc, argv, shell,
      {.prepare = [&](const sim::EnvironmentOptions& environment,
                      sim::DoomEnvironmentSet& environments) -> Status {
         if (environments.size() != 1)
           return Error{ErrorCode::kBadInput,
                        "a page shows one environment; --num_envs_per_worker must be 1"};
         COMRAD_TRY_ASSIGN(view, view_of(flags, environment, environments.at(0).game(), [&] {
                             return arena != nullptr && shm::is_stopping(shell.stop(), *arena);
                           }));
         environments.at(0).show_to(view.get());
         return {};
       },
       .wrap =
           [&](std::unique_ptr<sim::EnvironmentSet> environments, const shm::Arena& joined) {
             arena = &joined;
             return sim::shown_environments(std::move(environments), joined, *view);
           }});
}
