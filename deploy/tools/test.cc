// `comrad test`: ctest over the build folder that this program lies in. ctest's own summary stays last; what was skipped and why,
// and the slowest tests, stand right before it.

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <functional>
#include <span>

#include "deploy/process/child_program.h"
#include "deploy/run/command.h"
#include "deploy/settings/merged_settings.h"
#include "deploy/tools/test_report.h"
#include "rollout_buffer/core/cores.h"
#include "rollout_buffer/core/files.h"

namespace comrad::deploy {
namespace {

constexpr double kSuiteTimeoutSeconds = 80 * 60;
constexpr std::size_t kSlowestShown = 10;

bool has_flag(Arguments arguments, std::initializer_list<std::string_view> names) {
  return std::any_of(arguments.begin(), arguments.end(), [&](const std::string& word) {
    return std::any_of(names.begin(), names.end(), [&](std::string_view name) {
      return name.starts_with("--") ? word == name || word.starts_with(std::string(name) + "=")
                                    : word.starts_with(name);
    });
  });
}

/// How many tests a label has, by asking ctest.
int count_label(const std::string& build, const std::string& label) {
  const auto listed = run_program({"ctest", "--test-dir", build, "-N", "-L", "^" + label + "$"});
  if (!listed) return 0;
  const size_t total = listed->output.find("Total Tests: ");
  return total == std::string::npos ? 0 : std::atoi(listed->output.c_str() + total + 13);
}

/// Prints what was skipped. False where CI=true does not allow one of the reasons.
bool print_skipped(const std::string& log, const std::vector<std::string>& skipped, int left_out) {
  const char* ci = std::getenv("CI");
  const std::string page = data_dir() + "/tests/SKIPPED.md";
  const bool is_strict = ci != nullptr && std::string_view(ci) == "true";
  const std::vector<std::string> words = allowed_words(read_file(page).value_or(""));
  bool all_allowed = true;
  if (!skipped.empty()) {
    std::printf("Skipped, in whole or in part:\n");
    for (const std::string& test : skipped)
      for (const std::string& reason : skip_reasons(log, test)) {
        const bool is_refused = is_strict && !is_allowed(reason, words);
        all_allowed &= !is_refused;
        std::printf("  %s: %s%s\n", test.c_str(), reason.c_str(), is_refused ? " [not allowed]" : "");
      }
    if (!all_allowed)
      std::printf("CI=true allows the skips that %s lists; install what the others lack.\n", page.c_str());
  }
  if (left_out > 0)
    std::printf("Left out: %d tests labelled long (./comrad test -L long runs them).\n", left_out);
  if (!skipped.empty() || left_out > 0) std::printf("\n");
  return all_allowed;
}

void print_slowest(std::vector<TestTime> times) {
  if (times.size() <= kSlowestShown) return;
  std::ranges::sort(times, std::greater(), &TestTime::seconds);
  std::printf("The slowest:\n");
  for (const TestTime& time : std::span(times).first(kSlowestShown))
    std::printf("  %6.1f s  %s\n", time.seconds, time.name.c_str());
  std::printf("\n");
}

Expected<int> run_suite(Arguments arguments) {
  const std::string build = build_folder();
  if (!std::filesystem::exists(build + "/CTestTestfile.cmake"))
    return Error{ErrorCode::kNotFound,
                 build + " is no build folder with tests; run ./comrad test from the sources"};

  std::vector<std::string> command = {"ctest", "--test-dir", build, "--output-on-failure"};
  const bool chooses_labels = has_flag(arguments, {"-L", "--label-regex", "--label-exclude"});
  if (!chooses_labels) command.insert(command.end(), {"-LE", "^long$"});
  if (!has_flag(arguments, {"-j", "--parallel"}))
    command.push_back(fmt::format("-j{}", std::min(usable_cores(), 8)));
  command.insert(command.end(), arguments.begin(), arguments.end());

  std::vector<std::string> skipped;
  std::vector<TestTime> times;
  std::vector<std::string> closing;  // held back until the reasons are printed
  ProgramOptions options{.timeout_s = kSuiteTimeoutSeconds, .echo_stderr = true};
  options.on_line = [&](const std::string& line) {
    if (!closing.empty() || is_closing_line(line)) {
      closing.push_back(line);
      return;
    }
    if (const std::string_view name = skipped_test(line); !name.empty()) skipped.emplace_back(name);
    if (std::optional<TestTime> time = test_time(line)) times.push_back(std::move(*time));
    std::printf("%s\n", line.c_str());
    std::fflush(stdout);
  };
  COMRAD_TRY_ASSIGN(const ProgramResult result, run_program(command, options));
  // Before count_label(): that call of ctest begins the file anew.
  const std::string log = read_file(build + "/Testing/Temporary/LastTest.log").value_or("");
  print_slowest(std::move(times));
  const bool all_allowed = print_skipped(log, skipped, chooses_labels ? 0 : count_label(build, "long"));
  for (const std::string& line : closing) std::printf("%s\n", line.c_str());
  return result.exit_code == 0 && all_allowed ? kExitDone : kExitFailed;
}

}  // namespace

int test_command(Arguments arguments) {
  if (has_flag(arguments, {"-h", "--help"})) {
    std::printf(
        "usage: comrad test [ctest arguments]\n\n"
        "Builds what is missing and installs what the tests need (./comrad does; COMRAD_NO_INSTALL=1 keeps "
        "it from "
        "installing),\nthen runs the test suite with ctest, everything but the label long.\n"
        "Arguments go to ctest:  comrad test -L unit    comrad test -R arena -j4    comrad test -L long\n"
        "Labels: unit games integration golden fuzz stress parity long.\n");
    return kExitDone;
  }
  const Expected<int> done = run_suite(arguments);
  return done ? *done : report_error("test", done.error());
}

}  // namespace comrad::deploy
