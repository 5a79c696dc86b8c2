#include "tests/simulation/many_hosts.h"

#include <sys/resource.h>

#include <algorithm>
#include <cstring>
#include <deque>
#include <map>
#include <memory>
#include <queue>
#include <vector>

#include "rollout_buffer/core/check.h"
#include "rollout_buffer/core/clock.h"
#include "rollout_buffer/core/log.h"
#include "rollout_buffer/core/rng.h"
#include "rollout_buffer/link/trajectories/trajectory_receiver.h"
#include "rollout_buffer/link/trajectories/trajectory_sender.h"
#include "rollout_buffer/shm/accounts.h"
#include "rollout_buffer/shm/slab_pool.h"
#include "rollout_buffer/shm/weight_buffers.h"
#include "tests/support/small_arena.h"

namespace comrad::simulation {
namespace {

using dds::Topic;
using Bytes = std::vector<std::byte>;

constexpr double kTickS = 0.02, kDelayS = 0.0005;
constexpr double kMessageBytes = 450;  // a hello or a state with the heads of RTPS, UDP and IP
constexpr std::size_t kReaderLimit = 256, kWriterLimit = 256;  // fragments, as link_bus.cc
constexpr double kAwayS = 5;
constexpr int64_t kWeightsBytes = 64;
constexpr double kFragments = 2;  // of these small slabs: what lies before and behind the final observations

struct Message {
  double arrival_s = 0;
  uint64_t key = 0;
  std::shared_ptr<const Bytes> head, payload;
};

/// The learner's host is in the middle; its line is what messages queue for.
struct Star {
  explicit Star(const ManyHosts& about)
      : traits(about), fragments(static_cast<std::size_t>(about.hosts)), to_host(fragments.size()) {}

  double size_of(Topic topic) const {
    return topic == Topic::kTrajectory ? traits.slab_bytes / kFragments
           : topic == Topic::kWeights  ? traits.weights_bytes
                                       : kMessageBytes;
  }
  /// `copies` of a message leave or reach the learner's host; when the last of them is through.
  double pass(double& line_free_s, double bytes) const {
    line_free_s = std::max(line_free_s, clock.now_s()) + bytes / traits.line_bytes_per_s;
    return line_free_s + kDelayS;
  }

  const ManyHosts& traits;
  ManualClock clock;
  std::map<Topic, std::deque<Message>> to_learner;
  std::vector<std::deque<Message>>
      fragments;  ///< by the host that wrote them: what one reader takes from many writers
  std::size_t next_host = 0;
  std::vector<std::map<Topic, std::deque<Message>>> to_host;
  double in_free_s = 0, out_free_s = 0, in_bytes = 0, out_bytes = 0, in_messages = 0, out_messages = 0;
  double cpu_s = 0, cpu_until_s = 0;  // of the receiver: what it used, and until when it is busy
  int hosts_here = 0;
};

class Port final : public dds::LinkCarrier {
 public:
  Port(Star& star, int host) : star_(star), host_(host) {}

  Status write(Topic topic, uint64_t key, std::span<const std::byte> head,
               std::span<const std::byte> payload) override {
    Message message{0, key, std::make_shared<Bytes>(head.begin(), head.end()),
                    std::make_shared<Bytes>(payload.begin(), payload.end())};
    if (host_ >= 0) {
      std::deque<Message>& queue = topic == Topic::kTrajectory
                                       ? star_.fragments[static_cast<std::size_t>(host_)]
                                       : star_.to_learner[topic];
      if (topic == Topic::kTrajectory && queue.size() >= kWriterLimit)
        return Error{ErrorCode::kTimeout, "the reader does not keep up"};
      message.arrival_s = star_.pass(star_.in_free_s, star_.size_of(topic));
      star_.in_bytes += star_.size_of(topic);
      ++star_.in_messages;
      queue.push_back(std::move(message));
      return {};
    }
    // Without multicast every reader of a topic gets a copy, also of what is for another.
    const double copies = star_.hosts_here;
    message.arrival_s = star_.pass(star_.out_free_s, copies * star_.size_of(topic));
    star_.out_bytes += copies * star_.size_of(topic);
    star_.out_messages += copies;
    star_.cpu_s += copies * star_.traits.cpu_s_per_message;
    star_.cpu_until_s += copies * star_.traits.cpu_s_per_message;
    if (topic == Topic::kState)
      star_.to_host[key - 1][topic].push_back(message);  // the others throw theirs away
    else
      for (auto& inbox : star_.to_host) inbox[topic] = {message};
    return {};
  }
  void take(Topic topic, const Visitor& visit) override {
    if (host_ >= 0) {
      take_from(star_.to_host[static_cast<std::size_t>(host_)][topic], visit, SIZE_MAX);
    } else if (topic != Topic::kTrajectory) {
      take_from(star_.to_learner[topic], visit, SIZE_MAX);
    } else {
      for (std::size_t idle = 0; idle < star_.fragments.size();) {
        star_.next_host = (star_.next_host + 1) % star_.fragments.size();
        idle = take_from(star_.fragments[star_.next_host], visit, 1) ? 0 : idle + 1;
      }
    }
  }
  bool is_acknowledged(Topic) const override { return star_.out_free_s <= star_.clock.now_s(); }
  bool wait(int) override { return true; }

  static constexpr double kSlabDecisions = 64;

 private:
  /// At most so many that have arrived, while the receiver has the time. Whether there was any.
  bool take_from(std::deque<Message>& queue, const Visitor& visit, std::size_t most) {
    const double now_s = star_.clock.now_s();
    bool has_any = false;
    for (; most > 0 && !queue.empty() && queue.front().arrival_s <= now_s; --most) {
      if (host_ < 0) {
        if (star_.cpu_until_s > now_s) return false;
        const double cost_s = queue.front().payload->empty()
                                  ? star_.traits.cpu_s_per_message
                                  : kSlabDecisions / kFragments * star_.traits.cpu_s_per_decision;
        star_.cpu_until_s = std::max(star_.cpu_until_s, now_s - kTickS) + cost_s;
        star_.cpu_s += cost_s;
      }
      const Message message = std::move(queue.front());
      queue.pop_front();
      visit(message.key, *message.head, *message.payload);
      has_any = true;
    }
    return has_any;
  }

  Star& star_;
  const int host_;  ///< -1: the learner's
};

shm::Arena make_arena(int workers, int slabs, int remote, uint64_t id) {
  shm::ArenaShape shape = test::small_arena_shape();
  shape.trajectory.rollout_steps = 2;
  shape.trajectory.final_capacity = 1;
  shape.trajectory.recurrent_state_count = 1;
  shape.sim_worker_count = workers;
  shape.envs_per_worker = shape.splits_per_worker = 1;
  shape.remote_worker_count = remote;
  shape.slab_count = slabs;
  shape.journal_steps = 0;
  shape.episode_ring_capacity = 1;
  shape.weights_bytes = kWeightsBytes;
  auto arena = shm::Arena::create(shape, id);
  COMRAD_CHECK(arena.has_value(), "a small arena can be made");
  arena->control().run_state = shm::RunState::kRunning;
  return std::move(*arena);
}

struct Host {
  explicit Host(int index) : arena(make_arena(1, 8, 0, static_cast<uint64_t>(index) + 100)) {}
  shm::Arena arena;
  std::unique_ptr<link::TrajectorySender> sender;
  double owed = 0;  ///< trajectories that it would have played by now
  uint64_t rollouts = 0;
  double away_until_s = 0, back_s = 0;
  uint64_t delivered_before = 0;

  /// Seals what it had time to play, while it has room.
  void play(double trajectories) {
    owed = std::min(owed + trajectories, 4.0);
    for (; owed >= 1; --owed) {
      const auto slab = arena.slabs().acquire(0);
      if (!slab) return;
      shm::SlabHeader& header = arena.slabs().header(static_cast<int>(*slab));
      header.env_index = 0;
      header.length = 2;
      header.rollout_index = rollouts++;
      const SlabView view = arena.slabs().view(static_cast<int>(*slab));
      for (int step = 0; step < 2; ++step) view.final_index(step) = -1;
      arena.slabs().seal(*slab);
    }
  }
};

}  // namespace

ManyHostsOutcome play(const ManyHosts& about) {
  spdlog::set_level(spdlog::level::off);  // a line for each host that comes or goes
  rlimit files{};
  getrlimit(RLIMIT_NOFILE, &files);
  files.rlim_cur = files.rlim_max;
  setrlimit(RLIMIT_NOFILE, &files);

  Star star(about);
  Rng random(about.seed);
  const shm::Arena learner = make_arena(1 + about.hosts, 8 * about.hosts + 16, about.hosts, 7);
  link::TrajectoryReceiverOptions options;
  options.first_worker = 1;
  options.most_peers = static_cast<std::size_t>(about.hosts);
  options.offer.scenario = "field";
  options.weights.bytes_per_s *= kWeightsBytes / about.weights_bytes;  // those of the simulation are small
  link::TrajectoryReceiver receiver(learner, dds::LinkBus(std::make_unique<Port>(star, -1)), options,
                                    star.clock);
  receiver.begin();
  std::vector<std::unique_ptr<Host>> hosts;
  for (int index = 0; index < about.hosts; ++index) hosts.push_back(std::make_unique<Host>(index));
  const auto begin = [&](int index) {
    Host& host = *hosts[static_cast<std::size_t>(index)];
    link::SendingOptions sending;
    sending.peer_id = static_cast<uint64_t>(index) + 1;
    sending.fingerprint = link::fingerprint_of(options.offer);
    sending.host = "host " + std::to_string(index);
    host.sender = std::make_unique<link::TrajectorySender>(
        host.arena, dds::LinkBus(std::make_unique<Port>(star, index)), sending, star.clock);
    (void)host.sender->begin();
    ++star.hosts_here;
  };
  for (int index = 0; index < about.hosts; ++index) begin(index);

  ManyHostsOutcome outcome;
  std::vector<double> back_s;
  const double began_s = star.clock.now_s(), end_s = began_s + about.seconds;
  double learner_owed = 0, next_weights_s = 0;
  uint64_t sealed = 0;
  uint32_t version = 0;
  std::vector<std::byte> weights(kWeightsBytes);
  while (star.clock.now_s() < end_s) {
    star.clock.advance_s(kTickS);
    const double now_s = star.clock.now_s();
    if (now_s >= next_weights_s) {
      next_weights_s = now_s + 0.5;
      learner.weights().publish(weights, ++version);
    }
    if (star.cpu_until_s <= now_s) receiver.turn();
    int open = 0;
    for (int index = 0; index < about.hosts; ++index) {
      Host& host = *hosts[static_cast<std::size_t>(index)];
      if (host.sender == nullptr) {
        if (now_s >= host.away_until_s) begin(index), host.back_s = now_s;
        continue;
      }
      host.play(about.decisions_per_s * kTickS / Port::kSlabDecisions);
      (void)host.sender->turn();
      (void)host.sender->keep_up();
      open += host.sender->is_open();
      if (host.back_s > 0 && host.sender->account().delivered > host.delivered_before)
        back_s.push_back(now_s - host.back_s), host.back_s = 0;
      if (random.uniform() < about.leaving_per_minute * kTickS / 60) {
        host.sender->leave();
        host.delivered_before = host.sender->account().delivered;
        host.sender.reset();
        --star.hosts_here;
        host.away_until_s = now_s + kAwayS;
        star.to_host[static_cast<std::size_t>(index)].clear();
      }
    }
    if (outcome.places_s == 0 && open == star.hosts_here) outcome.places_s = now_s - began_s;
    learner_owed =
        std::min(learner_owed + about.learner_decisions_per_s * kTickS / Port::kSlabDecisions, 256.0);
    const std::vector<uint32_t> slabs = learner.slabs().drain(static_cast<int>(learner_owed));
    for (const uint32_t slab : slabs) learner.slabs().release(slab);
    learner_owed -= static_cast<double>(slabs.size());
    sealed += slabs.size();
    std::size_t waiting = 0;
    for (const std::deque<Message>& queue : star.fragments) waiting += queue.size();
    outcome.queue_mb_most =
        std::max(outcome.queue_mb_most, static_cast<double>(std::min(waiting, kReaderLimit)) *
                                            star.size_of(Topic::kTrajectory) / 1e6);
    int reserved = 0;
    for (const link::PeerRecord& record : receiver.records()) reserved += static_cast<int>(record.credits);
    outcome.slabs_reserved_most = std::max(outcome.slabs_reserved_most, reserved);
  }
  outcome.decisions_per_s = static_cast<double>(sealed) * Port::kSlabDecisions / about.seconds;
  outcome.in_bytes_per_s = star.in_bytes / about.seconds;
  outcome.out_bytes_per_s = star.out_bytes / about.seconds;
  outcome.in_messages_per_s = star.in_messages / about.seconds;
  outcome.out_messages_per_s = star.out_messages / about.seconds;
  outcome.cpu_share = star.cpu_s / about.seconds;
  std::ranges::sort(back_s);
  if (!back_s.empty()) outcome.back_s_median = back_s[back_s.size() / 2], outcome.back_s_most = back_s.back();
  double least = 1e18, sum = 0;
  for (const link::PeerRecord& record : receiver.records()) {
    outcome.lost += record.missing;
    outcome.duplicates += record.duplicates;
    const auto slabs = static_cast<double>(record.slabs);
    least = std::min(least, slabs);
    sum += slabs;
  }
  outcome.least_share = sum > 0 ? least * about.hosts / sum : 0;
  return outcome;
}

}  // namespace comrad::simulation
