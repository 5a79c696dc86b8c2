#include "sim_workers/worker/bench.h"

#include <cstddef>
#include <vector>

#include "rollout_buffer/core/bench_windows.h"
#include "rollout_buffer/core/check.h"
#include "rollout_buffer/core/clock.h"
#include "rollout_buffer/core/rng.h"
#include "rollout_buffer/schema/trajectory.h"

namespace comrad::sim {
namespace {

/// Slabs begin on pages in a run.
struct alignas(4096) Page {
  std::byte bytes[4096];
};

}  // namespace

BenchResult run_bench(EnvironmentSet& environments, const BenchOptions& options) {
  const EnvShape env_shape = environments.at(0).shape();
  const int count = environments.size();
  const std::size_t agents = static_cast<std::size_t>(env_shape.num_agents);
  const std::size_t heads = static_cast<std::size_t>(env_shape.head_count);
  // One slab per environment, as in a run, so that the memory traffic of rendering is a run's.
  const SlabOffsets offsets(
      {.env = env_shape, .rollout_steps = options.rollout_steps, .recurrent_state_count = 0});
  std::vector<Page> memory(static_cast<std::size_t>(offsets.slab_bytes) / sizeof(Page) *
                           static_cast<std::size_t>(count));
  const auto slab_of = [&](int index) {
    return SlabView(offsets, reinterpret_cast<std::byte*>(memory.data()) + index * offsets.slab_bytes);
  };
  const auto target_of = [&](int index, int step, bool is_final) -> ObservationTarget {
    const SlabView slab = slab_of(index);
    return {.frame = is_final ? slab.final_frame(0, 0).data() : slab.frame(step, 0).data(),
            .measurement = env_shape.measurement_count > 0 ? slab.measurement(step, 0).data() : nullptr,
            .action_mask = slab.action_mask(step, 0).data(),
            .agent_active = &slab.agent_active(step, 0),
            .global_state = env_shape.global_state_count == 0 ? nullptr
                            : is_final                        ? slab.final_global_state(0).data()
                                                              : slab.global_state(step).data()};
  };

  const RngKey run(options.seed);
  Rng actions(run.split("bench"));
  std::vector<uint64_t> episode(static_cast<std::size_t>(count), 0);
  const auto reset = [&](int index) {
    const uint64_t number = episode[static_cast<std::size_t>(index)]++;
    if (options.layout_count > 0) {
      const uint64_t chosen =
          (static_cast<uint64_t>(index) + number) % static_cast<uint64_t>(options.layout_count);
      COMRAD_CHECK(environments.at(index).choose_layout(static_cast<int>(chosen)), "the pool's layouts load");
    }
    environments.at(index).reset(
        run.split("episode").split(static_cast<uint64_t>(index)).split(number).bits());
  };
  for (int index = 0; index < count; ++index) reset(index);

  std::vector<int32_t> action(agents * heads);
  std::vector<int> indices;
  std::vector<ObservationTarget> targets;
  const bool draws = options.part != BenchPart::kEngine;
  BenchResult result;
  BenchWindows windows(options.seconds);
  double drawing_s = 0;
  int row = 0;
  bool is_counting = false;
  Stopwatch clock(CLOCK_PROCESS_CPUTIME_ID);
  const auto play = [&](int first, int last) {
    for (int index = first; index < last; ++index) {
      Environment& environment = environments.at(index);
      for (std::size_t choice = 0; choice < action.size(); ++choice)
        action[choice] =
            static_cast<int32_t>(actions.below(static_cast<uint32_t>(env_shape.head_sizes[choice % heads])));
      environment.step(action);
      shape_rewards(environment.last_step().reward, options.rewards,
                    {&slab_of(index).reward(row, 0), agents});
      if (!environment.last_step().episode_over()) continue;
      const ObservationTarget final_target = target_of(index, row + 1, true);
      if (draws) environments.observe({&index, 1}, {&final_target, 1});
      reset(index);
      ++result.episodes;
    }
  };
  const auto draw = [&](int first, int last) {
    indices.clear();
    targets.clear();
    for (int index = first; index < last; ++index) {
      indices.push_back(index);
      targets.push_back(target_of(index, row + 1, false));
    }
    environments.observe(indices, targets);
  };
  for (;;) {
    for (int split = 0; split < options.splits; ++split) {
      const int first = count * split / options.splits, last = count * (split + 1) / options.splits;
      const Stopwatch playing;
      play(first, last);
      result.tic_cpu_seconds += playing.cpu_elapsed();
      if (draws) {
        const Stopwatch drawing;
        draw(first, last);
        result.render_cpu_seconds += drawing.cpu_elapsed();
        drawing_s += drawing.elapsed();
      }
      result.decisions += static_cast<uint64_t>(last - first) * agents;
    }
    row = (row + 1) % options.rollout_steps;
    if (!is_counting) {
      if (clock.elapsed() < options.warmup_seconds) continue;
      is_counting = true;
      result = {};
      drawing_s = 0;
      clock = Stopwatch(CLOCK_PROCESS_CPUTIME_ID);
      continue;
    }
    result.seconds = options.part == BenchPart::kRender ? drawing_s : clock.elapsed();
    if (!windows.see(static_cast<double>(result.decisions), result.seconds)) continue;
    result.cpu_seconds = clock.cpu_elapsed();
    result.windows = windows.rates();
    return result;
  }
}

}  // namespace comrad::sim
