// The end of the frame link on a host with simulators and no policy: on the arena of that host it stands where the policy
// worker stands, and where the learner stands. It sends what simulators commit and scatters the actions that come back. The
// other end has a copy of each slab; when a simulator seals one, it is notified to seal its own. Stages: gather, scatter, drain.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "rollout_buffer/link/frames/frame_stream.h"
#include "rollout_buffer/link/session/sending_end.h"
#include "rollout_buffer/shm/step_slots.h"

namespace comrad::link {

enum class Compression { kNever, kAlways, kAuto };

struct FrameSenderOptions : SendingOptions {
  FrameSenderOptions() { resend_after_s = 2; }
  Compression compression = Compression::kAuto;
  std::size_t batch_bytes = 256 << 10;  ///< a batch goes out when it is as large
};

/// Nothing is lost where this process is killed and starts again on the same arena: what its predecessor had in hand is
/// sent again, and the other end keeps count of what it has. Delivered is what the other end has sealed. Threads: one.
class FrameSender final : public SendingEnd {
 public:
  /// The arena has one policy worker, this one.
  FrameSender(const shm::Arena& arena, dds::LinkBus bus, const FrameSenderOptions& options,
              const Clock& clock = kMachineClock);

  std::optional<FrameAccount> frames() const override;

  /// Errors: kBadInput where a request is too large for the link.
  Status begin() override;
  Status turn() override;
  void wait() override;

 private:
  struct Pending {
    bool is_out = false;
    FrameRequest request;
    uint32_t slab = 0;
    double sent_s = 0;
  };

  void deliver() override;
  Status say_hello(bool is_leaving) override;
  void renew() override;
  bool take_actions();
  bool take_answers(std::span<const std::byte> payload);
  bool send_ready();
  bool may_begin(const shm::StepSlot& slot) const;
  FrameRequest request_of(const shm::StepSlot& slot, int env) const;
  FrameRequest sealed_request_of(uint32_t slab) const;
  bool send_batch();
  void drain();
  void make_room(const FrameRequest& request);
  bool send_sealed();
  void take_sealed(const FrameAnswer& answer);
  void resend_due();

  const Compression compression_;
  const std::size_t batch_bytes_;
  FramePacker packer_;
  std::vector<int> packed_;  ///< environments of the batch in the making
  std::vector<std::byte> compressed_;
  std::vector<int32_t> choices_;
  std::vector<Pending> pending_;  ///< by environment
  std::vector<bool> is_split_acted_;
  int out_count_ = 0;
  uint64_t batch_index_ = 0, begun_ = 0;
  CompressionChoice choice_;
  LatencyCounts latency_;
  FrameAccount account_;
  double looked_s_ = 0;
  uint32_t heard_ready_ = 0;
  bool has_moved_ = false, has_failed_ = false;
};

}  // namespace comrad::link
