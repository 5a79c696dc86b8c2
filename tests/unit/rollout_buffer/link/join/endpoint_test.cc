#include "rollout_buffer/link/join/endpoint.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <nlohmann/json.hpp>

#include "rollout_buffer/core/checksum.h"
#include "rollout_buffer/core/clock.h"
#include "rollout_buffer/link/join/link_address.h"
#include "rollout_buffer/link/join/link_files.h"
#include "tests/support/random_bytes.h"
#include "tests/support/scratch_folder.h"

namespace comrad::link {
namespace join_test {

using nlohmann::json;
using ::testing::HasSubstr;

class Join : public ::testing::Test {
 protected:
  Join() {
    const std::string bytes(3 * dds::kChunkBytes / 2, 'm');
    scratch_.write("map.wad", bytes);
    offer_ = {.scenario = "stag_hunt_arena",
              .scenario_checksum = 11,
              .iwad_checksum = 12,
              .files = {{.name = "layouts/map.wad",
                         .path = scratch_ / "map.wad",
                         .bytes = bytes.size(),
                         .checksum = checksum64(std::as_bytes(std::span(bytes)))}}};
  }
  json ask(json question) {
    if (!question.contains("protocol")) question["protocol"] = kJoinProtocol;
    if (!question.contains("link")) question["link"] = dds::kLinkVersion;
    const JoinEndpoint keeper(offer_);
    last_ = keeper.answer({.peer_id = 3, .question_id = 4, .text = question.dump()});
    EXPECT_EQ(last_.peer_id, 3u);
    EXPECT_EQ(last_.question_id, 4u);
    return json::parse(last_.text);
  }

  const test::ScratchFolder scratch_;
  Offer offer_;
  dds::JoinAnswer last_;
};

TEST_F(Join, TheOfferNamesFilesAndNotWhereTheyLie) {
  const json said = ask({{"ask", "offer"}});
  EXPECT_EQ(said["bytes"], last_.payload.size());
  EXPECT_THAT(last_.payload, ::testing::Not(HasSubstr(scratch_.string())));
  const auto offer = parse_offer(last_.payload);
  ASSERT_TRUE(offer) << offer.error().message;
  EXPECT_EQ(offer->scenario, "stag_hunt_arena");
  EXPECT_EQ(offer->scenario_checksum, 11u);
  EXPECT_EQ(offer->iwad_checksum, 12u);
  ASSERT_EQ(offer->files.size(), 1u);
  EXPECT_EQ(offer->files[0].name, "layouts/map.wad");
  EXPECT_EQ(offer->files[0].checksum, offer_.files[0].checksum);
  EXPECT_EQ(fingerprint_of(*offer), fingerprint_of(offer_)) << "both ends mean the same game";
  const auto own = parse_offer(text_of(offer_, /*with_paths=*/true));
  ASSERT_TRUE(own);
  EXPECT_EQ(own->files[0].path, offer_.files[0].path);
}

TEST_F(Join, FilesComeInPieces) {
  std::string bytes;
  for (int piece = 0; piece < 2; ++piece) {
    EXPECT_EQ(ask({{"ask", "file"}, {"name", "layouts/map.wad"}, {"offset", bytes.size()}})["offset"],
              bytes.size());
    bytes += last_.payload;
  }
  EXPECT_EQ(bytes, std::string(3 * dds::kChunkBytes / 2, 'm'));
  EXPECT_EQ(ask({{"ask", "file"}, {"name", "layouts/map.wad"}, {"offset", ~uint64_t{0}}})["offset"],
            bytes.size());
  EXPECT_TRUE(last_.payload.empty());
}

TEST_F(Join, APingIsAnsweredWithTheTimeAndAsManyBytesAsAChunkHolds) {
  const double before_s = wall_s();
  EXPECT_GE(ask({{"ask", "ping"}, {"bytes", 1000}})["time_s"].get<double>(), before_s);
  EXPECT_EQ(last_.payload.size(), 1000u);
  ask({{"ask", "ping"}, {"bytes", ~uint64_t{0}}});
  EXPECT_EQ(last_.payload.size(), dds::kChunkBytes);
}

TEST_F(Join, AnotherVersionGetsThisOnesNumber) {
  EXPECT_THAT(ask({{"ask", "offer"}, {"protocol", 99}})["error"], HasSubstr("join protocol 1"));
  EXPECT_THAT(ask({{"ask", "offer"}, {"link", 99}})["error"], HasSubstr("install the same version"));
}

TEST_F(Join, OnlyWhatIsOfferedIsGivenAndOnlyAsItWas) {
  EXPECT_THAT(ask({{"ask", "file"}, {"name", "/etc/passwd"}})["error"], HasSubstr("no file of that name"));
  EXPECT_THAT(ask({{"ask", "file"}, {"name", "../link_id"}})["error"], HasSubstr("no file of that name"));
  EXPECT_THAT(ask({{"ask", "everything"}})["error"], HasSubstr("neither"));
  scratch_.write("map.wad", "another map");
  EXPECT_THAT(ask({{"ask", "file"}, {"name", "layouts/map.wad"}})["error"], HasSubstr("has changed"));
}

TEST_F(Join, NoQuestionAndNoOfferDoesHarm) {
  const JoinEndpoint keeper(offer_);
  const uint64_t seed = test::fuzz_seed();
  Rng rng(seed);
  const std::string question = json{{"protocol", kJoinProtocol},
                                    {"link", dds::kLinkVersion},
                                    {"ask", "file"},
                                    {"name", "x"},
                                    {"offset", 1}}
                                   .dump(),
                    offer = text_of(offer_, true);
  for (int round = 0; round < 3000; ++round) {
    const dds::JoinAnswer answer = keeper.answer({.text = test::mutated(rng, question)});
    EXPECT_LE(answer.text.size(), dds::kQuestionBytes) << "seed " << seed << " round " << round;
    const auto parsed = parse_offer(test::mutated(rng, offer));
    if (!parsed) continue;
    for (const OfferedFile& file : parsed->files) {
      EXPECT_NE(file.name[0], '/') << "seed " << seed;
      EXPECT_EQ(file.name.find("/."), std::string::npos) << "seed " << seed;
    }
  }
  for (const char* name : {"../x", "/etc/passwd", "a/../../x", ".ssh/key", "a//b", "a b", ""}) {
    Offer hostile = offer_;
    hostile.files[0].name = name;
    EXPECT_FALSE(parse_offer(text_of(hostile, false))) << name;
  }
  Offer large = offer_;
  large.files[0].bytes = uint64_t{1} << 40;
  EXPECT_FALSE(parse_offer(text_of(large, false)));
}

TEST(LinkAddress, IsReadAsItIsPrinted) {
  for (const char* text : {"192.168.1.7/0123456789abcdef", "127.0.0.1:12000/ffffffffffffffff"}) {
    const auto address = parse_address(text);
    ASSERT_TRUE(address) << address.error().message;
    EXPECT_EQ(text_of(*address), text);
  }
  for (const char* text :
       {"", "192.168.1.7", "192.168.1.7/", "192.168.1.7/012345678", "host/0123456789abcdef",
        "1.2.3.4:x/0123456789abcdef", "1.2.3.4/0123456789abcdeg", "1.2.3.4/0123456789abcdef0"}) {
    const auto refused = parse_address(text);
    ASSERT_FALSE(refused) << text;
    EXPECT_THAT(refused.error().message, HasSubstr("192.168.1.7/"));
  }
}

TEST(LinkAddress, ARunKeepsItsIdForItsOwnerAlone) {
  const test::ScratchFolder scratch;
  const auto first = keep_link_id(scratch.string()), again = keep_link_id(scratch.string());
  ASSERT_TRUE(first && again);
  EXPECT_EQ(*first, *again);
  EXPECT_NE(*first, 0u);
  struct stat about {};
  ASSERT_EQ(stat((scratch / kLinkIdFile).c_str(), &about), 0);
  EXPECT_EQ(about.st_mode & 0777, 0600u);
  scratch.write(kLinkIdFile, "garbage");
  const auto damaged = keep_link_id(scratch.string());
  ASSERT_FALSE(damaged);
  EXPECT_THAT(damaged.error().message, HasSubstr("remove it"));
}

TEST(LinkAddress, IsFoundInTheFolderOfTheRunThatServes) {
  const test::ScratchFolder scratch;
  EXPECT_FALSE(read_address(scratch.string()));
  const LinkAddress address{.host = "10.1.2.3", .port_base = 9000, .link_id = 77};
  ASSERT_TRUE(keep_address(scratch.string(), address));
  ASSERT_TRUE(keep_address(scratch.string(), address)) << "once more";
  struct stat about {};
  ASSERT_EQ(stat((scratch / kAddressFile).c_str(), &about), 0);
  EXPECT_EQ(about.st_mode & 0777, 0600u) << "a process with the id may request a place";
  for (const std::string& given : {scratch.string(), (scratch / kAddressFile).string(), text_of(address)}) {
    const auto read = read_address(given);
    ASSERT_TRUE(read) << given << read.error().message;
    EXPECT_EQ(text_of(*read), "10.1.2.3:9000/000000000000004d");
  }
}

TEST(LinkFiles, AccountsAreReadAsTheyWereWritten) {
  const test::ScratchFolder scratch;
  EXPECT_FALSE(read_feed(scratch.string()));
  EXPECT_TRUE(read_peers(scratch.string(), kTrajectoryFiles).empty());
  ASSERT_TRUE(
      write_feed(scratch.string(),
                 {.account = {.played = 9, .delivered = 4, .waiting = 3, .unfinished = 2}, .is_fed = true}));
  const auto feed = read_feed(scratch.string());
  ASSERT_TRUE(feed);
  EXPECT_EQ(feed->account.played, 9u);
  EXPECT_EQ(feed->account.waiting, 3u);
  EXPECT_TRUE(feed->is_fed);
  EXPECT_FALSE(feed->has_ended);
  ASSERT_TRUE(write_peers(scratch.string(), kTrajectoryFiles,
                          {{.host = "b\"", .workers = 2, .is_here = true, .decisions = 5}}));
  const auto peers = read_peers(scratch.string(), kTrajectoryFiles);
  ASSERT_EQ(peers.size(), 1u);
  EXPECT_EQ(peers[0].host, "b\"");
  EXPECT_EQ(peers[0].decisions, 5u);
  scratch.write(kTrajectoryFiles.peers, "{\"guests\": [1, {\"host\": 3}]}");
  EXPECT_EQ(read_peers(scratch.string(), kTrajectoryFiles).size(), 1u) << "what is no account is left out";
  remove_accounts(scratch.string());
  EXPECT_FALSE(read_feed(scratch.string()));
}

TEST(LinkAddress, TheInterfaceFollowsFromTheAddress) {
  const auto loopback = interface_towards("127.0.0.1");
  ASSERT_TRUE(loopback) << loopback.error().message;
  EXPECT_EQ(*loopback, "lo");
  EXPECT_FALSE(interface_towards("nonsense"));
  const auto address = address_of_interface("lo");
  ASSERT_TRUE(address);
  EXPECT_EQ(*address, "127.0.0.1");
  EXPECT_FALSE(address_of_interface("no-such-one"));
}

}  // namespace join_test
}  // namespace comrad::link
