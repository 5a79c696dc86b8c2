// One program that runs on this machine: it dies with us, keeps nothing of ours open, and what it prints
// comes back line by line.
#pragma once

#include <sys/types.h>

#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "deploy/process/process_host.h"
#include "deploy/process/process_start.h"
#include "rollout_buffer/core/expected.h"

namespace comrad::deploy {

/// A running child. Destroying it kills (SIGKILL) and reaps a child that still runs.
class ChildProcess final : public Process {
 public:
  /// Starts the program as process_start.h describes: standard error and (unless it goes elsewhere) output are one pipe to us; SIGINT and SIGHUP are
  /// ignored (the supervisor decides). Errors: kNotFound or kSystem when it cannot be executed.
  /// Threads: call from a thread that outlives the child.
  static Expected<ChildProcess> spawn(const ChildOptions& options);

  ChildProcess(ChildProcess&& other) noexcept;
  ChildProcess& operator=(ChildProcess&& other) noexcept;
  ~ChildProcess() override;

  pid_t pid() const override { return pid_; }
  int output_descriptor() const override { return output_.get(); }
  std::vector<std::string> read_lines() override;
  const std::optional<ExitStatus>& poll_exit() override;
  void send_signal(int signal) override;
  void write_input(const std::string& text) override;
  void end_input() override { input_.close(); }
  double cpu_seconds() const override;
  bool is_stopped() const override;
  bool is_at_work() const override;

 private:
  ChildProcess(pid_t pid, Descriptor output, Descriptor input)
      : pid_(pid), output_(std::move(output)), input_(std::move(input)) {}
  void end();
  pid_t pid_ = -1;
  Descriptor output_, input_;
  std::string partial_;
  std::optional<ExitStatus> exit_;
  double cpu_s_at_exit_ = 0;
};

}  // namespace comrad::deploy
