#include "deploy/watch/live_page.h"

#include <algorithm>
#include <atomic>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <map>
#include <memory>
#include <mutex>
#include <nlohmann/json.hpp>
#include <optional>
#include <thread>
#include <utility>

#include "deploy/process/child_program.h"
#include "deploy/process/http_server.h"
#include "deploy/watch/session.h"
#include "deploy/watch/watched_run.h"
#include "rollout_buffer/core/clock.h"
#include "rollout_buffer/core/process.h"

namespace comrad::deploy {
namespace {

using nlohmann::json;

constexpr double kTurnS = 0.05, kLookS = 2, kRetryS = 5;
constexpr std::size_t kBrowsersMax = 16;

volatile std::sig_atomic_t has_ended = 0;

void end_on_signals() {
  struct sigaction on_end {};
  on_end.sa_handler = [](int) { has_ended = 1; };
  const sigset_t heard = heard_of({SIGINT, SIGTERM, SIGHUP});
  for (const int number : {SIGINT, SIGTERM, SIGHUP})
    if (sigismember(&heard, number) == 1) sigaction(number, &on_end, nullptr);
}

std::shared_ptr<const std::string> shared(std::string text) {
  return std::make_shared<const std::string>(std::move(text));
}
std::shared_ptr<const std::string> shared(const json& words) {
  return shared(words.dump(-1, ' ', false, json::error_handler_t::replace));
}

std::string word_of(const json& object, const char* name) {
  const auto found = object.find(name);
  return found != object.end() && found->is_string() ? found->get<std::string>() : std::string();
}

/// A seed as typed into the page: up to 18 digits; else nothing.
bool is_seed(const std::string& text) {
  return text.size() <= 18 &&
         std::ranges::all_of(text, [](char letter) { return letter >= '0' && letter <= '9'; });
}

/// Looks at a run in a separate thread: a blocked run must not block the page.
class RunWatcher {
 public:
  explicit RunWatcher(const std::string& run_dir) : view_(run_dir) {
    seen_.checkpoint = view_.newest_checkpoint();  // the first game names it
    if (!run_dir.empty()) thread_ = std::thread([this] { work(); });
  }
  RunWatcher(const RunWatcher&) = delete;
  RunWatcher& operator=(const RunWatcher&) = delete;
  ~RunWatcher() {
    ends_ = true;
    if (thread_.joinable()) thread_.join();
  }
  struct Seen {
    std::shared_ptr<const std::string> words;  ///< null: nothing yet
    std::string checkpoint;
    uint64_t looks = 0;
  };
  Seen seen() const {
    const std::lock_guard lock(mutex_);
    return seen_;
  }

 private:
  void work() {
    while (!ends_) {
      auto words = shared(view_.look());
      std::string checkpoint = view_.newest_checkpoint();
      {
        const std::lock_guard lock(mutex_);
        seen_ = {std::move(words), std::move(checkpoint), seen_.looks + 1};
      }
      for (double rest_s = kLookS; rest_s > 0 && !ends_; rest_s -= kTurnS)
        std::this_thread::sleep_for(std::chrono::duration<double>(kTurnS));
    }
  }
  WatchedRun view_;
  mutable std::mutex mutex_;
  Seen seen_;
  std::atomic<bool> ends_{false};
  std::thread thread_;
};

class LivePage {
 public:
  explicit LivePage(const LivePageOptions& options) : options_(options), run_(options.run_dir) {
    for (std::size_t seat = 0; seat < std::max<std::size_t>(1, options.seats.size()); ++seat)
      tokens_.push_back(seat == 0 && !options.token.empty() ? options.token : make_token());
  }
  Status serve();

 private:
  bool is_play() const { return !options_.seats.empty(); }
  Status open();
  void print_addresses() const;
  HttpReply admit(SocketId id, const HttpRequest& request);
  void heard_browser(SocketId id, std::string_view message);
  void obey(int seat, const json& command);
  void heard_words(json words);
  void heard_picture(int agent, std::string_view jpeg);
  void start_game();
  void turn();
  bool has_failed() const;
  void say_how_many();
  json session_words(int seat) const;
  json seen_by(int seat, const json& words) const;
  void send_to_all(const json& words);

  const LivePageOptions options_;
  std::vector<std::string> tokens_;
  std::optional<HttpServer> server_;
  std::optional<Session> session_;
  RunWatcher run_;
  std::map<SocketId, int> browsers_;  ///< with the agent that each plays; -1: none
  PageChoice choice_;
  json began_, now_;  ///< last words, for browsers that come later
  std::map<int, std::shared_ptr<const std::string>> pictures_;
  std::string checkpoint_;                   ///< that plays
  bool has_newer_ = false, is_due_ = false;  ///< a newer one is there; it is to play now
  uint64_t looks_ = 0;
  Session::State told_state_ = Session::State::kNone;
  bool has_played_ = false;
  double retry_s_ = 0;
};

/// Whether the newest word is about an episode that is over.
bool is_over(const json& now) { return now.is_object() && !word_of(now, "over").empty(); }

Status LivePage::open() {
  HttpRules rules;
  rules.tokens = tokens_;
  rules.answer = [](const HttpRequest& request) -> HttpReply {
    if (request.method != "GET" && request.method != "HEAD")
      return {.status = 405, .body = "request GET /\n"};
    if (request.path != "/") return {.status = 404, .body = "request /\n"};
    return {.type = "text/html; charset=utf-8", .body = kLivePageHtml};
  };
  rules.open = [this](SocketId id, const HttpRequest& request) { return admit(id, request); };
  rules.heard = [this](SocketId id, std::string_view message) { heard_browser(id, message); };
  rules.closed = [this](SocketId id) {
    browsers_.erase(id);
    say_how_many();
  };
  Expected<HttpServer> server = HttpServer::open(options_.address, options_.port, std::move(rules));
  if (!server)
    return Error{server.error().code, server.error().message + "; choose another --port, or leave it out"};
  server_.emplace(std::move(server).value());
  session_.emplace(
      *server_,
      Session::Heard{.words = [this](json words) { heard_words(std::move(words)); },
                     .picture = [this](int agent, std::string_view jpeg) { heard_picture(agent, jpeg); }});
  return {};
}

void LivePage::print_addresses() const {
  const std::string host = options_.address == "0.0.0.0" ? "127.0.0.1" : options_.address;
  const std::string page = "http://" + host + ":" + std::to_string(server_->port()) + "/?token=";
  for (std::size_t seat = 0; seat < tokens_.size(); ++seat) {
    if (tokens_.size() > 1) std::printf("agent %d: ", options_.seats[seat]);
    std::printf("%s%s\n", page.c_str(), tokens_[seat].c_str());
  }
  std::fflush(stdout);
  const bool has_display = std::getenv("DISPLAY") != nullptr || std::getenv("WAYLAND_DISPLAY") != nullptr;
  if (!options_.opens_browser || !has_display) return;
  // setsid: the browser outlives us. Without xdg-open the printed address is there to be opened.
  (void)!run_program({"setsid", "--fork", "xdg-open", page + tokens_[0]}, {.timeout_s = 5});
}

HttpReply LivePage::admit(SocketId id, const HttpRequest& request) {
  if (request.path != "/live") return {.status = 404, .body = "request /live\n"};
  if (browsers_.size() >= kBrowsersMax) return {.status = 503, .body = "too many pages look already\n"};
  int agent = -1;
  for (std::size_t seat = 0; seat < options_.seats.size(); ++seat)
    if (request.value("token") == tokens_[seat]) agent = options_.seats[seat];
  browsers_[id] = agent;
  server_->send(id, shared(session_words(agent)), HttpServer::Kind::kText);
  for (const json* words : {&began_, &now_})
    if (words->is_object()) server_->send(id, shared(seen_by(agent, *words)), HttpServer::Kind::kText);
  for (const auto& [of, picture] : pictures_)
    if (agent < 0 || of == agent) server_->send(id, picture, HttpServer::Kind::kPicture);
  if (const auto seen = run_.seen(); seen.words && agent < 0)
    server_->send(id, seen.words, HttpServer::Kind::kText);
  say_how_many();
  return {};
}

void LivePage::say_how_many() { session_->tell({{"do", "shown"}, {"pages", browsers_.size()}}); }

void LivePage::heard_browser(SocketId id, std::string_view message) {
  const json command = json::parse(message, nullptr, /*allow_exceptions=*/false);
  const auto browser = browsers_.find(id);
  if (command.is_object() && browser != browsers_.end()) obey(browser->second, command);
}

void LivePage::obey(int seat, const json& command) {
  const std::string order = word_of(command, "do");
  if (order == "press") {
    if (seat >= 0 && command.contains("choice"))
      session_->tell({{"do", "press"}, {"agent", seat}, {"choice", command["choice"]}});
  } else if (order == "pause" || order == "run" || order == "step" || order == "begin") {
    session_->tell({{"do", order}});
  } else if (order == "speed" && !is_play()) {
    if (command.contains("times")) session_->tell({{"do", "speed"}, {"times", command["times"]}});
  } else if (order == "size") {
    if (command.contains("width") && command.contains("height"))
      session_->tell({{"do", "size"}, {"width", command["width"]}, {"height", command["height"]}});
  } else if (order == "renderer" && !is_play()) {
    session_->tell({{"do", "renderer"}, {"name", word_of(command, "name")}});
  } else if (order == "play" && !is_play()) {
    PageChoice choice{
        .policy = command.value("policy", json(0)).is_number_integer() ? command.value("policy", 0) : 0,
        .seed = word_of(command, "seed"),
        .layout_seed = word_of(command, "layout_seed")};
    if (choice.policy < 0 || choice.policy >= std::max(1, static_cast<int>(options_.policies.size())) ||
        !is_seed(choice.seed) || !is_seed(choice.layout_seed))
      return;
    choice_ = std::move(choice);
    start_game();
  }
}

/// A player sees what its agent sees and the score, and no more.
json LivePage::seen_by(int seat, const json& words) const {
  if (seat < 0) return words;
  json seen = words;
  seen.erase("lines");
  seen.erase("things");
  if (seen.contains("agents") && seen["agents"].is_array())
    for (std::size_t agent = 0; agent < seen["agents"].size(); ++agent) {
      json& one = seen["agents"][agent];
      if (static_cast<int>(agent) != seat)
        one = {{"alive", one.value("alive", json())}, {"score", one.value("score", json())}};
      for (const char* hidden : {"at", "value", "logits"}) one.erase(hidden);
    }
  return seen;
}

void LivePage::heard_words(json words) {
  const std::string type = word_of(words, "type");
  if (type == "began") {
    // Between two episodes, and not while the session reads. Each game plays one at least: where a start takes longer
    // than the run's next checkpoint, nothing would be seen otherwise.
    is_due_ = has_newer_ && began_.is_object();
    began_ = std::move(words);
    now_ = json();
    has_played_ = true;
    say_how_many();
    for (const auto& [id, seat] : browsers_)
      server_->send(id, shared(seen_by(seat, began_)), HttpServer::Kind::kText);
  } else if (type == "now") {
    now_ = std::move(words);
    std::map<int, std::shared_ptr<const std::string>> by_seat;
    for (const auto& [id, seat] : browsers_) {
      auto& text = by_seat[seat];
      if (!text) text = shared(seen_by(seat, now_));
      // Each message holds all counts, so a dropped one is not missed, except the last of an episode.
      server_->send(id, text, is_over(now_) ? HttpServer::Kind::kText : HttpServer::Kind::kDroppableText);
    }
  }
}

void LivePage::heard_picture(int agent, std::string_view jpeg) {
  const auto message = shared(static_cast<char>(agent) + std::string(jpeg));
  pictures_[agent] = message;
  for (const auto& [id, seat] : browsers_)
    if (seat < 0 || seat == agent) server_->send(id, message, HttpServer::Kind::kPicture);
}

json LivePage::session_words(int seat) const {
  constexpr const char* kStates[] = {"ended", "starting", "playing", "ended"};
  return {{"type", "session"},
          {"mode", options_.command},
          {"agent", seat},
          {"state", kStates[static_cast<int>(session_->state())]},
          {"message", session_->state() == Session::State::kEnded ? session_->last_words() : ""},
          {"policies", options_.policies},
          {"policy", choice_.policy},
          {"seed", choice_.seed},
          {"layout_seed", choice_.layout_seed},
          {"checkpoint", checkpoint_.substr(checkpoint_.rfind('/') + 1)},
          {"saved", options_.saved}};
}

void LivePage::start_game() {
  has_newer_ = is_due_ = false;
  checkpoint_ = run_.seen().checkpoint;
  began_ = now_ = json();
  pictures_.clear();
  PageProgram program = options_.program(choice_);
  if (const Status started = session_->start(program.path, std::move(program.arguments)); !started)
    std::fprintf(stderr, "comrad %s: %s\n", options_.command.c_str(), started.error().message.c_str());
}

void LivePage::turn() {
  if (is_due_) start_game();
  session_->tick();
  if (session_->state() != told_state_) {
    told_state_ = session_->state();
    for (const auto& [id, seat] : browsers_)
      server_->send(id, shared(session_words(seat)), HttpServer::Kind::kText);
    if (told_state_ == Session::State::kEnded && has_played_)
      std::fprintf(stderr, "comrad %s: %s\n", options_.command.c_str(), session_->last_words().c_str());
    if (told_state_ == Session::State::kEnded) retry_s_ = monotonic_s() + kRetryS;
  }
  const RunWatcher::Seen seen = run_.seen();
  if (seen.looks == looks_) return;
  looks_ = seen.looks;
  for (const auto& [id, seat] : browsers_)
    if (seat < 0) server_->send(id, seen.words, HttpServer::Kind::kText);
  if (!options_.reloads || seen.checkpoint == checkpoint_ || seen.checkpoint.empty()) return;
  has_newer_ = true;
  if (session_->state() == Session::State::kEnded && monotonic_s() > retry_s_) start_game();
}

/// The first game did not start, and not because its checkpoint was pruned meanwhile: the next one is tried then.
bool LivePage::has_failed() const {
  if (session_->state() != Session::State::kEnded || has_played_) return false;
  return !options_.reloads || std::filesystem::exists(checkpoint_);
}

Status LivePage::serve() {
  COMRAD_TRY(open());
  end_on_signals();
  start_game();
  print_addresses();
  while (has_ended == 0) {
    server_->wait(kTurnS);
    turn();
    if (has_failed()) return Error{ErrorCode::kBadInput, session_->last_words()};
  }
  return {};
}

}  // namespace

Status serve_live_page(const LivePageOptions& options) {
  LivePage page(options);
  return page.serve();
}

}  // namespace comrad::deploy
