// The processes that play for a page: `comrad eval --page`, or comrad-sim-watch with recorded episodes, and the socket at which their
// simulator reports what it plays.
#pragma once

#include <functional>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "deploy/process/child_process.h"
#include "deploy/process/http_server.h"
#include "rollout_buffer/core/expected.h"

namespace comrad::deploy {

/// One after the other; at most one plays. Threads: one.
class Session {
 public:
  struct Heard {
    std::function<void(nlohmann::json words)> words;
    std::function<void(int agent, std::string_view jpeg)> picture;
  };
  enum class State { kNone, kStarting, kPlaying, kEnded };

  /// `server` waits for what the simulator sends, and outlives this.
  Session(HttpServer& server, Heard heard) : server_(server), heard_(std::move(heard)) {}
  Session(const Session&) = delete;
  Session& operator=(const Session&) = delete;
  /// Waits for the processes to end, and kills those that do not.
  ~Session();

  /// Ends what plays now and starts `program`, to which --page SOCKET is added. Errors: kSystem, kNotFound.
  Status start(const std::string& program, std::vector<std::string> arguments);
  /// Hears of the end of processes. Call it every now and then.
  void tick();
  /// A command of sim_workers/watch/live_view.h.
  void tell(const nlohmann::json& command);

  State state() const { return state_; }
  /// What the program said last.
  const std::string& last_words() const { return last_words_; }
  /// Processor time of the processes that play now, seconds.
  double cpu_seconds() const { return process_ ? process_->cpu_seconds() : 0; }

 private:
  void leave();
  void accept();
  void read();
  void close_link();

  HttpServer& server_;
  Heard heard_;
  State state_ = State::kNone;
  std::optional<ChildProcess> process_;
  std::vector<ChildProcess> leaving_;
  Descriptor listener_, link_;
  std::string received_, last_words_;
};

}  // namespace comrad::deploy
