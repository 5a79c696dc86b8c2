#include "deploy/hosts/run_offer.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>

#include "rollout_buffer/core/files.h"
#include "rollout_buffer/core/layout_list.h"
#include "rollout_buffer/link/join/link_files.h"
#include "rollout_buffer/settings/layers.h"
#include "tests/support/scratch_folder.h"

namespace comrad::deploy {
namespace run_offer_test {

using ::testing::HasSubstr;

/// A scenario in a folder that COMRAD_SCENARIO_PATH names, and a run that plays it.
class RunOffer : public ::testing::Test {
 protected:
  RunOffer() {
    scratch_.write("scenarios/field/scenario.toml", "title = \"Field\"");
    scratch_.write("scenarios/field/script.acs", "script 1 OPEN {}");
    setenv("COMRAD_SCENARIO_PATH", (scratch_ / "scenarios").c_str(), 1);
    iwad_ = scratch_.write("doom.wad", "IWAD and more");
    config_.run.scenario = "field";
    config_.run.train_dir = "/somewhere/else";
    config_.run.seed = 7;
    config_.collection.num_workers = 30;
    config_.collection.device = "cuda:1";
    config_.collection.policy_device = "cuda:0";
    config_.collection.rollout = 16;
    config_.environment.wad = scratch_.write("run/layouts/field_42.wad", "PWAD here");
  }
  ~RunOffer() override { unsetenv("COMRAD_SCENARIO_PATH"); }

  /// As the other host has it after its visit at the join endpoint.
  void fetch(const std::string& to) {
    const Expected<link::Offer> offer = link::read_offer(run_);
    ASSERT_TRUE(offer) << offer.error().message;
    for (const link::OfferedFile& file : offer->files)
      scratch_.write(to + "/" + file.name, read_file(file.path).value_or(""));
  }

  test::ScratchFolder scratch_;
  const std::string run_ = scratch_ / "run";
  std::string iwad_;
  RunConfig config_;
};

TEST_F(RunOffer, SettingsTravelWithoutWhatConcernsTheServingHostAlone) {
  ASSERT_TRUE(make_offer(run_, config_, iwad_));
  fetch("peer");
  const Expected<RunConfig> joined = joined_settings(scratch_ / "peer");
  ASSERT_TRUE(joined) << joined.error().message;
  EXPECT_EQ(joined->run.scenario, "field");
  EXPECT_EQ(joined->collection.rollout, 16);
  EXPECT_EQ(joined->collection.num_workers, 0);
  EXPECT_EQ(joined->collection.device, "auto");
  EXPECT_EQ(joined->collection.policy_device, "");
  EXPECT_EQ(joined->run.train_dir, RunConfig().run.train_dir);
  EXPECT_EQ(read_file(joined->environment.wad), "PWAD here") << joined->environment.wad;
}

TEST_F(RunOffer, AResumedRunOffersTheSameAgain) {
  ASSERT_TRUE(make_offer(run_, config_, iwad_));
  const uint64_t before = link::fingerprint_of(*link::read_offer(run_));
  config_.run.train_for_env_frames = 5;
  config_.collection.num_workers = 2;
  ASSERT_TRUE(make_offer(run_, config_, iwad_));
  EXPECT_EQ(link::fingerprint_of(*link::read_offer(run_)), before);
  config_.collection.rollout = 32;
  ASSERT_TRUE(make_offer(run_, config_, iwad_));
  EXPECT_NE(link::fingerprint_of(*link::read_offer(run_)), before);
}

TEST_F(RunOffer, MapsOfAPoolAreSentAndFoundOnTheOtherHost) {
  config_.environment.wad.clear();
  config_.environment.layout_pool = "train:2";
  LayoutList list;
  list.layouts = {{"one", scratch_.write("pool/a.wad", "A"), 0, 12},
                  {"two", scratch_.write("pool/b.wad", "B"), 0, 0}};
  scratch_.write("run/layouts/pool.toml", layout_list_text(list));
  ASSERT_TRUE(make_offer(run_, config_, iwad_));
  fetch("peer");
  const Expected<RunConfig> joined = joined_settings(scratch_ / "peer");
  ASSERT_TRUE(joined) << joined.error().message;
  const Expected<LayoutList> there = read_layout_list(scratch_ / "peer");
  ASSERT_TRUE(there) << there.error().message;
  ASSERT_EQ(there->layouts.size(), 2u);
  EXPECT_EQ(there->layouts[0].id, "one");
  EXPECT_EQ(there->layouts[0].ceiling, 12);
  EXPECT_EQ(read_file(there->layouts[1].path), "B");
  // A list that leads out of the folder is refused.
  for (const char* way_out : {"/etc/passwd", "layouts/../../doom.wad", ""}) {
    list.layouts[1].path = way_out;
    scratch_.write("peer/layouts/link_pool.toml", layout_list_text(list));
    EXPECT_FALSE(joined_settings(scratch_ / "peer")) << way_out;
  }
}

TEST_F(RunOffer, AnotherScenarioOrIwadIsDistinguished) {
  ASSERT_TRUE(make_offer(run_, config_, iwad_));
  const Expected<link::Offer> offer = link::read_offer(run_);
  ASSERT_TRUE(offer);
  EXPECT_TRUE(compare_with(*offer, iwad_));
  const std::string other = scratch_.write("other.wad", "IWAD and less");
  EXPECT_THAT(compare_with(*offer, other).error().message, HasSubstr("the IWAD " + other));
  scratch_.write("scenarios/field/README.md", "read me");
  EXPECT_TRUE(compare_with(*offer, iwad_)) << "a text changes no game";
  scratch_.write("scenarios/field/script.acs", "script 2 OPEN {}");
  EXPECT_THAT(compare_with(*offer, iwad_).error().message, HasSubstr("scenario field is another one"));
  std::filesystem::remove_all(scratch_ / "scenarios/field");
  EXPECT_THAT(compare_with(*offer, iwad_).error().message, HasSubstr("no scenario 'field'"));
}

TEST_F(RunOffer, AScenarioByItsPathIsRefused) {
  config_.run.scenario = scratch_ / "scenarios/field";
  EXPECT_THAT(make_offer(run_, config_, iwad_).error().message, HasSubstr("COMRAD_SCENARIO_PATH"));
}

}  // namespace run_offer_test
}  // namespace comrad::deploy
