#include "learner/step/step_runner.h"

#include <torch/csrc/autograd/autograd.h>

#include <algorithm>
#include <utility>

#include "learner/step/gradient_sum.h"
#include "learner/step/micro_batches.h"
#include "policy_workers/device/operator_path.h"
#include "policy_workers/device/torch_ops.h"

namespace comrad::learn {
namespace {

/// What one micro-batch adds.
struct Part {
  std::vector<Tensor> gradients;  ///< as the optimizer's parameters; undefined where the loss does not reach
  std::vector<TermName> names;
  Tensor numbers;  ///< f32 [K]
  Tensor loss;     ///< f32 [], without gradient
  Tensor kept;     ///< LossTerms::kept
};

Part part_of(const MicroLoss& loss, const std::vector<Tensor>& parameters, std::span<const Tensor> scalars) {
  const LossTerms terms = loss(scalars);
  Part part{.gradients = {},
            .names = terms.names(),
            .numbers = terms.numbers(),
            .loss = terms.loss().detach(),
            .kept = terms.kept};
  part.gradients = torch::autograd::grad({terms.loss()}, parameters, /*grad_outputs=*/{},
                                         /*retain_graph=*/c10::nullopt, /*create_graph=*/false,
                                         /*allow_unused=*/true);
  return part;
}

/// Each as f64 [] on the host.
std::vector<Tensor> tensors_of(const std::vector<double>& numbers) {
  std::vector<Tensor> tensors;
  for (const double number : numbers) tensors.push_back(torch::full({}, number, torch::kFloat64));
  return tensors;
}

std::vector<std::vector<int64_t>> shapes_of(StepInput& input) {
  std::vector<std::vector<int64_t>> shapes;
  input.visit([&](const Tensor& field) { shapes.push_back(field.sizes().vec()); });
  return shapes;
}

}  // namespace

TermValues MinibatchTerms::values(const double* numbers) const {
  TermValues values(names);
  for (std::size_t part = 0; part < of_parts.size(); ++part, numbers += names.size()) values.join(numbers);
  return values;
}

/// Recorded work and its own tensors that it reads. Other shapes, and work for another purpose, have their own recordings.
class StepRunner::Recorded {
 public:
  Recorded(StepInput& like, const void* for_what)
      : for_what_(for_what), input_(like.clone()), shapes_(shapes_of(like)) {
    input_->visit([](Tensor& field) { field = torch::empty_like(field); });
  }
  bool fits(StepInput& other, const void* for_what) const {
    return for_what_ == for_what && shapes_ == shapes_of(other);
  }
  StepInput& input() { return *input_; }
  /// Of what `from` holds now.
  void replay(StepInput& from) {
    std::vector<Tensor> fields;
    from.visit([&](Tensor& field) { fields.push_back(field); });
    input_->visit([&, next = std::size_t{0}](Tensor& field) mutable {
      const torch::NoGradGuard no_grad;
      field.copy_(fields[next++], /*non_blocking=*/true);
    });
    graph.replay();
  }

  device::Graph graph;

 private:
  const void* for_what_;
  std::unique_ptr<StepInput> input_;
  std::vector<std::vector<int64_t>> shapes_;
};

/// A step that a device replays.
struct StepRunner::RecordedStep : Recorded {
  using Recorded::Recorded;
  bool keeps = false;
  Tensor settings;  ///< f64 [K + 1]: the scalars, the learning rate
  MinibatchTerms terms;
  Tensor outcome;  ///< f64: what a LaunchedStep reads
};

/// And a look without gradient.
struct StepRunner::RecordedLook : Recorded {
  using Recorded::Recorded;
  std::vector<Tensor> said;
};

StepRunner::StepRunner(const RunConfig& config, torch::Device device)
    : device_(device), pool_(threads_for_parts(config, device)) {}

void StepRunner::resume(PolicyVersion version) {
  version_ = version;
  forget_recordings();
}

void StepRunner::forget_recordings() {
  recorded_steps_.clear();
  recorded_looks_.clear();
}

bool StepRunner::records() const { return !device::has_own_kernels(device_) && ranks_->is_alone(); }

Tensor StepRunner::to_read(const StepRequest& request, const MinibatchTerms& terms, const Tensor& outcome) {
  std::vector<Tensor> numbers = terms.of_parts;
  if (request.reads_kept) numbers.insert(numbers.end(), terms.kept.begin(), terms.kept.end());
  numbers.push_back(outcome);
  if (request.reads_second_moment) numbers.push_back(request.optimizer.max_second_moment().reshape({1}));
  return at::cat(numbers).to(torch::kFloat64);
}

StepRunner::Result StepRunner::launch(const StepRequest& request, UpdateStats& stats,
                                      LaunchedStep& launched) {
  launched.learning_rate = request.learning_rate;
  launched.has_second_moment = request.reads_second_moment;
  if (records() && !request.is_wanted) {
    if (request.keep_going && !request.keep_going()) return Result::kAbandoned;
    guard_.count_step(version_, stats);
    launch_recorded(request, launched);
    return Result::kLaunched;
  }
  request.optimizer.zero_grad();
  if (!add_gradient(request.input, request.optimizer, tensors_of(request.scalars), request.keeps,
                    request.keep_going, launched.terms))
    return Result::kAbandoned;
  if (request.is_wanted) {
    device::Readback read(at::cat(launched.terms.of_parts).to(torch::kFloat64));
    read.wait();
    if (!request.is_wanted(launched.terms.values(read.values()))) return Result::kRefused;
  }
  const Tensor outcome =
      guard_.step(request.optimizer, launched.terms.loss, request.learning_rate, version_, stats);
  launched.read = device::Readback(to_read(request, launched.terms, outcome));
  return Result::kLaunched;
}

StepRunner::RecordedStep& StepRunner::recorded_step(const StepRequest& request) {
  for (const auto& made : recorded_steps_)
    if (made->fits(request.input, &request.optimizer) && made->keeps == request.keeps) return *made;
  RecordedStep& made =
      *recorded_steps_.emplace_back(std::make_shared<RecordedStep>(request.input, &request.optimizer));
  made.keeps = request.keeps;
  made.settings = torch::empty({static_cast<int64_t>(request.scalars.size()) + 1},
                               torch::TensorOptions(torch::kFloat64).device(device_));
  made.graph.record_at_second_replay(
      device_, [this, &made, &optimizer = request.optimizer, reads_kept = request.reads_kept,
                reads_second_moment = request.reads_second_moment] {
        optimizer.zero_grad();
        made.terms = {};
        const std::vector<Tensor> settings = made.settings.unbind(0);
        (void)add_gradient(made.input(), optimizer, settings, made.keeps, {}, made.terms);
        made.outcome = to_read({.optimizer = optimizer,
                                .input = made.input(),
                                .scalars = {},
                                .reads_kept = reads_kept,
                                .reads_second_moment = reads_second_moment},
                               made.terms, optimizer.step(settings.back(), made.terms.loss));
      });
  return made;
}

void StepRunner::launch_recorded(const StepRequest& request, LaunchedStep& launched) {
  RecordedStep& recorded = recorded_step(request);
  {
    torch::NoGradGuard no_grad;
    const Tensor settings = device::host_memory(recorded.settings.sizes(), torch::kFloat64, device_);
    for (std::size_t i = 0; i < request.scalars.size(); ++i)
      settings[static_cast<int64_t>(i)].fill_(request.scalars[i]);
    settings[-1].fill_(request.learning_rate);
    recorded.settings.copy_(settings, /*non_blocking=*/true);
  }
  recorded.replay(request.input);
  launched.terms = recorded.terms;
  // The next replay writes over them.
  for (Tensor& samples : launched.terms.kept) samples = samples.clone();
  launched.read = device::Readback(recorded.outcome);
}

bool StepRunner::add_gradient(const StepInput& input, const AdamOptimizer& optimizer,
                              std::span<const Tensor> scalars, bool keeps,
                              const std::function<bool()>& keep_going, MinibatchTerms& terms) {
  // What depends on the whole minibatch came before; each micro-batch adds its share of the same sums, so the
  // gradient does not depend on micro_batch_size.
  const std::vector<MicroLoss> losses = input.micro_losses();
  const bool is_done = sum_gradients<Part>(
      pool_, optimizer.parameters(), static_cast<int64_t>(losses.size()),
      [&](int64_t i) {
        return part_of(losses[static_cast<std::size_t>(i)], optimizer.parameters(), scalars);
      },
      [&](const Part& part) {
        terms.names = part.names;
        terms.of_parts.push_back(part.numbers);
        if (keeps) terms.kept.push_back(part.kept);
        terms.loss = terms.loss.defined() ? terms.loss + part.loss : part.loss;
      },
      keep_going);
  if (!is_done) return false;
  if (ranks_->is_alone()) return true;
  ranks_->add_up_gradients(optimizer.parameters());
  const Tensor of_parts = ranks_->gather(torch::stack(terms.of_parts), 0);
  const Tensor losses_of_ranks = ranks_->gather(terms.loss.reshape({1}), 0);
  if (ranks_->failure()) return false;
  terms.of_parts = of_parts.unbind(0);
  terms.loss = losses_of_ranks.sum();
  return true;
}

std::optional<StepOutcome> StepRunner::gradient_of(const StepRequest& request) {
  MinibatchTerms terms;
  if (!add_gradient(request.input, request.optimizer, tensors_of(request.scalars), request.keeps,
                    request.keep_going, terms))
    return std::nullopt;
  std::vector<Tensor> numbers = terms.of_parts;
  numbers.insert(numbers.end(), terms.kept.begin(), terms.kept.end());
  device::Readback read(at::cat(numbers).to(torch::kFloat64));
  read.wait();
  StepOutcome outcome;
  outcome.terms = terms.values(read.values());
  outcome.kept.assign(read.values() + terms.of_parts.size() * terms.names.size(),
                      read.values() + read.count());
  return outcome;
}

StepOutcome StepRunner::complete(LaunchedStep& launched, UpdateStats& stats) {
  if (!launched.read.is_ready()) launched.read.wait();
  const double* const first = launched.read.values();
  const double* last = first + launched.read.count();
  StepOutcome outcome;
  outcome.terms = launched.terms.values(first);
  if (launched.has_second_moment) outcome.max_second_moment = *--last;
  last -= 2;  // AdamOptimizer::step()'s numbers
  outcome.was_taken = last[0] != 0;
  outcome.kept.assign(first + launched.terms.of_parts.size() * launched.terms.names.size(), last);
  guard_.complete({.was_taken = outcome.was_taken,
                   .grad_norm = last[1],
                   .loss = outcome.terms.loss(),
                   .learning_rate = launched.learning_rate},
                  version_, stats);
  return outcome;
}

std::vector<Tensor> StepRunner::evaluate(StepInput& input, const void* for_what,
                                         const std::function<std::vector<Tensor>(const StepInput&)>& look) {
  if (device::has_own_kernels(device_)) return look(input);
  auto recorded =
      std::ranges::find_if(recorded_looks_, [&](const auto& made) { return made->fits(input, for_what); });
  if (recorded == recorded_looks_.end()) {
    recorded = recorded_looks_.insert(recorded, std::make_shared<RecordedLook>(input, for_what));
    RecordedLook& made = **recorded;
    made.graph.record_at_second_replay(device_, [&made, look] { made.said = look(made.input()); });
  }
  (*recorded)->replay(input);
  std::vector<Tensor> said;  // the next replay writes over its own
  for (const Tensor& one : (*recorded)->said) said.push_back(one.defined() ? one.clone() : one);
  return said;
}

}  // namespace comrad::learn
