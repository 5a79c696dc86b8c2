// The learners of one run as one: what several processes say about their shares of a batch, put together by c10d (Gloo
// between hosts' memories, NCCL between GPUs that a rank has alone). Everything is put together in the order of the
// ranks, so the result does not depend on which rank was first, and all ranks hold the same numbers behind every call. Stage:
// update.
//
//   rank 0  share of the slabs -> gradient ─┐                       ┌─ optimizer step -> publish, save
//   rank 1  share of the slabs -> gradient ─┴─ add_up, rank by rank ─┴─ the same step
#pragma once

#include <torch/types.h>

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "rollout_buffer/core/expected.h"

namespace comrad::learn {

/// Threads: one, the training thread. All ranks make the same calls in the same order.
///
/// A call that fails (a rank has left, or watch() returned false) takes this rank's part for that of all others, so that shapes
/// are what they would have been, and failure() states why from then on; so do all calls after it. The training loop reads
/// failure() before an optimizer steps.
class RankGroup {
 public:
  struct Options {
    int rank = 0, count = 1;
    int rendezvous = -1;  ///< RankProcesses::rendezvous(): an open file that all ranks share
    double join_timeout_s = 60;
    torch::Device device = torch::kCPU;  ///< that this rank trains on
    bool has_own_gpu = false;            ///< no two ranks train on one GPU

    /// Rank `rank` of `count` with a device as the setting names it: with "auto" and "cuda" ranks take the host's GPUs in
    /// turn. Errors: those of policy::choose_device().
    static Expected<Options> of(const std::string& device, int rank, int count, int rendezvous);
  };
  /// Asked now and then while a call waits for others; an error ends the waiting.
  using Watch = std::function<Status()>;

  /// A learner alone: every call gives back what it was given.
  RankGroup();
  ~RankGroup();
  RankGroup(const RankGroup&) = delete;
  RankGroup& operator=(const RankGroup&) = delete;

  /// Meets the other ranks. Errors: kTimeout, naming the ranks that did not come; kUnsupported (a libtorch without Gloo);
  /// those of `watch`; kSystem.
  static Expected<std::unique_ptr<RankGroup>> join(const Options& options, Watch watch);

  int rank() const { return options_.rank; }
  int count() const { return options_.count; }
  torch::Device device() const { return options_.device; }
  bool is_alone() const { return options_.count == 1; }
  /// Of all ranks: the first publishes, saves and reports.
  bool is_leader() const { return options_.rank == 0; }
  void set_watch(Watch watch) { watch_ = std::move(watch); }
  const std::optional<Error>& failure() const { return failure_; }
  Status status() const { return failure_ ? Status(*failure_) : Status(); }
  /// This rank makes no more calls that others wait for: from now on all of them fail, because of `why`.
  void leave(const Error& why) {
    if (!is_alone() && !failure_) failure_ = why;
  }

  /// The ranks' tensors one behind the other along `dim`; of one shape and type in all ranks.
  torch::Tensor gather(const torch::Tensor& part, int64_t dim);
  /// The rows of all ranks' tables, of one width and type; a rank may have none.
  torch::Tensor gather_rows(const torch::Tensor& table);
  /// The sum over the ranks in place, of one shape in all ranks. Integers below 2^53 are summed exactly in f64.
  void add_up(torch::Tensor& numbers);
  std::vector<double> add_up(const std::vector<double>& numbers);
  /// add_up() of a tensor as a function; empty for a learner alone.
  std::function<void(torch::Tensor&)> adder();
  /// The same for the gradients of `parameters` (f32), in one exchange of their sum's size twice. Parameters without a
  /// gradient are left out; they must be the same in all ranks.
  void add_up_gradients(const std::vector<torch::Tensor>& parameters);
  /// Whether all ranks say so.
  bool all(bool mine);
  /// What the leader gave, in all ranks.
  std::string from_leader(const std::string& text);

 private:
  struct Engines;
  RankGroup(const Options& options, Watch watch);
  Status meet();
  /// By way of the host, whatever the device.
  std::vector<torch::Tensor> parts_of_all(const torch::Tensor& part);
  bool add_up_flat(torch::Tensor& flat);

  Options options_;
  Watch watch_;
  std::optional<Error> failure_;
  std::unique_ptr<Engines> engines_;  ///< null: alone
};

}  // namespace comrad::learn
