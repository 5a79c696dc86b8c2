#include "rollout_buffer/dds/link_bus.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <functional>
#include <random>

#include "rollout_buffer/core/clock.h"
#include "tests/support/network_pair.h"
#include "tests/support/patience.h"

namespace comrad::dds {
namespace link_bus_test {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

uint64_t fresh_id() {
  static std::random_device device;
  return (uint64_t{device()} << 32) | device();
}

LinkBus open_link(const BusConfig& config) {
  auto bus = LinkBus::open(config);
  EXPECT_TRUE(bus) << bus.error().message;
  return std::move(bus).value();
}

const double kPatience_s = test::kPatienceSeconds * test::patience();

bool eventually(LinkBus& bus, double limit_s, const std::function<bool()>& done) {
  for (const double end_s = monotonic_s() + limit_s; monotonic_s() < end_s;) {
    if (done()) return true;
    bus.wait(20);
  }
  return done();
}

std::vector<std::byte> noise(std::size_t count) {
  std::vector<std::byte> bytes(count);
  for (std::size_t i = 0; i < count; ++i) bytes[i] = static_cast<std::byte>(i * 2654435761u >> 13);
  return bytes;
}

TEST(LinkBus, CarriesEveryTopicWholeUpToItsBound) {
  const BusConfig config = link_config(fresh_id());
  LinkBus bus = open_link(config);  // a participant hears itself, too
  int questions = 0, answers = 0, reports = 0, states = 0, fragments = 0, weights = 0, episodes = 0;
  const std::vector<std::byte> chunk = noise(kChunkBytes), piece = noise(kFragmentPayloadBytes);
  const std::string text(kQuestionBytes, 't'), payload(kChunkBytes, 'p');
  const auto take = [&] {
    bus.take_questions([&](const JoinQuestion& in) {
      ++questions;
      EXPECT_EQ(in.peer_id, 1u);
      EXPECT_EQ(in.question_id, 2u);
      EXPECT_EQ(in.text, text);
    });
    bus.take_answers([&](const JoinAnswer& in) {
      ++answers;
      EXPECT_EQ(in.text, text);
      EXPECT_EQ(in.payload, payload);
    });
    bus.take<SenderReport>([&](const SenderReport& in) {
      ++reports;
      EXPECT_EQ(in.hello.epoch, 3u);
      EXPECT_EQ(in.hello.sim_workers, 4u);
      EXPECT_EQ(in.hello.is_leaving, 1u);
      EXPECT_EQ(in.decisions_delivered, uint64_t{1} << 40);
      EXPECT_EQ(in.hello.host.str(), "there");
    });
    bus.take<PeerState>([&](const PeerState& in) {
      if (in.peer_id != 1) return;
      ++states;
      EXPECT_EQ(in.run, PeerRun::kPaused);
      EXPECT_EQ(in.message.str(), "because");
      EXPECT_EQ(in.done_index, 5u);
      EXPECT_EQ(in.credit_index, 9u);
      EXPECT_EQ(in.schedule_env_frames, uint64_t{1} << 40);
    });
    bus.take<TrajectoryFragment>([&](const TrajectoryFragment& in) {
      ++fragments;
      EXPECT_EQ(in.send_index, 6u);
      EXPECT_EQ(in.rollout_index, 7u);
      EXPECT_EQ(in.length, 8u);
      EXPECT_TRUE(std::ranges::equal(in.payload, piece));
    });
    bus.take<WeightsChunk>([&](const WeightsChunk& in) {
      ++weights;
      EXPECT_EQ(in.version, 11u);
      EXPECT_EQ(in.bf16_count, 12u);
      EXPECT_TRUE(std::ranges::equal(in.payload, chunk));
    });
    bus.take<PeerEpisode>([&](const PeerEpisode& in) {
      ++episodes;
      EXPECT_THAT(in.record.returns(), ElementsAre(1, -2));
      EXPECT_THAT(in.record.scores(), ElementsAre(3, 4));
      EXPECT_EQ(in.record.score, 12.5f);
    });
  };
  take();  // the readers are there before the first message
  ASSERT_TRUE(bus.write(JoinQuestion{.peer_id = 1, .question_id = 2, .text = text}));
  ASSERT_TRUE(bus.write(JoinAnswer{.peer_id = 1, .question_id = 2, .text = text, .payload = payload}));
  ASSERT_TRUE(bus.write(
      SenderReport{.hello = {.peer_id = 1, .epoch = 3, .sim_workers = 4, .is_leaving = 1, .host = "there"},
                   .decisions_delivered = uint64_t{1} << 40}));
  ASSERT_TRUE(bus.write(PeerState{.peer_id = 2}));  // another host's
  ASSERT_TRUE(bus.write(PeerState{.peer_id = 1,
                                  .done_index = 5,
                                  .credit_index = 9,
                                  .schedule_env_frames = uint64_t{1} << 40,
                                  .run = PeerRun::kPaused,
                                  .message = "because"}));
  ASSERT_TRUE(bus.write(
      TrajectoryFragment{.peer_id = 1, .send_index = 6, .rollout_index = 7, .length = 8, .payload = piece}));
  ASSERT_TRUE(bus.write(WeightsChunk{.bf16_count = 12, .chunk_count = 1, .version = 11, .payload = chunk}));
  ASSERT_TRUE(bus.write(PeerEpisode{
      .record = {.agent_count = 2, .score = 12.5f, .agent_return = {1, -2}, .agent_score = {3, 4}}}));
  EXPECT_TRUE(eventually(bus, kPatience_s, [&] {
    take();
    return questions && answers && reports && states && fragments && weights && episodes;
  }));
  EXPECT_EQ(questions + answers + reports + states + fragments + weights + episodes, 7);
}

TEST(LinkBus, WordsAreCutBetweenTwoCharacters) {
  EXPECT_EQ(Words("because").str(), "because");
  EXPECT_EQ(Words(std::string(300, 'x')).str(), std::string(255, 'x'));
  EXPECT_EQ(Words(std::string(254, 'x') + "\u00e4").str(), std::string(254, 'x'));
}

TEST(LinkBus, RefusesWhatIsBeyondATopicsBound) {
  LinkBus bus = open_link(link_config(fresh_id()));
  const std::vector<std::byte> large = noise(kChunkBytes + 1);
  for (const Status& refused :
       {bus.write(JoinQuestion{.text = std::string(kQuestionBytes + 1, 't')}),
        bus.write(JoinAnswer{.text = std::string(kQuestionBytes + 1, 't')}),
        bus.write(JoinAnswer{.payload = std::string(kChunkBytes + 1, 'p')}),
        bus.write(TrajectoryFragment{.payload = std::span(large).first(kFragmentPayloadBytes + 1)}),
        bus.write(WeightsChunk{.payload = large})}) {
    ASSERT_FALSE(refused);
    EXPECT_EQ(refused.error().code, ErrorCode::kBadInput);
    EXPECT_THAT(refused.error().message, HasSubstr("at most"));
  }
}

TEST(LinkBus, ANetworkWithoutKeysIsUsedOnlyOnRequest) {
  BusConfig config = link_config(fresh_id());
  config.interface_name = "eth0";
  const auto refused = LinkBus::open(config);
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().code, ErrorCode::kBadInput);
  EXPECT_THAT(refused.error().message, HasSubstr("--insecure_network"));
  config.allows_insecure_network = true;
  config.interface_name = "no-such-one";
  const auto missing = LinkBus::open(config);
  ASSERT_FALSE(missing);
  EXPECT_THAT(missing.error().message, HasSubstr("ip addr"));
}

TEST(LinkBus, PeersPortsAndBuffersAreChecked) {
  const auto refusal = [](const std::function<void(BusConfig&)>& change) {
    BusConfig config = link_config(1);
    change(config);
    const Status valid = validate(config);
    return valid ? std::string() : valid.error().message;
  };
  EXPECT_EQ(refusal([](BusConfig&) {}), "");
  EXPECT_THAT(refusal([](BusConfig& config) {
                config.peers = {"10.0.0.1", "10.0.0.1\"/><x"};
              }),
              HasSubstr("10.0.0.1"));
  EXPECT_THAT(refusal([](BusConfig& config) { config.peers = {"localhost"}; }), HasSubstr("IPv4"));
  EXPECT_THAT(refusal([](BusConfig& config) { config.port_base = 80; }), HasSubstr("port base 80"));
  EXPECT_THAT(refusal([](BusConfig& config) { config.port_base = 65000; }), HasSubstr("65535"));
  EXPECT_THAT(refusal([](BusConfig& config) { config.receive_buffer_mb = 0; }), HasSubstr("1 to 1024"));
  EXPECT_THAT(refusal([](BusConfig& config) { config.max_participants = 121; }), HasSubstr("121"));
  BusConfig moved = link_config(1);
  moved.port_base = 12000;
  EXPECT_THAT(make_cyclone_config(moved).value(), HasSubstr("<Base>12000</Base>"));
}

/// Two hosts: one reports until it is answered, the other answers. Afterwards both exit with 0.
int report_until_answered(const BusConfig& config, double limit_s) {
  auto bus = LinkBus::open(config);
  if (!bus) return 2;
  bool is_answered = false;
  bus->take<PeerState>([](const PeerState&) {});
  eventually(*bus, limit_s, [&] {
    (void)bus->write(SenderReport{.hello = {.peer_id = 7, .host = "b"}});
    bus->take<PeerState>([&](const PeerState& in) { is_answered |= in.peer_id == 7; });
    return is_answered;
  });
  return is_answered ? 0 : 3;
}

int answer_reports(const BusConfig& config, double limit_s) {
  auto bus = LinkBus::open(config);
  if (!bus) return 2;
  int heard = 0;
  double first_s = 0;
  bus->take<SenderReport>([](const SenderReport&) {});
  eventually(*bus, limit_s, [&] {
    bus->take<SenderReport>([&](const SenderReport& in) {
      if (++heard == 1) first_s = monotonic_s();
      (void)bus->write(PeerState{.peer_id = in.hello.peer_id});
    });
    return heard > 0 && monotonic_s() - first_s > 3;
  });
  return heard > 0 ? 0 : 3;
}

TEST(LinkBus, TwoHostsMeetByUnicastAndAnotherRunOfTheSameNetworkStaysApart) {
  const test::NetworkPair network;
  if (!network.is_made()) GTEST_SKIP() << test::NetworkPair::why_not();
  const uint64_t id = fresh_id();
  const auto config = [&](uint64_t link_id, int end, std::vector<std::string> peers) {
    BusConfig of_end = link_config(link_id);
    of_end.domain_id = 5;  // the unknown peers' as well: tag and partition must do
    of_end.interface_name = network.device(end);
    of_end.peers = std::move(peers);
    of_end.allows_insecure_network = true;
    return of_end;
  };
  // Only the host that joins has the other one's address.
  const pid_t server = network.start(0, [&] { return answer_reports(config(id, 0, {}), kPatience_s); });
  const pid_t unknown =
      network.start(1, [&] { return report_until_answered(config(id + 1, 1, {network.address(0)}), 4); });
  const pid_t joined = network.start(
      1, [&] { return report_until_answered(config(id, 1, {network.address(0)}), kPatience_s); });
  EXPECT_EQ(test::NetworkPair::wait(joined), 0) << "the host that joins was not answered";
  EXPECT_EQ(test::NetworkPair::wait(unknown), 3) << "a run was answered by another run";
  EXPECT_EQ(test::NetworkPair::wait(server), 0);
}

TEST(LinkBus, ARunsBusOnLoopbackIsNotHeardOnTheNetwork) {
  const test::NetworkPair network(2);
  if (!network.is_made()) GTEST_SKIP() << test::NetworkPair::why_not();
  const uint64_t id = fresh_id();
  const pid_t server =
      network.start(0, [&] { return answer_reports(link_config(id), 5); });  // on its loopback
  const pid_t outside = network.start(1, [&] {
    BusConfig config = link_config(id);
    config.interface_name = network.device(1);
    config.peers = {network.address(0)};
    config.allows_insecure_network = true;
    return report_until_answered(config, 4);
  });
  EXPECT_EQ(test::NetworkPair::wait(outside), 3);
  EXPECT_EQ(test::NetworkPair::wait(server), 3) << "a report came through loopback";
}

}  // namespace link_bus_test
}  // namespace comrad::dds
