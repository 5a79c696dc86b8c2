#include "tests/simulation/simulated_host.h"

#include <algorithm>
#include <cstdlib>

namespace comrad::simulation {

/// The supervisor's hold on a body.
class Puppet final : public deploy::Process {
 public:
  Puppet(SimulatedHost& host, std::shared_ptr<Body> body, pid_t pid)
      : host_(host), body_(std::move(body)), pid_(pid) {}
  ~Puppet() override { body_->end({.code = 0, .signal = SIGKILL}, host_.clock_.now_s()); }

  pid_t pid() const override { return pid_; }
  int output_descriptor() const override { return -1; }
  std::vector<std::string> read_lines() override { return std::exchange(body_->lines, {}); }
  const std::optional<ExitStatus>& poll_exit() override {
    if (body_->exit && !is_seen_) host_.exits_.push_back({body_->place, *body_->exit, body_});
    is_seen_ |= body_->exit.has_value();
    return body_->exit;
  }
  void send_signal(int signal) override {
    const double now_s = host_.clock_.now_s();
    if (signal == SIGTERM && body_->term_s == 0) body_->term_s = now_s;
    if (signal != SIGKILL) return;
    if (body_->kill_s == 0) body_->kill_s = now_s;
    if (!body_->ignores_kill) body_->end({.code = 0, .signal = SIGKILL}, now_s);
  }
  void write_input(const std::string&) override {}
  void end_input() override {
    if (body_->input_ended_s == 0) body_->input_ended_s = host_.clock_.now_s();
  }
  double cpu_seconds() const override { return 0; }
  bool is_stopped() const override { return body_->is_stopped; }
  bool is_at_work() const override { return host_.shows_work_ && body_->is_alive() && !body_->is_hung; }

 private:
  SimulatedHost& host_;
  std::shared_ptr<Body> body_;
  const pid_t pid_;
  bool is_seen_ = false;
};

/// By the program's name, and by the index that it is given.
int SimulatedHost::place_of(const deploy::ChildOptions& options) const {
  const std::string program = options.program.substr(options.program.rfind('/') + 1);
  int index = 0;
  if (const auto flag = std::ranges::find(options.arguments, "--worker_index");
      flag != options.arguments.end())
    index = std::atoi(std::next(flag)->c_str());
  if (program == "comrad-sim-worker") return index;
  if (program == "comrad-policy-worker") return setting_.policy(index);
  if (program == "comrad-learner") return setting_.learner();
  if (program.starts_with("host-")) return setting_.host(std::atoi(program.c_str() + 5));
  return setting_.evaluation();
}

Expected<std::unique_ptr<deploy::Process>> SimulatedHost::spawn(const deploy::ChildOptions& options) {
  const int place = place_of(options);
  if (is_unstartable(place)) {
    failures_.push_back(place);
    return Error{ErrorCode::kNotFound, "cannot start " + setting_.name(place)};
  }
  if (living(place) != nullptr) doubles_.push_back(place);
  auto body = std::make_shared<Body>();
  body->place = place;
  body->started_s = clock_.now_s();
  body->ignores_kill = ignores_kill_;
  bodies_[static_cast<std::size_t>(place)] = body;
  starts_.push_back(place);
  return std::unique_ptr<deploy::Process>(std::make_unique<Puppet>(*this, std::move(body), next_pid_++));
}

bool SimulatedHost::any_alive() const {
  return std::ranges::any_of(bodies_, [](const auto& body) { return body && body->is_alive(); });
}

void SimulatedHost::forget_news() {
  exits_.clear();
  starts_.clear();
  doubles_.clear();
  failures_.clear();
}

}  // namespace comrad::simulation
