// The end of the frame link on a host with simulators and no policy: on the arena of that host it stands where the policy
// worker stands, and where the learner stands. It sends what simulators commit and scatters the actions that come back. The
// other end has a copy of each slab; when a simulator seals one, it is told to seal its own. Stages: gather, scatter, drain.
#pragma once

#include <atomic>
#include <cstdint>
#include <deque>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "rollout_buffer/core/clock.h"
#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/dds/link_bus.h"
#include "rollout_buffer/link/delivery_account.h"
#include "rollout_buffer/link/frame_stream.h"
#include "rollout_buffer/link/layout_grants.h"
#include "rollout_buffer/shm/arena.h"
#include "rollout_buffer/shm/step_slots.h"

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
  int layout_count = 0;                 ///< of the run's pool, from which this host draws evenly; 0: one map
};

/// Nothing is lost where this process is killed and starts again on the same arena: what its predecessor had in hand is
/// sent again, and the other end knows what it has. Threads: one.
class FrameSender {
 public:
  /// The arena has one policy worker, this one.
  /// Arena and clock outlive it.
  FrameSender(const shm::Arena& arena, dds::LinkBus bus, const FrameSenderOptions& options,
              const Clock& clock = kMachineClock);

  /// Until `stop`, or this arena's run stops, or the other one ends. Errors: kBadInput where this host is refused or a
  /// request is too large for the link, kNotFound where nobody was heard for patience_s.
  Status run(const std::atomic<bool>& stop);
  /// Called in run(), and at its end.
  void every_second(std::function<void()> report) { every_second_ = std::move(report); }

  FrameAccount account() const;
  /// Delivered is what the other end has sealed.
  FeederAccount deliveries() const;
  /// The other end has places for this one.
  bool is_played_with() const { return session_ != 0; }
  /// Since something was heard of the other end.
  double silent_s() const;
  /// run() ended because the run that is played for has ended.
  bool has_run_ended() const { return has_run_ended_; }

 private:
  struct Pending {
    bool is_out = false;
    FrameRequest request;
    uint32_t slab = 0;
    double sent_s = 0;
  };
  /// A slab that its simulator has sealed.
  struct InHand {
    uint32_t slab = 0;
    FrameRequest request;
    double sent_s = 0;  ///< 0: not yet
    bool is_packed = false;
    bool is_done = false, is_delivered = false;
  };

  bool take_actions();
  void begin_anew(uint64_t session);
  bool take_answers(std::span<const std::byte> payload);
  bool send_ready();
  bool may_begin(const shm::StepSlot& slot) const;
  FrameRequest request_of(const shm::StepSlot& slot, int env) const;
  bool send_batch();
  void drain();
  void hold(uint32_t slab);
  void make_room(const FrameRequest& request);
  bool send_sealed();
  void take_sealed(const FrameAnswer& answer);
  void finish_done();
  void resend_due();
  void send_episodes();
  Status say_hello(bool is_leaving);
  dds::FrameBatch batch_head() const;

  const shm::Arena& arena_;
  const Clock& clock_;
  dds::LinkBus bus_;
  const FrameSenderOptions options_;
  FramePacker packer_;
  std::vector<int> packed_;  ///< environments of the batch in the making
  std::vector<std::byte> compressed_;
  std::vector<int32_t> choices_;
  std::vector<Pending> pending_;  ///< by environment
  std::deque<InHand> in_hand_;    ///< in the order of sealing
  DeliveryAccount deliveries_;
  LayoutGrants layouts_;
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
