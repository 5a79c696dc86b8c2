#include "rollout_buffer/settings/resolve.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <string>
#include <vector>

#include "rollout_buffer/core/cores.h"
#include "rollout_buffer/core/cpu_features.h"
#include "rollout_buffer/core/parts.h"
#include "rollout_buffer/core/text.h"
#include "rollout_buffer/settings/applies_when.h"
#include "rollout_buffer/settings/drawn_batch.h"
#include "rollout_buffer/settings/encoder_layers.h"
#include "rollout_buffer/settings/setting.h"

namespace comrad {
namespace {

constexpr int64_t kBatchEnvsOfAuto = 1024;
constexpr int64_t kRemoteSlabs = 32;  // that trajectories of other hosts arrive in, 4 of each host at once

int64_t devices_of_policies(const RunConfig& config) {
  return static_cast<int64_t>(
      std::max<std::size_t>(1, parts_of(config.collection.policy_device, ',').size()));
}

/// `auto` is a GPU where there is a driver.
bool policies_use_gpu(const RunConfig& config) {
  for (int64_t worker = 0; worker < devices_of_policies(config); ++worker) {
    const std::string device = policy_device(config, static_cast<int>(worker));
    if (device.starts_with("cuda") ||
        (device == "auto" && std::filesystem::exists("/proc/driver/nvidia/version")))
      return true;
  }
  return false;
}

/// Processes take turns on a GPU, so one keeps it busy; of two threads one packs while the other waits for its answers.
int64_t policy_workers_on_gpus(const RunConfig& config) {
  return config.collection.policy_processes ? devices_of_policies(config) : 2;
}

/// Settings that Q-learning cannot have together.
Status check_q_combinations(const RunConfig& c) {
  const auto refuse = [](std::string message) { return Error{ErrorCode::kBadInput, std::move(message)}; };
  if (c.run.algo->mixes_q_values() && c.environment.num_agents < 2)
    return refuse("num_agents is 1; " + c.run.algo.name() +
                  " mixes the values of at least 2 agents, use idqn for one");
  if (c.network.use_rnn && c.network.rnn_type != RnnType::kGru)
    return refuse("rnn_type is " + std::string(word_of(c.network.rnn_type)) + "; " + c.run.algo.name() +
                  "'s core is a gru, or --use_rnn=False");
  if (c.network.use_rnn && c.collection.rollout < 2)
    return refuse("rollout is 1; a recurrent core learns from sequences of at least 2 decisions");
  if (c.q_learning.td_lambda >= 0 && !c.network.use_rnn)
    return refuse("td_lambda is " + real_text(c.q_learning.td_lambda) +
                  "; without a recurrent core single decisions are drawn, use --n_step");
  for (const Schedule::Point& point : c.q_learning.n_step.points()) {
    if (point.value > static_cast<double>(c.collection.rollout))
      return refuse(fmt::format("n_step is {}; a trajectory holds rollout {} decisions",
                                c.q_learning.n_step.text(), c.collection.rollout));
    if (point.value != std::floor(point.value))
      return refuse(
          fmt::format("n_step is {}; each of its values must be a whole number", c.q_learning.n_step.text()));
  }
  if (c.q_learning.burn_in > 0 && (!c.network.use_rnn || c.q_learning.burn_in >= c.collection.rollout))
    return refuse(
        fmt::format("burn_in is {}; it needs a recurrent core and must leave some of the rollout's {} "
                    "decisions to learn from",
                    c.q_learning.burn_in, c.collection.rollout));
  if (follows_kl(c.optimisation.lr_schedule))
    return refuse("lr_schedule is " + std::string(word_of(c.optimisation.lr_schedule)) + "; " +
                  c.run.algo.name() +
                  " has no policy whose KL it could follow, use constant or linear_decay");
  return {};
}

/// Settings of maps and curricula that cannot be had together.
Status check_map_combinations(const RunConfig& c) {
  const auto refuse = [](std::string message) { return Error{ErrorCode::kBadInput, std::move(message)}; };
  const EnvironmentSettings& maps = c.environment;
  if (!maps.layout_pool.empty() && !maps.wad.empty())
    return refuse("layout_pool is " + maps.layout_pool +
                  "; leave it out where --wad names the one map to play");
  if (maps.resize == Resize::kNone && maps.render_size != "128x72")
    return refuse(
        "render_size is " + maps.render_size +
        "; it must be 128x72, unless --resize nearest or --resize area brings the view to that size");
  const CurriculumSettings& draws = c.curriculum;
  const std::string curriculum = word_of(draws.curriculum);
  if (draws.curriculum != CurriculumKind::kUniform && maps.layout_pool.empty())
    return refuse("curriculum is " + curriculum +
                  "; it must be used with --layout_pool, the maps that it draws from");
  if (draws.lp_max_return != 0 && draws.lp_max_return <= draws.lp_min_return)
    return refuse("lp_max_return is " + real_text(draws.lp_max_return) +
                  "; it must be greater than lp_min_return (" + real_text(draws.lp_min_return) + ")");
  if (!draws.interestingness_graph_path.empty() && draws.curriculum != CurriculumKind::kOmni)
    return refuse("interestingness_graph_path is " + draws.interestingness_graph_path +
                  "; it must be left out, or used with --curriculum omni");
  if (draws.curriculum == CurriculumKind::kPlr && c.run.algo->learns_q_values())
    return refuse("curriculum is plr; it must be another one with algo " + c.run.algo.name() +
                  ", which estimates no advantages");
  return {};
}

/// Layers are read; a name that is not in the table may be one of policy_workers/network, which reports an error when the network is made.
Status check_encoder(const RunConfig& c) {
  const std::string& encoder = c.network.encoder;
  if (is_encoder_file(encoder)) {
    if (with::join_endpoint.holds(c))
      return Error{ErrorCode::kBadInput,
                   "encoder is " + encoder +
                       " in a run that other hosts join; they do not get the file, so it "
                       "must be a name or layers"};
    return {};
  }
  if (is_encoder_name(encoder)) return {};
  COMRAD_TRY(parse_encoder(encoder));
  return {};
}

/// Settings that exclude each other.
Status check_combinations(const RunConfig& c) {
  const auto refuse = [](std::string message) { return Error{ErrorCode::kBadInput, std::move(message)}; };
  const AlgorithmRow& algo = *c.run.algo;
  const std::string name = c.run.algo.name();
  if (c.optimisation.lr_adaptive_max < c.optimisation.lr_adaptive_min)
    return refuse("lr_adaptive_max is " + real_text(c.optimisation.lr_adaptive_max) +
                  "; it must be at least lr_adaptive_min (" + real_text(c.optimisation.lr_adaptive_min) +
                  ")");
  if (!c.optimisation.learning_rate.is_constant() && c.optimisation.lr_schedule != RateSchedule::kConstant)
    return refuse("learning_rate is " + c.optimisation.learning_rate.text() + " and lr_schedule " +
                  word_of(c.optimisation.lr_schedule) +
                  "; only one of them can move the rate, so lr_schedule must be constant");
  if (!c.mixers.mixer.empty() && c.mixers.mixer != algo.mixer_name)
    return refuse(
        "mixer is " + c.mixers.mixer +
        "; it must be one of vdn, qmix, dmaq, dmaq_qatten with algo qmix or qplex, and left out with algo " +
        name);
  COMRAD_TRY(check_map_combinations(c));
  COMRAD_TRY(check_encoder(c));
  if (with::join_endpoint.holds(c) && (c.collection.deterministic || !c.collection.async_rl))
    return refuse(std::string(c.hosts.link == LinkKind::kDds ? "link is dds"
                              : c.hosts.serve                ? "serve is on"
                                                             : "hosts is " + c.hosts.hosts) +
                  " with " + (c.collection.deterministic ? "deterministic" : "async_rl off") +
                  "; lock step waits for every simulator, so the link is for asynchronous runs alone");
  if (!c.collection.policy_processes && c.collection.learners > 1)
    return refuse(fmt::format(
        "policy_processes is off with {} learners; policy workers are threads of one learner alone, so add "
        "--policy_processes",
        c.collection.learners));
  if (!c.collection.policy_processes && !c.collection.policy_device.empty() &&
      c.collection.policy_device != c.collection.device)
    return refuse("policy_device is " + c.collection.policy_device +
                  " with policy_processes off; threads of the learner work on its device (" +
                  c.collection.device + "), so leave policy_device out or add --policy_processes");
  if (with::join_endpoint.holds(c) && c.curriculum.curriculum != CurriculumKind::kUniform)
    return refuse("curriculum is " + std::string(word_of(c.curriculum.curriculum)) +
                  " in a run that other hosts join; each host draws its maps evenly, so it must be uniform");
  if (c.on_policy.with_vtrace && !algo.learns_q_values() && !algo.can_use_vtrace)
    return refuse("with_vtrace is on; " + name +
                  " estimates advantages with GAE, V-trace works with ippo and mappo");
  if (c.on_policy.with_vtrace && c.optimisation.normalize_returns)
    return refuse(
        "with_vtrace and normalize_returns are both on; V-trace mixes values of different versions, so their "
        "scale must not move: add --normalize_returns=False");
  if (algo.separate_agents && c.network.share_parameters)
    return refuse("share_parameters is on; " + name + " updates one network per agent, so leave it off");
  if (c.network.agent_id_input && !c.network.share_parameters)
    return refuse("agent_id_input is on without share_parameters; its own network needs no agent index");
  if (algo.learns_q_values()) return check_q_combinations(c);
  if (!algo.can_follow_kl && follows_kl(c.optimisation.lr_schedule))
    return refuse("lr_schedule is " + std::string(word_of(c.optimisation.lr_schedule)) + "; " + name +
                  "'s agents are updated one after the other, so it must be constant or linear_decay");
  return {};
}

int64_t automatic_replay_batch(const RunConfig& c) {
  switch (counted_unit(c)) {
    case DrawnBatch::Unit::kSequence:
      return 8;
    case DrawnBatch::Unit::kJointDecision:
      return 32;
    case DrawnBatch::Unit::kDecisionOfOne:
      break;
  }
  return std::min<int64_t>(c.optimisation.batch_size, 256);
}

/// What the settings of Q-learning become once the others are known.
void resolve_q_learning(RunConfig& c) {
  c.mixers.mixer = c.run.algo->mixer_name;
  if (c.network.use_rnn) c.replay.per = c.replay.per && c.replay.per_sequences;
  if (c.q_learning.replay_batch_size == 0) c.q_learning.replay_batch_size = automatic_replay_batch(c);
  if (c.replay.per_beta_env_frames == 0) c.replay.per_beta_env_frames = c.run.train_for_env_frames;
  if (c.q_learning.team_reward == TeamReward::kAuto)
    c.q_learning.team_reward = c.environment.shared_reward_alpha == 1 ? TeamReward::kMean : TeamReward::kSum;
  c.replay.save_replay |= c.collection.deterministic;
}

/// Lock step takes one rollout of every environment and cuts it into batches without a remainder.
Status resolve_deterministic_batches(RunConfig& c) {
  const int64_t slab_rows = c.collection.rollout * c.environment.num_agents,
                env_count = c.collection.num_workers * c.collection.num_envs_per_worker;
  const std::string envs = fmt::format("{} environments (num_workers {} x num_envs_per_worker {})", env_count,
                                       c.collection.num_workers, c.collection.num_envs_per_worker);
  if (env_count % c.optimisation.num_batches_per_epoch != 0)
    return Error{
        ErrorCode::kBadInput,
        fmt::format("deterministic: one rollout of {} cannot be cut into num_batches_per_epoch {} equal "
                    "batches; make num_envs_per_worker a multiple of it, or set --num_batches_per_epoch 1",
                    envs, c.optimisation.num_batches_per_epoch)};
  const int64_t slabs_in_all = env_count / c.optimisation.num_batches_per_epoch;
  const int64_t wanted = std::min(c.optimisation.batch_size / slab_rows, slabs_in_all);
  int64_t slabs = wanted;
  while (slabs_in_all % slabs != 0) --slabs;
  if (2 * slabs < wanted)
    return Error{
        ErrorCode::kBadInput,
        fmt::format("deterministic: batch_size is {}, but one rollout of {} holds {} agent decisions, which "
                    "it does not divide; set --num_workers and --num_envs_per_worker so that their product "
                    "is a multiple of {}, or --batch_size {}",
                    c.optimisation.batch_size, envs, env_count * slab_rows, wanted,
                    slabs_in_all * slab_rows)};
  c.optimisation.batch_size = slabs * slab_rows;
  return {};
}

/// What several learners share is dealt out without a remainder.
Status check_learners(const RunConfig& c) {
  const int64_t learners = c.collection.learners;
  if (learners == 1) return {};
  const auto refuse = [&](const std::string& message) {
    return Error{ErrorCode::kBadInput, fmt::format("learners is {}; {}", learners, message)};
  };
  // What `count` would be next where learners share it without a remainder.
  const auto divided = [learners](int64_t count) { return (count / learners + 1) * learners; };
  const int64_t slab_rows = c.collection.rollout * c.environment.num_agents,
                slabs = c.optimisation.batch_size * c.optimisation.num_batches_per_epoch / slab_rows,
                env_count = c.collection.num_workers * c.collection.num_envs_per_worker;
  const bool draws = c.run.algo->learns_q_values();
  if (draws) {
    const DrawnBatch drawn = drawn_batch(c, c.environment.num_agents);
    if (drawn.units % learners != 0)
      return refuse(fmt::format(
          "an update's {}{} are not divided by it without a remainder; set --replay_batch_size {}",
          drawn.units, (drawn.unit == DrawnBatch::Unit::kSequence ? " sequences" : " decisions"),
          divided(drawn.units) * drawn.setting_value_per_unit));
    if (env_count < learners)
      return refuse(
          fmt::format("each has a replay of the trajectories of some environments, and there are {}; raise "
                      "--num_workers or --num_envs_per_worker, or lower --learners",
                      env_count));
  }
  // Asynchronous Q-learning counts what comes in, and takes it in by single trajectories.
  if (draws && c.collection.async_rl) return {};
  if (slabs % learners != 0)
    return refuse(
        fmt::format("a batch of {} trajectories (batch_size x num_batches_per_epoch / (rollout x "
                    "num_agents)) is not divided by it without a remainder; set --batch_size {}",
                    slabs, divided(slabs) * slab_rows / c.optimisation.num_batches_per_epoch));
  if (!draws && (slabs / learners) % c.optimisation.num_batches_per_epoch != 0)
    return refuse(
        fmt::format("each has {} trajectories of a batch, which num_batches_per_epoch {} does not divide "
                    "without a remainder",
                    slabs / learners, c.optimisation.num_batches_per_epoch));
  if (!c.collection.async_rl && env_count % slabs != 0)
    return refuse(
        fmt::format("lock step cuts the trajectories of {} environments (num_workers x num_envs_per_worker) "
                    "into batches of {}, which must leave no rest",
                    env_count, slabs));
  return {};
}

}  // namespace

Status resolve_settings(RunConfig& config, int core_count) {
  RunConfig c = config;
  COMRAD_TRY(check_limits(c));
  COMRAD_TRY(check_combinations(c));
  if (is_encoder_file(c.network.encoder)) c.network.normalize_input = false;  // a module gets bytes
  if (c.collection.device == "gpu") c.collection.device = "cuda";             // Sample Factory's word
  if (c.collection.precision == Precision::kAuto)
    c.collection.precision = c.collection.device.starts_with("cuda") || cpu_multiplies_bf16()
                                 ? Precision::kBf16
                                 : Precision::kFp32;
  if (c.collection.max_policy_lag == 0)
    c.collection.max_policy_lag = 1000 * c.run.algo->versions_per_batch(c.environment.num_agents);

  const int64_t cores = std::max(core_count, 1);
  if (c.collection.num_workers == 0) c.collection.num_workers = std::min<int64_t>(cores, 1024);
  const bool on_gpu = policies_use_gpu(c);
  // Where few cores do everything, no process waits for another with an idle core: a second split would only make
  // batches smaller and turns on the cores shorter (BENCHMARKS.md).
  const bool one_split = c.collection.worker_num_splits == 0 && cores <= kFewCores && !on_gpu &&
                         c.collection.policy_workers <= 1;
  if (c.collection.worker_num_splits == 0) c.collection.worker_num_splits = one_split ? 1 : 2;
  c.collection.worker_num_splits = std::min(c.collection.worker_num_splits, c.collection.num_envs_per_worker);
  // Two already on two cores: simulators and policy workers leave half a core idle (BENCHMARKS.md).
  if (c.collection.learner_threads == 0)
    c.collection.learner_threads =
        std::max<int64_t>(1, (cores <= 4 ? std::min<int64_t>(cores, 2) : std::min<int64_t>(cores / 2, 16)) /
                                 c.collection.learners);
  const int64_t env_count = c.collection.num_workers * c.collection.num_envs_per_worker;
  const int64_t group_count = c.collection.num_workers * c.collection.worker_num_splits;
  if (c.collection.policy_workers == 0)
    // On 16 cores three made the pipeline 1.3 times as fast as one.
    c.collection.policy_workers = std::min(
        {on_gpu ? policy_workers_on_gpus(c) : std::max<int64_t>(1, cores / 5), group_count, int64_t{64}});
  if (c.collection.policy_workers > group_count)
    return Error{ErrorCode::kBadInput, fmt::format("policy_workers is {}; only {} groups of environments "
                                                   "(num_workers x worker_num_splits) could feed them",
                                                   c.collection.policy_workers, group_count)};

  // A third of the groups of a policy worker make a batch, as in Sample Factory, or all where there is one split; the
  // deadline covers the rest.
  const int64_t group_envs = (c.collection.num_envs_per_worker + c.collection.worker_num_splits - 1) /
                             c.collection.worker_num_splits;
  const int64_t served_envs = (env_count + c.collection.policy_workers - 1) / c.collection.policy_workers;
  if (c.collection.min_batch == 0) {
    const int64_t groups = std::max<int64_t>(1, c.collection.num_workers / c.collection.policy_workers / 3);
    const int64_t most = c.collection.max_batch > 0 ? c.collection.max_batch : kBatchEnvsOfAuto;
    c.collection.min_batch = one_split ? std::min(served_envs, most) : groups * group_envs;
  }
  if (c.collection.max_batch == 0)
    c.collection.max_batch = std::max(c.collection.min_batch, std::min(served_envs, kBatchEnvsOfAuto));
  if (c.collection.max_batch < c.collection.min_batch)
    return Error{ErrorCode::kBadInput, fmt::format("max_batch is {}; it must be at least min_batch ({})",
                                                   c.collection.max_batch, c.collection.min_batch)};

  const int64_t slab_rows = c.collection.rollout * c.environment.num_agents;
  if (c.optimisation.batch_size < slab_rows)
    return Error{ErrorCode::kBadInput, fmt::format("batch_size is {}; it must hold at least one trajectory "
                                                   "of all agents, rollout {} x num_agents {} = {}",
                                                   c.optimisation.batch_size, c.collection.rollout,
                                                   c.environment.num_agents, slab_rows)};
  c.optimisation.batch_size -= c.optimisation.batch_size % slab_rows;
  if (c.optimisation.micro_batch_size > 0)
    c.optimisation.micro_batch_size =
        std::max(c.collection.rollout,
                 c.optimisation.micro_batch_size - c.optimisation.micro_batch_size % c.collection.rollout);
  if (c.collection.deterministic) {
    c.collection.async_rl = false;
    COMRAD_TRY(resolve_deterministic_batches(c));
  }

  if (c.run.algo->learns_q_values()) resolve_q_learning(c);
  COMRAD_TRY(check_learners(c));

  // One slab in the hands of every environment, the batches that wait, one in training, and slack for the
  // moment between sealing and draining. In lock step a rollout is sealed while the next one may not
  // begin yet.
  const int64_t cycle_slabs = c.optimisation.batch_size / slab_rows * c.optimisation.num_batches_per_epoch;
  const int64_t least_slabs = c.collection.deterministic ? env_count : std::max<int64_t>(cycle_slabs, 2);
  if (c.collection.trajectory_slabs == 0) {
    // One in the making per environment, and the batches that may wait. More would only let the data
    // grow older.
    c.collection.trajectory_slabs = c.collection.deterministic
                                        ? 2 * env_count
                                        : env_count + c.collection.num_batches_to_accumulate * cycle_slabs +
                                              (with::join_endpoint.holds(c) ? kRemoteSlabs : 0);
  }
  if (c.collection.trajectory_slabs < least_slabs)
    return Error{ErrorCode::kBadInput,
                 fmt::format("trajectory_slabs is {}; it must be at least {}{}, or 0 for auto",
                             c.collection.trajectory_slabs, least_slabs,
                             (c.collection.deterministic ? ", one per environment" : ", one full batch"))};
  config = std::move(c);
  return {};
}

std::string policy_device(const RunConfig& config, int worker) {
  const std::vector<std::string> named = parts_of(config.collection.policy_device, ',');
  const std::string& device =
      named.empty() ? config.collection.device : named[static_cast<std::size_t>(worker) % named.size()];
  return device == "gpu" ? "cuda" : device;
}

}  // namespace comrad
