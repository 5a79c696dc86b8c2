// oracle_play SCENARIO [EPISODES [LAYOUTS [AGENTS [FIRST_SEED [NAME=VALUE...]]]]]: plays a scenario's scripted
// team without pipeline or pictures, on layouts of as many seeds (from 1000000 on) with those parameters, and
// prints each episode's score, then their mean with its 95 % interval. A tool for whoever writes an oracle.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <string>

#include "scenarios/spec/registry.h"
#include "scenarios/spec/scenario_spec.h"
#include "sim_workers/oracle/oracle.h"

using namespace comrad;

int main(int argc, char** argv) {
  if (argc < 2)
    return std::fprintf(
               stderr,
               "usage: oracle_play SCENARIO [EPISODES [LAYOUTS [AGENTS [FIRST_SEED [NAME=VALUE...]]]]]\n"),
           2;
  const std::string scenario = argv[1];
  const int episodes = argc > 2 ? std::atoi(argv[2]) : 5, layouts = argc > 3 ? std::atoi(argv[3]) : 1;
  const auto spec = scenarios::load_scenario(scenario);
  if (!spec) return std::fprintf(stderr, "%s\n", spec.error().message.c_str()), 1;
  const int agents = argc > 4 ? std::atoi(argv[4]) : spec->default_agents;
  const uint64_t first_seed = argc > 5 ? std::strtoull(argv[5], nullptr, 10) : 1'000'000;
  double sum = 0, squares = 0;
  for (int episode = 0; episode < episodes; ++episode) {
    scenarios::LayoutRequest request;
    request.seed = layouts > 1 ? first_seed + static_cast<uint64_t>(episode % layouts) : 42;
    request.num_agents = agents;
    for (int i = 6; i < argc; ++i) {
      const std::string setting = argv[i];
      const std::size_t equals = std::min(setting.find('='), setting.size() - 1);
      request.parameters.emplace_back(setting.substr(0, equals), setting.substr(equals + 1));
    }
    const auto layout = scenarios::generate_layout(scenario, request);
    if (!layout) return std::fprintf(stderr, "%s\n", layout.error().message.c_str()), 1;
    const auto wad = wad::WadFile::from_bytes({layout->wad.begin(), layout->wad.end()}, scenario);
    if (!wad) return std::fprintf(stderr, "%s\n", wad.error().message.c_str()), 1;
    sim::EnvironmentOptions options;
    options.scenario = scenario;
    options.num_agents = agents;
    const auto game = sim::load_doom_game(options, *wad);
    if (!game) return std::fprintf(stderr, "%s\n", game.error().message.c_str()), 1;
    const auto summary = sim::play_oracle_episode(*game, static_cast<uint64_t>(episode));
    if (!summary) return std::fprintf(stderr, "%s\n", summary.error().message.c_str()), 1;
    std::printf("episode %d layout %llu: J %.3f, %u tics, return %.2f\n", episode,
                static_cast<unsigned long long>(request.seed), summary->score, summary->length_tics,
                summary->agent_return.at(0));
    std::fflush(stdout);
    sum += summary->score, squares += double{summary->score} * summary->score;
  }
  const double mean = sum / episodes, spread = std::sqrt(std::max(0.0, squares / episodes - mean * mean));
  std::printf("mean J %.3f +- %.3f of %d episodes (ceiling %.3f)\n", mean,
              episodes > 1 ? 1.96 * spread / std::sqrt(episodes - 1) : 0.0, episodes, spec->ceiling);
  return 0;
}
