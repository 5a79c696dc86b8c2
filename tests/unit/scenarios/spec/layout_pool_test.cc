#include "scenarios/spec/layout_pool.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <set>

#include "doomgen/layout/wad_writer.h"
#include "scenarios/spec/scenario_files.h"

namespace comrad::scenarios {
namespace {

using testing::HasSubstr;
namespace fs = std::filesystem;

class LayoutPool : public testing::Test {
 protected:
  void SetUp() override {
    folder_ = fs::path(testing::TempDir()) / ("comrad_pool_" + std::to_string(getpid()));
  }
  void TearDown() override { fs::remove_all(folder_); }
  std::string folder(const char* name) const { return (folder_ / name).string(); }
  fs::path folder_;
};

TEST(PoolSeeds, NoSeedIsInBothPools) {
  const std::vector<uint64_t> train = pool_seeds("stag_hunt_arena", PoolKind::kTrain, 2000);
  const std::vector<uint64_t> eval = pool_seeds("stag_hunt_arena", PoolKind::kEval, 300);
  const std::set<uint64_t> trained(train.begin(), train.end());
  EXPECT_EQ(trained.size(), train.size());
  for (const uint64_t seed : eval) EXPECT_FALSE(trained.contains(seed)) << seed;
  for (const uint64_t seed : kHeldOutSeeds) EXPECT_FALSE(trained.contains(seed)) << seed;
  EXPECT_THAT(std::vector<uint64_t>(eval.begin(), eval.begin() + 5),
              testing::ElementsAre(1009, 2027, 3037, 4051, 5099));
}

TEST(PoolSeeds, OneSeedInTenIsForEvaluation) {
  int eval = 0;
  for (uint64_t seed = 0; seed < 10'000; ++seed) eval += pool_of_seed("lava_pit", seed) == PoolKind::kEval;
  EXPECT_NEAR(eval, 1000, 120);
}

TEST_F(LayoutPool, FilesRegistryAndHashesAgree) {
  const auto made =
      make_pool("foraging_commons", {.kind = PoolKind::kTrain, .count = 12, .vary = true}, folder("train"));
  ASSERT_TRUE(made) << made.error().message;
  const auto pool = read_pool(folder("train"));
  ASSERT_TRUE(pool) << pool.error().message;
  ASSERT_EQ(pool->size(), 12u);
  std::set<uint64_t> hashes;
  for (const PoolEntry& entry : *pool) {
    EXPECT_EQ(fs::path(entry.filename).stem(), entry.id);
    const auto bytes = read_scenario_file(entry.filename);
    ASSERT_TRUE(bytes);
    EXPECT_EQ(doomgen::content_hash(*bytes), entry.content_hash);
    EXPECT_EQ(entry.axis_choices.size(), layout_recipe("foraging_commons")->axes.size());
    EXPECT_EQ(pool_of_seed("foraging_commons", entry.info.seed), PoolKind::kTrain);
    hashes.insert(entry.content_hash);
    // The registry suffices to draw the layout again.
    LayoutRequest again{.seed = entry.info.seed};
    for (const auto& [name, value] : entry.info.parameters)
      again.parameters.emplace_back(name, std::to_string(value));
    EXPECT_EQ(generate_layout("foraging_commons", again)->content_hash, entry.content_hash);
  }
  EXPECT_EQ(hashes.size(), 12u);
}

TEST_F(LayoutPool, WithoutRegistryAllWadsCountInTheOrderOfTheirNames) {
  fs::create_directories(folder("plain"));
  for (const char* name : {"b.wad", "a.wad", "notes.txt"}) std::ofstream(folder_ / "plain" / name) << "PWAD";
  const auto pool = read_pool(folder("plain"));
  ASSERT_TRUE(pool);
  ASSERT_EQ(pool->size(), 2u);
  EXPECT_EQ((*pool)[0].id, "a");
  EXPECT_EQ((*pool)[1].id, "b");
}

TEST_F(LayoutPool, BadPoolsSayWhatIsWrong) {
  EXPECT_FALSE(read_pool(folder("missing")));
  fs::create_directories(folder("empty"));
  EXPECT_THAT(read_pool(folder("empty")).error().message, HasSubstr("empty"));
  std::ofstream(folder_ / "empty" / kPoolRegistryName) << "[{\"id\": 3}]";
  EXPECT_THAT(read_pool(folder("empty")).error().message, HasSubstr("entry 0"));
  std::ofstream(folder_ / "empty" / kPoolRegistryName) << "{";
  EXPECT_THAT(read_pool(folder("empty")).error().message, HasSubstr("line 1, column 2"));
  EXPECT_THAT(make_pool("stag_hunt_arena", {.count = 0}, folder("x")).error().message,
              HasSubstr("1..100000"));
  EXPECT_THAT(make_pool("no_such", {.count = 1}, folder("x")).error().message, HasSubstr("no_such"));
}

}  // namespace
}  // namespace comrad::scenarios
