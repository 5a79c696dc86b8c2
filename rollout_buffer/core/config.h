// Every setting of a run, once: name, default, help and old names stand in one table (visit_settings), from
// which the command line, the TOML files and config.toml in the run directory are all made. The launcher
// merges the layers and writes the result; every worker reads that file and nothing else.
#pragma once

#include <cstdint>
#include <initializer_list>
#include <string>
#include <string_view>
#include <vector>

#include "rollout_buffer/core/expected.h"

namespace comrad {

/// The merged settings of one run. Defaults here are the built-in layer; 0 means "auto" where the help says
/// so.
struct RunConfig {
  // What to train.
  std::string scenario = "coop_health_gathering";
  std::string algo = "ippo";
  std::string preset = "small";
  std::string experiment;
  std::string train_dir = "train_dir";
  std::string restart_behavior = "resume";
  int64_t seed = 42;
  int64_t num_agents = 0;
  int64_t layout_seed = 42;
  std::string wad;
  std::string layout_pool;
  int64_t layout_swap_every = 5;
  double train_for_env_steps = 1e8;
  double train_for_seconds = 0;

  // Processes.
  std::string device = "auto";
  int64_t num_workers = 0;
  int64_t num_envs_per_worker = 16;
  int64_t worker_num_splits = 2;
  int64_t policy_workers = 1;
  bool async_rl = true;
  bool deterministic = false;
  int64_t min_batch = 0;
  int64_t max_batch = 0;
  int64_t max_wait_us = 2000;
  int64_t trajectory_slabs = 0;
  int64_t learner_threads = 0;
  int64_t policy_threads = 1;
  std::string precision = "fp32";
  bool set_workers_cpu_affinity = false;

  // Environment.
  int64_t env_frameskip = 4;
  std::string render_size = "128x72";
  std::string resize = "none";
  bool use_additional_input = false;
  double reward_scale = 1.0;
  double reward_clip = 1000.0;
  double shared_reward_alpha = -1.0;
  std::string shared_reward_scalarisation = "sum";

  // Batches.
  int64_t rollout = 32;
  int64_t batch_size = 4096;
  int64_t num_batches_per_epoch = 1;
  int64_t num_epochs = 1;
  int64_t num_batches_to_accumulate = 2;
  int64_t micro_batch_size = 512;
  int64_t max_policy_lag = 1000;
  bool shuffle_minibatches = false;

  // Returns and losses.
  double gamma = 0.99;
  double gae_lambda = 0.95;
  bool normalize_returns = true;
  double returns_clip = 5.0;
  bool normalize_input = true;
  bool legacy_timeouts = false;
  double ppo_clip_ratio = 0.1;
  double ppo_clip_value = 0.2;
  double value_loss_coeff = 0.5;
  std::string exploration_loss = "symmetric_kl";
  double exploration_loss_coeff = 0.001;
  double kl_loss_coeff = 0.0;
  double early_stop_kl = 0.0;
  bool with_vtrace = false;
  double vtrace_rho = 1.0;
  double vtrace_c = 1.0;
  std::string happo_agent_order = "random";
  double happo_factor_clamp = 0.0;

  // Q-learning: targets, exploration, pace.
  double epsilon_start = 1.0;
  double epsilon_end = 0.01;
  double epsilon_decay_steps = 2e7;
  bool epsilon_per_head = true;
  bool double_dqn = true;
  double target_update_tau = 0.005;
  int64_t target_update_interval = 1000;
  int64_t n_step = 1;
  double td_lambda = -1.0;
  double q_value_clamp = 100.0;
  bool normalize_q_values = false;
  bool use_huber_loss = true;
  double dqn_reward_clip = 1.0;
  std::string team_reward = "auto";
  int64_t learning_starts = 50000;
  int64_t train_frequency = 4;
  int64_t dqn_max_updates_per_batch = 4;
  double replay_ratio = 0;
  int64_t dqn_batch_size = 0;
  int64_t qmix_buffer_batch_size = 32;
  int64_t qmix_sequence_batch_size = 8;
  int64_t burn_in = 0;

  // Replay.
  double replay_gb = 0;
  int64_t replay_buffer_size = 1'000'000;
  std::string replay_file;
  std::string replay_compress = "auto";
  bool save_replay = false;
  bool per = true;
  double per_omega = 0.6;
  double per_beta_start = 0.4;
  double per_beta_frames = 0;
  bool per_sequences = false;
  double per_eta = 0.9;

  // Mixers.
  std::string mixer;
  int64_t qmix_embed_dim = 32;
  int64_t qmix_hypernet_hidden = 64;
  std::string qplex_preset = "comrad";
  int64_t qplex_embed_dim = 32;
  int64_t qplex_hypernet_embed = 64;
  int64_t qplex_adv_hypernet_layers = 1;
  int64_t qplex_adv_hypernet_embed = 64;
  int64_t qplex_num_kernel = 4;
  int64_t qplex_n_head = 4;
  double qplex_attend_reg_coef = 0.001;
  bool qplex_is_minus_one = true;
  bool qplex_weighted_head = false;
  bool qplex_nonlinear = false;
  bool qplex_state_bias = false;

  // Optimizer.
  double learning_rate = 1e-4;
  std::string lr_schedule = "constant";
  double lr_schedule_kl_threshold = 0.008;
  double lr_adaptive_min = 1e-6;
  double lr_adaptive_max = 1e-2;
  double adam_eps = 1e-6;
  double adam_beta1 = 0.9;
  double adam_beta2 = 0.999;
  double max_grad_norm = 4.0;

  // Model.
  std::string encoder_conv_architecture = "convnet_simple";
  bool use_rnn = true;
  std::string rnn_type = "gru";
  int64_t rnn_size = 512;
  int64_t rnn_num_layers = 1;
  std::string decoder_mlp_layers = "none";
  double policy_init_gain = 1.0;
  bool share_parameters = true;
  bool agent_id_input = false;
  std::string critic_hidden_sizes = "512,256";
  std::string mappo_critic_view = "own_first";
  bool happo_critic_rnn = true;

  // Curriculum over a layout pool (learner/curriculum).
  std::string curriculum = "uniform";
  double seq_threshold = 0.8;
  double seq_max_return = 0;
  int64_t seq_window = 100;
  int64_t seq_min_outcomes = 20;
  double lp_p_theta = 0.1;
  double lp_min_return = 0;
  double lp_max_return = 0;
  double lp_uniform_prob = 0.25;
  std::string interestingness_graph_path;
  double omni_mastery = 0;
  std::string plr_score_key = "mean_value_l1";
  double plr_max_score_coef = 0;
  double plr_alpha = 1.0;
  std::string plr_score_transform = "rank";
  double plr_temperature = 0.1;
  double plr_staleness_coef = 0.1;
  std::string plr_staleness_transform = "power";
  double plr_staleness_temperature = 1.0;
  std::string plr_replay_schedule = "proportionate";
  double plr_replay_prob = 0.5;
  double plr_rho = 1.0;
  double plr_eps = 0.05;

  // Records.
  double save_every_sec = 120.0;
  int64_t keep_checkpoints = 2;
  double save_best_every_sec = 5.0;
  double save_best_after = 1e5;
  std::string load_checkpoint_kind = "latest";
  double experiment_summaries_interval = 10.0;
  double progress_interval = 5.0;
  int64_t stats_avg = 100;
};

/// Calls `visit(name, member, help, aliases)` for every setting, in the order of the struct.
/// `member` is a reference to std::string, int64_t, double or bool.
template <typename Config, typename Visitor>
void visit_settings(Config& c, Visitor&& visit) {
  using Names = std::initializer_list<const char*>;
  visit("scenario", c.scenario, "scenario to play; `comrad scenarios` lists them", Names{"env"});
  visit("algo", c.algo, "learning algorithm: ippo, mappo, happo, idqn, vdn, qmix, qplex_d or qplex_q",
        Names{});
  visit(
      "preset", c.preset,
      "recipe: paper (the published configuration, its faults mended) or small (what learns most per hour on "
      "a few cores)",
      Names{});
  visit("experiment", c.experiment, "run name; empty makes <scenario>_<ALGO>_<date>_<time>", Names{});
  visit("train_dir", c.train_dir, "folder that holds the runs", Names{});
  visit("restart_behavior", c.restart_behavior,
        "when the run exists: resume, restart (old one is renamed) or overwrite", Names{});
  visit("seed", c.seed, "seed of everything random", Names{});
  visit("num_agents", c.num_agents, "agents per environment; 0: the scenario's default", Names{});
  visit("layout_seed", c.layout_seed, "seed of the generated map", Names{});
  visit("wad", c.wad, "play this WAD instead of a generated one", Names{});
  visit("layout_pool", c.layout_pool,
        "play a pool of maps: a folder that `comrad doomgen --pool` made, or train:<count> or eval:<count> "
        "to have one "
        "made; empty: one map",
        Names{"wad_batch"});
  visit("layout_swap_every", c.layout_swap_every, "episodes of an environment between two draws of its map",
        Names{"wad_swap_every"});
  visit("train_for_env_steps", c.train_for_env_steps, "stop after so many env frames (agents x tics)",
        Names{});
  visit("train_for_seconds", c.train_for_seconds, "stop after so many seconds of training; 0: no limit",
        Names{});

  visit("device", c.device, "where networks run: auto, cpu, cuda or cuda:<n>", Names{});
  visit("num_workers", c.num_workers, "simulator processes; 0: one per core", Names{});
  visit("num_envs_per_worker", c.num_envs_per_worker, "environments in each simulator process", Names{});
  visit("worker_num_splits", c.worker_num_splits,
        "groups of environments that alternate in a simulator: 1 or 2", Names{});
  visit("policy_workers", c.policy_workers, "inference processes", Names{"policy_workers_per_policy"});
  visit("async_rl", c.async_rl, "collect while the learner trains", Names{});
  visit("deterministic", c.deterministic,
        "lock step: the same seed gives the same weights bit for bit on a CPU", Names{"serial_mode"});
  visit("min_batch", c.min_batch, "environments an inference batch waits for; 0: auto", Names{});
  visit("max_batch", c.max_batch, "environments in one inference batch at most; 0: auto", Names{});
  visit("max_wait_us", c.max_wait_us, "longest wait for min_batch, microseconds", Names{});
  visit("trajectory_slabs", c.trajectory_slabs, "trajectory slabs in the arena; 0: auto", Names{});
  visit("learner_threads", c.learner_threads, "CPU threads of the learner; 0: auto", Names{});
  visit("policy_threads", c.policy_threads, "CPU threads of each policy worker", Names{});
  visit("precision", c.precision,
        "arithmetic of convolutions and matrix products, in inference and training: fp32 or bf16", Names{});
  visit("set_workers_cpu_affinity", c.set_workers_cpu_affinity, "pin simulator processes to cores", Names{});

  visit("env_frameskip", c.env_frameskip, "tics that one decision is held", Names{"frame_skip"});
  visit("render_size", c.render_size, "size the view is drawn at, WIDTHxHEIGHT", Names{});
  visit("resize", c.resize, "how a drawn view becomes 128x72: none, nearest or area", Names{});
  visit("use_additional_input", c.use_additional_input,
        "feed the scenario's measurement vector to the network", Names{});
  visit("reward_scale", c.reward_scale, "factor on every reward", Names{});
  visit("reward_clip", c.reward_clip, "rewards are clipped to +- this", Names{});
  visit("shared_reward_alpha", c.shared_reward_alpha,
        "share of the team's reward; -1: the scenario's, for happo 1, for Q-learning 0", Names{});
  visit("shared_reward_scalarisation", c.shared_reward_scalarisation, "team reward: sum or mean", Names{});

  visit("rollout", c.rollout, "decisions in a trajectory, T", Names{});
  visit("batch_size", c.batch_size, "agent decisions in one minibatch", Names{});
  visit("num_batches_per_epoch", c.num_batches_per_epoch, "minibatches that one epoch is cut into", Names{});
  visit("num_epochs", c.num_epochs, "passes over every batch", Names{});
  visit("num_batches_to_accumulate", c.num_batches_to_accumulate, "batches that may wait for the learner",
        Names{});
  visit("micro_batch_size", c.micro_batch_size,
        "rows in one forward and backward pass; same gradient, less memory", Names{});
  visit("max_policy_lag", c.max_policy_lag,
        "decisions older than this many versions are masked; 0: 1000, for happo 1000 x (agents + 1)",
        Names{});
  visit("shuffle_minibatches", c.shuffle_minibatches, "draw the trajectories of a minibatch in random order",
        Names{});

  visit("gamma", c.gamma, "discount per decision", Names{});
  visit("gae_lambda", c.gae_lambda, "lambda of generalised advantage estimation", Names{});
  visit("normalize_returns", c.normalize_returns, "the critic predicts normalised returns", Names{});
  visit("returns_clip", c.returns_clip,
        "with normalize_returns: targets and values are clipped to +- this many deviations; 0: off", Names{});
  visit("normalize_input", c.normalize_input, "running mean and deviation of every input element", Names{});
  visit("legacy_timeouts", c.legacy_timeouts, "treat time-outs as terminal, as the reference does", Names{});
  visit("ppo_clip_ratio", c.ppo_clip_ratio, "epsilon of the clip interval [1/(1+eps), 1+eps]", Names{});
  visit("ppo_clip_value", c.ppo_clip_value, "largest step of the value from its old one", Names{});
  visit("value_loss_coeff", c.value_loss_coeff, "weight of the value loss", Names{});
  visit("exploration_loss", c.exploration_loss, "symmetric_kl, entropy or none", Names{});
  visit("exploration_loss_coeff", c.exploration_loss_coeff, "weight of the exploration loss", Names{});
  visit("kl_loss_coeff", c.kl_loss_coeff, "weight of KL to the behaviour policy", Names{});
  visit("early_stop_kl", c.early_stop_kl,
        "leave a batch once KL to the behaviour policy is above this; 0: off", Names{});
  visit("with_vtrace", c.with_vtrace, "V-trace instead of GAE (ippo, mappo; needs --normalize_returns=False)",
        Names{});
  visit("vtrace_rho", c.vtrace_rho, "cap of V-trace's weights of temporal differences", Names{});
  visit("vtrace_c", c.vtrace_c, "cap of V-trace's trace weights", Names{});
  visit("happo_agent_order", c.happo_agent_order, "order of HAPPO's agents in an update: random or fixed",
        Names{});
  visit("happo_factor_clamp", c.happo_factor_clamp,
        "HAPPO: clamp each ratio in the factor M to [1/c, c]; 0: off", Names{});

  visit("epsilon_start", c.epsilon_start, "Q-learning: share of random decisions at first", Names{});
  visit("epsilon_end", c.epsilon_end, "Q-learning: share of random decisions in the end", Names{});
  visit("epsilon_decay_steps", c.epsilon_decay_steps, "Q-learning: env frames of the linear way between them",
        Names{});
  visit("epsilon_per_head", c.epsilon_per_head,
        "Q-learning: every action head explores on its own; off: all heads of an exploring agent at once, as "
        "published",
        Names{});
  visit("double_dqn", c.double_dqn, "Q-learning: the online network chooses the next action of a target",
        Names{});
  visit(
      "target_update_tau", c.target_update_tau,
      "Q-learning: share of the online network that enters the target network after every optimizer step; 1: "
      "a copy now and then",
      Names{});
  visit("target_update_interval", c.target_update_interval,
        "Q-learning: optimizer steps between two copies; with target_update_tau 1", Names{});
  visit("n_step", c.n_step, "Q-learning: rewards in a target before it bootstraps", Names{});
  visit("td_lambda", c.td_lambda, "Q-learning: lambda of TD(lambda) targets over sequences; below 0: n_step",
        Names{});
  visit("q_value_clamp", c.q_value_clamp,
        "Q-learning: targets are clipped to +- this; 0 turns it off; ignored by idqn", Names{});
  visit("normalize_q_values", c.normalize_q_values,
        "Q-learning: networks predict Q-values in units of the targets' running deviation (PopArt's scale)",
        Names{});
  visit("use_huber_loss", c.use_huber_loss, "Q-learning: Huber loss instead of the squared error", Names{});
  visit("dqn_reward_clip", c.dqn_reward_clip, "idqn: rewards are clipped to +- this; 0: off", Names{});
  visit("team_reward", c.team_reward,
        "mixers: sum or mean of the agents' rewards; auto: the mean where shared_reward_alpha is 1, else the "
        "sum",
        Names{});
  visit("learning_starts", c.learning_starts,
        "Q-learning: agent decisions in the replay before training; half of the replay if that is less",
        Names{});
  visit("train_frequency", c.train_frequency, "Q-learning: new agent decisions per update", Names{});
  visit("dqn_max_updates_per_batch", c.dqn_max_updates_per_batch,
        "Q-learning: updates per batch_size new decisions at most", Names{});
  visit("replay_ratio", c.replay_ratio,
        "Q-learning: decisions trained on per new decision; 0: from train_frequency and "
        "dqn_max_updates_per_batch",
        Names{});
  visit("dqn_batch_size", c.dqn_batch_size, "idqn: decisions in an update; 0: batch_size, 256 at most",
        Names{});
  visit("qmix_buffer_batch_size", c.qmix_buffer_batch_size,
        "mixers without a recurrent core: joint decisions in an update", Names{});
  visit("qmix_sequence_batch_size", c.qmix_sequence_batch_size,
        "with a recurrent core: sequences in an update", Names{});
  visit("burn_in", c.burn_in, "with a recurrent core: first steps of a sequence that only warm up the state",
        Names{});

  visit("replay_gb", c.replay_gb, "replay: capacity in gigabytes (1e9 bytes); 0: from free memory", Names{});
  visit("replay_buffer_size", c.replay_buffer_size,
        "replay: capacity in agent decisions; the smaller of the two counts", Names{});
  visit("replay_file", c.replay_file,
        "replay: file that holds it, so that it may outgrow memory; empty: memory, or a file in the run's "
        "folder "
        "where memory is too small",
        Names{});
  visit("replay_compress", c.replay_compress,
        "replay: frames are compressed with LZ4: auto (where it pays), true or false", Names{});
  visit("save_replay", c.save_replay, "replay: saved with every checkpoint; always so in deterministic runs",
        Names{});
  visit("per", c.per, "replay: prioritised; with a recurrent core only where per_sequences is on", Names{});
  visit("per_omega", c.per_omega, "replay: exponent of priorities", Names{"per_alpha"});
  visit("per_beta_start", c.per_beta_start, "replay: exponent of importance weights at first, 1 in the end",
        Names{});
  visit("per_beta_frames", c.per_beta_frames, "replay: env frames of that way; 0: the whole run", Names{});
  visit("per_sequences", c.per_sequences, "replay: sequences are prioritised, too (R2D2)", Names{});
  visit("per_eta", c.per_eta,
        "replay: share of the largest |TD error| in a sequence's priority, the rest is their mean", Names{});

  visit("mixer", c.mixer,
        "with algo qmix or qplex: vdn, qmix, dmaq (qplex_d) or dmaq_qatten (qplex_q); empty: the algorithm's",
        Names{});
  visit("qmix_embed_dim", c.qmix_embed_dim, "QMIX: width of the mixing layer", Names{});
  visit("qmix_hypernet_hidden", c.qmix_hypernet_hidden, "QMIX: hidden width of the hypernetworks", Names{});
  visit("qplex_preset", c.qplex_preset, "QPLEX: comrad (the benchmark's) or paper (the authors') settings",
        Names{});
  visit("qplex_embed_dim", c.qplex_embed_dim, "QPLEX: width of attention queries and keys", Names{});
  visit("qplex_hypernet_embed", c.qplex_hypernet_embed, "QPLEX: hidden width of the weights' networks",
        Names{});
  visit("qplex_adv_hypernet_layers", c.qplex_adv_hypernet_layers,
        "QPLEX: layers of the lambda networks, 1 to 3", Names{});
  visit("qplex_adv_hypernet_embed", c.qplex_adv_hypernet_embed, "QPLEX: hidden width of the lambda networks",
        Names{});
  visit("qplex_num_kernel", c.qplex_num_kernel, "QPLEX: kernels of lambda", Names{});
  visit("qplex_n_head", c.qplex_n_head, "QPLEX-Q: attention heads", Names{});
  visit("qplex_attend_reg_coef", c.qplex_attend_reg_coef, "QPLEX-Q: weight of the attention logits' squares",
        Names{});
  visit("qplex_is_minus_one", c.qplex_is_minus_one, "QPLEX: lambda - 1 instead of lambda in the advantage",
        Names{});
  visit("qplex_weighted_head", c.qplex_weighted_head, "QPLEX: weights and biases of utilities by state",
        Names{});
  visit("qplex_nonlinear", c.qplex_nonlinear, "QPLEX-Q: keys see the utilities, too", Names{});
  visit("qplex_state_bias", c.qplex_state_bias, "QPLEX-Q: a bias by state", Names{});

  visit("learning_rate", c.learning_rate, "Adam's learning rate", Names{"lr"});
  visit("lr_schedule", c.lr_schedule, "constant, linear_decay, kl_adaptive_minibatch or kl_adaptive_epoch",
        Names{});
  visit("lr_schedule_kl_threshold", c.lr_schedule_kl_threshold, "KL that the adaptive schedules aim at",
        Names{});
  visit("lr_adaptive_min", c.lr_adaptive_min, "floor of the adaptive schedules", Names{});
  visit("lr_adaptive_max", c.lr_adaptive_max, "cap of the adaptive schedules", Names{});
  visit("adam_eps", c.adam_eps, "Adam's epsilon", Names{});
  visit("adam_beta1", c.adam_beta1, "Adam's first decay", Names{});
  visit("adam_beta2", c.adam_beta2, "Adam's second decay", Names{});
  visit("max_grad_norm", c.max_grad_norm, "global gradient norm is clipped to this; 0: off", Names{});

  visit("encoder_conv_architecture", c.encoder_conv_architecture,
        "pixel encoder: convnet_simple, convnet_impala, convnet_atari or resnet_impala", Names{});
  visit("use_rnn", c.use_rnn, "recurrent core; without it the network is feed-forward", Names{});
  visit("rnn_type", c.rnn_type, "gru or lstm", Names{});
  visit("rnn_size", c.rnn_size, "hidden units of the recurrent core", Names{});
  visit("rnn_num_layers", c.rnn_num_layers, "layers of the recurrent core", Names{});
  visit("decoder_mlp_layers", c.decoder_mlp_layers,
        "widths of ELU layers between core and heads, as 512,256; none: no layer", Names{});
  visit("policy_init_gain", c.policy_init_gain, "gain of the orthogonal initialisation", Names{});
  visit("share_parameters", c.share_parameters,
        "one network for all agents; off: one per agent (always so in happo)", Names{});
  visit("agent_id_input", c.agent_id_input, "feed the agent's index, one-hot, to the shared network",
        Names{});
  visit("critic_hidden_sizes", c.critic_hidden_sizes,
        "hidden widths of mappo's and happo's central critic, as 512,256; none: linear",
        Names{"happo_critic_hidden_sizes"});
  visit("mappo_critic_view", c.mappo_critic_view,
        "what mappo's critic sees for an agent's value: own_first (its own features, then the mean of its "
        "partners') or position (all in order, a value a position, as published)",
        Names{});
  visit("happo_critic_rnn", c.happo_critic_rnn, "HAPPO's critic has a recurrent core per agent", Names{});

  visit("curriculum", c.curriculum,
        "who draws from the layout pool: uniform, sequential, learning_progress, omni or plr",
        Names{"wad_curriculum"});
  visit("seq_threshold", c.seq_threshold, "sequential: the next map comes at this fraction of seq_max_return",
        Names{});
  visit("seq_max_return", c.seq_max_return, "sequential: best score; 0: each map's own ceiling", Names{});
  visit("seq_window", c.seq_window, "sequential: episodes of a map that its mean is taken over", Names{});
  visit("seq_min_outcomes", c.seq_min_outcomes,
        "sequential: episodes of a map before the next may come; 1: as published", Names{});
  visit("lp_p_theta", c.lp_p_theta, "learning_progress, omni: theta of the reweighting", Names{});
  visit("lp_min_return", c.lp_min_return, "learning_progress, omni: score that counts as no success",
        Names{});
  visit("lp_max_return", c.lp_max_return,
        "learning_progress, omni: score that counts as full success; 0: each map's own ceiling", Names{});
  visit("lp_uniform_prob", c.lp_uniform_prob, "learning_progress, omni: share of draws that are uniform",
        Names{});
  visit("interestingness_graph_path", c.interestingness_graph_path,
        "omni: JSON file, map -> other map -> is it still interesting; empty: the pool's own", Names{});
  visit("omni_mastery", c.omni_mastery,
        "omni: a map is mastered from this fraction of lp_max_return on; 0: as published", Names{});
  visit("plr_score_key", c.plr_score_key,
        "plr: what scores a map: mean_value_l1, mean_advantage or mean_entropy", Names{});
  visit("plr_max_score_coef", c.plr_max_score_coef,
        "plr: share of the maximum in a score, the rest is the mean", Names{});
  visit("plr_alpha", c.plr_alpha, "plr: share of the newest score", Names{});
  visit("plr_score_transform", c.plr_score_transform,
        "plr: rank, power, softmax, max, eps_greedy or constant", Names{});
  visit("plr_temperature", c.plr_temperature, "plr: temperature of the score's transform", Names{});
  visit("plr_staleness_coef", c.plr_staleness_coef, "plr: share of staleness in the weights", Names{});
  visit("plr_staleness_transform", c.plr_staleness_transform, "plr: as plr_score_transform", Names{});
  visit("plr_staleness_temperature", c.plr_staleness_temperature,
        "plr: temperature of the staleness's transform", Names{});
  visit("plr_replay_schedule", c.plr_replay_schedule, "plr: proportionate or fixed", Names{});
  visit("plr_replay_prob", c.plr_replay_prob, "plr: probability of a map that was played before", Names{});
  visit("plr_rho", c.plr_rho, "plr: fraction of maps to score before any is replayed", Names{});
  visit("plr_eps", c.plr_eps, "plr: epsilon of the transform eps_greedy", Names{});

  visit("save_every_sec", c.save_every_sec, "seconds between checkpoints", Names{});
  visit("keep_checkpoints", c.keep_checkpoints, "newest checkpoints that are kept", Names{});
  visit("save_best_every_sec", c.save_best_every_sec, "seconds between looks at the score for a new best",
        Names{});
  visit("save_best_after", c.save_best_after, "env frames before the first best checkpoint", Names{});
  visit("load_checkpoint_kind", c.load_checkpoint_kind, "checkpoint to resume or evaluate: latest or best",
        Names{});
  visit("experiment_summaries_interval", c.experiment_summaries_interval, "seconds between metric reports",
        Names{});
  visit("progress_interval", c.progress_interval, "seconds between progress lines", Names{});
  visit("stats_avg", c.stats_avg, "episodes that the reported score is averaged over", Names{});
}

/// One layer of settings as `key = value` text pairs, in order; a later layer wins.
struct SettingsLayer {
  std::string origin;  ///< named in messages: "command line", "run.toml", "scenario coop_health_gathering"
  std::vector<std::pair<std::string, std::string>> values;
};

/// Puts a layer on top of `config`. Values are parsed by the setting's type: integers accept 1e6, booleans
/// accept true/false/1/0/True/False. Errors: kBadInput for an unknown key (naming the nearest known one) or a
/// value of the wrong type.
Status apply_layer(RunConfig& config, const SettingsLayer& layer);

/// Reads a TOML file of settings into a layer. Nested tables are not settings and are errors.
/// Errors: kNotFound, kBadFormat with line and column.
Expected<SettingsLayer> read_settings_toml(const std::string& path);

/// The merged settings as a TOML document that read_settings_toml reads back without loss.
std::string settings_to_toml(const RunConfig& config);

/// Reads config.toml of a run: every worker's first step.
Expected<RunConfig> load_run_config(const std::string& path);

/// The defaults of an algorithm (LSTM and 4 epochs for IPPO, ...), the layer below the
/// preset's (core/recipes.h). Errors: kBadInput for an unknown algorithm, naming the known ones.
Expected<SettingsLayer> algorithm_defaults(const std::string& algo);

/// The settings that --qplex_preset stands for, in the preset's layer above its rows for the algorithm and below
/// the scenario's: empty for "comrad", the authors' own for "paper". Source: Wang et al. 2021, arXiv:2008.01062.
SettingsLayer qplex_preset_settings(const std::string& preset);

/// Whether the algorithm learns Q-values from a replay (idqn and the mixers), and whether it mixes them into
/// a team's (vdn, qmix, qplex_d, qplex_q).
bool learns_q_values(const RunConfig& config);
bool mixes_q_values(const RunConfig& config);

/// Replaces the zeros that mean "auto" by numbers for a host of `core_count` cores and checks every range and
/// combination (batch_size is rounded down to a multiple of rollout * num_agents).
/// Errors: kBadInput naming the setting, its value and what it may be.
Status resolve_settings(RunConfig& config, int core_count);

/// The layer widths that `text` lists, separated by commas or blanks ("512,256"); none for "none" or empty
/// text. Errors: kBadInput for more than 8 widths or one outside 1 to 8192.
Expected<std::vector<int64_t>> parse_widths(const std::string& text);

/// Floats of recurrent state per agent that the run's network carries from one decision to the next: layers x
/// size for GRU, twice that for LSTM, twice again where HAPPO's critic is recurrent; 0 without a core.
int64_t recurrent_state_count(const RunConfig& config);

/// An upper bound of the bytes of the run's weights (parameters and input statistics of all networks), from
/// which the arena is made; what is not used is never touched. `frame_bytes`: of one agent's frame,
/// `logits`: choices of all action heads.
int64_t weights_bytes_limit(const RunConfig& config, int64_t num_agents, int64_t frame_bytes, int64_t logits);

/// To be asked before toml++ parses `text`, for what its 3.3 does not survive: a table's header without a key
/// ("[=]" is undefined behaviour in release builds), and a key of more than 64 parts, whose tables lie in one
/// another. Errors: kBadFormat as "label:line:column: what".
Status check_toml_text(std::string_view text, const std::string& label);

/// The folder that holds scenarios/ and the other data files: $COMRAD_HOME, else the source folder of the
/// build.
std::string data_dir();

}  // namespace comrad
