// A simulator's connection to `comrad watch` or `comrad play`, which shows what it plays: pictures and words go out, a person's
// commands come in. Stage: beside step, for eyes.
#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "rollout_buffer/core/descriptor.h"
#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/schema/watch_message.h"

namespace comrad::sim {

/// Never waits for the other end: pictures are dropped while it does not read. Threads: one.
class PageLink {
 public:
  /// Connects to the abstract Unix socket of that name. Errors: kNotFound, and kBadInput where another user listens there.
  static Expected<PageLink> connect(const std::string& name);

  /// The other end has left, or read nothing for too long.
  bool is_closed() const { return is_closed_; }
  /// Whether a picture that is sent now leaves soon.
  bool takes_pictures();
  void send(const nlohmann::json& words);
  void send_picture(int agent, std::string_view jpeg);
  /// The commands that came, after waiting at most so long for one; what is no JSON object is left out.
  std::vector<nlohmann::json> commands(int wait_ms);

 private:
  explicit PageLink(Descriptor socket) : socket_(std::move(socket)) {}
  void append(WatchKind kind, std::string_view payload);
  void flush();

  Descriptor socket_;
  bool is_closed_ = false;
  std::string waiting_;   ///< to be sent
  std::string received_;  ///< of a command that is not whole yet
};

}  // namespace comrad::sim
