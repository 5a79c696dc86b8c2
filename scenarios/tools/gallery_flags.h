// The flags of `comrad scenarios --gallery`, read by comrad-scenarios, whose help shows them, and by comrad-trace, which has
// the engine and draws.
#pragma once

#include <CLI/CLI.hpp>

#include <cstdint>
#include <string>
#include <vector>

namespace comrad::scenarios {

struct GalleryFlags {
  std::string folder;                  ///< receives <scenario>.png
  std::vector<std::string> scenarios;  ///< names; empty: all
  int num_agents = 0;                  ///< 0: each scenario's own
  int64_t decisions = 100;
  std::string size = "256x144";  ///< of one view: twice an observation's
  uint64_t seed = 42;
};

/// Adds --gallery and what belongs to it. A --gallery without a folder leaves `folder` empty, so that a flag behind it is
/// not taken for one; the returned option has been seen then.
inline CLI::Option* add_gallery_flags(CLI::App& app, GalleryFlags& flags) {
  CLI::Option* gallery =
      app.add_option(
             "--gallery", flags.folder,
             "draw what the agents of each scenario see into this folder, a PNG each, and one of all of them")
          ->expected(0, 1)
          ->type_name("DIR");
  app.add_option("scenarios", flags.scenarios, "with --gallery: the scenarios to draw; default: all");
  app.add_option("--num_agents", flags.num_agents, "with --gallery: default: the scenario's own")
      ->check(CLI::Range(1, 8))
      ->needs(gallery);
  app.add_option("--decisions", flags.decisions, "with --gallery: played before the picture is taken")
      ->check(CLI::Range(int64_t{0}, int64_t{1'000'000}))
      ->capture_default_str()
      ->needs(gallery);
  app.add_option("--size", flags.size, "with --gallery: of one view")->capture_default_str()->needs(gallery);
  app.add_option("--seed", flags.seed, "with --gallery: of the episode")
      ->capture_default_str()
      ->needs(gallery);
  return gallery;
}

}  // namespace comrad::scenarios
