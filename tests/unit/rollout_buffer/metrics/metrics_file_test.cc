#include "rollout_buffer/metrics/metrics_file.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <limits>
#include <map>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "tensorboard_event.pb.h"
#include "tests/support/scratch_folder.h"
#include "tests/support/test_python.h"

namespace comrad {
namespace metrics_file_test {

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

class MetricsFileTest : public ::testing::Test {
 protected:
  fs::path event_file() const {
    for (const auto& entry : fs::directory_iterator(folder_))
      if (entry.path().filename().string().starts_with("events.out.tfevents.")) return entry.path();
    return {};
  }
  const test::ScratchFolder folder_;
};

TEST(MaskedCrc32c, MatchesTheCheckValueOfThePolynomial) {
  // CRC-32C("123456789") = 0xE3069283 (RFC 3720 appendix B.4's polynomial), then TFRecord's mask.
  const uint32_t crc = 0xE3069283u;
  EXPECT_EQ(masked_crc32c("123456789"), ((crc >> 15) | (crc << 17)) + 0xA282EAD8u);
  EXPECT_EQ(masked_crc32c(std::string(32, '\0')), ((0x8A9136AAu >> 15) | (0x8A9136AAu << 17)) + 0xA282EAD8u);
}

TEST_F(MetricsFileTest, WritesTheSameNumbersToBothFiles) {
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

TEST_F(MetricsFileTest, AResumedRunRecordsFromWhereOlderFilesAreForgotten) {
  {
    Expected<EventFile> file = EventFile::create(folder_.string());
    ASSERT_TRUE(file);
    ASSERT_TRUE(file->write_start(1.0, 3));
  }
  const std::string bytes = read_file(event_file());
  uint64_t first_length = 0;
  std::memcpy(&first_length, bytes.data(), 8);
  // As below; session_log: field 7 { status: field 1 varint 1, START }.
  const std::string expected("\x09\0\0\0\0\0\0\xF0\x3F\x10\x03\x3A\x02\x08\x01", 15);
  EXPECT_EQ(bytes.substr(16 + first_length + 12, expected.size()), expected);
}

TEST_F(MetricsFileTest, AnEventIsTheWireFormatThatTensorboardReads) {
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

TEST_F(MetricsFileTest, AZeroIsOnTheWire) {
  {
    Expected<EventFile> file = EventFile::create(folder_.string());
    ASSERT_TRUE(file);
    ASSERT_TRUE(file->write(1.0, 3, {{"a", 0.0}}));
  }
  const std::vector<tensorboard::Event> events = read_events(read_file(event_file()));
  ASSERT_EQ(events.size(), 2u);
  EXPECT_TRUE(events[1].summary().value(0).has_simple_value()) << "TensorBoard drops a point without a value";
}

/// The head of a GIF of 258 x 3 pixels.
const std::string kGif("GIF89a\x02\x01\x03\x00", 10);

/// A run that learned from few frames, as a learner and an evaluation write it.
void write_run(const fs::path& run, const char* algo, int64_t seed, double score) {
  RunConfig config;
  config.run.scenario = "lava_pit";
  config.run.algo = algo;
  config.run.seed = seed;
  config.optimisation.learning_rate = 3e-4;
  fs::create_directories(run);
  Expected<MetricsWriter> learner = MetricsWriter::open(run.string());
  ASSERT_TRUE(learner) << learner.error().message;
  ASSERT_TRUE(learner->describe_run(config));
  ASSERT_TRUE(learner->write(
      1, 100, 25,
      {{"policy_stats/avg_true_objective", score}, {"train/lr", 3e-4}, {"train/num_sgd_steps", 0}}));
  Expected<MetricsWriter> evaluations = MetricsWriter::open(run.string(), (run / "eval").string());
  ASSERT_TRUE(evaluations) << evaluations.error().message;
  ASSERT_TRUE(evaluations->write(1, 100, 25, {{"eval/J", score + 1}}));
  ASSERT_TRUE(evaluations->write_gif(100, "eval/video", kGif));
}

TEST_F(MetricsFileTest, TheSettingsOfARunAreARowOfTheHparamsPage) {
  write_run(folder_ / "run", "qmix", 68, 7);
  std::vector<tensorboard::Event> events;
  for (const auto& entry : fs::directory_iterator(folder_ / "run"))
    if (entry.path().filename().string().starts_with("events."))
      events = read_events(read_file(entry.path()));
  ASSERT_EQ(events.size(), 4u);
  const auto data_of = [](const tensorboard::Event& event, const char* tag) {
    EXPECT_EQ(event.summary().value_size(), 1);
    const tensorboard::Summary::Value& value = event.summary().value(0);
    EXPECT_EQ(value.tag(), tag);
    EXPECT_TRUE(value.has_tensor()) << "TensorBoard drops a value without one";
    EXPECT_EQ(value.metadata().plugin_data().plugin_name(), "hparams");
    tensorboard::HparamsData data;
    EXPECT_TRUE(data.ParseFromString(value.metadata().plugin_data().content()));
    return data;
  };
  const tensorboard::Experiment columns = data_of(events[1], "_hparams_/experiment").experiment();
  ASSERT_GT(columns.hparam_infos_size(), 20);
  std::map<std::string, int> leading;
  for (const tensorboard::Experiment::Hparam& column : columns.hparam_infos())
    if (column.differs()) leading[column.name()] = column.type();
  EXPECT_EQ(leading, (std::map<std::string, int>{{"scenario", 1}, {"algo", 1}, {"seed", 3}, {"preset", 1}}));
  EXPECT_EQ(columns.metric_infos(0).name().tag(), "policy_stats/avg_true_objective");
  const tensorboard::SessionStart row =
      data_of(events[2], "_hparams_/session_start_info").session_start_info();
  EXPECT_EQ(row.hparams().at("scenario").string_value(), "lava_pit");
  EXPECT_EQ(row.hparams().at("algo").string_value(), "qmix");
  EXPECT_EQ(row.hparams().at("seed").number_value(), 68);
  EXPECT_EQ(row.hparams().at("learning_rate").number_value(), 3e-4);
  EXPECT_TRUE(row.hparams().at("double_dqn").bool_value());
  EXPECT_FALSE(row.hparams().contains("ppo_clip_ratio")) << "it makes no difference in this run";
  EXPECT_FALSE(row.hparams().contains("experiment")) << "that is the row's name";
}

// TensorBoard's own reader and the backend of its HPARAMS page, on two runs in one folder.
TEST_F(MetricsFileTest, TensorBoardReadsScalarsAndSettings) {
  const Expected<std::string> python = test::python_with("tensorboard");
  if (!python) GTEST_SKIP() << python.error().message;
  write_run(folder_ / "runs/one", "qmix", 42, 7);
  write_run(folder_ / "runs/two", "ippo", 68, 9);
  const fs::path script = folder_.write("read.py", R"(
import sys
from tensorboard import context
from tensorboard.backend.event_processing import data_provider, plugin_event_multiplexer
from tensorboard.plugins import base_plugin
from tensorboard.plugins.hparams import api_pb2, backend_context, list_session_groups

runs = plugin_event_multiplexer.EventMultiplexer()
runs.AddRunsFromDirectory(sys.argv[1])
runs.Reload()
assert sorted(runs.Runs()) == ["one", "one/eval", "two", "two/eval"], runs.Runs()
provider = data_provider.MultiplexerDataProvider(runs, sys.argv[1])
request = context.RequestContext()
scalars = provider.read_scalars(request, experiment_id="", plugin_name="scalars", downsample=10)
lr, steps = scalars["one"]["train/lr"][0], scalars["one"]["train/num_sgd_steps"][0]
assert (lr.step, round(lr.value, 6)) == (100, 3e-4) and steps.value == 0, (lr, steps)
assert scalars["two/eval"]["eval/J"][0].value == 10
videos = provider.read_blob_sequences(request, experiment_id="", plugin_name="images", downsample=10)
(video,) = videos["two/eval"]["eval/video"]
width, height, gif = [provider.read_blob(request, blob_key=one.blob_key) for one in video.values]
assert (video.step, width, height, gif[:6]) == (100, b"258", b"3", b"GIF89a"), (video, width, height, gif)

backend = backend_context.Context(base_plugin.TBContext(data_provider=provider))
written = backend.hparams_metadata(request, "")
page = backend.experiment_from_metadata(request, "", True, written, [])
names = [one.name for one in page.hparam_infos]
assert names[:4] == ["algo", "preset", "scenario", "seed"] and len(set(names)) == len(names), names
kinds = {one.name: one.type for one in page.hparam_infos}
assert kinds["algo"] == api_pb2.DATA_TYPE_STRING and kinds["seed"] == api_pb2.DATA_TYPE_FLOAT64
assert kinds["double_dqn"] == api_pb2.DATA_TYPE_BOOL
asked = api_pb2.ListSessionGroupsRequest(slice_size=10, allowed_statuses=api_pb2.Status.values())
groups = {one.name: one for one in list_session_groups.Handler(request, backend, "", asked).run().session_groups}
assert sorted(groups) == ["one", "two"], groups
one, two = groups["one"].hparams, groups["two"].hparams
assert one["scenario"].string_value == "lava_pit" and one["algo"].string_value == "qmix"
assert one["seed"].number_value == 42 and two["seed"].number_value == 68
assert one["double_dqn"].bool_value and "ppo_clip_ratio" not in one and "ppo_clip_ratio" in two
values = {(one.name.group, one.name.tag): one.value for one in groups["two"].metric_values}
assert values == {("", "policy_stats/avg_true_objective"): 9, ("eval", "eval/J"): 10}, values
)");
  const std::string command = *python + " " + script.string() + " " + (folder_ / "runs").string();
  EXPECT_EQ(std::system(command.c_str()), 0);
}

TEST_F(MetricsFileTest, TensorBoardForgetsWhatACrashedRunHadReported) {
  const Expected<std::string> python = test::python_with("tensorboard");
  if (!python) GTEST_SKIP() << python.error().message;
  for (const std::vector<uint64_t>& env_frames :
       {std::vector<uint64_t>{40960, 46080, 53248}, std::vector<uint64_t>{45056, 49152}}) {
    Expected<MetricsWriter> writer = MetricsWriter::open(folder_.string());
    ASSERT_TRUE(writer) << writer.error().message;
    ASSERT_TRUE(writer->begin_at(env_frames[0] == 40960 ? 1 : 40961));  // the checkpoint's env frames, and 1
    for (const uint64_t at : env_frames) ASSERT_TRUE(writer->write(1, at, 1, {{"reward/reward", 1.0}}));
  }
  const fs::path script = folder_.write("read.py", R"(
import sys
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

run = EventAccumulator(sys.argv[1], size_guidance={"scalars": 0})
run.Reload()
steps = [one.step for one in run.Scalars("reward/reward")]
assert steps == [40960, 45056, 49152], steps
)");
  EXPECT_EQ(std::system((*python + " " + script.string() + " " + folder_.string()).c_str()), 0);
}

TEST_F(MetricsFileTest, ClosesAHalfLineOfACrashBeforeItAppends) {
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

TEST_F(MetricsFileTest, RefusesAVideoThatIsNone) {
  Expected<MetricsWriter> writer = MetricsWriter::open(folder_.string());
  ASSERT_TRUE(writer);
  for (const char* bytes : {"", "GIF89a", "a video that is none"}) {
    const Status written = writer->write_gif(1, "eval/video", bytes);
    ASSERT_FALSE(written) << bytes;
    EXPECT_EQ(written.error().message, "the video eval/video is no GIF");
  }
}

TEST_F(MetricsFileTest, AMissingFolderIsAClearError) {
  const Expected<MetricsWriter> writer = MetricsWriter::open((folder_ / "nowhere").string());
  ASSERT_FALSE(writer);
  EXPECT_NE(writer.error().message.find("nowhere"), std::string::npos);
}

TEST_F(MetricsFileTest, TwoWritersOfOneRunDoNotMixTheirLines) {
  const std::string evaluations = (folder_ / "eval").string();
  Expected<MetricsWriter> learner = MetricsWriter::open(folder_.string());
  Expected<MetricsWriter> supervisor = MetricsWriter::open(folder_.string(), evaluations);
  ASSERT_TRUE(learner && supervisor);
  ASSERT_TRUE(learner->write(1, 100, 25, {{"train/loss", 1}}));
  ASSERT_TRUE(supervisor->write(1, 80, 20, {{"eval/J", 7}}));
  std::ofstream(folder_ / "metrics.jsonl", std::ios::app) << "{\"time_s\": 2";  // a full disk
  ASSERT_TRUE(supervisor->write(2, 90, 22, {{"eval/J", 8}}));
  std::ifstream lines(folder_ / "metrics.jsonl");
  std::vector<std::string> all;
  for (std::string line; std::getline(lines, line);) all.push_back(line);
  ASSERT_EQ(all.size(), 4u);
  EXPECT_EQ(nlohmann::json::parse(all[0])["train/loss"], 1);
  EXPECT_EQ(nlohmann::json::parse(all[1])["eval/J"], 7);
  EXPECT_EQ(nlohmann::json::parse(all[3])["env_frames"], 90);
  int event_files = 0;
  for (const auto& entry : fs::directory_iterator(evaluations)) {
    ++event_files;
    EXPECT_EQ(read_events(read_file(entry.path())).size(), 3u);
  }
  EXPECT_EQ(event_files, 1);
}

}  // namespace metrics_file_test
}  // namespace comrad
