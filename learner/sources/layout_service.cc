#include "learner/sources/layout_service.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>
#include <optional>

#include "policy_workers/device/torch_ops.h"
#include "policy_workers/network/action_heads.h"
#include "rollout_buffer/core/check.h"
#include "rollout_buffer/core/files.h"
#include "rollout_buffer/core/rng.h"
#include "rollout_buffer/core/text.h"
#include "rollout_buffer/shm/episode_stream.h"
#include "rollout_buffer/shm/layout_mailbox.h"

namespace comrad::learn {
namespace {

constexpr int64_t kMailboxFields = 4;  // taken, playing, granted, layout

}  // namespace

Expected<std::map<std::string, std::set<std::string>>> read_interestingness_graph(const std::string& path) {
  const std::optional<std::string> text = read_file(path);
  if (!text) return Error{ErrorCode::kNotFound, path + ": cannot be read"};
  nlohmann::json graph;
  try {  // nlohmann throws with line and column; nothing of it leaves this block
    graph = nlohmann::json::parse(*text);
  } catch (const nlohmann::json::parse_error& error) {
    return Error{ErrorCode::kBadFormat, path + ": " + error.what()};
  }
  const auto bad = [&](const std::string& what) { return Error{ErrorCode::kBadFormat, path + ": " + what}; };
  if (!graph.is_object()) return bad("is no JSON object of layouts");
  std::map<std::string, std::set<std::string>> uninteresting;
  for (const auto& [layout, row] : graph.items()) {
    if (!row.is_object()) return bad("'" + layout + "' needs an object: other layout -> true or false");
    for (const auto& [other, interesting] : row.items()) {
      if (!interesting.is_boolean() && !interesting.is_number_integer())
        return bad("'" + layout + "' states neither true nor false about '" + other + "'");
      const bool is = interesting.is_boolean() ? interesting.get<bool>() : interesting.get<int64_t>() != 0;
      if (!is) uninteresting[layout].insert(other);
    }
  }
  return uninteresting;
}

Expected<CurriculumOptions> curriculum_options(const RunConfig& config, const LayoutList& list) {
  CurriculumOptions options;
  options.kind = config.curriculum.curriculum;
  options.seed = RngKey(static_cast<uint64_t>(config.run.seed)).split("curriculum").bits();
  options.threshold = config.curriculum.seq_threshold;
  options.window = static_cast<int>(config.curriculum.seq_window);
  options.min_outcomes = static_cast<int>(config.curriculum.seq_min_outcomes);
  options.p_theta = config.curriculum.lp_p_theta;
  options.min_return = config.curriculum.lp_min_return;
  options.uniform_prob = config.curriculum.lp_uniform_prob;
  // Two settings, one for each family of strategies. 0: what each layout allows; a score that a setting names
  // counts for all of them. What a published stage is divided by goes before either.
  options.max_return = config.curriculum.curriculum == CurriculumKind::kSequential
                           ? config.curriculum.seq_max_return
                           : config.curriculum.lp_max_return;
  const bool needs_maximum = config.curriculum.curriculum == CurriculumKind::kSequential ||
                             config.curriculum.curriculum == CurriculumKind::kLearningProgress ||
                             config.curriculum.curriculum == CurriculumKind::kOmni;
  const bool is_set = options.max_return != 0;
  for (const LayoutEntry& layout : list.layouts) {
    const double best = layout.metric_scale > 0 ? layout.metric_scale : is_set ? 0.0 : layout.ceiling;
    if (needs_maximum && !is_set && !(best > 0))
      return Error{
          ErrorCode::kBadInput,
          std::string(config.curriculum.curriculum == CurriculumKind::kSequential ? "seq_max_return"
                                                                                  : "lp_max_return") +
              " is 0, and layout " + layout.id + " of scenario " + config.run.scenario +
              " has no ceiling; give the best possible score"};
    if (needs_maximum && config.curriculum.curriculum != CurriculumKind::kSequential && best > 0 &&
        !(best > options.min_return))
      return Error{ErrorCode::kBadInput, "lp_min_return is " + real_text(options.min_return) +
                                             "; it must be below the ceiling of layout " + layout.id + ", " +
                                             real_text(best)};
    options.task_scale.push_back(best);
    if (!is_set) options.max_return = std::max(options.max_return, best);
  }
  if (!needs_maximum) options.max_return = options.min_return + 1.0;
  if (config.curriculum.curriculum == CurriculumKind::kSequential)
    options.min_return = std::min(options.min_return, 0.0);
  options.omni_mastery = config.curriculum.omni_mastery;
  options.max_score_coef = config.curriculum.plr_max_score_coef;
  options.alpha = config.curriculum.plr_alpha;
  options.temperature = config.curriculum.plr_temperature;
  options.transform = config.curriculum.plr_score_transform;
  options.staleness_coef = config.curriculum.plr_staleness_coef;
  options.staleness_temperature = config.curriculum.plr_staleness_temperature;
  options.staleness_transform = config.curriculum.plr_staleness_transform;
  options.proportionate = config.curriculum.plr_replay_schedule == PlrSchedule::kProportionate;
  options.replay_prob = config.curriculum.plr_replay_prob;
  options.rho = config.curriculum.plr_rho;
  options.eps = config.curriculum.plr_eps;
  if (config.curriculum.curriculum != CurriculumKind::kOmni) return options;
  const std::string& graph = config.curriculum.interestingness_graph_path.empty()
                                 ? list.interestingness_graph
                                 : config.curriculum.interestingness_graph_path;
  if (graph.empty()) return options;
  COMRAD_TRY_ASSIGN(options.uninteresting, read_interestingness_graph(graph));
  std::set<std::string> known;
  for (const LayoutEntry& layout : list.layouts) known.insert(layout.id);
  for (const auto& [layout, row] : options.uninteresting) {
    std::vector<std::string> named(row.begin(), row.end());
    named.push_back(layout);
    for (const std::string& name : named) {
      if (known.contains(name)) continue;
      return Error{ErrorCode::kBadInput, graph + ": '" + name + "' is no layout of the pool" +
                                             did_you_mean(name, {known.begin(), known.end()})};
    }
  }
  return options;
}

std::vector<LayoutSignal> layout_signals(const RolloutBatch& batch, PlrScore score_key, int layout_count) {
  torch::NoGradGuard no_grad;
  Tensor signal;
  if (score_key == PlrScore::kMeanEntropy)
    signal = policy::entropy(policy::head_log_probs(batch.logits, batch.mask_or_undefined(), batch.shape.env),
                             batch.shape.env);
  else if (batch.raw_advantage.defined())  // `advantage` has no unit any more where it was standardised
    signal = score_key == PlrScore::kMeanAdvantage ? batch.raw_advantage : batch.raw_advantage.abs();
  if (!signal.defined()) return {};
  signal = signal.to(torch::kCPU, torch::kFloat32).contiguous();
  const Tensor acting = batch.acting(), layout_index = batch.layout_index.contiguous();
  COMRAD_CHECK(signal.numel() == acting.numel(), "one number for each decision");
  const float* value = signal.data_ptr<float>();
  const uint8_t* counts = acting.data_ptr<uint8_t>();
  const int32_t* of = layout_index.data_ptr<int32_t>();

  std::map<int, LayoutSignal> found;
  for (int64_t i = 0; i < acting.numel(); ++i) {
    if (counts[i] == 0 || of[i] < 0 || of[i] >= layout_count || !std::isfinite(value[i])) continue;
    LayoutSignal& one =
        found.try_emplace(of[i], LayoutSignal{of[i], 0, 0.0, -std::numeric_limits<double>::infinity()})
            .first->second;
    ++one.decisions;
    one.mean += value[i];
    one.maximum = std::max(one.maximum, static_cast<double>(value[i]));
  }
  std::vector<LayoutSignal> signals;
  for (auto& [index, one] : found) {
    one.mean /= static_cast<double>(one.decisions);
    signals.push_back(one);
  }
  return signals;
}

std::vector<LayoutSignal> of_all_ranks(const std::vector<LayoutSignal>& signals, RankGroup& ranks) {
  if (ranks.is_alone()) return signals;
  Tensor table = torch::empty({static_cast<int64_t>(signals.size()), 4}, torch::kFloat64);
  double* out = table.data_ptr<double>();
  for (const LayoutSignal& one : signals)
    for (const double number :
         {static_cast<double>(one.layout_index), static_cast<double>(one.decisions), one.mean, one.maximum})
      *out++ = number;
  const Tensor all = ranks.gather_rows(table);
  std::map<int, LayoutSignal> found;
  const double* row = all.data_ptr<double>();
  for (int64_t i = 0; i < all.size(0); ++i, row += 4) {
    const LayoutSignal part{static_cast<int>(row[0]), static_cast<int64_t>(row[1]), row[2], row[3]};
    const auto [place, is_new] = found.try_emplace(part.layout_index, part);
    if (is_new) continue;
    LayoutSignal& one = place->second;
    const auto before = static_cast<double>(one.decisions), more = static_cast<double>(part.decisions);
    one.mean = (one.mean * before + part.mean * more) / (before + more);
    one.decisions += part.decisions;
    one.maximum = std::max(one.maximum, part.maximum);
  }
  std::vector<LayoutSignal> merged;
  for (const auto& [index, one] : found) merged.push_back(one);
  return merged;
}

Expected<std::unique_ptr<LayoutService>> LayoutService::open(const RunConfig& config,
                                                             const std::string& run_dir) {
  if (config.environment.layout_pool.empty()) return std::unique_ptr<LayoutService>();
  COMRAD_TRY_ASSIGN(const LayoutList list, read_layout_list(run_dir));
  COMRAD_TRY_ASSIGN(const CurriculumOptions options, curriculum_options(config, list));
  std::vector<std::string> names;
  for (const LayoutEntry& layout : list.layouts) names.push_back(layout.id);
  COMRAD_TRY_ASSIGN(std::unique_ptr<Curriculum> curriculum, Curriculum::create(options, std::move(names)));
  return std::unique_ptr<LayoutService>(
      new LayoutService(std::move(curriculum), config.curriculum.curriculum == CurriculumKind::kPlr
                                                   ? std::optional(config.curriculum.plr_score_key)
                                                   : std::nullopt));
}

void LayoutService::serve(const shm::Arena& arena) {
  const auto known = static_cast<uint32_t>(curriculum_->task_count());
  late_draws_ = 0;
  std::vector<EpisodeRecord> ended;
  while (const auto record = arena.episodes().read(shm::EpisodeReader::kCurriculum)) ended.push_back(*record);
  // Of the episodes of one simulator timing chooses the order; in this one a run in lock step repeats itself.
  std::ranges::stable_sort(ended, {}, &EpisodeRecord::env_index);
  for (const EpisodeRecord& record : ended)
    if (record.layout_index < known && std::isfinite(record.score))
      curriculum_->update(static_cast<int>(record.layout_index), record.score);
  lost_outcomes_ = arena.episodes().lost(shm::EpisodeReader::kCurriculum);
  // Outcomes first, assignments then: all draws of one round see the same weights.
  for (int env = 0; env < arena.shape().env_count(); ++env) {
    shm::LayoutMailbox& mailbox = arena.layout_mailboxes().of(env);
    late_draws_ += mailbox.late.load(std::memory_order_relaxed);
    if (mailbox.is_due()) mailbox.assign(static_cast<uint32_t>(curriculum_->draw()));
  }
}

void LayoutService::score(const RolloutBatch& batch, RankGroup& ranks) {
  if (!score_key_) return;
  for (const LayoutSignal& signal :
       of_all_ranks(layout_signals(batch, *score_key_, curriculum_->task_count()), ranks))
    curriculum_->score(signal.layout_index, signal.decisions, signal.mean, signal.maximum);
}

void LayoutService::append_to(std::vector<std::pair<std::string, double>>& metrics) {
  for (const auto& [name, value] : curriculum_->metrics()) metrics.emplace_back("curriculum/" + name, value);
  metrics.emplace_back("curriculum/late_draws", static_cast<double>(late_draws_));
  metrics.emplace_back("curriculum/lost_outcomes", static_cast<double>(lost_outcomes_));
}

void LayoutService::capture_mailboxes(const shm::Arena& arena, bool exact) {
  mailboxes_.clear();
  if (!exact) return;
  for (int env = 0; env < arena.shape().env_count(); ++env) {
    const shm::LayoutMailbox& mailbox = arena.layout_mailboxes().of(env);
    for (const std::atomic<uint32_t>* field :
         {&mailbox.taken, &mailbox.playing, &mailbox.assigned, &mailbox.layout_index})
      mailboxes_.push_back(field->load());
  }
}

Status LayoutService::restore_mailboxes(const shm::Arena& arena) const {
  if (mailboxes_.empty()) return {};
  const auto env_count = static_cast<int64_t>(mailboxes_.size()) / kMailboxFields;
  if (env_count != arena.shape().env_count())
    return Error{ErrorCode::kBadFormat,
                 fmt::format("the checkpoint holds the layouts of {} environments, this run has {}",
                             env_count, arena.shape().env_count())};
  const auto known = static_cast<int64_t>(curriculum_->task_count());
  for (int env = 0; env < arena.shape().env_count(); ++env) {
    const int64_t* field = mailboxes_.data() + env * kMailboxFields;
    if (field[1] < 0 || field[1] >= known || field[3] < 0 || field[3] >= known)
      return Error{
          ErrorCode::kBadFormat,
          fmt::format("the checkpoint's environment {} plays a layout that is not in the pool", env)};
    shm::LayoutMailbox& mailbox = arena.layout_mailboxes().of(env);
    mailbox.taken.store(static_cast<uint32_t>(field[0]));
    mailbox.playing.store(static_cast<uint32_t>(field[1]));
    mailbox.assigned.store(static_cast<uint32_t>(field[2]));
    mailbox.layout_index.store(static_cast<uint32_t>(field[3]));
  }
  return {};
}

void LayoutService::save(StateDict& state) const {
  state.put("curriculum/state", curriculum_->state());
  if (mailboxes_.empty()) return;
  const auto env_count = static_cast<int64_t>(mailboxes_.size()) / kMailboxFields;
  state.put("curriculum/desks", torch::tensor(mailboxes_, torch::kInt64).view({env_count, kMailboxFields}));
}

Status LayoutService::load(const StateDict& state) {
  if (!is_in(state))
    return Error{
        ErrorCode::kBadInput,
        "the checkpoint holds no curriculum: its run played without --layout_pool; leave that out, or "
        "start another --experiment"};
  COMRAD_TRY_ASSIGN(const std::string text, state.text("curriculum/state"));
  COMRAD_TRY(curriculum_->restore(text));
  mailboxes_.clear();
  if (!state.has("curriculum/desks")) return {};
  COMRAD_TRY_ASSIGN(const torch::Tensor saved, state.tensor("curriculum/desks"));
  if (saved.dim() != 2 || saved.size(1) != kMailboxFields || saved.scalar_type() != torch::kInt64)
    return Error{ErrorCode::kBadFormat,
                 "the checkpoint's curriculum/desks has another shape than this build writes"};
  const torch::Tensor dense = saved.contiguous();
  mailboxes_.assign(dense.data_ptr<int64_t>(), dense.data_ptr<int64_t>() + dense.numel());
  return {};
}

Status LayoutService::write_file(const std::string& run_dir) const {
  return write_file_atomically(run_dir + "/curriculum_state.json", curriculum_->state() + "\n",
                               /*durable=*/false);
}

}  // namespace comrad::learn
