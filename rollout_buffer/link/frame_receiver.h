// The end of the frame link on the host with the policy: on its arena it stands where simulators stand. Rows of other
// hosts' simulators are written into free slabs, committed, answered by this host's policy workers as any other, and the
// whole slab is sealed when the simulator has sealed its own; so neither policy workers nor the learner know of the link.
// Stages: acquire, commit, seal.
#pragma once

#include <atomic>
#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <string>
#include <vector>

#include "rollout_buffer/core/clock.h"
#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/dds/link_bus.h"
#include "rollout_buffer/link/frame_stream.h"
#include "rollout_buffer/link/seats.h"
#include "rollout_buffer/shm/arena.h"

namespace comrad::link {

struct FrameReceiverOptions {
  int first_worker = 0;      ///< simulators of the arena from this one on are played by other hosts,
  int worker_count = 1;      ///< so many
  uint64_t fingerprint = 0;  ///< of the offer; other games are refused
  double silent_after_s =
      5;                     ///< then a host's free slabs go back, and another that needs its places has them
  double seat_kept_s = 600;  ///< then its simulators' places are free, and what it began is lost
};

/// Bounded: a host has one request under way for each environment, and may begin no more trajectories than there are
/// slabs for. Threads: one.
class FrameReceiver {
 public:
  /// Arena and clock outlive it.
  FrameReceiver(const shm::Arena& arena, dds::LinkBus bus, const FrameReceiverOptions& options,
                const Clock& clock = kMachineClock);

  /// Until `stop`, or the run stops; then the hosts that play are told.
  Status run(const std::atomic<bool>& stop);
  /// Called in run(), and at its end.
  void every_second(std::function<void()> report) { every_second_ = std::move(report); }

  std::vector<FeederRecord> records() const;
  /// What records() of a predecessor said last, that hosts which have left are not forgotten. Call before run().
  void remember(const std::vector<FeederRecord>& records);
  /// Hosts of this name deliver what they have played, and go. They may join again.
  void ask_to_leave(const std::string& host);

 private:
  /// A whole copy, to be sealed when the simulator has sealed its own.
  struct Copy {
    uint32_t slab = 0;
    uint32_t length = 0;
    uint64_t rollout_index = 0;  ///< of the simulators' host
    uint64_t layout_id = 0, first_episode_id = 0, first_episode_seed = 0;
  };
  /// One environment of another host, and the slab in which it plays here.
  struct Mirror {
    int env = 0;  ///< of this arena
    bool has_slab = false, is_out = false, is_answered = false;
    bool is_whole = false;  ///< every row of the slab was seen, from the first one on
    uint32_t slab = 0;
    uint32_t next_step = 0;
    uint32_t counted_epoch = 0;  ///< in which its first row was counted as begun
    uint64_t layout_id = 0, first_episode_id = 0, first_episode_seed = 0;
    FrameRequest request;  ///< the newest
    FrameAnswer answer;
    std::vector<int32_t> choices;  ///< of `answer`
    std::deque<Copy> whole;
    std::deque<std::pair<uint64_t, bool>>
        answered;  ///< rollouts, and whether they were sealed: asked again, told again
  };
  struct Guest {
    FeederRecord record;
    std::vector<int> workers;
    std::vector<Mirror> mirrors;  ///< by the host's own environment index
    std::deque<uint32_t> reserved;
    uint32_t epoch = 0;
    uint64_t session = 0, next_batch = 0, begun = 0, told_credit = 0, answers = 0;
    std::string refusal;
    double heard_s = 0, told_s = 0;
    std::vector<std::byte> payload;
    bool is_to_be_told = false;
    bool is_asked_to_leave = false;
  };

  void hear(const dds::FrameBatch& batch);
  std::string seat(Guest& guest, const dds::FrameBatch& batch);
  void free_seat(Guest& guest);
  void give_back(Guest& guest);
  void reserve();
  void take(Guest& guest, const dds::FrameBatch& batch);
  void mirror(Guest& guest, const FrameRequest& request, const FrameUnpacker& frames);
  bool begin(Guest& guest, Mirror& mirror, const FrameRequest& request);
  void abandon(Guest& guest, Mirror& mirror);
  bool collect();
  void finish(Guest& guest, Mirror& mirror);
  void answer(Guest& guest, const Mirror& mirror);
  void confirm(Guest& guest, Mirror& mirror, const FrameRequest& request);
  bool seal(Guest& guest, const Mirror& mirror, const Copy& copy);
  void lose(Guest& guest, uint32_t slab, uint64_t steps);
  void forget_silent();
  void tell(uint64_t id, Guest& guest);

  const shm::Arena& arena_;
  const Clock& clock_;
  dds::LinkBus bus_;
  const FrameReceiverOptions options_;
  std::map<uint64_t, Guest> guests_;
  Seats seats_;
  std::vector<std::byte> raw_;
  std::vector<uint32_t> round_;  ///< requests of each split in the batch under way
  int out_count_ = 0;
  int waiting_for_ = -1;  ///< a split that is being answered
  bool is_stopping_ = false;
  double reported_s_ = 0;
  std::function<void()> every_second_;
};

}  // namespace comrad::link
