// The page of `comrad watch` and `comrad play`: access, what each browser sees, and its commands. The game is played
// by a Session's processes; nothing here can change a run.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "rollout_buffer/core/expected.h"

namespace comrad::deploy {

/// What a watching person may choose; empty words are the run's or the scenario's own.
struct PageChoice {
  int policy = 0;  ///< index in LivePageOptions::policies
  std::string seed, layout_seed;
};

/// A program and its arguments.
struct PageProgram {
  std::string path;
  std::vector<std::string> arguments;
};

struct LivePageOptions {
  std::string command;                ///< "watch" or "play", for messages
  std::string address = "127.0.0.1";  ///< to listen on
  int port = 0;                       ///< 0: any
  std::string token = {};             ///< empty: one is made. With several seats each has a separate token
  std::vector<int> seats = {};        ///< agents that people play, a page each; none: all pages watch
  std::vector<std::string> policies = {};  ///< that can be chosen
  std::string run_dir = {};                ///< whose curves are shown; empty: none
  std::string saved = {};                  ///< where episodes are kept, for the page; empty: nowhere
  bool reloads = false;                    ///< the newest checkpoint of run_dir, when there is a newer one
  bool opens_browser = true;               ///< where there is a display
  std::function<PageProgram(const PageChoice&)> program = nullptr;
};

/// Serves until SIGINT, SIGTERM or SIGHUP. The addresses of the pages go to standard output. Errors: those of
/// HttpServer::open(); the first game's, where it cannot be played.
Status serve_live_page(const LivePageOptions& options);

/// The page itself: HTML with its style and script.
extern const char* const kLivePageHtml;

}  // namespace comrad::deploy
