// What a user asks to be filmed, checked before anything starts.
#pragma once

#include <string>

#include "deploy/launch/launch_plan.h"
#include "rollout_buffer/core/expected.h"

namespace comrad::deploy {

/// As typed; empty where it was not.
struct FilmRequest {
  std::string video = {}, frames = {}, size = {};
};

/// The films to make, with absolute paths: a video's name ends in .mp4 or .mkv and its folder is there and may be written
/// to; a folder of pictures is new or empty; the size lies between 128x72 and 1920x1080, 640x360 where none was typed.
/// Errors: kBadInput, naming the flag.
Expected<FilmPlan> check_films(const FilmRequest& request);

}  // namespace comrad::deploy
