// Runs comrad-bench-replay to its end and keeps what it said.
#pragma once

#include <sys/wait.h>

#include <array>
#include <cstdio>
#include <string>

namespace comrad::replay {

struct BenchRun {
  int exit_code = -1;
  std::string output;  ///< stdout, and stderr where the command line joins them
};

/// `before` is shell text put before the program, e.g. to enter a control group.
inline BenchRun run_bench(const std::string& flags, const std::string& before = "") {
  BenchRun run;
  FILE* pipe = popen((before + "exec " COMRAD_BENCH_REPLAY " " + flags).c_str(), "r");
  if (pipe == nullptr) return run;
  std::array<char, 4096> piece{};
  while (const std::size_t count = fread(piece.data(), 1, piece.size(), pipe))
    run.output.append(piece.data(), count);
  const int status = pclose(pipe);
  run.exit_code = WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
  return run;
}

}  // namespace comrad::replay
