#include "rollout_buffer/metrics/learner_messages.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <spdlog/sinks/basic_file_sink.h>
#include <spdlog/sinks/stdout_sinks.h>

#include <filesystem>
#include <fstream>

#include "rollout_buffer/core/files.h"
#include "rollout_buffer/core/log.h"
#include "tests/support/scratch_folder.h"

namespace comrad {
namespace learner_messages_test {

using ::testing::ElementsAre;
using ::testing::EndsWith;
using ::testing::IsEmpty;
using Kind = UserMessage::Kind;

TEST(UserMessage, IsReadBackFromItsLine) {
  for (const Kind kind : {Kind::kNote, Kind::kWarning})
    for (const char* text :
         {"31% of the samples are old", "a \"quoted\" \\ word: warning: no other", "", "ä"}) {
      const std::optional<UserMessage> read = parse_user_message(to_line({kind, text}));
      ASSERT_TRUE(read) << text;
      EXPECT_EQ(read->kind, kind);
      EXPECT_EQ(read->text, text);
    }
  EXPECT_EQ((UserMessage{Kind::kWarning, "hot"}.words()), "warning: hot");
  EXPECT_EQ((UserMessage{Kind::kNote, "cold"}.words()), "note: cold");
}

TEST(UserMessage, ALineOfAnyOtherKindIsNone) {
  const std::string prefix(kUserMessagePrefix), good = to_line({Kind::kNote, "x"});
  for (const std::string& line :
       {std::string(), std::string("2026-11-22T10:00:00.000 W learner: warning: 31%"), prefix, prefix + "{}",
        prefix + "[]", prefix + "null", prefix + R"({"kind": "note"})", prefix + R"({"text": "x"})",
        prefix + R"({"kind": "order", "text": "x"})", prefix + R"({"kind": 1, "text": "x"})",
        prefix + R"({"kind": "note", "text": 1})", "x" + good,
        prefix + R"({"kind": "note", "text": ")" + std::string(kUserMessageBytesMax, 'x') + "\"}"})
    EXPECT_FALSE(parse_user_message(line)) << line;
  for (std::size_t size = 0; size < good.size(); ++size)  // of a worker that was killed
    EXPECT_FALSE(parse_user_message(good.substr(0, size))) << size;
}

TEST(UserMessage, AWorkersBytesNeitherDriveATerminalNorMakeALineLong) {
  const std::optional<UserMessage> read = parse_user_message(to_line({Kind::kNote, "a\x1B[2J\nb\x7F"}));
  ASSERT_TRUE(read);
  EXPECT_EQ(read->text, "a [2J b ");
  for (const char letter : {'x', '\x01', '\xFF'}) {
    const std::string line = to_line({Kind::kWarning, std::string(100'000, letter)});
    EXPECT_LE(line.size(), kUserMessageBytesMax);
    EXPECT_EQ(line.find('\n'), std::string::npos);
    EXPECT_TRUE(parse_user_message(line));
  }
}

TEST(UserMessage, GoesIntoTheLogFileAndOnceToStandardError) {
  const test::ScratchFolder folder;
  const std::string path = (folder / "learner.log").string();
  const auto before = spdlog::default_logger();
  spdlog::set_default_logger(std::make_shared<spdlog::logger>(
      "learner", spdlog::sinks_init_list{std::make_shared<spdlog::sinks::stderr_sink_mt>(),
                                         std::make_shared<spdlog::sinks::basic_file_sink_mt>(path)}));
  ::testing::internal::CaptureStderr();
  tell_user({Kind::kWarning, "hot"});
  const std::string printed = ::testing::internal::GetCapturedStderr();
  spdlog::set_default_logger(before);
  EXPECT_EQ(printed, to_line({Kind::kWarning, "hot"}) + "\n");
  EXPECT_THAT(read_file(path).value_or(""), EndsWith("warning: hot\n"));
}

class RequestedEvaluations : public ::testing::Test {
 protected:
  std::vector<std::string> files() const {
    std::vector<std::string> names;
    for (const RequestedEvaluation& request : requested_evaluations(folder())) names.push_back(request.file);
    return names;
  }
  void write(const std::string& text) const {
    std::ofstream(folder() + "/" + kEvaluationsFile, std::ios::app) << text;
  }
  std::string folder() const { return (scratch_ / "checkpoint").string(); }
  const test::ScratchFolder scratch_;
};

TEST_F(RequestedEvaluations, AreReadBackTheNewestOfEachFile) {
  EXPECT_THAT(requested_evaluations(folder()), IsEmpty());
  ASSERT_TRUE(request_evaluation(folder(), {"a.pt", 1, 2, 3}));
  ASSERT_TRUE(request_evaluation(folder(), {"b.pt", 4, 5, 6}));
  ASSERT_TRUE(request_evaluation(folder(), {"a.pt", 7, uint64_t{1} << 63, 9}));
  const std::vector<RequestedEvaluation> requests = requested_evaluations(folder());
  ASSERT_THAT(files(), ElementsAre("b.pt", "a.pt"));
  EXPECT_EQ(requests[0].version, 4u);
  EXPECT_EQ(requests[0].train_seconds, 6u);
  EXPECT_EQ(requests[1].version, 7u);
  EXPECT_EQ(requests[1].env_frames, uint64_t{1} << 63);
}

TEST_F(RequestedEvaluations, WhatALearnerThatDiedHasLeftCostsItsOwnLineAlone) {
  ASSERT_TRUE(request_evaluation(folder(), {"a.pt", 1, 2, 3}));
  write(R"({"file": "half.pt", "version": 1, "env_fr)");
  ASSERT_TRUE(request_evaluation(folder(), {"b.pt", 1, 2, 3}));
  EXPECT_THAT(files(), ElementsAre("a.pt", "b.pt"));
}

TEST_F(RequestedEvaluations, NothingElseIsOne) {
  std::filesystem::create_directories(folder());
  const auto line = [](const std::string& file, const std::string& version) {
    return R"({"file": )" + file + R"(, "version": )" + version +
           R"(, "env_frames": 2, "train_seconds": 3})" + "\n";
  };
  write("\n[]\nnull\n{}\n\"x\"\n");
  for (const char* file :
       {"1", "\"\"", "\"../a.pt\"", "\"/etc/passwd\"", "\"x/a.pt\"", "\".tmp-1-a.pt\"", "\"..\""})
    write(line(file, "1"));
  for (const char* version : {"-1", "1.5", "\"1\"", "1e30", "99999999999999999999", "null"})
    write(line("\"a.pt\"", version));
  EXPECT_THAT(files(), IsEmpty());
  write(line("\"a.pt\"", "1"));
  EXPECT_THAT(files(), ElementsAre("a.pt"));
  // Of a file that never ends the last lines are read.
  write(std::string(2 << 20, 'x') + "\n" + line("\"b.pt\"", "1"));
  EXPECT_THAT(files(), ElementsAre("b.pt"));
}

}  // namespace learner_messages_test
}  // namespace comrad
