// The end of the trajectory link on the learner's host: on the learner's arena it stands where simulators stand. Slabs
// of other hosts are put together in free ones of this arena, checked, and sealed as a simulator seals its own; so
// nothing behind `seal` knows of the link. Stages: acquire, seal.
#pragma once

#include <atomic>
#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "rollout_buffer/core/clock.h"
#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/dds/link_bus.h"
#include "rollout_buffer/link/door.h"
#include "rollout_buffer/link/seats.h"
#include "rollout_buffer/link/slab_stream.h"
#include "rollout_buffer/link/weights_pace.h"
#include "rollout_buffer/link/weights_stream.h"
#include "rollout_buffer/shm/arena.h"

namespace comrad::link {

struct ReceiverOptions {
  int first_worker = 0;        ///< simulators of the arena from this one on are played by other hosts
  Offer offer;                 ///< what hosts that join are told
  int window = 4;              ///< slabs that are kept free for each host, its credits
  double silent_after_s = 5;   ///< then its free slabs go back, and another that needs its places has them
  double seat_kept_s = 600;    ///< then its simulators' places are free
  WeightsLimits weights = {};  ///< how often versions go to other hosts
  uint64_t bf16_parameters =
      0;  ///< so many parameters are sent as bfloat16, the statistics behind them as f32; 0: all as they are
  double weights_wait_s =
      3;  ///< a version has so long to reach every host before a newer one takes its place
};

/// Exactly once: a slab is known by its host, environment and rollout index. How far each environment came stands in
/// the arena, so a receiver that is killed and starts again takes no slab twice. Threads: one.
class Receiver {
 public:
  /// Arena and clock outlive it.
  Receiver(const shm::Arena& arena, dds::LinkBus bus, ReceiverOptions options,
           const Clock& clock = kMachineClock);

  /// Until `stop`, or the run stops; then the hosts that feed are told.
  Status run(const std::atomic<bool>& stop);
  /// Called in run(), and at its end.
  void every_second(std::function<void()> report) { every_second_ = std::move(report); }

  std::vector<FeederRecord> records() const;
  /// What records() of a predecessor said last, that hosts which have left are not forgotten. Call before run().
  void remember(const std::vector<FeederRecord>& records);
  /// Hosts of this name deliver what they have played, and go. They may join again.
  void ask_to_leave(const std::string& host);

 private:
  struct Guest {
    FeederRecord record;
    std::vector<int> workers;  ///< of this arena; its simulator k plays workers[k]
    uint32_t epoch = 0;
    uint64_t done_index = 0;
    std::deque<uint32_t> reserved;  ///< free slabs in our hands; the first is the one that is being filled
    std::unique_ptr<SlabAssembler> assembler;
    bool is_assembling = false;
    std::string refusal;  ///< why it may not feed
    bool is_asked_to_leave = false;
    double heard_s = 0, told_s = 0;
    uint64_t told_credit = 0, told_done = 0;
    bool is_to_be_told = false;
  };

  void turn();
  void hear(const dds::FeedReport& report);
  std::string seat(Guest& guest, const dds::FeedReport& report);
  void free_seat(Guest& guest);
  void take(const dds::TrajectoryFragment& fragment);
  void seal(Guest& guest, const dds::TrajectoryFragment& fragment);
  void take_episode(const dds::FeederEpisode& episode);
  void reserve();
  void give_back(Guest& guest);
  void forget_silent();
  void send_weights_if_due();
  void tell(Guest& guest);
  int remote_env(const Guest& guest, uint32_t env_index) const;  ///< -1: it has no such environment

  const shm::Arena& arena_;
  const Clock& clock_;
  dds::LinkBus bus_;
  const ReceiverOptions options_;
  const DoorKeeper door_;
  const uint64_t fingerprint_;
  uint64_t session_ = 0;
  std::map<uint64_t, Guest> guests_;
  Seats seats_;
  std::vector<std::byte> weights_, as_in_arena_;
  PolicyVersion weights_version_ = 0;
  bool are_weights_sent_ = false;
  WeightsPace weights_pace_;
  uint64_t beat_ = 0;
  bool is_stopping_ = false;
  double reported_s_ = 0;
  std::function<void()> every_second_;
};

}  // namespace comrad::link
