#include "learner/worker/metrics.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <limits>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "tensorboard_event.pb.h"
#include "tests/support/scratch_folder.h"

namespace comrad::learn {
namespace {

namespace fs = std::filesystem;

std::string read_file(const fs::path& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()};
}

/// The records of an event file, framing checked.
std::vector<tensorboard::Event> read_events(const std::string& bytes) {
  std::vector<tensorboard::Event> events;
  std::size_t at = 0;
  while (at < bytes.size()) {
    uint64_t length = 0;
    uint32_t crc = 0;
    EXPECT_LE(at + 12, bytes.size());
    std::memcpy(&length, bytes.data() + at, 8);
    std::memcpy(&crc, bytes.data() + at + 8, 4);
    EXPECT_EQ(crc, masked_crc32c(std::string_view(bytes).substr(at, 8)));
    EXPECT_LE(at + 16 + length, bytes.size());
    const std::string_view payload = std::string_view(bytes).substr(at + 12, length);
    std::memcpy(&crc, bytes.data() + at + 12 + length, 4);
    EXPECT_EQ(crc, masked_crc32c(payload));
    tensorboard::Event event;
    EXPECT_TRUE(event.ParseFromArray(payload.data(), static_cast<int>(payload.size())));
    events.push_back(event);
    at += 16 + length;
  }
  return events;
}

class MetricsTest : public ::testing::Test {
 protected:
  fs::path event_file() const {
    for (const auto& entry : fs::directory_iterator(folder_))
      if (entry.path().filename().string().starts_with("events.out.tfevents.")) return entry.path();
    return {};
  }
  const test::ScratchFolder folder_;
};

shm::EpisodeRecord episode(float score, std::array<float, 2> agent_return, uint32_t length_tics) {
  shm::EpisodeRecord record{};
  record.score = score;
  std::ranges::copy(agent_return, record.agent_return);
  record.length_tics = length_tics;
  return record;
}

TEST(MaskedCrc32c, MatchesTheCheckValueOfThePolynomial) {
  // CRC-32C("123456789") = 0xE3069283 (RFC 3720 appendix B.4's polynomial), then TFRecord's mask.
  const uint32_t crc = 0xE3069283u;
  EXPECT_EQ(masked_crc32c("123456789"), ((crc >> 15) | (crc << 17)) + 0xA282EAD8u);
  EXPECT_EQ(masked_crc32c(std::string(32, '\0')), ((0x8A9136AAu >> 15) | (0x8A9136AAu << 17)) + 0xA282EAD8u);
}

TEST_F(MetricsTest, WritesTheSameNumbersToBothFiles) {
  {
    Expected<MetricsWriter> writer = MetricsWriter::open(folder_.string());
    ASSERT_TRUE(writer) << writer.error().message;
    ASSERT_TRUE(writer->write(1.5, 4096, 1024, {{"train/policy_loss", -0.25}, {"reward/reward", 3.0}}));
    ASSERT_TRUE(
        writer->write(2.5, 8192, 2048, {{"reward/reward", std::numeric_limits<double>::quiet_NaN()}}));
  }
  std::ifstream lines(folder_ / "metrics.jsonl");
  std::string line;
  ASSERT_TRUE(std::getline(lines, line));
  const auto first = nlohmann::json::parse(line);
  EXPECT_EQ(first["time_s"], 1.5);
  EXPECT_EQ(first["env_frames"], 4096);
  EXPECT_EQ(first["decisions"], 1024);
  EXPECT_EQ(first["train/policy_loss"], -0.25);
  ASSERT_TRUE(std::getline(lines, line));
  EXPECT_TRUE(nlohmann::json::parse(line)["reward/reward"].is_null());

  const std::vector<tensorboard::Event> events = read_events(read_file(event_file()));
  ASSERT_EQ(events.size(), 3u);
  EXPECT_EQ(events[0].file_version(), "brain.Event:2");
  EXPECT_EQ(events[1].step(), 4096);
  EXPECT_GT(events[1].wall_time(), 1.6e9);
  ASSERT_EQ(events[1].summary().value_size(), 2);
  EXPECT_EQ(events[1].summary().value(0).tag(), "train/policy_loss");
  EXPECT_EQ(events[1].summary().value(0).simple_value(), -0.25f);
  EXPECT_EQ(events[2].summary().value_size(), 0);
}

TEST_F(MetricsTest, AnEventIsTheWireFormatThatTensorboardReads) {
  {
    Expected<EventFile> file = EventFile::create(folder_.string());
    ASSERT_TRUE(file);
    ASSERT_TRUE(file->write(1.0, 3, {{"a", 2.0}}));
  }
  const std::string bytes = read_file(event_file());
  uint64_t first_length = 0;
  std::memcpy(&first_length, bytes.data(), 8);
  const std::string_view second = std::string_view(bytes).substr(16 + first_length);
  // wall_time: field 1 double; step: field 2 varint; summary: field 5 { value: field 1 { tag: 1,
  // simple_value: 2 } }
  const std::string expected = std::string("\x09\0\0\0\0\0\0\xF0\x3F\x10\x03\x2A\x0A\x0A\x08\x0A\x01", 17) +
                               "a" + std::string("\x15\0\0\0\x40", 5);
  EXPECT_EQ(second.substr(12, second.size() - 16), expected);
}

TEST_F(MetricsTest, AZeroIsOnTheWire) {
  {
    Expected<EventFile> file = EventFile::create(folder_.string());
    ASSERT_TRUE(file);
    ASSERT_TRUE(file->write(1.0, 3, {{"a", 0.0}}));
  }
  const std::vector<tensorboard::Event> events = read_events(read_file(event_file()));
  ASSERT_EQ(events.size(), 2u);
  EXPECT_TRUE(events[1].summary().value(0).has_simple_value()) << "TensorBoard drops a point without a value";
}

TEST_F(MetricsTest, ClosesAHalfLineOfACrashBeforeItAppends) {
  std::ofstream(folder_ / "metrics.jsonl") << "{\"time_s\": 1}\n{\"time_s\": 2, \"env_fr";
  {
    Expected<MetricsWriter> writer = MetricsWriter::open(folder_.string());
    ASSERT_TRUE(writer);
    ASSERT_TRUE(writer->write(3, 1, 1, {}));
  }
  std::ifstream lines(folder_ / "metrics.jsonl");
  std::string line, last;
  int count = 0;
  while (std::getline(lines, line)) {
    last = line;
    ++count;
  }
  EXPECT_EQ(count, 3);
  EXPECT_EQ(nlohmann::json::parse(last)["time_s"], 3.0);
}

TEST_F(MetricsTest, AMissingFolderIsAClearError) {
  const Expected<MetricsWriter> writer = MetricsWriter::open((folder_ / "nowhere").string());
  ASSERT_FALSE(writer);
  EXPECT_NE(writer.error().message.find("nowhere"), std::string::npos);
}

TEST(EpisodeWindow, AveragesTheLastEpisodesOnly) {
  EpisodeWindow window(2);
  EXPECT_TRUE(std::isnan(window.score_mean()));
  window.add(episode(100, {1, 1}, 40), 2);
  window.add(episode(10, {2, 4}, 80), 2);
  window.add(episode(20, {6, 10}, 120), 2);
  EXPECT_EQ(window.episodes(), 3u);
  EXPECT_DOUBLE_EQ(window.score_mean(), 15);
  EXPECT_DOUBLE_EQ(window.return_mean(), (3 + 8) / 2.0);
  MetricValues values;
  window.append_to(values);
  const auto find = [&](const std::string& name) {
    for (const auto& [key, value] : values)
      if (key == name) return value;
    return std::nan("");
  };
  EXPECT_DOUBLE_EQ(find("reward/reward"), 5.5);
  EXPECT_DOUBLE_EQ(find("reward/reward_min"), 2);
  EXPECT_DOUBLE_EQ(find("reward/reward_max"), 10);
  EXPECT_DOUBLE_EQ(find("len/len"), 100);
  EXPECT_DOUBLE_EQ(find("policy_stats/avg_true_objective"), 15);
  EXPECT_DOUBLE_EQ(find("policy_stats/avg_true_objective_max"), 20);
}

TEST(EpisodeWindow, CountsEpisodesInWhichAnyAgentsReturnIsNotZero) {
  EpisodeWindow window(4);
  window.add(episode(0, {0, 0}, 40), 2);
  window.add(episode(0, {0, -1}, 40), 2);
  window.add(episode(0, {2, -2}, 40), 2);
  window.add(episode(7, {0, 0}, 40), 2);
  MetricValues values;
  window.append_to(values);
  EXPECT_EQ(values.back().first, "stats/rewarded_episodes_fraction");
  EXPECT_DOUBLE_EQ(values.back().second, 0.5);
}

TEST(EpisodeWindow, TellsScoresAsSharesOfWhatEachMapAllows) {
  const auto share_of = [](const EpisodeWindow& window) {
    MetricValues values;
    window.append_to(values);
    for (const auto& [key, value] : values)
      if (key == "policy_stats/avg_true_objective_share") return value;
    return -1.0;
  };
  EpisodeWindow window(4);
  window.add(episode(7, {0, 0}, 40), 2);
  EXPECT_EQ(share_of(window), -1) << "no map said its ceiling";
  for (const auto& [score, ceiling] : {std::pair{35.0f, 35.0f}, {23.5f, 47.0f}}) {
    shm::EpisodeRecord record = episode(score, {0, 0}, 40);
    record.ceiling = ceiling;
    window.add(record, 2);
  }
  EXPECT_DOUBLE_EQ(share_of(window), 0.75);
  EpisodeWindow again(4);
  ASSERT_TRUE(again.restore(window.state()));
  EXPECT_DOUBLE_EQ(share_of(again), 0.75);
  // Checkpoints from before there were shares have a number less.
  const std::vector<double> older(2 * (EpisodeWindow::kFields - 1), 3.0);
  ASSERT_TRUE(again.restore(older, EpisodeWindow::kFields - 1));
  EXPECT_EQ(again.size(), 2u);
  EXPECT_DOUBLE_EQ(again.score_mean(), 3);
  EXPECT_EQ(share_of(again), -1);
  EXPECT_FALSE(again.restore(older, EpisodeWindow::kFields - 2));
}

TEST(EpisodeWindow, GoesOnInAnotherProcessWhereItStood) {
  EpisodeWindow window(3);
  for (int i = 0; i < 4; ++i) {
    EXPECT_EQ(window.is_full(), i == 3) << i;
    window.add(
        episode(static_cast<float>(i), {1.0f * static_cast<float>(i), 2.0f * static_cast<float>(i)}, 40), 2);
  }
  EpisodeWindow again(3);
  ASSERT_TRUE(again.restore(window.state()));
  EXPECT_TRUE(again.is_full());
  EXPECT_EQ(again.episodes(), 0u);
  MetricValues before, after;
  window.append_to(before);
  again.append_to(after);
  EXPECT_EQ(before, after);
  window.add(episode(10, {0, 0}, 4), 2);
  again.add(episode(10, {0, 0}, 4), 2);
  EXPECT_DOUBLE_EQ(again.score_mean(), window.score_mean());
}

TEST(EpisodeWindow, TakesTheNewestThatFitAndNoBrokenOnes) {
  EpisodeWindow window(10);
  for (int i = 0; i < 10; ++i) window.add(episode(static_cast<float>(i), {0, 0}, 40), 2);
  EpisodeWindow shorter(2), longer(20);
  ASSERT_TRUE(shorter.restore(window.state()));
  EXPECT_DOUBLE_EQ(shorter.score_mean(), 8.5);
  ASSERT_TRUE(longer.restore(window.state()));
  EXPECT_FALSE(longer.is_full());
  std::vector<double> broken = window.state();
  broken.pop_back();
  EXPECT_FALSE(longer.restore(broken));
  ASSERT_TRUE(longer.restore({}));
  EXPECT_EQ(longer.size(), 0u);
}

TEST(RateWindow, IsTheSlopeOverTheWindow) {
  RateWindow rates(10);
  EXPECT_EQ(rates.env_frames_per_s(), 0);
  rates.add(0, 0, 0);
  EXPECT_EQ(rates.env_frames_per_s(), 0);
  rates.add(5, 4000, 1000);
  EXPECT_DOUBLE_EQ(rates.env_frames_per_s(), 800);
  EXPECT_DOUBLE_EQ(rates.decisions_per_s(), 200);
  rates.add(10, 8000, 2000);
  rates.add(15, 8000, 2000);  // stalled; the sample at 5 s is the window's edge now
  EXPECT_DOUBLE_EQ(rates.env_frames_per_s(), 400);
}

}  // namespace
}  // namespace comrad::learn
