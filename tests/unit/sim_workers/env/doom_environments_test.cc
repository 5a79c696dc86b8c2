#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <set>

#include "rollout_buffer/core/files.h"
#include "scenarios/spec/registry.h"
#include "sim_workers/env/environment.h"

namespace comrad::sim {
namespace doom_environments_test {

using testing::HasSubstr;

/// The default map with the real renderer; skipped where this machine cannot draw.
class DoomEnvironments : public testing::Test {
 protected:
  void SetUp() override {
    path_ = testing::TempDir() + "/comrad_doom_environments_" + std::to_string(getpid()) + ".wad";
    const auto layout = scenarios::generate_layout("coop_health_gathering", {});
    ASSERT_TRUE(layout) << layout.error().message;
    ASSERT_TRUE(write_file_atomically(path_, layout->wad, /*durable=*/false));
    options_.scenario = "coop_health_gathering";
    options_.wad_path = path_;
    options_.count = 3;
  }
  void TearDown() override { std::filesystem::remove(path_); }

  std::string path_;
  EnvironmentOptions options_;
};

/// Room for the observations of `count` environments.
struct Pictures {
  Pictures(const EnvShape& shape, int count)
      : frame_bytes(shape.frame_bytes()),
        frame(count * shape.num_agents * frame_bytes),
        mask(count * shape.num_agents * shape.logit_count()),
        active(count * shape.num_agents) {
    for (int i = 0; i < count; ++i)
      targets.push_back({frame.data() + i * shape.num_agents * frame_bytes, nullptr,
                         mask.data() + i * shape.num_agents * shape.logit_count(),
                         active.data() + i * shape.num_agents});
  }
  std::vector<uint8_t> view(int index) const {
    return {frame.begin() + index * frame_bytes, frame.begin() + (index + 1) * frame_bytes};
  }
  int64_t frame_bytes;
  std::vector<uint8_t> frame, mask, active;
  std::vector<ObservationTarget> targets;
};

TEST_F(DoomEnvironments, EveryAgentSeesItsOwnWorld) {
  auto set = make_doom_environments(options_);
  if (!set && (set.error().code == ErrorCode::kUnsupported || set.error().code == ErrorCode::kNotFound))
    GTEST_SKIP() << set.error().message;
  ASSERT_TRUE(set) << set.error().message;
  ASSERT_EQ((*set)->size(), 3);
  const EnvShape& shape = (*set)->at(0).shape();
  for (int i = 0; i < 3; ++i) (*set)->at(i).reset(static_cast<uint64_t>(i));
  Pictures before(shape, 3), after(shape, 3), again(shape, 3);
  const std::vector<int> indices = {0, 1, 2};
  (*set)->observe(indices, before.targets);
  for (int step = 0; step < 8; ++step)
    for (int i = 0; i < 3; ++i) (*set)->at(i).step(std::vector<int32_t>{1, 0, i, 0, 1, 1});
  (*set)->observe(indices, after.targets);
  (*set)->observe(indices, again.targets);
  EXPECT_EQ(after.frame, again.frame) << "drawing changes nothing";
  for (int view = 0; view < 6; ++view) {
    const std::vector<uint8_t> picture = after.view(view);
    EXPECT_GT(std::set<uint8_t>(picture.begin(), picture.end()).size(), 20u)
        << "view " << view << " is nearly flat";
    EXPECT_NE(picture, before.view(view)) << "view " << view << " did not move";
  }
  EXPECT_NE(after.view(0), after.view(1)) << "two agents, two places";
  EXPECT_NE(after.view(0), after.view(2)) << "environments 0 and 1 turned differently";
}

TEST_F(DoomEnvironments, TheReferencePathDrawsLargerAndResizes) {
  options_.render_size = "160x120";
  options_.resize = Resize::kNearest;
  options_.count = 1;
  auto set = make_doom_environments(options_);
  if (!set && (set.error().code == ErrorCode::kUnsupported || set.error().code == ErrorCode::kNotFound))
    GTEST_SKIP() << set.error().message;
  ASSERT_TRUE(set) << set.error().message;
  (*set)->at(0).reset(1);
  Pictures pictures((*set)->at(0).shape(), 1);
  const int index = 0;
  (*set)->observe(std::span(&index, 1), pictures.targets);
  const std::vector<uint8_t> picture = pictures.view(1);
  EXPECT_GT(std::set<uint8_t>(picture.begin(), picture.end()).size(), 20u);
}

TEST_F(DoomEnvironments, BadRequestsSayWhatIsWrong) {
  const auto message = [&](auto&& change) {
    EnvironmentOptions options = options_;
    change(options);
    auto set = make_doom_environments(options);
    return set ? std::string("no error") : set.error().message;
  };
  EXPECT_THAT(message([](auto& o) { o.render_size = "160x120"; }), HasSubstr("resize=nearest"));
  EXPECT_THAT(message([](auto& o) { o.render_size = "big"; }), HasSubstr("WIDTHxHEIGHT"));
  EXPECT_THAT(message([](auto& o) { o.count = 0; }), HasSubstr("num_envs_per_worker"));
  EXPECT_THAT(message([](auto& o) { o.wad_path = "/nowhere/x.wad"; }), HasSubstr("/nowhere/x.wad"));
}

}  // namespace doom_environments_test
}  // namespace comrad::sim
