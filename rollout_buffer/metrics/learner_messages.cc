#include "rollout_buffer/metrics/learner_messages.h"

#include <fcntl.h>
#include <spdlog/sinks/stdout_sinks.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <utility>

#include "rollout_buffer/core/files.h"
#include "rollout_buffer/core/log.h"

namespace comrad {
namespace {

using nlohmann::json;

constexpr std::array<const char*, 2> kKinds = {"note", "warning"};  // in the order of UserMessage::Kind
constexpr std::streamoff kRequestsBytesMax = 1 << 20;

std::string dumped(const json& object) {
  return object.dump(-1, ' ', /*ensure_ascii=*/false, json::error_handler_t::replace);
}

/// A member's text; nothing where there is none.
std::optional<std::string> text_of(const json& object, const char* key) {
  const auto found = object.find(key);
  if (found == object.end() || !found->is_string()) return std::nullopt;
  return found->get<std::string>();
}

std::optional<RequestedEvaluation> parse_request(const std::string& line) {
  const json object = json::parse(line, nullptr, /*allow_exceptions=*/false);
  if (!object.is_object()) return std::nullopt;
  const std::optional<std::string> file = text_of(object, "file");
  if (!file || file->empty() || file->front() == '.' || file->find('/') != std::string::npos)
    return std::nullopt;
  RequestedEvaluation request{.file = *file};
  for (const auto& [key, number] : {std::pair{"version", &request.version},
                                    {"env_frames", &request.env_frames},
                                    {"train_seconds", &request.train_seconds}}) {
    const auto found = object.find(key);
    if (found == object.end() || !found->is_number_unsigned()) return std::nullopt;
    *number = found->get<uint64_t>();
  }
  return request;
}

}  // namespace

std::string UserMessage::words() const {
  return std::string(kKinds[static_cast<std::size_t>(kind)]) + ": " + text;
}

std::string to_line(const UserMessage& message) {
  constexpr std::size_t kTextBytesMax = kUserMessageBytesMax / 2;  // JSON writes some bytes as two or more
  std::string line;
  for (std::size_t bytes = kTextBytesMax; line.empty() || line.size() > kUserMessageBytesMax; bytes /= 2)
    line = std::string(kUserMessagePrefix) + dumped({{"kind", kKinds[static_cast<std::size_t>(message.kind)]},
                                                     {"text", message.text.substr(0, bytes)}});
  return line;
}

std::optional<UserMessage> parse_user_message(std::string_view line) {
  if (line.size() > kUserMessageBytesMax || !line.starts_with(kUserMessagePrefix)) return std::nullopt;
  const json object =
      json::parse(line.substr(kUserMessagePrefix.size()), nullptr, /*allow_exceptions=*/false);
  if (!object.is_object()) return std::nullopt;
  const std::optional<std::string> kind = text_of(object, "kind");
  std::optional<std::string> text = text_of(object, "text");
  const auto known = kind ? std::ranges::find(kKinds, *kind) : kKinds.end();
  if (known == kKinds.end() || !text) return std::nullopt;
  std::ranges::replace_if(
      *text, [](char c) { return static_cast<unsigned char>(c) < 0x20 || c == 0x7F; }, ' ');
  return UserMessage{static_cast<UserMessage::Kind>(known - kKinds.begin()), *std::move(text)};
}

void tell_user(const UserMessage& message) {
  const auto logger = spdlog::default_logger();
  const auto level = message.kind == UserMessage::Kind::kWarning ? spdlog::level::warn : spdlog::level::info;
  const std::string words = message.words();
  bool has_file = false;
  for (const spdlog::sink_ptr& sink : logger->sinks()) {
    if (dynamic_cast<spdlog::sinks::stderr_sink_mt*>(sink.get()) != nullptr) continue;
    sink->log(spdlog::details::log_msg(logger->name(), level, words));
    sink->flush();
    has_file = true;
  }
  if (!has_file) return spdlog::log(level, "{}", words);
  const std::string line = to_line(message) + "\n";
  std::fwrite(line.data(), 1, line.size(), stderr);
}

Status request_evaluation(const std::string& folder, const RequestedEvaluation& request) {
  const std::string path = folder + "/" + kEvaluationsFile;
  std::error_code ignored;
  std::filesystem::create_directories(folder, ignored);
  const int file = open(path.c_str(), O_WRONLY | O_APPEND | O_CREAT | O_CLOEXEC, 0644);
  if (file < 0) return file_error("cannot write " + path, errno);
  // It begins with an end of line: what a full disk or a kill has cut before is no part of it.
  const Status written = write_all(file,
                                   "\n" +
                                       dumped({{"file", request.file},
                                               {"version", request.version},
                                               {"env_frames", request.env_frames},
                                               {"train_seconds", request.train_seconds}}) +
                                       "\n",
                                   path);
  close(file);
  return written;
}

std::vector<RequestedEvaluation> requested_evaluations(const std::string& folder) {
  std::vector<RequestedEvaluation> requests;
  std::ifstream lines(folder + "/" + kEvaluationsFile, std::ios::binary | std::ios::ate);
  if (!lines) return requests;
  lines.seekg(std::max<std::streamoff>(0, lines.tellg() - kRequestsBytesMax));
  for (std::string line; std::getline(lines, line);) {
    std::optional<RequestedEvaluation> request = parse_request(line);
    if (!request) continue;
    std::erase_if(requests, [&](const RequestedEvaluation& other) { return other.file == request->file; });
    requests.push_back(*std::move(request));
  }
  return requests;
}

}  // namespace comrad
