#include "deploy/settings/existing_run.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/support/scratch_folder.h"

namespace comrad::deploy {
namespace existing_run_test {

using ::testing::EndsWith;
using ::testing::HasSubstr;

class ExistingRun : public ::testing::Test {
 protected:
  ExistingRun() {
    std::filesystem::create_directories(folder_ / "stag" / "checkpoint");
    touch("stag/config.toml");
  }
  void touch(const std::string& name) { folder_.write(name, "x"); }
  test::ScratchFolder folder_;
};

TEST_F(ExistingRun, IsFoundByFolderAndByName) {
  const std::string path = (folder_ / "stag").string();
  ASSERT_TRUE(find_run(path, "/nowhere"));
  EXPECT_EQ(*find_run(path + "/", "/nowhere"), path);
  ASSERT_TRUE(find_run("stag", folder_.string()));
  EXPECT_EQ(*find_run("stag", folder_.string()), path);
}

TEST_F(ExistingRun, NamesTheNearestOne) {
  const auto run = find_run("stagg", folder_.string());
  ASSERT_FALSE(run);
  EXPECT_THAT(run.error().message, HasSubstr("did you mean 'stag'?"));
}

TEST_F(ExistingRun, LatestIsTheHighestVersionAndBestTheHighestScore) {
  touch("stag/checkpoint/checkpoint_000000009_1000.pt");
  touch("stag/checkpoint/checkpoint_000000010_2000.pt");
  touch("stag/checkpoint/.tmp-7-checkpoint_000000011_3000.pt");
  touch("stag/checkpoint/best_-12.50.pt");
  touch("stag/checkpoint/best_-2.25.pt");
  const std::string run = (folder_ / "stag").string();
  ASSERT_TRUE(find_checkpoint(run, CheckpointKind::kLatest));
  EXPECT_THAT(*find_checkpoint(run, CheckpointKind::kLatest), EndsWith("checkpoint_000000010_2000.pt"));
  ASSERT_TRUE(find_checkpoint(run, CheckpointKind::kBest));
  EXPECT_THAT(*find_checkpoint(run, CheckpointKind::kBest), EndsWith("best_-2.25.pt"));
}

TEST_F(ExistingRun, ReportsWhatItLacks) {
  touch("stag/checkpoint/checkpoint_000000009_1000.pt");
  const auto best = find_checkpoint((folder_ / "stag").string(), CheckpointKind::kBest);
  ASSERT_FALSE(best);
  EXPECT_THAT(best.error().message, HasSubstr("--load_checkpoint_kind latest"));
}

}  // namespace existing_run_test
}  // namespace comrad::deploy
