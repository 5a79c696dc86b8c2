// The arguments of `comrad eval`, as typed.
#pragma once

#include <string>
#include <vector>

#include "deploy/evaluation/video_request.h"

namespace comrad::deploy {

struct EvaluationRequest {
  std::vector<std::string> policies = {};  ///< players that play whole teams, or the seats that are not named
  std::vector<std::string> seats = {};     ///< "AGENT=PLAYER"
  std::vector<std::string> cross_play = {};  ///< players that meet each other
  double episodes = 100;
  std::string maps = {};        ///< "train", "held_out", or empty: what the run's kind of maps requests
  std::string checkpoint = {};  ///< of the one policy; empty: that which --load_checkpoint_kind names
  bool greedy = true;
  bool stochastic = false;
  bool json = false, csv = false;
  bool each = false;  ///< report every episode, too
  bool background = false;
  VideoRequest videos = {};
  std::string positions = {}, episodes_file = {};  ///< files to write; empty: none
  std::string episodes_dir = {};                   ///< folder of episodes that play again; empty: none
  std::string recorded = {};                       ///< folder of recorded episodes to score; empty: none
  std::string page = {},
              page_size = "640x360";  ///< socket that shows what is played, of which size; empty: none
  double pictures_per_s = 17.5;       ///< there, at most
};

}  // namespace comrad::deploy
