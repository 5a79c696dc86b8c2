#include "deploy/process/http_server.h"

#include <arpa/inet.h>
#include <sys/random.h>
#include <unistd.h>

#include <algorithm>
#include <boost/asio/executor_work_guard.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/posix/stream_descriptor.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/http.hpp>
#include <boost/beast/websocket.hpp>
#include <chrono>
#include <deque>
#include <map>
#include <optional>
#include <sstream>
#include <utility>

#include "deploy/process/reply_server.h"
#include "rollout_buffer/core/text.h"

namespace comrad::deploy {
namespace {

namespace asio = boost::asio;
namespace beast = boost::beast;
namespace http = beast::http;
namespace websocket = beast::websocket;
using Code = beast::error_code;
using Parser = http::request_parser<http::string_body>;
using Request = http::request<http::string_body>;
using Response = http::response<http::string_body>;
using Clock = std::chrono::steady_clock;

constexpr int kHandlersPerTick = 1000;  // so that no number of clients keeps a run's supervisor

std::string_view view_of(beast::string_view text) { return {text.data(), text.size()}; }

Clock::duration duration_of(double seconds) {
  return std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(seconds));
}

/// A host without its port.
std::string_view name_of(std::string_view host) {
  const std::size_t end = host.starts_with('[') ? host.find(']') + 1 : host.find(':');
  return host.substr(0, std::min(end, host.size()));
}

bool is_address(const std::string& name) {
  in_addr address{};
  return inet_pton(AF_INET, name.c_str(), &address) == 1;
}

/// Whether a browser that sends this Host was sent here by an address and not by a name, which may be a foreign page's.
bool names_this_server(std::string_view host, const HttpRules& rules) {
  const std::string name(name_of(host));
  if (same_ignoring_case(name, "localhost") || name == "127.0.0.1" || name == "[::1]") return true;
  return !rules.address.empty() && (rules.address == "0.0.0.0" ? is_address(name) : name == rules.address);
}

/// The same time for all words of one length.
bool is_same_word(std::string_view left, std::string_view right) {
  if (left.size() != right.size()) return false;
  unsigned difference = 0;
  for (std::size_t i = 0; i < left.size(); ++i)
    difference |= static_cast<unsigned char>(left[i]) ^ static_cast<unsigned char>(right[i]);
  return difference == 0;
}

HttpReply words(unsigned status, const std::string& text) { return {.status = status, .body = text + "\n"}; }

HttpRequest readable(const Request& request) {
  const std::string_view target = view_of(request.target());
  const std::size_t path_end = std::min(target.find('?'), target.size());
  return {.method = std::string(view_of(request.method_string())),
          .path = std::string(target.substr(0, path_end)),
          .query = std::string(target.substr(std::min(path_end + 1, target.size()))),
          .body = request.body()};
}

/// Why a request is not answered, whatever its path.
std::optional<HttpReply> refusal_of(const Request& request, const HttpRequest& read, const HttpRules& rules) {
  std::string_view host;
  const auto hosts = request.equal_range(http::field::host);
  for (auto field = hosts.first; field != hosts.second; ++field) {
    host = view_of(field->value());
    if (!names_this_server(host, rules)) return words(403, "request 127.0.0.1 or localhost");
  }
  const auto origins = request.equal_range(http::field::origin);
  for (auto field = origins.first; field != origins.second; ++field)
    if (view_of(field->value()) != "http://" + std::string(host))
      return words(403, "the request comes from a page of another origin; open the printed address instead");
  const std::string token = read.value("token");
  const auto is_right = [&](const std::string& one) { return is_same_word(token, one); };
  if (!rules.tokens.empty() && std::ranges::none_of(rules.tokens, is_right))
    return words(403, "the token is missing or wrong; open the printed address, with its token");
  return std::nullopt;
}

Response response_to(const HttpReply& reply, bool with_body, unsigned version) {
  Response response(static_cast<http::status>(reply.status), version);
  response.set(http::field::content_type, reply.type);
  response.set(http::field::connection, "close");
  response.set(http::field::cache_control, "no-store");
  response.set("X-Content-Type-Options", "nosniff");
  response.set("X-Frame-Options", "DENY");
  response.set("Referrer-Policy", "no-referrer");  // the token is in the address
  if (reply.type.starts_with("text/html"))
    response.set("Content-Security-Policy",
                 "default-src 'none'; style-src 'unsafe-inline'; script-src 'unsafe-inline'; img-src blob: "
                 "data:; connect-src 'self'; base-uri 'none'; form-action 'none'");
  response.content_length(reply.body.size());
  if (with_body) response.body() = reply.body;
  return response;
}

Response response_to(const Request& request, const HttpRules& rules) {
  const HttpRequest read = readable(request);
  const std::optional<HttpReply> refusal = refusal_of(request, read, rules);
  return response_to(refusal ? *refusal : rules.answer(read), request.method() != http::verb::head,
                     request.version() == 10 ? 10 : 11);
}

/// What is sent for bytes that cannot be read; none where the other end has left or is too slow.
std::optional<Response> response_to(const Code& fault) {
  if (fault == http::error::header_limit)
    return response_to(words(431, "the request's headers are too long"), true, 11);
  if (fault == http::error::body_limit)
    return response_to(words(413, "the request's body is too long"), true, 11);
  if (fault == http::error::end_of_stream ||
      fault.category() != make_error_code(http::error::bad_method).category())
    return std::nullopt;
  return response_to(words(400, "this is no HTTP request"), true, 11);
}

void limit(Parser& parser, const HttpLimits& limits) {
  parser.header_limit(static_cast<std::uint32_t>(limits.head_bytes));
  parser.body_limit(limits.body_bytes);
}

}  // namespace

std::string HttpRequest::value(std::string_view name) const {
  const auto digit = [](char letter) {
    const char lower = lower_case(letter);
    return lower >= '0' && lower <= '9' ? lower - '0' : lower >= 'a' && lower <= 'f' ? lower - 'a' + 10 : -1;
  };
  for (std::size_t at = 0; at < query.size();) {
    const std::size_t end = std::min(query.find('&', at), query.size());
    const std::string_view item = std::string_view(query).substr(at, end - at);
    at = end + 1;
    if (!item.starts_with(name) || item.size() <= name.size() || item[name.size()] != '=') continue;
    std::string value;
    for (std::size_t i = name.size() + 1; i < item.size(); ++i) {
      const bool is_coded =
          item[i] == '%' && i + 2 < item.size() && digit(item[i + 1]) >= 0 && digit(item[i + 2]) >= 0;
      value += is_coded ? static_cast<char>(digit(item[i + 1]) * 16 + digit(item[i + 2])) : item[i];
      if (is_coded) i += 2;
    }
    return value;
  }
  return "";
}

std::string http_answer(std::string_view bytes, const HttpRules& rules, const HttpLimits& limits) {
  Parser parser;
  limit(parser, limits);
  parser.eager(true);
  Code fault;
  std::size_t used = 0;
  while (!fault && !parser.is_done() && used < bytes.size()) {
    const std::size_t more = parser.put(asio::buffer(bytes.data() + used, bytes.size() - used), fault);
    used += more;
    if (more == 0) break;
  }
  if (!fault && !parser.is_done()) fault = http::error::partial_message;
  if (fault == http::error::need_more) fault = http::error::partial_message;
  std::ostringstream text;
  text << (fault ? response_to(fault).value_or(response_to(words(400, "this is no HTTP request"), true, 11))
                 : response_to(parser.get(), rules));
  return text.str();
}

std::string make_token() {
  unsigned char bytes[16] = {};
  (void)!getrandom(bytes, sizeof bytes, 0);
  std::string token;
  for (const unsigned char byte : bytes) {
    constexpr const char* kDigits = "0123456789abcdef";
    token += kDigits[byte >> 4];
    token += kDigits[byte & 15];
  }
  return token;
}

namespace {

class Connection;

/// What all connections share, and outlives them.
struct Shared {
  HttpRules rules;
  HttpLimits limits;
  std::size_t connections = 0;
  SocketId last_socket = 0;
  std::map<SocketId, std::weak_ptr<Connection>> sockets = {};
};

/// One client, from its first byte to its last: a request and its answer, or a WebSocket.
class Connection : public std::enable_shared_from_this<Connection> {
 public:
  Connection(asio::ip::tcp::socket socket, std::shared_ptr<Shared> shared)
      : shared_(std::move(shared)), stream_(std::move(socket)) {
    ++shared_->connections;
  }
  Connection(const Connection&) = delete;
  Connection& operator=(const Connection&) = delete;
  ~Connection() { --shared_->connections; }

  void start() {
    stream_.expires_after(duration_of(shared_->limits.seconds));
    limit(parser_, shared_->limits);
    http::async_read(stream_, buffer_, parser_,
                     [self = shared_from_this()](Code fault, std::size_t) { self->asked(fault); });
  }

  void send(std::shared_ptr<const std::string> message, HttpServer::Kind kind) {
    if (is_over_) return;
    if (kind != HttpServer::Kind::kText && queued_bytes_ > shared_->limits.picture_bytes) return;
    queued_bytes_ += message->size();
    queue_.emplace_back(std::move(message), kind == HttpServer::Kind::kPicture);
    if (queued_bytes_ > shared_->limits.queue_bytes) return end();
    if (queue_.size() == 1) write();
  }

  void end() {
    if (std::exchange(is_over_, true)) return;
    Code ignored;
    (socket_ ? beast::get_lowest_layer(*socket_) : stream_).socket().close(ignored);
    shared_->sockets.erase(id_);
    if (shared_->rules.closed) shared_->rules.closed(id_);
  }

 private:
  void asked(Code fault) {
    if (fault) {
      if (std::optional<Response> response = response_to(fault)) return answer(std::move(*response));
      return;
    }
    if (!websocket::is_upgrade(parser_.get())) return answer(response_to(parser_.get(), shared_->rules));
    const HttpRequest read = readable(parser_.get());
    std::optional<HttpReply> refusal = refusal_of(parser_.get(), read, shared_->rules);
    if (!refusal && !shared_->rules.open) refusal = words(404, "no WebSocket is served here");
    if (refusal) return answer(response_to(*refusal, true, 11));
    id_ = ++shared_->last_socket;
    shared_->sockets[id_] = weak_from_this();
    is_writing_ = true;  // what is sent before the handshake waits for its end
    const HttpReply opened = shared_->rules.open(id_, read);
    if (opened.status == 200) return accept();
    shared_->sockets.erase(id_);
    answer(response_to(opened, true, 11));
  }

  void answer(Response response) {
    response_ = std::move(response);
    http::async_write(stream_, response_, [self = shared_from_this()](Code fault, std::size_t) {
      if (!fault) self->await_end();
    });
  }
  /// The client ends the connection: if we did, what it still sends would cut our answer off.
  void await_end() {
    Code ignored;
    stream_.socket().shutdown(asio::ip::tcp::socket::shutdown_send, ignored);
    buffer_.clear();
    discard();
  }
  void discard() {
    stream_.async_read_some(asio::buffer(rest_), [self = shared_from_this()](Code fault, std::size_t) {
      if (!fault) self->discard();
    });
  }

  void accept() {
    stream_.expires_never();
    socket_.emplace(std::move(stream_));
    websocket::stream_base::timeout timeout;
    timeout.handshake_timeout = duration_of(shared_->limits.seconds);
    timeout.idle_timeout = duration_of(shared_->limits.silent_s);
    timeout.keep_alive_pings = true;
    socket_->set_option(timeout);
    socket_->read_message_max(shared_->limits.body_bytes);
    socket_->async_accept(parser_.get(), [self = shared_from_this()](Code fault) {
      self->is_writing_ = false;
      if (fault) return self->end();
      self->read();
      self->write();
    });
  }
  void read() {
    socket_->async_read(buffer_,
                        [self = shared_from_this()](Code fault, std::size_t) { self->heard(fault); });
  }
  void heard(Code fault) {
    if (is_over_) return;
    if (fault || !may_speak()) return end();
    const std::string message = beast::buffers_to_string(buffer_.data());
    buffer_.clear();
    if (socket_->got_text() && shared_->rules.heard) shared_->rules.heard(id_, message);
    if (!is_over_) read();
  }
  bool may_speak() {
    const Clock::time_point now = Clock::now();
    if (now - second_ >= std::chrono::seconds(1)) second_ = now, messages_ = 0;
    return ++messages_ <= shared_->limits.messages_per_s;
  }
  void write() {
    if (is_writing_ || is_over_ || queue_.empty()) return;
    is_writing_ = true;
    socket_->binary(queue_.front().second);
    socket_->async_write(asio::buffer(*queue_.front().first),
                         [self = shared_from_this()](Code fault, std::size_t) {
                           self->is_writing_ = false;
                           self->queued_bytes_ -= self->queue_.front().first->size();
                           self->queue_.pop_front();
                           if (fault) return self->end();
                           self->write();
                         });
  }

  const std::shared_ptr<Shared> shared_;
  beast::tcp_stream stream_;  // until it becomes a WebSocket
  beast::flat_buffer buffer_;
  Parser parser_;
  Response response_;
  char rest_[1024] = {};
  // As a WebSocket.
  SocketId id_ = 0;
  std::optional<websocket::stream<beast::tcp_stream>> socket_;
  std::deque<std::pair<std::shared_ptr<const std::string>, bool>> queue_;  // message, whether it is a picture
  std::size_t queued_bytes_ = 0;
  bool is_writing_ = false, is_over_ = false;
  Clock::time_point second_{};
  int messages_ = 0;
};

/// A foreign descriptor that is waited for.
struct Listened {
  asio::posix::stream_descriptor descriptor;
  std::function<void()> readable;
};

void await(const std::shared_ptr<Listened>& one) {
  one->descriptor.async_wait(asio::posix::stream_descriptor::wait_read, [one](Code fault) {
    if (fault || !one->descriptor.is_open()) return;
    one->readable();
    if (one->descriptor.is_open()) await(one);
  });
}

}  // namespace

struct HttpServer::State {
  State(HttpRules rules, const HttpLimits& limits)
      : shared(std::make_shared<Shared>(Shared{.rules = std::move(rules), .limits = limits})),
        acceptor(context) {}
  ~State() {
    for (auto& [number, one] : descriptors) one->descriptor.release();
  }

  void accept() {
    if (is_accepting || shared->connections >= shared->limits.connections || Clock::now() < resume_at) return;
    is_accepting = true;
    acceptor.async_accept([this](Code fault, asio::ip::tcp::socket socket) {
      is_accepting = false;
      if (fault) {  // out of descriptors
        resume_at = Clock::now() + std::chrono::milliseconds(100);
        return;
      }
      Code ignored;
      socket.set_option(asio::ip::tcp::no_delay(true), ignored);
      std::make_shared<Connection>(std::move(socket), shared)->start();
    });
  }

  asio::io_context context{1};  // outlives what uses it
  asio::executor_work_guard<asio::io_context::executor_type> has_work = asio::make_work_guard(context);
  std::shared_ptr<Shared> shared;
  asio::ip::tcp::acceptor acceptor;
  bool is_accepting = false;
  Clock::time_point resume_at{};
  std::map<int, std::shared_ptr<Listened>> descriptors;
};

HttpServer::HttpServer(std::unique_ptr<State> state) : state_(std::move(state)) {}
HttpServer::HttpServer(HttpServer&&) noexcept = default;
HttpServer& HttpServer::operator=(HttpServer&&) noexcept = default;
HttpServer::~HttpServer() = default;

Expected<HttpServer> HttpServer::open(const std::string& address, int port, HttpRules rules,
                                      const HttpLimits& limits) {
  COMRAD_TRY_ASSIGN(Descriptor listener, listen_on_address(address, port));
  if (address != "127.0.0.1") rules.address = address;
  auto state = std::make_unique<State>(std::move(rules), limits);
  Code fault;
  state->acceptor.assign(asio::ip::tcp::v4(), dup(listener.get()), fault);
  if (fault) return Error{ErrorCode::kSystem, address + ": " + fault.message()};
  HttpServer server(std::move(state));
  server.tick();
  return server;
}

int HttpServer::port() const {
  Code fault;
  const asio::ip::tcp::endpoint endpoint = state_->acceptor.local_endpoint(fault);
  return fault ? 0 : endpoint.port();
}

void HttpServer::tick() {
  state_->context.restart();
  state_->accept();
  for (int handlers = 0; handlers < kHandlersPerTick && state_->context.poll_one() > 0; ++handlers)
    state_->accept();
}

void HttpServer::wait(double seconds) {
  const Clock::time_point end = Clock::now() + duration_of(seconds);
  state_->context.restart();
  state_->accept();
  while (Clock::now() < end && state_->context.run_one_until(end) > 0) state_->accept();
}

void HttpServer::listen_to(int descriptor, std::function<void()> readable) {
  forget(descriptor);
  auto one = std::make_shared<Listened>(
      Listened{asio::posix::stream_descriptor(state_->context, descriptor), std::move(readable)});
  state_->descriptors[descriptor] = one;
  await(one);
}

void HttpServer::forget(int descriptor) {
  const auto found = state_->descriptors.find(descriptor);
  if (found == state_->descriptors.end()) return;
  const std::shared_ptr<Listened> one = found->second;
  one->descriptor.release();  // its owner closes it
  state_->descriptors.erase(found);
}

void HttpServer::send(SocketId socket, std::shared_ptr<const std::string> message, Kind kind) {
  const auto found = state_->shared->sockets.find(socket);
  if (found == state_->shared->sockets.end()) return;
  if (const std::shared_ptr<Connection> connection = found->second.lock())
    connection->send(std::move(message), kind);
}

void HttpServer::close(SocketId socket) {
  const auto found = state_->shared->sockets.find(socket);
  if (found == state_->shared->sockets.end()) return;
  if (const std::shared_ptr<Connection> connection = found->second.lock()) connection->end();
}

}  // namespace comrad::deploy
