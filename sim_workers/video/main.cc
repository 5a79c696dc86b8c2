// comrad-sim-video: a simulator process of an evaluation that records what it plays.

#include <opencv2/core.hpp>

#include "sim_workers/video/video_recorder.h"
#include "sim_workers/worker/sim_program.h"

namespace {

using namespace comrad;

Expected<std::unique_ptr<sim::VideoRecorder>> recorder_of(sim::VideoOptions options, const std::string& size,
                                                          const sim::EnvironmentOptions& environment,
                                                          sim::DoomEnvironmentSet& environments) {
  if (environments.size() != 1)
    return Error{ErrorCode::kBadInput, "a video shows one environment; --num_envs_per_worker must be 1"};
  COMRAD_TRY_ASSIGN(options.size, sim::parse_view_size(size));
  COMRAD_TRY_ASSIGN(std::unique_ptr<sim::VideoRecorder> recorder,
                    sim::VideoRecorder::create(options, environment, environments.at(0).game()));
  environments.at(0).show_to(recorder.get());
  return recorder;
}

}  // namespace

int main(int argc, char** argv) {
  cv::setNumThreads(1);  // a picture is small: handing its parts to threads costs more than they save
  shm::WorkerShell shell({.name = "comrad-sim-video",
                          .role = "sim",
                          .description =
                              "A simulator process of an evaluation that records its one environment; "
                              "comrad eval --save_video and --frames start it."});
  sim::VideoOptions options;
  std::string size = "640x360";
  shell.flags().add("--video", options.video, "video file, .mp4, .mkv or .gif");
  shell.flags().add("--finished_video", options.finished_video, "what it is renamed to once it is whole");
  shell.flags().add("--video_frames", options.frames, "folder for one picture a decision");
  shell.flags().add("--video_size", size, "of one agent's view");
  shell.flags().add("--video_seconds", options.seconds, "of video after which nothing is drawn; 0: no limit");
  std::unique_ptr<sim::VideoRecorder> recorder;
  return sim::run_sim_program(argc, argv, shell,
                              {.prepare = [&](const sim::EnvironmentOptions& environment,
                                              sim::DoomEnvironmentSet& environments) -> Status {
                                 COMRAD_TRY_ASSIGN(recorder,
                                                   recorder_of(options, size, environment, environments));
                                 return {};
                               },
                               .finish = [&] { return recorder->finish(); }});
}
