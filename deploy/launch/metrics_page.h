// The Prometheus page of a run: http://127.0.0.1:<metrics_port>/metrics, text format 0.0.4.
#pragma once

#include <functional>
#include <string>
#include <string_view>

#include "deploy/launch/run_snapshot.h"
#include "deploy/process/reply_server.h"
#include "rollout_buffer/core/expected.h"

namespace comrad::deploy {

/// One family a number, each with its HELP and TYPE; the run is a label of all. What is not known yet is left out.
std::string metrics_text(const RunSnapshot& run);

/// The HTTP answer to a request; `page` makes the body of GET /metrics. A Host that is not this machine is refused: a web
/// page in the user's browser must not read it under a name of its own.
std::string http_answer(std::string_view request, const std::function<std::string()>& page);

/// Whether the page could be served there now; 0: none is wanted. Errors: those of MetricsPage::open().
Status check_metrics_port(int64_t port);

/// Threads: the supervisor's.
class MetricsPage {
 public:
  /// Errors: kBadInput where the port is taken, kSystem.
  static Expected<MetricsPage> open(int port, std::function<std::string()> page);
  void tick(double now_s) { server_.tick(now_s); }

 private:
  explicit MetricsPage(ReplyServer server) : server_(std::move(server)) {}
  ReplyServer server_;
};

}  // namespace comrad::deploy
