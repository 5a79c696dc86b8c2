// The end of the frame link on a host with simulators and no policy: on the arena of that host it stands where the policy
// worker stands, and where the learner stands. It sends what simulators commit, scatters the actions that come back, and
// lets sealed slabs go, because the other end has written a slab of its own. Stages: gather, scatter.
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/dds/link_bus.h"
#include "rollout_buffer/link/frame_stream.h"
#include "rollout_buffer/shm/arena.h"

namespace comrad::link {

enum class Compression { kNever, kAlways, kAuto };

struct FrameSenderOptions {
  uint64_t feeder_id = 0;    ///< of this arena
  uint64_t fingerprint = 0;  ///< of the offer that this host plays
  std::string host;          ///< its name, for people
  Compression compression = Compression::kAuto;
  double patience_s = 300;              ///< how long the other end may be silent
  double resend_after_s = 2;            ///< a request without an answer goes once more
  std::size_t batch_bytes = 256 << 10;  ///< a batch goes out when it is as large
};

/// What became of this host's requests.
struct FrameAccount {
  uint64_t decisions = 0;  ///< answered, all agents counted
  uint64_t batches = 0;
  uint64_t raw_bytes = 0, sent_bytes = 0;
  uint64_t resent = 0;      ///< requests
  uint64_t duplicates = 0;  ///< answers to what was answered, or never asked
  uint64_t refused = 0;     ///< batches of actions that are none
  bool is_compressed = false;
  double latency_us_p50 = 0, latency_us_p90 = 0, latency_us_p99 = 0;  ///< from sending to the answer
};

/// Nothing is lost where this process is killed and starts again on the same arena: what its predecessor had in hand is
/// sent again, and the other end knows what it has. Threads: one.
class FrameSender {
 public:
  /// The arena has one policy worker, this one.
  FrameSender(const shm::Arena& arena, dds::LinkBus bus, const FrameSenderOptions& options);

  /// Until `stop`, or this arena's run stops, or the other one ends. Errors: kBadInput where this host is refused or a
  /// request is too large for the link, kNotFound where nobody was heard for patience_s.
  Status run(const std::atomic<bool>& stop);
  /// Called in run(), and at its end.
  void every_second(std::function<void()> report) { every_second_ = std::move(report); }

  FrameAccount account() const;
  /// run() ended because the run that is played for has ended.
  bool has_run_ended() const { return has_run_ended_; }

 private:
  struct Pending {
    bool is_out = false;
    FrameRequest request;
    uint32_t slab = 0;
    double sent_s = 0;
  };

  bool take_actions();
  void begin_anew(uint64_t session);
  bool take_answers(std::span<const std::byte> payload);
  bool send_ready();
  bool may_begin(const shm::StepSlot& slot) const;
  FrameRequest request_of(const shm::StepSlot& slot, int env) const;
  bool send_batch();
  bool release_sealed();
  void resend_due();
  void send_episodes();
  Status say_hello(bool is_leaving);
  dds::FrameBatch batch_head() const;

  const shm::Arena& arena_;
  dds::LinkBus bus_;
  const FrameSenderOptions options_;
  FramePacker packer_;
  std::vector<int> packed_;  ///< environments of the batch in the making
  std::vector<std::byte> compressed_;
  std::vector<int32_t> choices_;
  std::vector<Pending> pending_;  ///< by environment
  int out_count_ = 0;
  uint32_t epoch_ = 0;
  uint64_t session_ = 0, batch_index_ = 0, begun_ = 0, credit_ = 0;
  CompressionChoice choice_;
  LatencyCounts latency_;
  FrameAccount account_;
  double heard_s_ = 0, said_s_ = 0, told_s_ = 0, looked_s_ = 0;
  bool has_run_ended_ = false;
  std::string refusal_;
  std::function<void()> every_second_;
};

}  // namespace comrad::link
