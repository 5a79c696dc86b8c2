#include "deploy/sweep/report_step.h"

#include <spdlog/fmt/fmt.h>

#include <cstdio>
#include <filesystem>

#include "deploy/process/child_program.h"
#include "rollout_buffer/core/files.h"
#include "rollout_buffer/core/text.h"

namespace comrad::deploy {

std::string report_lines(const SweepFolder& folder, const std::string& command) {
  constexpr std::string_view kFolder = "{folder}";
  std::string line = command;
  const std::string word = shell_word(folder.path());
  for (std::size_t place = line.find(kFolder); place != std::string::npos;
       place = line.find(kFolder, place + word.size()))
    line.replace(place, kFolder.size(), word);
  const std::string programs = std::filesystem::path(sibling_program("comrad")).parent_path().string();
  return "export PATH=" + shell_word(programs) + ":\"$PATH\"\ncd " + word + " || exit 1\n" + line + "\n";
}

Status run_report(const SweepFolder& folder, const std::string& command) {
  if (command.empty()) return {};
  constexpr double kLongestS = 86400;
  std::fprintf(stderr, "report: %s\n", command.c_str());
  COMRAD_TRY_ASSIGN(const ProgramResult done, run_program({"bash", "-c", report_lines(folder, command)},
                                                          {.timeout_s = kLongestS, .echo_stderr = true}));
  COMRAD_TRY(write_file_atomically(folder.path() + "/records/report.log", done.output + done.error_output,
                                   /*durable=*/false));
  if (done.exit_code == 0) return {};
  return Error{ErrorCode::kPeerLost,
               fmt::format("the report failed (exit code {}): {} (see {}/records/report.log)", done.exit_code,
                           last_words(done), folder.path())};
}

}  // namespace comrad::deploy
