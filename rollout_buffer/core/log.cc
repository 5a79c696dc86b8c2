#include "rollout_buffer/core/log.h"

#include <spdlog/sinks/rotating_file_sink.h>
#include <spdlog/sinks/stdout_sinks.h>

#include <filesystem>
#include <memory>
#include <vector>

#include "rollout_buffer/core/host_name.h"

namespace comrad {
namespace {

// So much of a long run's log is kept, the newest.
constexpr std::size_t kFileBytes = std::size_t{8} << 20, kOlderFiles = 3;

/// A pattern that writes `text` as it is.
std::string literal(const std::string& text) {
  std::string pattern;
  for (const char letter : text) pattern += letter == '%' ? std::string("%%") : std::string(1, letter);
  return pattern;
}

/// "my_run@host".
std::string run_and_host(const std::string& path) {
  std::error_code failed;
  const std::filesystem::path file = std::filesystem::absolute(path, failed).lexically_normal();
  return file.parent_path().parent_path().filename().string() + "@" + host_name();
}

}  // namespace

Status init_log(const std::string& role, const std::string& path) {
  std::vector<spdlog::sink_ptr> sinks;
  auto terminal = std::make_shared<spdlog::sinks::stderr_sink_mt>();
  terminal->set_level(path.empty() ? spdlog::level::info : spdlog::level::warn);
  sinks.push_back(terminal);
  if (!path.empty()) {
    std::error_code made;
    std::filesystem::create_directories(std::filesystem::path(path).parent_path(), made);
    try {
      sinks.push_back(std::make_shared<spdlog::sinks::rotating_file_sink_mt>(path, kFileBytes, kOlderFiles));
    } catch (const spdlog::spdlog_ex& failure) {
      return Error{ErrorCode::kSystem, "log file " + path + ": " + failure.what()};
    }
  }
  auto logger = std::make_shared<spdlog::logger>(role, sinks.begin(), sinks.end());
  logger->set_pattern("%Y-%m-%dT%H:%M:%S.%e %L %n: %v");
  if (!path.empty())
    sinks.back()->set_pattern("%Y-%m-%dT%H:%M:%S.%e %L " + literal(run_and_host(path)) + " %n: %v");
  logger->flush_on(spdlog::level::info);
  spdlog::set_default_logger(std::move(logger));
  return {};
}

}  // namespace comrad
