// Settings that take one word of a few: each is an enum, and the words that users write stand beside it, in the order of
// the enumerators. Stage: before a run.
#pragma once

#include <array>
#include <cstddef>
#include <string_view>

namespace comrad {

/// The words of an enum; specialised below for every enum that a setting has.
template <typename Enum>
struct Words;

/// The word that users write for `value`.
template <typename Enum>
constexpr const char* word_of(Enum value) {
  return Words<Enum>::words[static_cast<std::size_t>(value)];
}

enum class Preset { kPaper, kSmall, kGpu };
template <>
struct Words<Preset> {
  static constexpr std::array words = {"paper", "small", "gpu"};
};

/// What happens when the run exists already.
enum class RestartBehavior { kResume, kRestart, kOverwrite };
template <>
struct Words<RestartBehavior> {
  static constexpr std::array words = {"resume", "restart", "overwrite"};
};

enum class CheckpointKind { kLatest, kBest };
template <>
struct Words<CheckpointKind> {
  static constexpr std::array words = {"latest", "best"};
};

/// Which maps evaluations play: those that the run trains on, or others that no training pool shares.
enum class EvalMaps { kTrain, kHeldOut };
template <>
struct Words<EvalMaps> {
  static constexpr std::array words = {"train", "held_out"};
};

/// What draws views: a painter of our own, or OpenGL on the CPU or by a driver.
enum class RendererKind { kPainter, kOsmesa, kEgl };
template <>
struct Words<RendererKind> {
  static constexpr std::array words = {"painter", "osmesa", "egl"};
};

/// How a drawn view becomes a frame.
enum class Resize { kNone, kNearest, kArea };
template <>
struct Words<Resize> {
  static constexpr std::array words = {"none", "nearest", "area"};
};

/// How the agents' rewards become the team's.
enum class Scalarisation { kSum, kMean };
template <>
struct Words<Scalarisation> {
  static constexpr std::array words = {"sum", "mean"};
};

/// Of convolutions and matrix products.
enum class Precision { kFp32, kBf16, kAuto };
template <>
struct Words<Precision> {
  static constexpr std::array words = {"fp32", "bf16", "auto"};
};

/// How simulators reach a policy.
enum class LinkKind { kAuto, kShm, kDds };
template <>
struct Words<LinkKind> {
  static constexpr std::array words = {"auto", "shm", "dds"};
};

enum class RnnType { kGru, kLstm };
template <>
struct Words<RnnType> {
  static constexpr std::array words = {"gru", "lstm"};
};

/// What a central critic is shown for the value of one agent.
enum class CriticView { kOwnFirst, kPosition };
template <>
struct Words<CriticView> {
  static constexpr std::array words = {"own_first", "position"};
};

/// What the critic of a whole team is shown: its networks' features, or the world's true state beside them.
enum class CriticState { kFeatures, kGlobal };
template <>
struct Words<CriticState> {
  static constexpr std::array words = {"features", "global"};
};

enum class RateSchedule { kConstant, kLinearDecay, kKlAdaptiveMinibatch, kKlAdaptiveEpoch };
template <>
struct Words<RateSchedule> {
  static constexpr std::array words = {"constant", "linear_decay", "kl_adaptive_minibatch",
                                       "kl_adaptive_epoch"};
};
constexpr bool follows_kl(RateSchedule schedule) {
  return schedule == RateSchedule::kKlAdaptiveMinibatch || schedule == RateSchedule::kKlAdaptiveEpoch;
}

enum class ExplorationLoss { kSymmetricKl, kEntropy, kNone };
template <>
struct Words<ExplorationLoss> {
  static constexpr std::array words = {"symmetric_kl", "entropy", "none"};
};

enum class AgentOrder { kRandom, kFixed };
template <>
struct Words<AgentOrder> {
  static constexpr std::array words = {"random", "fixed"};
};

enum class TeamReward { kAuto, kSum, kMean };
template <>
struct Words<TeamReward> {
  static constexpr std::array words = {"auto", "sum", "mean"};
};

enum class Compress { kAuto, kTrue, kFalse };
template <>
struct Words<Compress> {
  static constexpr std::array words = {"auto", "true", "false"};
};

enum class QplexPreset { kComrad, kPaper };
template <>
struct Words<QplexPreset> {
  static constexpr std::array words = {"comrad", "paper"};
};

/// What draws from a layout pool.
enum class CurriculumKind { kUniform, kSequential, kLearningProgress, kOmni, kPlr };
template <>
struct Words<CurriculumKind> {
  static constexpr std::array words = {"uniform", "sequential", "learning_progress", "omni", "plr"};
};

enum class PlrScore { kMeanValueL1, kMeanAdvantage, kMeanEntropy };
template <>
struct Words<PlrScore> {
  static constexpr std::array words = {"mean_value_l1", "mean_advantage", "mean_entropy"};
};

enum class PlrTransform { kRank, kPower, kSoftmax, kMax, kEpsGreedy, kConstant };
template <>
struct Words<PlrTransform> {
  static constexpr std::array words = {"rank", "power", "softmax", "max", "eps_greedy", "constant"};
};

enum class PlrSchedule { kProportionate, kFixed };
template <>
struct Words<PlrSchedule> {
  static constexpr std::array words = {"proportionate", "fixed"};
};

}  // namespace comrad
