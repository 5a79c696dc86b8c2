// What the learner sends the supervisor besides numbers: messages for the user, and checkpoints to evaluate. Each message is a line
// of JSON, which is read whole or not at all. Stage: beside the flow.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "rollout_buffer/core/expected.h"

namespace comrad {

/// A worker's message to the user: a line of its standard error, behind kUserMessagePrefix. The supervisor shows
/// it, whatever else the worker prints.
struct UserMessage {
  enum class Kind { kNote, kWarning };
  Kind kind = Kind::kNote;
  std::string text;

  /// "warning: 31% of the samples are old".
  std::string words() const;
};

constexpr std::string_view kUserMessagePrefix = "comrad-message ";
constexpr std::size_t kUserMessageBytesMax = 2048;  ///< of a line; a longer text is cut

std::string to_line(const UserMessage& message);
/// Nothing for a line of any other kind, or longer than kUserMessageBytesMax. Control characters become blanks: the text
/// goes to a terminal.
std::optional<UserMessage> parse_user_message(std::string_view line);
/// Writes the message into the log, and to standard error for the supervisor; a process without a log file, which has none,
/// only logs it.
void tell_user(const UserMessage& message);

/// A checkpoint that the learner requires evaluated: a line of kEvaluationsFile in the folder of checkpoints. The line is written
/// before the checkpoint, which is deleted when it was evaluated: what has both waits, in a run that was killed, too.
struct RequestedEvaluation {
  std::string file;  ///< name in the same folder
  uint64_t version = 0;
  uint64_t env_frames = 0;
  uint64_t train_seconds = 0;
};

constexpr const char* kEvaluationsFile = "evaluations.jsonl";

/// Adds a line, with one call of the system; makes the folder. Errors: as file_error.
Status request_evaluation(const std::string& folder, const RequestedEvaluation& request);
/// The requests of the last MiB of lines, the newest of each file; lines that hold none are left out, as is a file's name that
/// is not of this folder.
std::vector<RequestedEvaluation> requested_evaluations(const std::string& folder);

}  // namespace comrad
