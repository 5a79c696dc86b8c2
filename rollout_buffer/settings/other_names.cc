#include "rollout_buffer/settings/other_names.h"

#include <algorithm>
#include <optional>

#include "rollout_buffer/core/text.h"
#include "rollout_buffer/settings/encoder_layers.h"
#include "rollout_buffer/settings/setting.h"

namespace comrad {
namespace {

/// "gru 256" as the settings that it stands for.
Status assign_core(RunConfig& config, const std::string& origin, std::string_view text) {
  const Expected<CoreText> core = parse_core(text);
  if (!core) return Error{core.error().code, origin + ": " + core.error().message};
  config.network.use_rnn = core->use_rnn;
  if (!core->use_rnn) return {};
  config.network.rnn_type = core->is_lstm ? RnnType::kLstm : RnnType::kGru;
  config.network.rnn_size = core->size;
  config.network.rnn_num_layers = core->layers;
  return {};
}

/// Epsilon was three settings, the ends of a line and its length, before it was a schedule.
enum class EpsilonPart { kStart, kEnd, kEnvFrames };
template <EpsilonPart part>
Status assign_epsilon(RunConfig& config, const std::string& origin, std::string_view text) {
  const std::optional<double> number = read_real(text);
  const bool is_length = part == EpsilonPart::kEnvFrames;
  if (!number || *number < 0 || *number > (is_length ? 1e15 : 1) || (is_length && *number == 0))
    return Error{ErrorCode::kBadInput, origin + ": " +
                                           (is_length ? "epsilon's env frames are '" : "epsilon is '") +
                                           std::string(text) + "'; it must be a number " +
                                           (is_length ? "above 0 and at most 1e15" : "between 0 and 1") +
                                           " (today --epsilon 1@0..0.01@2e7 sets all three)"};
  Schedule& epsilon = config.q_learning.epsilon;
  const Schedule::Point end = epsilon.is_constant()
                                  ? Schedule::Point{.value = epsilon.last(), .env_frames = 1}
                                  : epsilon.points().back();
  epsilon = Schedule::line(part == EpsilonPart::kStart ? *number : epsilon.at(0),
                           part == EpsilonPart::kEnd ? *number : end.value,
                           part == EpsilonPart::kEnvFrames ? *number : end.env_frames);
  return {};
}

/// The size of a replay's batch was three settings, one for each unit.
Status assign_replay_batch(RunConfig& config, const std::string& origin, std::string_view text) {
  return set(config, origin, "replay_batch_size", text);
}
constexpr OtherName replay_batch(std::string_view name, const AppliesWhen& applies_when) {
  return {.name = name,
          .assign = assign_replay_batch,
          .sets = {"replay_batch_size"},
          .applies_when = applies_when};
}

constexpr OtherName kOtherNames[] = {
    replay_batch("qmix_batch_sequences", with::sequences),
    replay_batch("qmix_sequence_batch_size", with::sequences),
    replay_batch("qmix_batch_joint_decisions", with::joint_decisions),
    replay_batch("qmix_buffer_batch_size", with::joint_decisions),
    replay_batch("dqn_batch_decisions", with::decisions_of_one),
    replay_batch("dqn_batch_size", with::decisions_of_one),
    {.name = "epsilon_start", .assign = assign_epsilon<EpsilonPart::kStart>, .sets = {"epsilon"}},
    {.name = "epsilon_end", .assign = assign_epsilon<EpsilonPart::kEnd>, .sets = {"epsilon"}},
    {.name = "epsilon_decay_env_frames",
     .assign = assign_epsilon<EpsilonPart::kEnvFrames>,
     .sets = {"epsilon"}},
    {.name = "epsilon_decay_steps", .assign = assign_epsilon<EpsilonPart::kEnvFrames>, .sets = {"epsilon"}},
    {.name = "value_bootstrap", .is_boolean = true, .setting = "legacy_timeouts"},
    {.name = "core", .assign = assign_core, .sets = {"use_rnn", "rnn_type", "rnn_size", "rnn_num_layers"}},
    {.name = "env_framestack",
     .same = "1",
     .instead = "frames are not stacked; agents remember by their recurrent core (--use_rnn, --rnn_type, "
                "--rnn_size)"},
    {.name = "recurrence",
     .same = "-1",
     .instead = "gradients run through the whole trajectory; its length is --rollout"},
    {.name = "nonlinearity", .same = "elu", .instead = "all layers are followed by ELU; leave it out"},
    {.name = "optimizer",
     .same = "adam",
     .instead = "Adam is the one optimizer (--learning_rate, --adam_eps, --adam_beta1, --adam_beta2)"},
    {.name = "with_wandb",
     .is_boolean = true,
     .same = "false 0",
     .instead = "leave it out; at any time `comrad export RUN` makes W&B's offline folder of what the run "
                "has written "
                "into its metrics.jsonl, and `wandb sync` uploads that (comrad help export)"},
    {.name = "num_policies",
     .same = "1",
     .instead = "a run trains one team; start one run for each --seed. Separate networks for the agents of a "
                "team: --share_parameters=False"},
    {.name = "with_pbt",
     .is_boolean = true,
     .same = "false 0",
     .instead =
         "a run trains one team; `comrad sweep` with [search] and method = \"pbt\" trains a population "
         "(deploy/SWEEPS.md)"},
    {.name = "batched_sampling",
     .is_boolean = true,
     .same = "false true 0 1",
     .instead =
         "observations of many environments make one inference batch in any case (--min_batch, --max_batch)"},
    {.name = "actor_critic_share_weights",
     .is_boolean = true,
     .same = "true 1",
     .instead = "ippo's policy and value share one network; --algo mappo and happo have their own critic"},
    {.name = "policy_initialization",
     .same = "orthogonal",
     .instead = "weights begin orthogonal (--policy_init_gain)"},
    {.name = "encoder_mlp_layers",
     .instead = "observations are pictures (--encoder); measurements join them with "
                "--use_additional_input"},
    {.name = "encoder_conv_mlp_layers",
     .same = "512",
     .instead = "the width after the convolutions belongs to --encoder; layers after the core: "
                "--decoder_mlp_layers"},
    {.name = "obs_subtract_mean",
     .same = "0 0.0",
     .instead = "pixels are brought to mean 0 by --normalize_input"},
    {.name = "obs_scale",
     .same = "1 1.0",
     .instead = "pixels are brought to deviation 1 by --normalize_input"},
    {.name = "summaries_use_frameskip",
     .is_boolean = true,
     .same = "true 1",
     .instead = "summaries count env frames; metrics.jsonl has decisions beside them"},
    {.name = "save_best_metric",
     .same = "score",
     .instead = "the best checkpoint is the one with the highest score J"},
    {.name = "res_w",
     .same = "128",
     .instead = "frames are 128x72; the size they are drawn at is --render_size"},
    {.name = "res_h",
     .same = "72",
     .instead = "frames are 128x72; the size they are drawn at is --render_size"},
};

}  // namespace

Status OtherName::accept(const std::string& origin, std::string_view text) const {
  const std::string given = lower_case(trimmed(text));
  std::string_view rest = same;
  while (!rest.empty()) {
    const std::size_t end = std::min(rest.find(' '), rest.size());
    if (rest.substr(0, end) == given) return {};
    rest.remove_prefix(std::min(end + 1, rest.size()));
  }
  return Error{ErrorCode::kBadInput,
               origin + ": " + std::string(name) + " " + std::string(text) + ": " + std::string(instead)};
}

std::span<const OtherName> other_names() { return kOtherNames; }

const OtherName* find_other_name(std::string_view name) {
  const auto* const found = std::ranges::find(kOtherNames, name, &OtherName::name);
  return found == std::end(kOtherNames) ? nullptr : found;
}

}  // namespace comrad
