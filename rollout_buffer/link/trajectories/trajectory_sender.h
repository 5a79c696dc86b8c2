// The end of the trajectory link on a host that plays for another one's learner: it sends the slabs that are sealed on this
// host's arena, and publishes the weights that come back. Stages: drain, publish.
#pragma once

#include <cstdint>
#include <optional>

#include "rollout_buffer/link/session/sending_end.h"
#include "rollout_buffer/link/trajectories/slab_stream.h"
#include "rollout_buffer/link/trajectories/weights_stream.h"

namespace comrad::link {

/// Nothing is lost where this process is killed and starts again on the same arena: what its predecessor had in hand is
/// sent again, and the other end keeps count of what it has. Threads: one.
class TrajectorySender final : public SendingEnd {
 public:
  TrajectorySender(const shm::Arena& arena, dds::LinkBus bus, const SendingOptions& options,
                   const Clock& clock = kMachineClock);

  Status turn() override;

 private:
  void deliver() override;
  Status say_hello(bool is_leaving) override;
  void renew() override;
  void hear_all();
  void drain();
  bool send();

  SlabCutter cutter_;
  WeightsAssembler weights_;
  std::optional<uint64_t> cutting_;  ///< index of the slab that is being sent
  uint32_t next_fragment_ = 0;
};

}  // namespace comrad::link
