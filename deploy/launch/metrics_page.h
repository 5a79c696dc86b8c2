// The Prometheus page of a run: http://127.0.0.1:<metrics_port>/metrics, text format 0.0.4.
#pragma once

#include <functional>
#include <string>

#include "deploy/launch/run_snapshot.h"
#include "deploy/process/http_server.h"
#include "rollout_buffer/core/expected.h"

namespace comrad::deploy {

/// One family a number, each with its HELP and TYPE; the run is a label of all. What is not known yet is left out.
std::string metrics_text(const RunSnapshot& run);

/// What is served; `page` makes the body of GET /metrics.
HttpRules metrics_rules(std::function<std::string()> page);

/// Whether the page could be served there now; 0: none is wanted. Errors: those of MetricsPage::open().
Status check_metrics_port(int64_t port);

/// Threads: the supervisor's.
class MetricsPage {
 public:
  /// Errors: kBadInput where the port is taken, kSystem.
  static Expected<MetricsPage> open(int port, std::function<std::string()> page);
  void tick() { server_.tick(); }

 private:
  explicit MetricsPage(HttpServer server) : server_(std::move(server)) {}
  HttpServer server_;
};

}  // namespace comrad::deploy
