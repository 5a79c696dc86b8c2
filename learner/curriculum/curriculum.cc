#include "learner/curriculum/curriculum.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <numeric>

#include "rollout_buffer/core/check.h"
#include "rollout_buffer/core/rng.h"

namespace comrad::learn {
namespace {

using Json = nlohmann::ordered_json;
using Arrays = std::vector<std::pair<std::string, std::vector<double>*>>;
constexpr int kFormat = 1;

/// Makes the weights sum to 1; uniform where they are all 0.
void normalise(std::vector<double>& weights) {
  const double sum = std::accumulate(weights.begin(), weights.end(), 0.0);
  for (double& w : weights) w = sum > 0.0 ? w / sum : 1.0 / static_cast<double>(weights.size());
}

/// An index with probability proportional to its weight; never one of weight 0.
int pick(std::span<const double> weights, double uniform) {
  const double sum = std::accumulate(weights.begin(), weights.end(), 0.0);
  double rest = uniform * sum;
  int last = 0;
  for (std::size_t i = 0; i < weights.size(); ++i) {
    if (weights[i] <= 0.0) continue;
    last = static_cast<int>(i);
    if (rest < weights[i]) return last;
    rest -= weights[i];
  }
  return last;
}

class Uniform final : public Curriculum {
 public:
  using Curriculum::Curriculum;
  Uniform(const CurriculumOptions& options, std::vector<std::string> names)
      : Curriculum(options, std::move(names)) {}

 private:
  void record(int, double) override {}
  Arrays arrays() override { return {}; }
};

/// One task after the other, as soon as the mean of its outcomes reaches the threshold.
class Sequential final : public Curriculum {
 public:
  Sequential(const CurriculumOptions& options, std::vector<std::string> names)
      : Curriculum(options, std::move(names)) {
    Sequential::refresh();
  }

 private:
  void record(int task, double outcome) override {
    if (task != position()) return;
    outcomes_.push_back(outcome);
    if (static_cast<int>(outcomes_.size()) > options_.window) outcomes_.erase(outcomes_.begin());
    const double mean = std::accumulate(outcomes_.begin(), outcomes_.end(), 0.0) /
                        static_cast<double>(outcomes_.size()) /
                        std::max(maximum(static_cast<std::size_t>(task)), 1e-6);
    if (static_cast<int>(outcomes_.size()) >= std::min(options_.window, options_.min_outcomes) &&
        mean >= options_.threshold && position() < task_count() - 1) {
      position_[0] += 1.0;
      outcomes_.clear();
    }
  }
  void refresh() override {
    std::fill(weights_.begin(), weights_.end(), 0.0);
    weights_[position()] = 1.0;
  }
  void strategy_metrics(std::vector<std::pair<std::string, double>>& metrics) const override {
    metrics.emplace_back("position", position_[0]);
  }
  Arrays arrays() override { return {{"position", &position_}, {"outcomes", &outcomes_}}; }
  int position() const { return static_cast<int>(std::clamp(position_[0], 0.0, task_count() - 1.0)); }

  std::vector<double> position_{0.0}, outcomes_;
};

/// Tasks whose success rate moves get more weight; OMNI leaves out what is boring.
class LearningProgress final : public Curriculum {
 public:
  LearningProgress(const CurriculumOptions& options, std::vector<std::string> names)
      : Curriculum(options, std::move(names)),
        fast_(task_names_.size()),
        slow_(task_names_.size()),
        raw_(task_names_.size()),
        seen_(task_names_.size()) {}

 private:
  void record(int task, double outcome) override {
    const double span = maximum(static_cast<std::size_t>(task)) - options_.min_return, a = options_.smoothing;
    const double p = std::clamp((outcome - options_.min_return) / (span > 0.0 ? span : 1.0), 0.0, 1.0);
    if (seen_[task] == 0.0) {
      fast_[task] = slow_[task] = p;
      raw_[task] = outcome;
      seen_[task] = 1.0;
      return;
    }
    fast_[task] = a * p + (1.0 - a) * fast_[task];
    slow_[task] = a * fast_[task] + (1.0 - a) * slow_[task];
    raw_[task] = a * outcome + (1.0 - a) * raw_[task];
  }
  void refresh() override {
    const std::size_t n = weights_.size();
    if (std::count(seen_.begin(), seen_.end(), 0.0) > 0) {
      std::fill(weights_.begin(), weights_.end(), 1.0 / static_cast<double>(n));
      return;
    }
    std::vector<double> progress(n);
    std::vector<std::size_t> eligible;
    for (std::size_t k = 0; k < n; ++k) {
      progress[k] = std::abs(learning_progress_reweight(fast_[k], options_.p_theta) -
                             learning_progress_reweight(slow_[k], options_.p_theta));
      if (progress[k] > 0.0 || fast_[k] > 0.0) eligible.push_back(k);
    }
    if (eligible.empty())
      for (std::size_t k = 0; k < n; ++k) eligible.push_back(k);
    double mean = 0.0, variance = 0.0;
    for (const std::size_t k : eligible) mean += progress[k] / static_cast<double>(eligible.size());
    for (const std::size_t k : eligible)
      variance += (progress[k] - mean) * (progress[k] - mean) / static_cast<double>(eligible.size());
    const double deviation = variance > 0.0 ? std::sqrt(variance) : 1.0;
    std::fill(weights_.begin(), weights_.end(), 0.0);
    for (const std::size_t k : eligible)
      weights_[k] = 1.0 / (1.0 + std::exp(-(progress[k] - mean) / deviation));
    normalise(weights_);
    for (double& w : weights_)
      w = (1.0 - options_.uniform_prob) * w + options_.uniform_prob / static_cast<double>(n);
    normalise(weights_);
    if (options_.kind == CurriculumKind::kOmni) leave_out_what_is_boring();
  }
  void leave_out_what_is_boring() {
    const std::size_t n = weights_.size();
    std::vector<std::size_t> order(n);
    std::iota(order.begin(), order.end(), std::size_t{0});
    const auto scaled = [&](std::size_t k) {
      return k < options_.task_scale.size() && options_.task_scale[k] > 0.0 ? raw_[k] / options_.task_scale[k]
                                                                            : raw_[k];
    };
    std::stable_sort(order.begin(), order.end(),
                     [&](std::size_t a, std::size_t b) { return scaled(a) > scaled(b); });
    enum : char { kOpen, kInteresting, kBoring };
    std::vector<char> sort(n, kOpen);
    for (const std::size_t k : order) {
      if (sort[k] != kOpen) continue;
      sort[k] = kInteresting;
      if (raw_[k] < options_.omni_mastery * maximum(k)) continue;  // not mastered: not informative yet
      const auto row = options_.uninteresting.find(task_names_[k]);
      if (row == options_.uninteresting.end()) continue;
      for (std::size_t other = 0; other < n; ++other)
        if (sort[other] == kOpen && row->second.contains(task_names_[other])) sort[other] = kBoring;
    }
    for (std::size_t k = 0; k < n; ++k)
      if (sort[k] == kBoring) weights_[k] *= options_.boring_factor;
    normalise(weights_);
  }
  void strategy_metrics(std::vector<std::pair<std::string, double>>& metrics) const override {
    double progress = 0.0, score = 0.0;
    for (std::size_t k = 0; k < fast_.size(); ++k) {
      progress += std::abs(learning_progress_reweight(fast_[k], options_.p_theta) -
                           learning_progress_reweight(slow_[k], options_.p_theta));
      score += raw_[k];
    }
    metrics.emplace_back("learning_progress", progress / static_cast<double>(fast_.size()));
    metrics.emplace_back("raw_score", score / static_cast<double>(fast_.size()));
  }
  Arrays arrays() override { return {{"fast", &fast_}, {"slow", &slow_}, {"raw", &raw_}, {"seen", &seen_}}; }

  std::vector<double> fast_, slow_, raw_, seen_;
};

/// Replays tasks on which the learner's estimates are worst, among those it was scored on.
class PrioritizedReplay final : public Curriculum {
 public:
  PrioritizedReplay(const CurriculumOptions& options, std::vector<std::string> names)
      : Curriculum(options, std::move(names)),
        score_(task_names_.size()),
        steps_(task_names_.size()),
        staleness_(task_names_.size()),
        seen_(task_names_.size()) {}

  void score(int task, int64_t steps, double mean, double maximum) override {
    COMRAD_CHECK(task >= 0 && task < task_count(), "a score names a task of the pool");
    const double q = options_.max_score_coef * maximum + (1.0 - options_.max_score_coef) * mean;
    score_[task] = (1.0 - options_.alpha) * score_[task] + options_.alpha * q;
    steps_[task] += static_cast<double>(steps);
    seen_[task] = 1.0;
  }

 private:
  void record(int, double) override {}
  int draw_from(uint64_t draw_seed) override {
    Rng rng(draw_seed);
    const double n = static_cast<double>(task_count());
    const double v = std::accumulate(seen_.begin(), seen_.end(), 0.0) / n;
    const bool none_unseen = v == 1.0;
    bool replay = none_unseen;
    if (v >= options_.rho) {
      const double uniform = rng.uniform();
      const double probability = options_.proportionate ? std::min(v, options_.replay_prob)
                                                        : (none_unseen ? 1.0 : options_.replay_prob);
      replay = none_unseen || uniform < probability;
    }
    int task = 0;
    if (replay) {
      mix(draw_seed);
      task = pick(weights_, rng.uniform());
    } else {
      std::vector<double> unseen;
      for (const double s : seen_) unseen.push_back(1.0 - s);
      task = pick(unseen, rng.uniform());
    }
    for (double& c : staleness_) c += 1.0;
    staleness_[task] = 0.0;
    return task;
  }
  void refresh() override { mix(counter_); }
  void mix(uint64_t draw_seed) {
    const std::vector<double> by_score = plr_weights(score_, seen_, options_.transform, options_.temperature,
                                                     options_.eps, options_.staleness_coef, draw_seed);
    const std::vector<double> by_staleness =
        plr_weights(staleness_, seen_, options_.staleness_transform, options_.staleness_temperature,
                    options_.eps, options_.staleness_coef, draw_seed + 1);
    for (std::size_t k = 0; k < weights_.size(); ++k)
      weights_[k] = (1.0 - options_.staleness_coef) * by_score[k] + options_.staleness_coef * by_staleness[k];
    normalise(weights_);
  }
  void strategy_metrics(std::vector<std::pair<std::string, double>>& metrics) const override {
    const double n = static_cast<double>(task_count());
    metrics.emplace_back("score", std::accumulate(score_.begin(), score_.end(), 0.0) / n);
    metrics.emplace_back("staleness", std::accumulate(staleness_.begin(), staleness_.end(), 0.0) / n);
    metrics.emplace_back("seen", std::accumulate(seen_.begin(), seen_.end(), 0.0) / n);
  }
  Arrays arrays() override {
    return {{"score", &score_}, {"steps", &steps_}, {"staleness", &staleness_}, {"seen", &seen_}};
  }

  std::vector<double> score_, steps_, staleness_, seen_;
};

}  // namespace

double learning_progress_reweight(double p, double theta) {
  const double denominator = p + theta * (1.0 - 2.0 * p);
  return denominator != 0.0 ? p * (1.0 - theta) / denominator : 0.0;
}

std::vector<double> plr_weights(std::span<const double> value, std::span<const double> seen,
                                PlrTransform transform, double temperature, double eps, double staleness_coef,
                                uint64_t draw_seed) {
  const std::size_t n = value.size();
  std::vector<double> weights(n, 0.0);
  std::vector<std::size_t> known;
  for (std::size_t k = 0; k < n; ++k)
    if (seen[k] != 0.0) known.push_back(k);
  if (known.empty()) return std::vector<double>(n, 1.0 / static_cast<double>(n));
  const auto best_value = [&] {
    double best = value[known[0]];
    for (const std::size_t k : known) best = std::max(best, value[k]);
    return best;
  };
  switch (transform) {
    case PlrTransform::kRank: {
      std::vector<std::size_t> order(n);
      std::iota(order.begin(), order.end(), std::size_t{0});
      std::stable_sort(order.begin(), order.end(),
                       [&](std::size_t a, std::size_t b) { return value[a] > value[b]; });
      for (std::size_t rank = 0; rank < n; ++rank)
        weights[order[rank]] = std::pow(1.0 / static_cast<double>(rank + 1), 1.0 / temperature);
      break;
    }
    case PlrTransform::kPower:
      for (std::size_t k = 0; k < n; ++k)
        weights[k] =
            std::pow(std::max(value[k], 0.0) + (staleness_coef == 0.0 ? 1e-3 : 0.0), 1.0 / temperature);
      break;
    case PlrTransform::kSoftmax: {
      const double best = best_value();
      for (std::size_t k = 0; k < n; ++k) weights[k] = std::exp((value[k] - best) / temperature);
      break;
    }
    case PlrTransform::kMax:
    case PlrTransform::kEpsGreedy: {
      const double best = best_value();
      std::vector<std::size_t> at_best;
      for (const std::size_t k : known)
        if (value[k] == best) at_best.push_back(k);
      Rng rng(RngKey(draw_seed).split("ties"));
      const std::size_t chosen = at_best[rng.below(static_cast<uint32_t>(at_best.size()))];
      const bool greedy = transform == PlrTransform::kEpsGreedy;
      weights[chosen] = greedy ? 1.0 - eps : 1.0;
      if (greedy)
        for (double& w : weights) w += eps / static_cast<double>(n);
      break;
    }
    case PlrTransform::kConstant:
      std::fill(weights.begin(), weights.end(), 1.0);
      break;
  }
  double sum = 0.0;
  for (std::size_t k = 0; k < n; ++k) sum += weights[k] *= seen[k];
  if (sum > 0.0)
    for (double& w : weights) w /= sum;
  else
    for (const std::size_t k : known) weights[k] = 1.0 / static_cast<double>(known.size());
  return weights;
}

Curriculum::Curriculum(const CurriculumOptions& options, std::vector<std::string> task_names)
    : options_(options),
      task_names_(std::move(task_names)),
      weights_(task_names_.size(), 1.0 / static_cast<double>(task_names_.size())),
      counts_(task_names_.size()),
      means_(task_names_.size()) {}

Expected<std::unique_ptr<Curriculum>> Curriculum::create(const CurriculumOptions& options,
                                                         std::vector<std::string> task_names) {
  const auto bad = [](const std::string& what) { return Error{ErrorCode::kBadInput, "curriculum: " + what}; };
  if (task_names.empty()) return bad("the pool is empty");
  if (std::set<std::string>(task_names.begin(), task_names.end()).size() != task_names.size())
    return bad("two tasks have the same name");
  const auto share = [](double value) { return value >= 0.0 && value <= 1.0; };
  if (options.window < 1) return bad("window must be positive");
  if (!(options.max_return > options.min_return)) return bad("max_return must be above min_return");
  if (!share(options.p_theta) || !share(options.uniform_prob) || !share(options.smoothing))
    return bad("p_theta, uniform_prob and smoothing must lie in 0..1");
  if (!share(options.max_score_coef) || !share(options.alpha) || !share(options.staleness_coef) ||
      !share(options.replay_prob) || !share(options.rho) || !share(options.eps))
    return bad("max_score_coef, alpha, staleness_coef, replay_prob, rho and eps must lie in 0..1");
  if (!(options.temperature > 0.0) || !(options.staleness_temperature > 0.0))
    return bad("temperatures must be positive");
  std::unique_ptr<Curriculum> made;
  switch (options.kind) {
    case CurriculumKind::kUniform:
      made = std::make_unique<Uniform>(options, std::move(task_names));
      break;
    case CurriculumKind::kSequential:
      made = std::make_unique<Sequential>(options, std::move(task_names));
      break;
    case CurriculumKind::kLearningProgress:
    case CurriculumKind::kOmni:
      made = std::make_unique<LearningProgress>(options, std::move(task_names));
      break;
    case CurriculumKind::kPlr:
      made = std::make_unique<PrioritizedReplay>(options, std::move(task_names));
      break;
  }
  return made;
}

int Curriculum::draw() {
  const uint64_t draw_seed = options_.seed + counter_ * kGoldenGamma;
  const int task = draw_from(draw_seed);
  ++counter_;
  return task;
}

int Curriculum::draw_from(uint64_t draw_seed) {
  Rng rng(draw_seed);
  return pick(weights(), rng.uniform());
}

void Curriculum::update(int task, double outcome) {
  COMRAD_CHECK(task >= 0 && task < task_count(), "an outcome names a task of the pool");
  constexpr double kNewest = 0.1;  // share of the newest outcome in a task's mean score
  means_[task] = counts_[task] == 0 ? outcome : kNewest * outcome + (1.0 - kNewest) * means_[task];
  ++counts_[task];
  record(task, outcome);
}

void Curriculum::score(int, int64_t, double, double) {}

const std::vector<double>& Curriculum::weights() {
  refresh();
  return weights_;
}

std::vector<std::pair<std::string, double>> Curriculum::metrics() {
  double entropy = 0.0, positive = 0.0;
  for (const double w : weights()) {
    if (w <= 0.0) continue;
    entropy -= w * std::log(w);
    positive += 1.0;
  }
  std::vector<std::pair<std::string, double>> result{{"entropy", entropy}, {"tasks", positive}};
  double episodes = 0.0, played = 0.0, score = 0.0;
  for (std::size_t k = 0; k < counts_.size(); ++k) {
    episodes += static_cast<double>(counts_[k]);
    played += counts_[k] > 0;
    score += means_[k];
  }
  result.emplace_back("layouts_seen", played);
  result.emplace_back("episodes", episodes);
  result.emplace_back("draws", static_cast<double>(counter_));
  result.emplace_back("weight_max", *std::max_element(weights_.begin(), weights_.end()));
  if (played > 0.0) result.emplace_back("mean_score", score / played);
  strategy_metrics(result);
  return result;
}

std::string Curriculum::state() const {
  auto& self = const_cast<Curriculum&>(*this);
  self.refresh();  // earlier reads of the weights must not show in the state
  Json json{{"format", kFormat},    {"kind", word_of(options_.kind)},
            {"tasks", task_names_}, {"seed", options_.seed},
            {"counter", counter_},  {"weights", weights_},
            {"counts", counts_},    {"means", means_}};
  for (const auto& [name, array] : self.arrays()) json["arrays"][name] = *array;
  return json.dump();
}

Status Curriculum::restore(const std::string& text) {
  const auto bad = [](ErrorCode code, const std::string& what) {
    return Error{code, "curriculum state: " + what};
  };
  const Json json = Json::parse(text, nullptr, false);
  try {  // nlohmann throws on wrong types; nothing of it leaves this function
    if (!json.is_object() || json.at("format") != kFormat)
      return bad(ErrorCode::kBadFormat, "no JSON of format 1");
    if (json.at("kind") != word_of(options_.kind))
      return bad(ErrorCode::kBadInput, "it is of kind " + json.at("kind").get<std::string>() +
                                           ", this run's is " + word_of(options_.kind));
    if (json.at("tasks").get<std::vector<std::string>>() != task_names_)
      return bad(ErrorCode::kBadInput, "its list of tasks is another one; resume with the same pool");
    const auto weights = json.at("weights").get<std::vector<double>>();
    const auto counts = json.at("counts").get<std::vector<int64_t>>();
    const auto means = json.at("means").get<std::vector<double>>();
    if (weights.size() != weights_.size() || counts.size() != counts_.size() || means.size() != means_.size())
      return bad(ErrorCode::kBadFormat, "weights, counts or means have another length");
    std::vector<std::pair<std::vector<double>*, std::vector<double>>> read;
    for (const auto& [name, array] : arrays()) {
      auto values = json.at("arrays").at(name).get<std::vector<double>>();
      if (name != "outcomes" && values.size() != array->size())
        return bad(ErrorCode::kBadFormat, name + " has another length");
      read.emplace_back(array, std::move(values));
    }
    options_.seed = json.at("seed").get<uint64_t>();
    counter_ = json.at("counter").get<uint64_t>();
    weights_ = weights;
    counts_ = counts;
    means_ = means;
    for (auto& [array, values] : read) *array = std::move(values);
  } catch (const Json::exception& error) {
    return bad(ErrorCode::kBadFormat, error.what());
  }
  return {};
}

}  // namespace comrad::learn
