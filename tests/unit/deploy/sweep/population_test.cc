// What members of a population do between two generations, and what they leave.
#include "deploy/sweep/population.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <set>

#include "rollout_buffer/core/files.h"
#include "tests/support/scratch_folder.h"

namespace comrad::deploy {
namespace population_test {

using ::testing::HasSubstr;
namespace fs = std::filesystem;

SweepSearch a_search() {
  SweepSearch search;
  search.method = SearchMethod::kPbt;
  search.runs = 4;
  search.seed = 3;
  search.every_env_frames = 1000;
  search.resample_probability = 0;
  search.space = {{.setting = "learning_rate", .choices = {}, .low = 1e-5, .high = 1e-2, .is_log = true},
                  {.setting = "num_epochs", .choices = {}, .low = 1, .high = 8, .is_whole = true},
                  {.setting = "exploration_loss", .choices = {"entropy", "none"}}};
  return search;
}

/// Members that have finished one generation with these scores; NaN: no episode had ended.
std::vector<Member> members_with(const std::vector<double>& scores) {
  std::vector<Member> members;
  for (std::size_t i = 0; i < scores.size(); ++i) {
    const std::string rate = std::to_string(i + 1) + "e-03";
    members.push_back(
        {"member_" + std::to_string(i + 1),
         {{.settings = {{"learning_rate", rate}, {"num_epochs", "4"}, {"exploration_loss", "none"}},
           .env_frames = 1000,
           .score = scores[i]}}});
  }
  return members;
}

std::string value_in(const Generation& generation, const std::string& setting) {
  for (const auto& [name, value] : generation.settings)
    if (name == setting) return value;
  return "";
}

TEST(NextGeneration, TheFirstIsDrawnFromTheWholeSpaceAndIsTheSameAgain) {
  SweepSearch search = a_search();
  std::set<std::string> epochs, losses;
  int low_rates = 0;
  for (search.seed = 0; search.seed < 200; ++search.seed) {
    const std::vector<Member> members = {
        {"seed7_member_1", {}}, {"seed7_member_2", {}}, {"seed8_member_2", {}}};
    const Generation first = next_generation(search, members, 1);
    EXPECT_EQ(first.settings, next_generation(search, members, 1).settings);
    EXPECT_NE(first.settings, next_generation(search, members, 0).settings);
    EXPECT_NE(first.settings, next_generation(search, members, 2).settings) << "another population";
    EXPECT_TRUE(check_in_space(search, first.settings, "it"));
    EXPECT_TRUE(first.parent.empty());
    epochs.insert(value_in(first, "num_epochs"));
    losses.insert(value_in(first, "exploration_loss"));
    low_rates += std::strtod(value_in(first, "learning_rate").c_str(), nullptr) < 1e-4;
  }
  EXPECT_EQ(epochs.size(), 8u);
  EXPECT_EQ(losses.size(), 2u);
  EXPECT_NEAR(low_rates, 200 / 3.0, 30);  // a third of the logarithms
}

TEST(NextGeneration, TheWorstTakesTheBestAndMultipliesItsNumbersByAFactor) {
  SweepSearch search = a_search();
  const std::vector<Member> members = members_with({5, 1, 9, 4});
  std::set<std::string> rates, epochs;
  for (search.seed = 0; search.seed < 50; ++search.seed) {
    const Generation next = next_generation(search, members, 1);
    EXPECT_EQ(next.parent, "member_3");
    rates.insert(value_in(next, "learning_rate"));
    epochs.insert(value_in(next, "num_epochs"));
    EXPECT_EQ(value_in(next, "exploration_loss"), "none");  // a choice is drawn anew or stays
    EXPECT_FALSE(next.is_over());
  }
  EXPECT_EQ(rates.size(), 2u);
  EXPECT_NEAR(std::stod(*rates.begin()), 3e-3 * 0.8, 1e-12);
  EXPECT_NEAR(std::stod(*rates.rbegin()), 3e-3 * 1.2, 1e-12);
  EXPECT_EQ(epochs, (std::set<std::string>{"3", "5"}));
  for (const std::size_t good : {0u, 2u, 3u}) {
    const Generation next = next_generation(search, members, good);
    EXPECT_TRUE(next.parent.empty());
    EXPECT_EQ(next.settings, members[good].generations[0].settings);
  }
}

TEST(NextGeneration, StaysInTheRangeAndDrawsAnewWhereTheFileRequestsIt) {
  SweepSearch search = a_search();
  search.perturb = {100};
  std::vector<Member> members = members_with({5, 1, 9, 4});
  EXPECT_EQ(value_in(next_generation(search, members, 1), "learning_rate"), "0.01");
  EXPECT_EQ(value_in(next_generation(search, members, 1), "num_epochs"), "8");
  search.resample_probability = 1;
  std::set<std::string> losses;
  for (search.seed = 0; search.seed < 50; ++search.seed) {
    const Generation next = next_generation(search, members, 1);
    EXPECT_TRUE(check_in_space(search, next.settings, "it"));
    losses.insert(value_in(next, "exploration_loss"));
  }
  EXPECT_EQ(losses.size(), 2u);
}

TEST(NextGeneration, ComparesThoseThatHaveFinishedAsManyAndWaitsForNone) {
  const SweepSearch search = a_search();
  std::vector<Member> members = members_with({5, 1, 9, 4});
  for (const std::size_t late : {0u, 2u, 3u}) members[late].generations[0].env_frames = 0;  // under way
  EXPECT_TRUE(next_generation(search, members, 1).parent.empty()) << "it is alone";
  members[3].generations[0].env_frames = 1000;
  EXPECT_EQ(next_generation(search, members, 1).parent, "member_4") << "the better one of two";
  members[2].generations[0].env_frames = 1000;
  members[2].generations.push_back(
      members[2].generations[0]);  // ahead: what it did in this generation counts
  members[2].generations[1].score = -100;
  EXPECT_EQ(next_generation(search, members, 1).parent, "member_3");
  EXPECT_TRUE(next_generation(search, members, 2).parent.empty()) << "none is as far";
}

TEST(NextGeneration, AMemberWithoutAScoreIsTheWorstAndNoParent) {
  const SweepSearch search = a_search();
  const double none = std::nan("");
  EXPECT_EQ(next_generation(search, members_with({none, 1, 2, 3}), 0).parent, "member_4");
  EXPECT_TRUE(next_generation(search, members_with({none, none}), 1).parent.empty());
  EXPECT_TRUE(next_generation(search, members_with({1, 1}), 1).parent.empty()) << "no better one";
}

class PopulationFolder : public ::testing::Test {
 protected:
  PopulationFolder() {
    SweepPlan plan;
    plan.file.path = "s.toml";
    plan.file.name = "study";
    plan.file.search = a_search();
    plan.folder = scratch_.string() + "/study";
    for (int64_t number = 1; number <= 2; ++number)
      plan.runs.push_back({"member_" + std::to_string(number), {"", {{"seed", "1"}}}, 4000, "study", number});
    Expected<SweepFolder> made = SweepFolder::make(plan, "text", {});
    EXPECT_TRUE(made) << made.error().message;
    folder_.emplace(*std::move(made));
    fs::create_directories(folder_->path() + "/search");
  }
  const SweepRun& run(std::size_t index) const { return folder_->runs()[index]; }
  std::string text(const std::string& path) const {
    return read_file(folder_->path() + "/" + path).value_or("");
  }

  const test::ScratchFolder scratch_;
  std::optional<SweepFolder> folder_;
};

TEST_F(PopulationFolder, MembersAreReadBackAsTheyWereWritten) {
  Member member = members_with({5})[0];
  member.generations.push_back({.settings = member.generations[0].settings, .parent = "member_2"});
  ASSERT_TRUE(write_member(*folder_, member));
  const Expected<std::vector<Member>> members = read_members(*folder_, run(0));
  ASSERT_TRUE(members) << members.error().message;
  ASSERT_EQ(members->size(), 2u);
  ASSERT_EQ((*members)[0].generations.size(), 2u);
  EXPECT_EQ((*members)[0].generations[0].score, 5);
  EXPECT_EQ((*members)[0].generations[0].settings, member.generations[0].settings);
  EXPECT_EQ((*members)[0].generations[1].parent, "member_2");
  EXPECT_FALSE((*members)[0].generations[1].is_over());
  EXPECT_TRUE((*members)[1].generations.empty());
}

TEST_F(PopulationFolder, ADamagedHistoryIsNamedByItsMemberAndOverlookedByOthers) {
  const std::string good = R"({"learning_rate": "0.001", "num_epochs": "4", "exploration_loss": "none"})";
  for (
      const std::string& bad :
      {std::string("{"), std::string("[]"), std::string(R"({"generations": 3})"),
       std::string(R"({"generations": [7]})"),
       std::string(R"({"generations": [{"settings": {"learning_rate": "0.001"}}]})"),
       std::string(
           R"({"generations": [{"settings": {"learning_rate": "7", "num_epochs": "4", "exploration_loss": "none"}}]})"),
       R"({"generations": [{"settings": )" + good + R"(}, {"settings": )" + good + "}]}",
       R"({"generations": [{"settings": )" + good + R"(, "parent": "../../etc"}]})"}) {
    scratch_.write("study/search/member_1.json", bad);
    EXPECT_THAT(read_members(*folder_, run(0)).error().message,
                HasSubstr("search/member_1.json is damaged; restore it"))
        << bad;
    const Expected<std::vector<Member>> others = read_members(*folder_, run(1));
    ASSERT_TRUE(others) << bad;
    EXPECT_TRUE((*others)[0].generations.empty());
  }
}

TEST_F(PopulationFolder, ACheckpointIsTakenOverAndNothingIsLostWhereverItIsKilled) {
  scratch_.write("study/member_2/checkpoint/checkpoint_9_1000.pt", "better");
  scratch_.write("study/member_2/checkpoint/checkpoint_8_900.pt", "older");
  scratch_.write("study/member_2/checkpoint/replay_9_1000.bin", "replay");
  scratch_.write("study/member_2/checkpoint/replay_8_900.bin", "older replay");
  ASSERT_TRUE(keep_checkpoint(*folder_, run(1), 0));
  scratch_.write("study/member_2/checkpoint/checkpoint_12_2000.pt", "later");  // the member has gone on
  EXPECT_EQ(text("search/member_2/0/checkpoint_9_1000.pt"), "better");
  EXPECT_EQ(text("search/member_2/0/replay_9_1000.bin"), "replay");
  EXPECT_FALSE(fs::exists(folder_->path() + "/search/member_2/0/checkpoint_8_900.pt"));

  scratch_.write("study/member_1/checkpoint/checkpoint_77_1050.pt", "worse");
  const auto is_taken = [&] {
    ASSERT_TRUE(take_checkpoint(*folder_, run(0), 1, "member_2"));
    EXPECT_EQ(text("member_1/checkpoint/checkpoint_9_1000.pt"), "better");
    EXPECT_EQ(text("member_1/checkpoint/replay_9_1000.bin"), "replay");
    EXPECT_FALSE(fs::exists(folder_->path() + "/member_1/checkpoint/checkpoint_77_1050.pt"));
    EXPECT_EQ(text("member_1/checkpoint_1/checkpoint_77_1050.pt"), "worse");
  };
  scratch_.write("study/member_1/checkpoint_next.new/half", "x");  // killed while it copied
  is_taken();
  scratch_.write("study/member_1/checkpoint/checkpoint_10_1500.pt", "trained on");
  is_taken();  // again, as after a restart: what was trained since stays
  EXPECT_EQ(text("member_1/checkpoint/checkpoint_10_1500.pt"), "trained on");
  fs::rename(folder_->path() + "/member_1/checkpoint",
             folder_->path() + "/member_1/checkpoint_next");  // between two renames
  is_taken();
  EXPECT_FALSE(take_checkpoint(*folder_, run(0), 2, "member_2")) << "that one kept nothing of generation 1";
  EXPECT_EQ(text("member_1/checkpoint/checkpoint_9_1000.pt"), "better") << "and nothing was moved";
}

}  // namespace population_test
}  // namespace comrad::deploy
