#include "learner/checkpoint/checkpoint.h"

#include <gtest/gtest.h>
#include <sys/stat.h>
#include <torch/csrc/jit/serialization/pickle.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <limits>
#include <string>

#include "policy_workers/device/torch_ops.h"
#include "rollout_buffer/settings/layers.h"
#include "rollout_buffer/settings/trained_game.h"
#include "tests/support/same_value.h"
#include "tests/support/scratch_folder.h"

namespace comrad::learn {
namespace checkpoint_test {

namespace fs = std::filesystem;

class CheckpointTest : public ::testing::Test {
 protected:
  std::string path(const std::string& name) const { return (folder_ / name).string(); }

  static StateDict sample_state() {
    StateDict state;
    state.put("network/weight", torch::arange(12, torch::kFloat32).view({3, 4}));
    state.put("network/statistics", torch::arange(3, torch::kFloat64));
    state.put("journal/actions", torch::arange(6, torch::kUInt8).view({1, 6}));
    state.put("counters/env_frames", int64_t{1} << 40);
    state.put("schedule/learning_rate", 1e-4);
    state.put("config/toml", std::string("algo = \"ippo\"\n"));
    return state;
  }

  const test::ScratchFolder folder_;
};

TEST_F(CheckpointTest, ReturnsEveryValueThatWasWritten) {
  ASSERT_TRUE(write_checkpoint(path("a.pt"), sample_state()));
  const Expected<StateDict> read = read_checkpoint(path("a.pt"));
  ASSERT_TRUE(read) << read.error().message;
  EXPECT_TRUE(torch::equal(*read->tensor("network/weight"), torch::arange(12, torch::kFloat32).view({3, 4})));
  EXPECT_TRUE(torch::equal(*read->tensor("network/statistics"), torch::arange(3, torch::kFloat64)));
  EXPECT_TRUE(torch::equal(*read->tensor("journal/actions"), torch::arange(6, torch::kUInt8).view({1, 6})));
  EXPECT_EQ(*read->integer("counters/env_frames"), int64_t{1} << 40);
  EXPECT_EQ(*read->number("schedule/learning_rate"), 1e-4);
  EXPECT_EQ(*read->text("config/toml"), "algo = \"ippo\"\n");
  EXPECT_EQ(read->values().size(), sample_state().values().size());
}

TEST_F(CheckpointTest, KeepsTheValuesOfTheMomentItWasTaken) {
  const torch::Tensor weight = torch::ones({2});
  StateDict state;
  state.put("network/weight", weight);
  weight.fill_(7);
  EXPECT_EQ((*state.tensor("network/weight"))[0].item<float>(), 1);
}

TEST_F(CheckpointTest, WhatIsToBePlayedHasNoMomentsAndRoundedWeights) {
  StateDict state = sample_state();
  const torch::Tensor large = torch::linspace(-3, 3, 2001);
  state.put("network/large", large);
  state.put("normalizer/large", large.to(torch::kFloat64));
  state.put("optimizer/0.exp_avg", torch::ones({3}));
  RunConfig config;
  config.run.seed = 5;
  config.run.train_dir = "/runs/here";
  config.environment.wad = "/runs/here/a.wad";
  state.put("config/toml", settings_to_toml(config));
  ASSERT_TRUE(write_checkpoint(path("whole.pt"), state));
  config.run.train_dir = "train_dir";
  config.environment.wad.clear();
  ASSERT_TRUE(write_to_be_played(path("whole.pt"), path("kept.pt"), settings_to_toml(config)));
  const Expected<StateDict> kept = read_checkpoint(path("kept.pt"));
  ASSERT_TRUE(kept) << kept.error().message;
  EXPECT_EQ(kept->tensor("optimizer/0.exp_avg")->count_nonzero().item<int64_t>(), 0);
  EXPECT_EQ(kept->values().size(), state.values().size());
  const Expected<RunConfig> settings = settings_of_checkpoint(*kept->text("config/toml"), "kept.pt");
  ASSERT_TRUE(settings) << settings.error().message;
  EXPECT_EQ(settings->run.seed, 5);
  EXPECT_EQ(kept->text("config/toml")->find("/runs"), std::string::npos);
  EXPECT_TRUE(torch::equal(*kept->tensor("network/weight"), *state.tensor("network/weight")));
  EXPECT_EQ(*kept->integer("counters/env_frames"), int64_t{1} << 40);
  const torch::Tensor rounded = *kept->tensor("network/large");
  for (int64_t i = 0; i < large.numel(); ++i) {
    const double x = large[i].item<double>(), y = rounded[i].item<double>();
    EXPECT_LE(std::abs(y - x), std::abs(x) / 128) << x;
    EXPECT_LE(std::abs((*kept->tensor("normalizer/large"))[i].item<double>() - x), std::abs(x) / 4096) << x;
    int exponent = 0;
    const double scaled = 128 * std::frexp(y, &exponent);
    EXPECT_EQ(scaled, std::round(scaled)) << x << " became " << y;
  }
}

TEST_F(CheckpointTest, NamesAMissingOrMisshapenTensor) {
  const StateDict state = sample_state();
  EXPECT_NE(state.tensor("network/nothing").error().message.find("network/nothing"), std::string::npos);
  const Status copied = state.copy_tensor("network/weight", torch::zeros({4, 3}));
  ASSERT_FALSE(copied);
  EXPECT_NE(copied.error().message.find("[3, 4]"), std::string::npos) << copied.error().message;
  EXPECT_NE(copied.error().message.find("[4, 3]"), std::string::npos) << copied.error().message;
  EXPECT_FALSE(state.copy_tensor("network/weight", torch::zeros({3, 4}, torch::kFloat64)));
}

TEST_F(CheckpointTest, ATruncatedFileIsAClearError) {
  ASSERT_TRUE(write_checkpoint(path("a.pt"), sample_state()));
  const auto full_bytes = fs::file_size(path("a.pt"));
  for (const double fraction : {0.0, 0.001, 0.3, 0.7, 0.999}) {
    fs::copy_file(path("a.pt"), path("cut.pt"), fs::copy_options::overwrite_existing);
    fs::resize_file(path("cut.pt"), static_cast<std::uintmax_t>(static_cast<double>(full_bytes) * fraction));
    const Expected<StateDict> read = read_checkpoint(path("cut.pt"));
    ASSERT_FALSE(read) << "fraction " << fraction;
    EXPECT_EQ(read.error().code, ErrorCode::kBadFormat);
    EXPECT_NE(read.error().message.find("cut.pt"), std::string::npos);
    EXPECT_EQ(read.error().message.find('\n'), std::string::npos) << read.error().message;
  }
}

TEST_F(CheckpointTest, AForeignFileIsAClearError) {
  std::ofstream(path("text.pt")) << "certainly not a checkpoint";
  EXPECT_EQ(read_checkpoint(path("text.pt")).error().code, ErrorCode::kBadFormat);
  EXPECT_EQ(read_checkpoint(path("absent.pt")).error().code, ErrorCode::kNotFound);
  EXPECT_EQ(read_checkpoint(folder_.string()).error().code, ErrorCode::kBadFormat);

  const std::vector<char> other = torch::jit::pickle_save(torch::ones({3}));  // a foreign torch archive
  std::ofstream(path("other.pt"), std::ios::binary)
      .write(other.data(), static_cast<std::streamsize>(other.size()));
  const Expected<StateDict> read = read_checkpoint(path("other.pt"));
  ASSERT_FALSE(read);
  EXPECT_NE(read.error().message.find("not a COMRAD checkpoint"), std::string::npos) << read.error().message;
}

TEST_F(CheckpointTest, FlippedBitsAreFoundOrDoNoHarm) {
  ASSERT_TRUE(write_checkpoint(path("a.pt"), sample_state()));
  const StateDict written = *read_checkpoint(path("a.pt"));
  std::ifstream file(path("a.pt"), std::ios::binary);
  const std::string intact((std::istreambuf_iterator<char>(file)), std::istreambuf_iterator<char>());
  int refused = 0;
  // Every byte: what lies between the records (padding, dates) may change without harm, the values may not.
  for (std::size_t at = 0; at < intact.size(); ++at) {
    std::string damaged = intact;
    damaged[at] = static_cast<char>(damaged[at] ^ (1 << at % 8));
    std::ofstream(path("damaged.pt"), std::ios::binary | std::ios::trunc) << damaged;
    const Expected<StateDict> read = read_checkpoint(path("damaged.pt"));
    if (!read) {
      ++refused;
      EXPECT_NE(read.error().message.find("damaged.pt"), std::string::npos) << "byte " << at;
      continue;
    }
    ASSERT_EQ(read->values().size(), written.values().size()) << "byte " << at;
    for (const auto& [key, value] : written.values())
      ASSERT_TRUE(read->has(key) && test::same_value(value, read->values().at(key)))
          << key << ", byte " << at;
  }
  EXPECT_GT(refused, 500) << "bytes of records of which a flip was found";
}

TEST_F(CheckpointTest, ANetworkThatIsNotFiniteIsRefused) {
  for (const char* section : {"network", "optimizer", "target", "mixer"}) {
    StateDict state = sample_state();
    torch::Tensor weight = torch::ones({4});
    weight[2] = std::numeric_limits<float>::quiet_NaN();
    state.put(std::string(section) + "/x", weight);
    ASSERT_TRUE(write_checkpoint(path("nan.pt"), state));
    const Expected<StateDict> read = read_checkpoint(path("nan.pt"));
    ASSERT_FALSE(read) << section;
    EXPECT_EQ(read.error().code, ErrorCode::kBadFormat);
    EXPECT_NE(read.error().message.find(std::string(section) + "/x"), std::string::npos);
  }
  StateDict state = sample_state();  // scores of episodes may be missing
  state.put("episodes/window",
            torch::full({1, 5}, std::numeric_limits<double>::quiet_NaN(), torch::kFloat64));
  ASSERT_TRUE(write_checkpoint(path("window.pt"), state));
  EXPECT_TRUE(read_checkpoint(path("window.pt")));
}

TEST_F(CheckpointTest, APipeUnderACheckpointsNameIsNotWaitedFor) {
  ASSERT_EQ(mkfifo(path("pipe.pt").c_str(), 0600), 0);
  EXPECT_EQ(read_checkpoint(path("pipe.pt")).error().code, ErrorCode::kBadFormat);
}

TEST_F(CheckpointTest, TheStoreKeepsTheNewestAndListsThemFirst) {
  CheckpointStore store(path("checkpoint"), 2);
  EXPECT_TRUE(store.list().empty());
  for (uint64_t i = 1; i <= 4; ++i) ASSERT_TRUE(store.save(sample_state(), 9 * i, 1000 * i));
  const auto files = store.list();
  ASSERT_EQ(files.size(), 2u);
  EXPECT_EQ(files[0].version, 36u);
  EXPECT_EQ(files[0].env_frames, 4000u);
  EXPECT_EQ(files[1].version, 27u);
  EXPECT_EQ(fs::path(files[0].path).filename(), "checkpoint_000000036_4000.pt");
}

TEST_F(CheckpointTest, TheStoreKeepsOneBest) {
  CheckpointStore store(path("checkpoint"), 2);
  EXPECT_EQ(store.best(), "");
  ASSERT_TRUE(store.save_best(sample_state(), -1.25));
  EXPECT_EQ(fs::path(store.best()).filename(), "best_-1.250.pt");
  ASSERT_TRUE(store.save_best(sample_state(), 12.5));
  EXPECT_EQ(fs::path(store.best()).filename(), "best_12.500.pt");
  EXPECT_FALSE(fs::exists(path("checkpoint/best_-1.250.pt")));
}

TEST_F(CheckpointTest, ABrokenFileIsSetAsideAndTheOneBeforeIsNext) {
  CheckpointStore store(path("checkpoint"), 2);
  ASSERT_TRUE(store.save(sample_state(), 1, 100));
  ASSERT_TRUE(store.save(sample_state(), 2, 200));
  fs::resize_file(store.list()[0].path, 100);
  ASSERT_FALSE(read_checkpoint(store.list()[0].path));
  store.set_aside(store.list()[0].path);
  ASSERT_EQ(store.list().size(), 1u);
  EXPECT_EQ(store.set_aside_count(), 1u);
  EXPECT_TRUE(read_checkpoint(store.list()[0].path));
}

TEST_F(CheckpointTest, AFailedWriteLeavesTheOldFileAndNoTemporary) {
  ASSERT_TRUE(write_checkpoint(path("a.pt"), sample_state()));
  EXPECT_FALSE(write_checkpoint(path("nowhere/a.pt"), sample_state()));
  fs::create_directories(path("taken.pt/inside"));  // a folder cannot be replaced by rename
  EXPECT_FALSE(write_checkpoint(path("taken.pt"), sample_state()));
  EXPECT_TRUE(read_checkpoint(path("a.pt")));
  for (const auto& entry : fs::directory_iterator(folder_))
    EXPECT_FALSE(entry.path().filename().string().starts_with(".tmp")) << entry.path();
}

TEST_F(CheckpointTest, RemovesTheTemporaryFilesOfACrash) {
  fs::create_directories(path("checkpoint"));
  std::ofstream(path("checkpoint/.tmp-123-checkpoint_000000001_4.pt")) << "half";
  CheckpointStore store(path("checkpoint"), 2);
  ASSERT_TRUE(store.save(sample_state(), 1, 100));
  EXPECT_FALSE(fs::exists(path("checkpoint/.tmp-123-checkpoint_000000001_4.pt")));
}

}  // namespace checkpoint_test
}  // namespace comrad::learn
