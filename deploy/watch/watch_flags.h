// The flags that `comrad watch` and `comrad play` share, and how they start `comrad eval`.
#pragma once

#include <string>
#include <vector>

#include "deploy/settings/command_line.h"
#include "deploy/watch/live_page.h"
#include "rollout_buffer/core/expected.h"

namespace comrad::deploy {

/// As typed.
struct PageFlags {
  double port = 0;
  std::string interface = "127.0.0.1", token = {}, size = "640x360";
  bool no_browser = false;

  void add_to(CommandLine& line);
  /// Puts them into `options`. Errors: kBadInput naming the flag.
  Status check(LivePageOptions& options) const;
};

/// The settings among the arguments as `comrad eval` takes them: "--name=value".
std::vector<std::string> settings_arguments(const CommandLine& line);

}  // namespace comrad::deploy
