#include "learner/ranks/rank_group.h"

#include <spdlog/fmt/fmt.h>
#include <torch/csrc/distributed/c10d/FileStore.hpp>
#ifdef USE_C10D_GLOO
#include <torch/csrc/distributed/c10d/ProcessGroupGloo.hpp>
#endif
#if defined(USE_C10D_NCCL) && defined(COMRAD_HAS_CUDA)
#define COMRAD_HAS_NCCL
#include <torch/csrc/distributed/c10d/ProcessGroupNCCL.hpp>
#endif

#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <exception>
#include <utility>

#include "policy_workers/device/choose_device.h"
#include "policy_workers/device/torch_ops.h"
#include "policy_workers/network/actor_critic.h"
#include "rollout_buffer/core/check.h"
#include "rollout_buffer/core/clock.h"
#include "rollout_buffer/core/process.h"

namespace comrad::learn {
namespace {

using torch::Tensor;

/// A pause of the run may be long, and a rank that dies is seen by its closed connection: no exchange ends by itself.
constexpr std::chrono::milliseconds kExchangeTimeout = std::chrono::hours(24 * 30);
constexpr double kWatchEveryS = 0.02;
constexpr int64_t kShortestNapUs = 20, kLongestNapUs = 1000;

/// From the first to the last.
Tensor sum_of(const std::vector<Tensor>& parts) {
  Tensor sum = parts.front().clone();
  for (std::size_t rank = 1; rank < parts.size(); ++rank) sum.add_(parts[rank]);
  return sum;
}

std::string joined_key(int rank) { return fmt::format("joined/{}", rank); }

/// Sleeps a little longer each time, and calls `watch` now and then.
class Waiting {
 public:
  explicit Waiting(const RankGroup::Watch& watch) : watch_(watch) {}
  Status nap() {
    usleep(static_cast<useconds_t>(nap_us_));
    nap_us_ = std::min(nap_us_ * 2, kLongestNapUs);
    const double now_s = monotonic_s();
    if (!watch_ || now_s - asked_s_ < kWatchEveryS) return {};
    asked_s_ = now_s;
    return watch_();
  }

 private:
  const RankGroup::Watch& watch_;
  int64_t nap_us_ = kShortestNapUs;
  double asked_s_ = monotonic_s();
};

}  // namespace

#ifdef USE_C10D_GLOO

struct RankGroup::Engines {
  c10::intrusive_ptr<c10d::FileStore> store;
  c10::intrusive_ptr<c10d::ProcessGroupGloo> host;
#ifdef COMRAD_HAS_NCCL
  c10::intrusive_ptr<c10d::ProcessGroupNCCL> device;
#endif

  /// Of every rank, on the device where `part` lies. Errors: those of exchange().
  template <typename Group>
  Expected<std::vector<Tensor>> parts_of_all(Group& group, const Tensor& part, const Watch& watch) {
    std::vector<Tensor> own = {part.contiguous()};
    std::vector<std::vector<Tensor>> all(1);
    for (int rank = 0; rank < group.getSize(); ++rank) all.front().push_back(torch::empty_like(own.front()));
    if (part.numel() > 0)  // Gloo divides by it
      COMRAD_TRY(exchange([&] { return group.allgather(all, own); }, watch));
    return all.front();
  }
  /// Begins an exchange and waits for it. What c10d throws ends here.
  template <typename Begin>
  Status exchange(const Begin& begin, const Watch& watch) {
    try {
      const auto work = begin();
      Waiting waiting(watch);
      while (!work->isCompleted()) COMRAD_TRY(waiting.nap());
      if (!work->isSuccess()) std::rethrow_exception(work->exception());
      work->synchronize();
      return {};
    } catch (const std::exception& failure) {
      const std::string text = failure.what();
      return Error{ErrorCode::kPeerLost, "a learner left the others: " + text.substr(0, text.find('\n'))};
    }
  }
};

Status RankGroup::meet() {
  if (options_.rendezvous < 0) return Error{ErrorCode::kBadInput, "learners need a file to meet in"};
  engines_ = std::make_unique<Engines>();
  const double began_s = monotonic_s(), limit_s = options_.join_timeout_s * patience();
  try {
    // It needs no removal: it has no name.
    engines_->store = c10::make_intrusive<c10d::FileStore>(
        fmt::format("/proc/self/fd/{}", options_.rendezvous), /*numWorkers=*/-1);
    engines_->store->set(joined_key(options_.rank), std::vector<uint8_t>{1});
    Waiting waiting(watch_);
    for (int rank = 0; rank < options_.count; ++rank)
      while (!engines_->store->check({joined_key(rank)})) {
        COMRAD_TRY(waiting.nap());
        if (monotonic_s() - began_s < limit_s) continue;
        std::string missing;
        for (int other = 0; other < options_.count; ++other)
          if (!engines_->store->check({joined_key(other)})) missing += fmt::format(" {}", other);
        return Error{ErrorCode::kTimeout,
                     fmt::format("learner {} of {} waited {} s in vain for learners{}; see their logs, or "
                                 "train with fewer --learners",
                                 options_.rank, options_.count, static_cast<int>(limit_s), missing)};
      }
    auto settings = c10d::ProcessGroupGloo::Options::create(kExchangeTimeout);
    settings->devices.push_back(c10d::ProcessGroupGloo::createDeviceForHostname("127.0.0.1"));
    settings->threads = 1;
    engines_->host =
        c10::make_intrusive<c10d::ProcessGroupGloo>(engines_->store, options_.rank, options_.count, settings);
#ifdef COMRAD_HAS_NCCL
    if (options_.device.is_cuda() && options_.has_own_gpu)
      engines_->device =
          c10::make_intrusive<c10d::ProcessGroupNCCL>(engines_->store, options_.rank, options_.count);
#endif
  } catch (const std::exception& failure) {
    return Error{ErrorCode::kSystem, std::string("learners cannot meet: ") + failure.what()};
  }
  // Connections are made pair by pair: a rank that has all its connections may leave again only when the others have theirs.
  all(true);
  return status();
}

RankGroup::~RankGroup() {
  // An exchange that others left never ends, and c10d would wait for it.
  if (failure_ && engines_) (void)engines_.release();
}

std::vector<Tensor> RankGroup::parts_of_all(const Tensor& part) {
  const Expected<std::vector<Tensor>> parts = engines_->parts_of_all(*engines_->host, part, watch_);
  if (parts) return *parts;
  failure_ = parts.error();
  return {};
}

/// Each rank adds up its piece of all ranks' numbers, then all ranks get all pieces.
bool RankGroup::add_up_flat(Tensor& flat) {
#ifdef COMRAD_HAS_NCCL
  if (flat.is_cuda() && engines_->device) {
    const Expected<std::vector<Tensor>> parts = engines_->parts_of_all(*engines_->device, flat, watch_);
    if (parts)
      flat.copy_(sum_of(*parts));
    else
      failure_ = parts.error();
    return !failure_;
  }
#endif
  Tensor sent = flat.cpu(), received = torch::empty_like(sent);
  std::vector<int64_t> no_splits;
  const Status done = engines_->exchange(
      [&] { return engines_->host->alltoall_base(received, sent, no_splits, no_splits); }, watch_);
  if (!done) failure_ = done.error();
  if (failure_) return false;
  const std::vector<Tensor> pieces = parts_of_all(sum_of(received.split(received.numel() / options_.count)));
  if (failure_) return false;
  flat.copy_(at::cat(pieces));
  return true;
}

#else

struct RankGroup::Engines {};

Status RankGroup::meet() {
  return Error{ErrorCode::kUnsupported, "this libtorch was built without Gloo; train with --learners 1"};
}
RankGroup::~RankGroup() = default;
std::vector<Tensor> RankGroup::parts_of_all(const Tensor& part) { return {part}; }
bool RankGroup::add_up_flat(Tensor&) { return false; }

#endif

Expected<RankGroup::Options> RankGroup::Options::of(const std::string& device, int rank, int count,
                                                    int rendezvous) {
  Options options{.rank = rank, .count = count, .rendezvous = rendezvous};
  COMRAD_TRY_ASSIGN(options.device, policy::choose_device(device));
  if (count == 1 || !options.device.is_cuda() || options.device.index() > 0) return options;
  const auto gpus = static_cast<int>(at::getNumGPUs());
  options.device = torch::Device(torch::kCUDA, static_cast<torch::DeviceIndex>(rank % gpus));
  options.has_own_gpu = count <= gpus;
  return options;
}

RankGroup::RankGroup() = default;
RankGroup::RankGroup(const Options& options, Watch watch) : options_(options), watch_(std::move(watch)) {}

Expected<std::unique_ptr<RankGroup>> RankGroup::join(const Options& options, Watch watch) {
  COMRAD_CHECK(0 <= options.rank && options.rank < options.count, "a rank is below their number");
  std::unique_ptr<RankGroup> group(new RankGroup(options, std::move(watch)));
  if (!group->is_alone()) COMRAD_TRY(group->meet());
  return group;
}

Tensor RankGroup::gather(const Tensor& part, int64_t dim) {
  if (is_alone()) return part;
  const torch::NoGradGuard no_grad;
  std::vector<Tensor> parts;
  if (!failure_) parts = parts_of_all(part.detach().cpu());
  if (failure_) parts.assign(static_cast<std::size_t>(count()), part.detach());
  return at::cat(parts, dim).to(part.device());
}

Tensor RankGroup::gather_rows(const Tensor& table) {
  if (is_alone() || failure_) return table;
  const torch::NoGradGuard no_grad;
  const Tensor counts = gather(torch::full({1}, table.size(0), torch::kInt64), 0);
  if (failure_) return table;
  const int64_t *first = counts.data_ptr<int64_t>(), *last = first + counts.numel();
  const int64_t most = *std::max_element(first, last);
  std::vector<int64_t> sizes = table.sizes().vec();
  sizes.front() = most;
  Tensor padded = torch::zeros(sizes, table.options());
  padded.narrow(0, 0, table.size(0)).copy_(table);
  std::vector<Tensor> parts = parts_of_all(padded.cpu());
  if (failure_) return table;
  for (std::size_t rank = 0; rank < parts.size(); ++rank) parts[rank] = parts[rank].narrow(0, 0, first[rank]);
  return at::cat(parts).to(table.device());
}

void RankGroup::add_up(Tensor& numbers) {
  if (is_alone() || failure_) return;
  const torch::NoGradGuard no_grad;
  const std::vector<Tensor> parts = parts_of_all(numbers.detach().cpu());
  if (failure_) return;
  numbers.copy_(sum_of(parts));
}

std::function<void(torch::Tensor&)> RankGroup::adder() {
  if (is_alone()) return {};
  return [this](torch::Tensor& numbers) { add_up(numbers); };
}

std::vector<double> RankGroup::add_up(const std::vector<double>& numbers) {
  if (is_alone()) return numbers;
  Tensor sum = torch::empty({static_cast<int64_t>(numbers.size())}, torch::kFloat64);
  std::ranges::copy(numbers, sum.data_ptr<double>());
  add_up(sum);
  return {sum.data_ptr<double>(), sum.data_ptr<double>() + sum.numel()};
}

void RankGroup::add_up_gradients(const std::vector<Tensor>& parameters) {
  if (is_alone() || failure_) return;
  const torch::NoGradGuard no_grad;
  std::vector<Tensor> gradients, rows;
  int64_t count = 0;
  for (const Tensor& parameter : parameters) {
    if (!parameter.grad().defined()) continue;
    gradients.push_back(parameter.grad());
    rows.push_back(gradients.back().reshape({-1}));
    count += rows.back().numel();
  }
  if (gradients.empty()) return;
  if (const int64_t rest = count % options_.count; rest != 0)
    rows.push_back(torch::zeros({options_.count - rest}, rows.front().options()));
  Tensor flat = at::cat(rows);
  if (!add_up_flat(flat)) return;
  int64_t begin = 0;
  for (Tensor& gradient : gradients) {
    gradient.copy_(flat.narrow(0, begin, gradient.numel()).view(gradient.sizes()));
    begin += gradient.numel();
  }
}

bool RankGroup::all(bool mine) {
  if (is_alone()) return mine;
  return add_up(std::vector<double>{mine ? 1.0 : 0.0}).front() == count() && !failure_;
}

std::string RankGroup::from_leader(const std::string& text) {
  if (is_alone() || failure_) return text;
  const std::string mine = is_leader() ? text : std::string();
  Tensor bytes = torch::empty({static_cast<int64_t>(mine.size())}, torch::kUInt8);
  std::ranges::copy(mine, bytes.data_ptr<uint8_t>());
  const Tensor all = gather_rows(bytes);
  const uint8_t* first = all.data_ptr<uint8_t>();
  return failure_ ? text : std::string(first, first + all.numel());
}

}  // namespace comrad::learn
