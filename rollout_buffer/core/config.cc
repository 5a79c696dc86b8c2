#include "rollout_buffer/core/config.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <cstdlib>
#include <limits>
#include <optional>
#include <type_traits>

#include "rollout_buffer/core/files.h"
#include "rollout_buffer/core/recipes.h"
#include "rollout_buffer/core/text.h"
#include "rollout_buffer/core/toml_text.h"

namespace comrad {
namespace {

/// The mixers by the names that --mixer knows, and the algorithm that each makes.
struct MixerName {
  const char* mixer;
  const char* algo;
};
constexpr MixerName kMixers[] = {
    {"vdn", "vdn"}, {"qmix", "qmix"}, {"dmaq", "qplex_d"}, {"dmaq_qatten", "qplex_q"}};

const char* mixer_of(std::string_view algo) {
  for (const MixerName& name : kMixers)
    if (algo == name.algo) return name.mixer;
  return "";
}

/// The algorithm that `mixer` makes of qmix or qplex; every other keeps its own.
void settle_mixer(RunConfig& config) {
  config.algo = canonical_algorithm(config.algo);
  config.mixer = lower_case(config.mixer);
  if (config.algo != "qmix" && config.algo != "qplex_d" && config.algo != "qplex_q") return;
  for (const MixerName& name : kMixers)
    if (config.mixer == name.mixer) config.algo = name.algo;
}

bool parse_value(std::string_view text, std::string& value) {
  value = text;
  return true;
}

bool parse_value(std::string_view given, double& value) {
  std::string_view text = trimmed(given);
  if (!text.empty() && text.front() == '+') text.remove_prefix(1);
  double parsed = 0;
  const auto [end, failure] = std::from_chars(text.data(), text.data() + text.size(), parsed);
  if (failure != std::errc() || end != text.data() + text.size() || !std::isfinite(parsed)) return false;
  value = parsed;
  return true;
}

bool parse_value(std::string_view given, int64_t& value) {
  std::string_view text = trimmed(given);
  if (!text.empty() && text.front() == '+') text.remove_prefix(1);
  int64_t parsed = 0;
  const auto [end, failure] = std::from_chars(text.data(), text.data() + text.size(), parsed);
  if (failure == std::errc() && end == text.data() + text.size()) {
    value = parsed;
    return true;
  }
  double real = 0;  // 1e6 and 4096.0 are integers too
  if (!parse_value(text, real) || real != std::floor(real) || std::fabs(real) > 9.0e15) return false;
  value = static_cast<int64_t>(real);
  return true;
}

bool parse_value(std::string_view given, bool& value) {
  const std::string text = lower_case(trimmed(given));
  if (text != "true" && text != "1" && text != "false" && text != "0") return false;
  value = text == "true" || text == "1";
  return true;
}

template <typename T>
const char* type_words() {
  if constexpr (std::is_same_v<T, int64_t>) return "a whole number";
  if constexpr (std::is_same_v<T, double>) return "a number";
  if constexpr (std::is_same_v<T, bool>) return "true or false";
  return "text";
}

std::string toml_text(const std::string& value) {
  std::string text = "\"";
  for (const char c : value) {
    if (c == '"' || c == '\\') {
      text += '\\';
      text += c;
    } else if (static_cast<unsigned char>(c) < 0x20 || c == 0x7F) {
      std::array<char, 8> escaped{};
      std::snprintf(escaped.data(), escaped.size(), "\\u%04X",
                    static_cast<unsigned>(static_cast<unsigned char>(c)));
      text += escaped.data();
    } else {
      text += c;
    }
  }
  return text + "\"";
}

constexpr std::size_t kSettingsBytesMax = 1 << 20;

// Upper bounds of reals that have no nearer one: beyond them numbers overflow on the way, or mean nothing.
constexpr double kCoefficientMax = 1e6;
constexpr double kScoreMax = 1e12;   // rewards, returns, scores
constexpr double kFramesMax = 1e15;  // env frames: counters stay exact in a double
constexpr double kSecondsMax = 1e9;  // 31 years

/// Collects the first violated range or choice, so that the table of checks below reads as a table.
class Checks {
 public:
  void that(bool holds, const char* name, const std::string& value, const std::string& must) {
    if (holds || failed_) return;
    failed_ = true;
    message_ = std::string(name) + " is " + (value.empty() ? "empty" : value) + "; it must be " + must;
  }
  void range(const char* name, int64_t value, int64_t low, int64_t high) {
    that(value >= low && value <= high, name, std::to_string(value),
         "between " + std::to_string(low) + " and " + std::to_string(high));
  }
  void real(const char* name, double value, double low, double high) {
    that(value >= low && value <= high, name, real_text(value),
         "between " + real_text(low) + " and " + real_text(high));
  }
  void above(const char* name, double value, double low, double high) {
    that(value > low && value <= high, name, real_text(value),
         "greater than " + real_text(low) + " and at most " + real_text(high));
  }
  void fraction(const char* name, double value) {
    that(value >= 0 && value <= 1, name, real_text(value), "between 0 and 1");
  }
  void one_of(const char* name, const std::string& value, const std::vector<std::string>& words) {
    that(std::find(words.begin(), words.end(), value) != words.end(), name, value, "one of " + joined(words));
  }
  Status status() const { return failed_ ? Status(Error{ErrorCode::kBadInput, message_}) : Status(); }

 private:
  bool failed_ = false;
  std::string message_;
};

bool is_device(std::string_view device) {
  if (device == "auto" || device == "cpu" || device == "cuda") return true;
  if (!device.starts_with("cuda:")) return false;
  device.remove_prefix(5);
  return !device.empty() && device.size() <= 3 &&
         std::all_of(device.begin(), device.end(), [](char c) { return c >= '0' && c <= '9'; });
}

bool is_size(std::string_view size) {
  const std::size_t cross = size.find('x');
  if (cross == std::string_view::npos) return false;
  int64_t width = 0, height = 0;
  return parse_value(size.substr(0, cross), width) && parse_value(size.substr(cross + 1), height) &&
         width >= 16 && width <= 4096 && height >= 16 && height <= 4096;
}

void check_curriculum(const RunConfig& c, Checks& check) {
  check.one_of("curriculum", c.curriculum, {"uniform", "sequential", "learning_progress", "omni", "plr"});
  check.that(c.curriculum == "uniform" || !c.layout_pool.empty(), "curriculum", c.curriculum,
             "used with --layout_pool, the maps that it draws from");
  check.fraction("seq_threshold", c.seq_threshold);
  check.real("seq_max_return", c.seq_max_return, 0, kScoreMax);
  check.range("seq_window", c.seq_window, 1, 1'000'000);
  check.range("seq_min_outcomes", c.seq_min_outcomes, 1, 1'000'000);
  check.fraction("lp_p_theta", c.lp_p_theta);
  check.real("lp_min_return", c.lp_min_return, -kScoreMax, kScoreMax);
  check.real("lp_max_return", c.lp_max_return, -kScoreMax, kScoreMax);
  check.that(c.lp_max_return == 0 || c.lp_max_return > c.lp_min_return, "lp_max_return",
             real_text(c.lp_max_return), "greater than lp_min_return (" + real_text(c.lp_min_return) + ")");
  check.fraction("lp_uniform_prob", c.lp_uniform_prob);
  check.fraction("omni_mastery", c.omni_mastery);
  check.that(c.interestingness_graph_path.empty() || c.curriculum == "omni", "interestingness_graph_path",
             c.interestingness_graph_path, "left out, or used with --curriculum omni");
  const std::vector<std::string> transforms = {"rank", "power", "softmax", "max", "eps_greedy", "constant"};
  check.that(c.curriculum != "plr" || c.algo == "ippo" || c.algo == "mappo" || c.algo == "happo",
             "curriculum", c.curriculum,
             "another one with algo " + c.algo + ", which estimates no advantages");
  check.one_of("plr_score_key", c.plr_score_key, {"mean_value_l1", "mean_advantage", "mean_entropy"});
  check.fraction("plr_max_score_coef", c.plr_max_score_coef);
  check.fraction("plr_alpha", c.plr_alpha);
  check.one_of("plr_score_transform", c.plr_score_transform, transforms);
  check.above("plr_temperature", c.plr_temperature, 0, 1e6);
  check.fraction("plr_staleness_coef", c.plr_staleness_coef);
  check.one_of("plr_staleness_transform", c.plr_staleness_transform, transforms);
  check.above("plr_staleness_temperature", c.plr_staleness_temperature, 0, 1e6);
  check.one_of("plr_replay_schedule", c.plr_replay_schedule, {"proportionate", "fixed"});
  check.fraction("plr_replay_prob", c.plr_replay_prob);
  check.fraction("plr_rho", c.plr_rho);
  check.fraction("plr_eps", c.plr_eps);
}

void check_q_learning(const RunConfig& c, Checks& check) {
  check.fraction("epsilon_start", c.epsilon_start);
  check.fraction("epsilon_end", c.epsilon_end);
  check.above("epsilon_decay_steps", c.epsilon_decay_steps, 0, kFramesMax);
  check.that(c.target_update_tau > 0 && c.target_update_tau <= 1, "target_update_tau",
             real_text(c.target_update_tau), "greater than 0 and at most 1");
  check.range("target_update_interval", c.target_update_interval, 1, 1'000'000'000);
  check.range("n_step", c.n_step, 1, 4096);
  check.that(c.td_lambda >= -1 && c.td_lambda <= 1, "td_lambda", real_text(c.td_lambda),
             "between 0 and 1, or -1 for n_step");
  check.real("q_value_clamp", c.q_value_clamp, 0, kScoreMax);
  check.real("dqn_reward_clip", c.dqn_reward_clip, 0, kScoreMax);
  check.one_of("team_reward", c.team_reward, {"auto", "sum", "mean"});
  check.range("learning_starts", c.learning_starts, 0, int64_t{1} << 40);
  check.range("train_frequency", c.train_frequency, 1, 1'000'000);
  check.range("dqn_max_updates_per_batch", c.dqn_max_updates_per_batch, 1, 1'000'000);
  check.real("replay_ratio", c.replay_ratio, 0, 1e4);
  check.range("dqn_batch_size", c.dqn_batch_size, 0, 1 << 20);
  check.range("qmix_buffer_batch_size", c.qmix_buffer_batch_size, 1, 1 << 20);
  check.range("qmix_sequence_batch_size", c.qmix_sequence_batch_size, 1, 1 << 16);
  check.range("burn_in", c.burn_in, 0, 4096);

  check.that(c.replay_gb >= 0 && c.replay_gb <= 1e6, "replay_gb", real_text(c.replay_gb),
             "at most 1000000, or 0 for what memory allows");
  check.one_of("replay_compress", c.replay_compress, {"auto", "true", "false"});
  check.range("replay_buffer_size", c.replay_buffer_size, 1, int64_t{1} << 40);
  check.fraction("per_omega", c.per_omega);
  check.fraction("per_beta_start", c.per_beta_start);
  check.real("per_beta_frames", c.per_beta_frames, 0, kFramesMax);
  check.fraction("per_eta", c.per_eta);

  check.that(c.mixer.empty() || c.mixer == mixer_of(c.algo), "mixer", c.mixer,
             "one of vdn, qmix, dmaq, dmaq_qatten with algo qmix or qplex, and left out with algo " + c.algo);
  check.range("qmix_embed_dim", c.qmix_embed_dim, 1, 4096);
  check.range("qmix_hypernet_hidden", c.qmix_hypernet_hidden, 1, 4096);
  check.one_of("qplex_preset", c.qplex_preset, {"comrad", "paper"});
  check.range("qplex_embed_dim", c.qplex_embed_dim, 1, 4096);
  check.range("qplex_hypernet_embed", c.qplex_hypernet_embed, 1, 4096);
  check.range("qplex_adv_hypernet_layers", c.qplex_adv_hypernet_layers, 1, 3);
  check.range("qplex_adv_hypernet_embed", c.qplex_adv_hypernet_embed, 1, 4096);
  check.range("qplex_num_kernel", c.qplex_num_kernel, 1, 256);
  check.range("qplex_n_head", c.qplex_n_head, 1, 256);
  check.real("qplex_attend_reg_coef", c.qplex_attend_reg_coef, 0, kCoefficientMax);
}

Status check_ranges(const RunConfig& c) {
  Checks check;
  visit_settings(c, [&check](const char* name, const auto& member, const char* /*help*/,
                             std::initializer_list<const char*> /*aliases*/) {
    if constexpr (std::is_same_v<std::remove_cvref_t<decltype(member)>, std::string>)
      check.that(is_utf8(member), name, "no UTF-8", "text in UTF-8");
  });
  check.that(!c.scenario.empty(), "scenario", c.scenario, "the name of a scenario");
  check.one_of("algo", c.algo, algorithm_names());
  check.one_of("preset", c.preset, preset_names());
  check.that(c.experiment.find('/') == std::string::npos && c.experiment != "." && c.experiment != "..",
             "experiment", c.experiment, "a folder name without '/'");
  check.that(!c.train_dir.empty(), "train_dir", c.train_dir, "a folder");
  check.one_of("restart_behavior", c.restart_behavior, {"resume", "restart", "overwrite"});
  check.range("seed", c.seed, 0, std::numeric_limits<int64_t>::max());
  check.range("num_agents", c.num_agents, 1, 8);
  check.range("layout_seed", c.layout_seed, 0, std::numeric_limits<int64_t>::max());
  check.that(c.layout_pool.empty() || c.wad.empty(), "layout_pool", c.layout_pool,
             "left out where --wad names the one map to play");
  check.range("layout_swap_every", c.layout_swap_every, 1, 1'000'000);
  check.above("train_for_env_steps", c.train_for_env_steps, 0, kFramesMax);
  check.real("train_for_seconds", c.train_for_seconds, 0, kSecondsMax);

  check.that(is_device(c.device), "device", c.device, "auto, cpu, cuda or cuda:<number>");
  check.range("num_workers", c.num_workers, 0, 1024);
  check.range("num_envs_per_worker", c.num_envs_per_worker, 1, 1024);
  check.range("worker_num_splits", c.worker_num_splits, 1, 2);
  check.range("policy_workers", c.policy_workers, 1, 64);
  check.range("min_batch", c.min_batch, 0, 1 << 20);
  check.range("max_batch", c.max_batch, 0, 1 << 20);
  check.range("max_wait_us", c.max_wait_us, 0, 10'000'000);
  check.range("trajectory_slabs", c.trajectory_slabs, 0, 1 << 20);
  check.range("learner_threads", c.learner_threads, 0, 1024);
  check.range("policy_threads", c.policy_threads, 1, 1024);
  check.one_of("precision", c.precision, {"fp32", "bf16"});

  check.range("env_frameskip", c.env_frameskip, 1, 100);
  check.that(is_size(c.render_size), "render_size", c.render_size, "WIDTHxHEIGHT, each from 16 to 4096");
  check.one_of("resize", c.resize, {"none", "nearest", "area"});
  check.that(c.resize != "none" || c.render_size == "128x72", "render_size", c.render_size,
             "128x72, unless --resize nearest or --resize area brings the view to that size");
  check.real("reward_scale", c.reward_scale, -kCoefficientMax, kCoefficientMax);
  check.above("reward_clip", c.reward_clip, 0, kScoreMax);
  check.that(c.shared_reward_alpha == -1 || (c.shared_reward_alpha >= 0 && c.shared_reward_alpha <= 1),
             "shared_reward_alpha", real_text(c.shared_reward_alpha),
             "between 0 and 1, or -1 for the scenario's");
  check.one_of("shared_reward_scalarisation", c.shared_reward_scalarisation, {"sum", "mean"});

  check.range("rollout", c.rollout, 1, 4096);
  check.range("batch_size", c.batch_size, 1, 1 << 26);
  check.range("num_batches_per_epoch", c.num_batches_per_epoch, 1, 1024);
  check.range("num_epochs", c.num_epochs, 1, 1000);
  check.range("num_batches_to_accumulate", c.num_batches_to_accumulate, 1, 1024);
  check.range("micro_batch_size", c.micro_batch_size, 1, 1 << 26);
  check.range("max_policy_lag", c.max_policy_lag, 0, 1'000'000'000);

  check.fraction("gamma", c.gamma);
  check.fraction("gae_lambda", c.gae_lambda);
  check.real("returns_clip", c.returns_clip, 0, kCoefficientMax);
  check.above("ppo_clip_ratio", c.ppo_clip_ratio, 0, 100);
  check.above("ppo_clip_value", c.ppo_clip_value, 0, kScoreMax);
  check.real("value_loss_coeff", c.value_loss_coeff, 0, kCoefficientMax);
  check.one_of("exploration_loss", c.exploration_loss, {"symmetric_kl", "entropy", "none"});
  check.real("exploration_loss_coeff", c.exploration_loss_coeff, 0, kCoefficientMax);
  check.real("kl_loss_coeff", c.kl_loss_coeff, 0, kCoefficientMax);
  check.real("early_stop_kl", c.early_stop_kl, 0, kCoefficientMax);
  check.above("vtrace_rho", c.vtrace_rho, 0, kCoefficientMax);
  check.above("vtrace_c", c.vtrace_c, 0, kCoefficientMax);
  check.one_of("happo_agent_order", c.happo_agent_order, {"random", "fixed"});
  check.that(
      c.happo_factor_clamp == 0 || (c.happo_factor_clamp > 1 && c.happo_factor_clamp <= kCoefficientMax),
      "happo_factor_clamp", real_text(c.happo_factor_clamp),
      "greater than 1 and at most " + real_text(kCoefficientMax) + ", or 0 for none");

  check_q_learning(c, check);

  check.real("learning_rate", c.learning_rate, 0, 1);
  check.one_of("lr_schedule", c.lr_schedule,
               {"constant", "linear_decay", "kl_adaptive_minibatch", "kl_adaptive_epoch"});
  check.above("lr_schedule_kl_threshold", c.lr_schedule_kl_threshold, 0, 100);
  check.above("lr_adaptive_min", c.lr_adaptive_min, 0, 1);
  check.real("lr_adaptive_max", c.lr_adaptive_max, c.lr_adaptive_min, 1);
  check.above("adam_eps", c.adam_eps, 0, 1);
  check.that(c.adam_beta1 >= 0 && c.adam_beta1 < 1, "adam_beta1", real_text(c.adam_beta1),
             "at least 0 and below 1");
  check.that(c.adam_beta2 >= 0 && c.adam_beta2 < 1, "adam_beta2", real_text(c.adam_beta2),
             "at least 0 and below 1");
  check.real("max_grad_norm", c.max_grad_norm, 0, kCoefficientMax);

  check.one_of("encoder_conv_architecture", c.encoder_conv_architecture,
               {"convnet_simple", "convnet_impala", "convnet_atari", "resnet_impala"});
  check.one_of("rnn_type", c.rnn_type, {"gru", "lstm"});
  check.range("rnn_size", c.rnn_size, 1, 4096);
  check.range("rnn_num_layers", c.rnn_num_layers, 1, 8);
  check.above("policy_init_gain", c.policy_init_gain, 0, 100);
  for (const auto& [name, text] : {std::pair("decoder_mlp_layers", &c.decoder_mlp_layers),
                                   std::pair("critic_hidden_sizes", &c.critic_hidden_sizes)})
    check.that(parse_widths(*text).has_value(), name, *text,
               "none, or up to 8 widths between 1 and 8192 as 512,256");

  check.one_of("mappo_critic_view", c.mappo_critic_view, {"own_first", "position"});

  check_curriculum(c, check);

  check.above("save_every_sec", c.save_every_sec, 0, kSecondsMax);
  check.range("keep_checkpoints", c.keep_checkpoints, 1, 1'000'000);
  check.above("save_best_every_sec", c.save_best_every_sec, 0, kSecondsMax);
  check.real("save_best_after", c.save_best_after, 0, kFramesMax);
  check.one_of("load_checkpoint_kind", c.load_checkpoint_kind, {"latest", "best"});
  check.above("experiment_summaries_interval", c.experiment_summaries_interval, 0, kSecondsMax);
  check.above("progress_interval", c.progress_interval, 0, kSecondsMax);
  check.range("stats_avg", c.stats_avg, 1, 1'000'000);
  return check.status();
}

/// Settings that Q-learning cannot have together.
Status check_q_combinations(const RunConfig& c) {
  const auto refuse = [](std::string message) { return Error{ErrorCode::kBadInput, std::move(message)}; };
  if (mixes_q_values(c) && c.num_agents < 2)
    return refuse("num_agents is 1; " + c.algo + " mixes the values of at least 2 agents, use idqn for one");
  if (c.use_rnn && c.rnn_type != "gru")
    return refuse("rnn_type is " + c.rnn_type + "; " + c.algo + "'s core is a gru, or --use_rnn=False");
  if (c.use_rnn && c.rollout < 2)
    return refuse("rollout is 1; a recurrent core learns from sequences of at least 2 decisions");
  if (c.td_lambda >= 0 && !c.use_rnn)
    return refuse("td_lambda is " + real_text(c.td_lambda) +
                  "; without a recurrent core single decisions are drawn, use --n_step");
  if (c.n_step > c.rollout)
    return refuse("n_step is " + std::to_string(c.n_step) + "; a trajectory holds rollout " +
                  std::to_string(c.rollout) + " decisions");
  if (c.burn_in > 0 && (!c.use_rnn || c.burn_in >= c.rollout))
    return refuse("burn_in is " + std::to_string(c.burn_in) +
                  "; it needs a recurrent core and must leave some of the rollout's " +
                  std::to_string(c.rollout) + " decisions to learn from");
  if (c.lr_schedule.starts_with("kl_adaptive"))
    return refuse("lr_schedule is " + c.lr_schedule + "; " + c.algo +
                  " has no policy whose KL it could follow, use constant or linear_decay");
  return {};
}

/// Settings that exclude each other.
Status check_combinations(const RunConfig& c) {
  const auto refuse = [](std::string message) { return Error{ErrorCode::kBadInput, std::move(message)}; };
  if (c.with_vtrace && c.algo == "happo")
    return refuse(
        "with_vtrace is on; happo estimates advantages with GAE, V-trace works with ippo and mappo");
  if (c.with_vtrace && c.normalize_returns)
    return refuse(
        "with_vtrace and normalize_returns are both on; V-trace mixes values of different versions, so their "
        "scale must not move: add --normalize_returns=False");
  if (c.algo == "happo" && c.share_parameters)
    return refuse("share_parameters is on; happo updates one network per agent, so leave it off");
  if (c.algo == "happo" && c.lr_schedule.starts_with("kl_adaptive"))
    return refuse("lr_schedule is " + c.lr_schedule +
                  "; happo's agents are updated one after the other, so it must be constant or linear_decay");
  if (c.agent_id_input && !c.share_parameters)
    return refuse("agent_id_input is on without share_parameters; a network of its own needs no agent index");
  if (learns_q_values(c)) return check_q_combinations(c);
  return {};
}

/// What the settings of Q-learning become once the others are known.
void resolve_q_learning(RunConfig& c) {
  c.mixer = mixer_of(c.algo);
  if (c.use_rnn) c.per = c.per && c.per_sequences;
  if (c.dqn_batch_size == 0) c.dqn_batch_size = std::min<int64_t>(c.batch_size, 256);
  if (c.per_beta_frames == 0) c.per_beta_frames = c.train_for_env_steps;
  if (c.team_reward == "auto") c.team_reward = c.shared_reward_alpha == 1 ? "mean" : "sum";
  c.save_replay |= c.deterministic;
}

/// Lock step takes one rollout of every environment and cuts it into batches without a remainder.
Status resolve_deterministic_batches(RunConfig& c) {
  const int64_t slab_rows = c.rollout * c.num_agents, env_count = c.num_workers * c.num_envs_per_worker;
  const std::string envs = std::to_string(env_count) + " environments (num_workers " +
                           std::to_string(c.num_workers) + " x num_envs_per_worker " +
                           std::to_string(c.num_envs_per_worker) + ")";
  if (env_count % c.num_batches_per_epoch != 0)
    return Error{
        ErrorCode::kBadInput,
        "deterministic: one rollout of " + envs + " cannot be cut into num_batches_per_epoch " +
            std::to_string(c.num_batches_per_epoch) +
            " equal batches; make num_envs_per_worker a multiple of it, or set --num_batches_per_epoch 1"};
  const int64_t slabs_in_all = env_count / c.num_batches_per_epoch;
  const int64_t wanted = std::min(c.batch_size / slab_rows, slabs_in_all);
  int64_t slabs = wanted;
  while (slabs_in_all % slabs != 0) --slabs;
  if (2 * slabs < wanted)
    return Error{
        ErrorCode::kBadInput,
        "deterministic: batch_size is " + std::to_string(c.batch_size) + ", but one rollout of " + envs +
            " holds " + std::to_string(env_count * slab_rows) +
            " agent decisions, which it does not divide; set --num_workers and --num_envs_per_worker so "
            "that their product is a multiple of " +
            std::to_string(wanted) + ", or --batch_size " + std::to_string(slabs_in_all * slab_rows)};
  c.batch_size = slabs * slab_rows;
  return {};
}

/// Collects one Visitor-shaped pass over the names; `found` tells whether `key` was a setting or an alias.
Status set_one(RunConfig& config, const std::string& origin, const std::string& key,
               const std::string& text) {
  bool found = false;
  Status status;
  std::vector<std::string> known;
  visit_settings(config, [&](const char* name, auto& member, const char* /*help*/,
                             std::initializer_list<const char*> aliases) {
    known.emplace_back(name);
    known.insert(known.end(), aliases.begin(), aliases.end());
    if (found || (key != name && std::none_of(aliases.begin(), aliases.end(),
                                              [&key](const char* alias) { return key == alias; })))
      return;
    found = true;
    if (!parse_value(text, member))
      status = Error{ErrorCode::kBadInput, origin + ": " + key + " is '" + text + "'; it must be " +
                                               type_words<std::remove_reference_t<decltype(member)>>()};
  });
  if (found) return status;
  const std::string hint = did_you_mean(key, known);
  return Error{ErrorCode::kBadInput, origin + ": unknown setting '" + key + "'" +
                                         (hint.empty() ? "; `comrad train --help` lists them all" : hint)};
}

}  // namespace

Status apply_layer(RunConfig& config, const SettingsLayer& layer) {
  for (const auto& [key, text] : layer.values) COMRAD_TRY(set_one(config, layer.origin, key, text));
  settle_mixer(config);
  return {};
}

namespace {

/// Where the string that begins at text[at] ends: the place behind its last quote. One that is left open ends with
/// its line, or with the text where three quotes began it; toml++ reports it.
std::size_t end_of_toml_string(std::string_view text, std::size_t at) {
  const char quote = text[at];
  const std::string three(3, quote);
  const bool is_long = text.substr(at, 3) == three;
  for (std::size_t i = at + (is_long ? 3 : 1); i < text.size(); ++i) {
    if (text[i] == '\\' && quote == '"') {
      ++i;
    } else if (is_long ? text.substr(i, 3) == three : text[i] == quote) {
      return i + (is_long ? 3 : 1);
    } else if (text[i] == '\n' && !is_long) {
      return i;
    }
  }
  return text.size();
}

/// A key of thousands of parts makes as many tables in one another, and taking those down overflows the stack.
Status check_toml_depth(std::string_view text, const std::string& label) {
  constexpr int kPartsMax = 64;
  int dots = 0;
  std::size_t line = 1, line_begin = 0;
  const auto count_line = [&](std::size_t newline) { ++line, line_begin = newline + 1; };
  for (std::size_t i = 0; i < text.size();) {
    const char c = text[i];
    if (c == '"' || c == '\'') {
      const std::size_t end = end_of_toml_string(text, i);
      for (; i < end; ++i)
        if (text[i] == '\n') count_line(i);
      continue;
    }
    if (c == '#') {
      i = std::min(text.find('\n', i), text.size());
      continue;
    }
    if (c == '.' && ++dots > kPartsMax)
      return Error{ErrorCode::kBadFormat, label + ":" + std::to_string(line) + ":" +
                                              std::to_string(i - line_begin + 1) + ": a key of more than " +
                                              std::to_string(kPartsMax) + " parts"};
    if (std::string_view("=,[]{}\n").find(c) != std::string_view::npos) dots = 0;
    if (c == '\n') count_line(i);
    ++i;
  }
  return {};
}

/// toml++ 3.3 assumes, unchecked in release builds, that a table's header goes on with a key.
Status check_toml_headers(std::string_view text, const std::string& label) {
  const auto byte_at = [&](std::size_t i) { return static_cast<unsigned char>(text[i]); };
  const auto is_blank = [](unsigned char c) {
    return c <= ' ' || c >= 0x7F;
  };                     // some of these are blanks to toml++
  bool at_start = true;  // nothing but blanks since the line began
  std::size_t line = 1, line_begin = 0;
  for (std::size_t i = 0; i < text.size(); ++i) {
    const unsigned char c = byte_at(i);
    if (c == '\n') ++line, line_begin = i + 1;
    if (c == '\n' || c == '\r' || c == '\v' || c == '\f') at_start = true;
    if (is_blank(c)) continue;
    if (c == '[' && at_start) {
      std::size_t key = i + 1;
      const auto skip_blanks = [&] {
        while (key < text.size() && (text[key] == ' ' || text[key] == '\t')) ++key;
      };
      skip_blanks();
      if (key < text.size() && text[key] == '[') ++key;
      skip_blanks();
      const unsigned char first = key < text.size() ? byte_at(key) : 'x';  // the end: toml++ says so itself
      const bool is_key = (first >= 'a' && first <= 'z') || (first >= 'A' && first <= 'Z') ||
                          (first >= '0' && first <= '9') || first == '_' || first == '-' || first == '"' ||
                          first == '\'' || first == ']';
      if (!is_key)
        return Error{ErrorCode::kBadFormat,
                     label + ":" + std::to_string(line) + ":" + std::to_string(key - line_begin + 1) +
                         ": a table's name begins with a letter, a digit, '_', '-' or a quote"};
    }
    at_start = false;
  }
  return {};
}

}  // namespace

Status check_toml_text(std::string_view text, const std::string& label) {
  COMRAD_TRY(check_toml_depth(text, label));
  return check_toml_headers(text, label);
}

Expected<SettingsLayer> read_settings_toml(const std::string& path) {
  const Expected<std::string> words = read_short_file(path, kSettingsBytesMax);
  if (!words)
    return Error{words.error().code, words.error().message + "; give the path of a TOML file of settings"};
  SettingsLayer layer{path, {}};
  COMRAD_TRY(check_toml_text(*words, path));
  try {
    const toml::table document = toml::parse(*words, path);
    for (const auto& [key, node] : document) {
      std::optional<std::string> text = toml_scalar_text(node);
      if (!text)
        return Error{ErrorCode::kBadFormat, path + ":" + std::to_string(node.source().begin.line) + ":" +
                                                std::to_string(node.source().begin.column) + ": setting '" +
                                                std::string(key.str()) +
                                                "' is neither text, a number, true nor false"};
      layer.values.emplace_back(std::string(key.str()), *std::move(text));
    }
  } catch (const toml::parse_error& failure) {
    return Error{ErrorCode::kBadFormat, path + ":" + std::to_string(failure.source().begin.line) + ":" +
                                            std::to_string(failure.source().begin.column) + ": " +
                                            std::string(failure.description())};
  }
  return layer;
}

std::string settings_to_toml(const RunConfig& config) {
  std::string text;
  visit_settings(config, [&text](const char* name, const auto& member, const char* help,
                                 std::initializer_list<const char*> /*aliases*/) {
    using T = std::remove_cvref_t<decltype(member)>;
    std::string value;
    if constexpr (std::is_same_v<T, std::string>) value = toml_text(member);
    if constexpr (std::is_same_v<T, double>) value = real_text(member);
    if constexpr (std::is_same_v<T, int64_t>) value = std::to_string(member);
    if constexpr (std::is_same_v<T, bool>) value = member ? "true" : "false";
    text += "# " + std::string(help) + "\n" + name + " = " + value + "\n";
  });
  return text;
}

Expected<RunConfig> load_run_config(const std::string& path) {
  COMRAD_TRY_ASSIGN(const SettingsLayer layer, read_settings_toml(path));
  RunConfig config;
  COMRAD_TRY(apply_layer(config, layer));
  return config;
}

bool learns_q_values(const RunConfig& config) { return config.algo == "idqn" || mixes_q_values(config); }

bool mixes_q_values(const RunConfig& config) { return *mixer_of(config.algo) != '\0'; }

Status resolve_settings(RunConfig& config, int core_count) {
  RunConfig c = config;
  settle_mixer(c);
  COMRAD_TRY(algorithm_defaults(c.algo));
  COMRAD_TRY(check_ranges(c));
  COMRAD_TRY(check_combinations(c));
  // HAPPO makes a version per agent and one for the critic from every batch.
  if (c.max_policy_lag == 0) c.max_policy_lag = c.algo == "happo" ? 1000 * (c.num_agents + 1) : 1000;

  const int64_t cores = std::max(core_count, 1);
  if (c.num_workers == 0) c.num_workers = std::min<int64_t>(cores, 1024);
  c.worker_num_splits = std::min(c.worker_num_splits, c.num_envs_per_worker);
  // Two already on two cores: simulators and policy workers leave half a core idle (BENCHMARKS.md).
  if (c.learner_threads == 0)
    c.learner_threads = cores <= 4 ? std::min<int64_t>(cores, 2) : std::min<int64_t>(cores / 2, 16);
  const int64_t env_count = c.num_workers * c.num_envs_per_worker;
  const int64_t group_count = c.num_workers * c.worker_num_splits;
  if (c.policy_workers > group_count)
    return Error{ErrorCode::kBadInput,
                 "policy_workers is " + std::to_string(c.policy_workers) + "; only " +
                     std::to_string(group_count) +
                     " groups of environments (num_workers x worker_num_splits) could feed them"};

  // A third of the groups of a policy worker make a batch, as in Sample Factory; the deadline covers the
  // rest.
  const int64_t group_envs = (c.num_envs_per_worker + c.worker_num_splits - 1) / c.worker_num_splits;
  const int64_t served_envs = (env_count + c.policy_workers - 1) / c.policy_workers;
  if (c.min_batch == 0) c.min_batch = std::max<int64_t>(1, c.num_workers / c.policy_workers / 3) * group_envs;
  if (c.max_batch == 0) c.max_batch = std::max(c.min_batch, std::min<int64_t>(served_envs, 1024));
  if (c.max_batch < c.min_batch)
    return Error{ErrorCode::kBadInput, "max_batch is " + std::to_string(c.max_batch) +
                                           "; it must be at least min_batch (" + std::to_string(c.min_batch) +
                                           ")"};

  const int64_t slab_rows = c.rollout * c.num_agents;
  if (c.batch_size < slab_rows)
    return Error{ErrorCode::kBadInput, "batch_size is " + std::to_string(c.batch_size) +
                                           "; it must hold at least one trajectory of all agents, rollout " +
                                           std::to_string(c.rollout) + " x num_agents " +
                                           std::to_string(c.num_agents) + " = " + std::to_string(slab_rows)};
  c.batch_size -= c.batch_size % slab_rows;
  c.micro_batch_size = std::max(c.rollout, c.micro_batch_size - c.micro_batch_size % c.rollout);
  if (c.deterministic) {
    c.async_rl = false;
    COMRAD_TRY(resolve_deterministic_batches(c));
  }

  if (learns_q_values(c)) resolve_q_learning(c);

  // One slab in the hands of every environment, the batches that wait, one in training, and slack for the
  // moment between sealing and draining. In lock step a rollout is sealed while the next one may not begin
  // yet.
  const int64_t cycle_slabs = c.batch_size / slab_rows * c.num_batches_per_epoch;
  const int64_t least_slabs = c.deterministic ? env_count : std::max<int64_t>(cycle_slabs, 2);
  if (c.trajectory_slabs == 0) {
    // One in the making per environment, and the batches that may wait. More would only let the data grow
    // older.
    c.trajectory_slabs =
        c.deterministic ? 2 * env_count : env_count + c.num_batches_to_accumulate * cycle_slabs;
  }
  if (c.trajectory_slabs < least_slabs)
    return Error{ErrorCode::kBadInput, "trajectory_slabs is " + std::to_string(c.trajectory_slabs) +
                                           "; it must be at least " + std::to_string(least_slabs) +
                                           (c.deterministic ? ", one per environment" : ", one full batch") +
                                           ", or 0 for auto"};
  config = std::move(c);
  return {};
}

Expected<std::vector<int64_t>> parse_widths(const std::string& text) {
  std::vector<int64_t> widths;
  std::string_view rest = trimmed(text);
  if (rest == "none") return widths;
  while (!rest.empty()) {
    const std::size_t end = std::min(rest.find_first_of(", "), rest.size());
    int64_t width = 0;
    if (!parse_value(rest.substr(0, end), width) || width < 1 || width > 8192 || widths.size() == 8)
      return Error{ErrorCode::kBadInput,
                   "'" + text + "' must be none, or up to 8 widths between 1 and 8192 as 512,256"};
    widths.push_back(width);
    if (end < rest.size() && rest[end] == ',' && trimmed(rest.substr(end + 1)).empty())
      return Error{ErrorCode::kBadInput, "'" + text + "' ends in a comma"};
    rest = trimmed(rest.substr(std::min(end + 1, rest.size())));
  }
  return widths;
}

int64_t recurrent_state_count(const RunConfig& config) {
  if (!config.use_rnn) return 0;
  const int64_t core = config.rnn_num_layers * config.rnn_size * (config.rnn_type == "lstm" ? 2 : 1);
  return core * (config.algo == "happo" && config.happo_critic_rnn ? 2 : 1);
}

int64_t weights_bytes_limit(const RunConfig& config, int64_t num_agents, int64_t frame_bytes,
                            int64_t logits) {
  const auto widths_of = [](const std::string& text) {
    Expected<std::vector<int64_t>> widths = parse_widths(text);
    return widths ? *std::move(widths) : std::vector<int64_t>();
  };
  // Convolutions and the image layer with its 512 features stay below 16 MiB for every encoder at 128x72, and
  // in proportion to larger frames; all else is counted with inputs rounded up.
  constexpr int64_t kEncoderParameters = int64_t{4} << 20, kFrameBytes = 3 * 72 * 128;
  constexpr int64_t kInputsMax = 1024;  // image and measurement features, agent index
  int64_t tower = kEncoderParameters * std::max<int64_t>(1, (frame_bytes + kFrameBytes - 1) / kFrameBytes);
  int64_t features = kInputsMax;
  if (config.use_rnn)
    for (int64_t layer = 0; layer < config.rnn_num_layers; ++layer) {
      tower += 4 * config.rnn_size * (features + config.rnn_size + 2);
      features = config.rnn_size;
    }
  for (const int64_t width : widths_of(config.decoder_mlp_layers)) {
    tower += width * (features + 1);
    features = width;
  }
  tower += (logits + 1) * (features + 1);
  const bool separate = config.algo == "happo" || !config.share_parameters;
  const int64_t towers = (separate ? num_agents : 1) + (config.algo == "happo" ? num_agents : 0);
  int64_t critic = 0, inputs = std::max(features, kInputsMax) * num_agents;
  for (const int64_t width : widths_of(config.critic_hidden_sizes)) {
    critic += width * (inputs + 1);
    inputs = width;
  }
  critic += num_agents * (inputs + 1);
  const int64_t statistics = 2 * 8 * (frame_bytes + kInputsMax) + (int64_t{1} << 20);
  return 4 * (towers * tower + critic) + statistics;
}

std::string data_dir() {
  if (const char* home = std::getenv("COMRAD_HOME"); home != nullptr && *home != '\0') return home;
  return COMRAD_SOURCE_DIR;
}

}  // namespace comrad
