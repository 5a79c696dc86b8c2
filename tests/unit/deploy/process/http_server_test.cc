#include "deploy/process/http_server.h"

#include <arpa/inet.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <chrono>
#include <vector>

namespace comrad::deploy {
namespace http_server_test {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::Not;
using ::testing::StartsWith;

constexpr const char* kUpgrade =
    "Host: 127.0.0.1\r\nUpgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
    "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n";

HttpRules page_rules(const std::string& token = "") {
  return {.tokens = token.empty() ? std::vector<std::string>() : std::vector<std::string>{"other", token},
          .answer = [](const HttpRequest& request) -> HttpReply {
            return {.type = "text/html; charset=utf-8", .body = "page " + request.path};
          }};
}

TEST(HttpAnswer, GivesThePageToThisMachineAlone) {
  const auto answer = [](const std::string& request) { return http_answer(request, page_rules()); };
  EXPECT_THAT(answer("GET /a HTTP/1.1\r\nHost: 127.0.0.1:9400\r\n\r\n"), StartsWith("HTTP/1.1 200 OK\r\n"));
  EXPECT_THAT(answer("GET /a HTTP/1.1\r\nHost: localhost\r\n\r\n"), HasSubstr("Content-Length: 7\r\n"));
  EXPECT_TRUE(answer("GET /a?x=1 HTTP/1.0\r\n\r\n").ends_with("\r\n\r\npage /a"));
  EXPECT_TRUE(answer("HEAD /a HTTP/1.1\r\nhost: [::1]:9400\r\n\r\n").ends_with("\r\n\r\n"));
  EXPECT_THAT(answer("GET /a HTTP/1.1\r\nHost: localhost\r\n\r\n"),
              HasSubstr("Content-Security-Policy: default-src 'none'"));
  for (const char* host :
       {"evil.example:9400", "127.0.0.1.evil.example", "10.0.0.1", "", "[", "localhost.:1"})
    EXPECT_THAT(answer("GET /a HTTP/1.1\r\nHost: " + std::string(host) + "\r\n\r\n"),
                StartsWith("HTTP/1.1 403 "))
        << host;
  EXPECT_THAT(answer("GET /a HTTP/1.1\r\nHost: localhost\r\nHost: evil.example\r\n\r\n"),
              StartsWith("HTTP/1.1 403 "));
  for (const char* request :
       {"", "\r\n\r\n", "GET", "GET /a", "\x16\x03\x01", "GET /a FTP\n\n", "GET /a HTTP/1.1\r\nHost"})
    EXPECT_THAT(answer(request), StartsWith("HTTP/1.1 400 ")) << request;
  EXPECT_THAT(answer("GET /" + std::string(9000, 'a') + " HTTP/1.1\r\n\r\n"), StartsWith("HTTP/1.1 431 "));
  EXPECT_THAT(answer("POST /a HTTP/1.1\r\nContent-Length: 5000\r\n\r\n"), StartsWith("HTTP/1.1 413 "));
}

TEST(HttpAnswer, RefusesPagesOfOtherOriginsAndRequestsWithoutTheToken) {
  const auto answer = [](const std::string& target, const std::string& headers = "") {
    return http_answer("GET " + target + " HTTP/1.1\r\nHost: 127.0.0.1:80\r\n" + headers + "\r\n",
                       page_rules("secret"));
  };
  EXPECT_THAT(answer("/?token=secret"), StartsWith("HTTP/1.1 200 "));
  EXPECT_THAT(answer("/?a=b&token=s%65cret"), StartsWith("HTTP/1.1 200 "));
  EXPECT_THAT(answer("/?token=secret", "Origin: http://127.0.0.1:80\r\n"), StartsWith("HTTP/1.1 200 "));
  for (const char* target : {"/", "/?token=", "/?token=secre", "/?token=secretx", "/?nottoken=secret",
                             "/?token=%zz", "/token=secret"})
    EXPECT_THAT(answer(target), StartsWith("HTTP/1.1 403 ")) << target;
  for (const char* origin :
       {"http://127.0.0.1:81", "https://127.0.0.1:80", "http://evil.example", "null", ""})
    EXPECT_THAT(answer("/?token=secret", "Origin: " + std::string(origin) + "\r\n"),
                StartsWith("HTTP/1.1 403 "))
        << origin;
}

TEST(MakeToken, NeverGivesTheSameTwice) {
  EXPECT_EQ(make_token().size(), 32u);
  EXPECT_NE(make_token(), make_token());
}

/// A server and clients in one thread.
class HttpServerTest : public ::testing::Test {
 protected:
  void serve(HttpRules rules, const HttpLimits& limits = {}) {
    Expected<HttpServer> opened = HttpServer::open("127.0.0.1", 0, std::move(rules), limits);
    ASSERT_TRUE(opened) << opened.error().message;
    server_.emplace(std::move(opened).value());
  }
  Descriptor client() const {
    Descriptor client(socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0));
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_port = htons(static_cast<uint16_t>(server_->port()));
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    EXPECT_EQ(connect(client.get(), reinterpret_cast<const sockaddr*>(&address), sizeof address), 0);
    return client;
  }
  static void say(const Descriptor& client, const std::string& text) {
    ASSERT_EQ(::send(client.get(), text.data(), text.size(), MSG_NOSIGNAL),
              static_cast<ssize_t>(text.size()));
  }
  /// Serves until the client has heard `words`, or is left, or ten seconds are over; what it heard.
  std::string heard(const Descriptor& client, const std::string& words = "") {
    std::string text;
    for (int turn = 0; turn < 1000; ++turn) {
      char bytes[65536];
      for (;;) {
        const ssize_t size = recv(client.get(), bytes, sizeof bytes, MSG_DONTWAIT);
        if (size == 0 || (size < 0 && errno != EAGAIN)) return text + "<end>";
        if (size < 0) break;
        text.append(bytes, static_cast<std::size_t>(size));
      }
      if (!words.empty() && text.find(words) != std::string::npos) return text;
      server_->wait(0.01);
    }
    return text;
  }
  /// A text message of at most 125 bytes as a browser sends it, with the mask 0.
  static std::string framed(const std::string& text) {
    return std::string{'\x81', static_cast<char>(0x80 | text.size()), 0, 0, 0, 0} + text;
  }
  HttpRules talk_rules() {
    HttpRules rules = page_rules("t");
    rules.open = [this](SocketId id, const HttpRequest& request) -> HttpReply {
      if (request.path != "/talk") return {.status = 404, .body = "no such talk\n"};
      server_->send(id, std::make_shared<std::string>("welcome"), HttpServer::Kind::kText);
      opened_.push_back(id);
      return {};
    };
    rules.heard = [this](SocketId, std::string_view message) { messages_.emplace_back(message); };
    rules.closed = [this](SocketId id) { closed_.push_back(id); };
    return rules;
  }
  Descriptor talk() {
    Descriptor browser = client();
    say(browser, "GET /talk?token=t HTTP/1.1\r\n" + std::string(kUpgrade) + "\r\n");
    EXPECT_THAT(heard(browser, "welcome"), StartsWith("HTTP/1.1 101 "));
    return browser;
  }

  std::optional<HttpServer> server_;
  std::vector<SocketId> opened_, closed_;
  std::vector<std::string> messages_;
};

TEST_F(HttpServerTest, AnswersARequestHoweverItComes) {
  serve(page_rules());
  const Descriptor one = client(), two = client();
  say(two, "GET /two HT");
  say(one, "GET /one HTTP/1.1\r\n\r\n");
  EXPECT_TRUE(heard(one).ends_with("page /one<end>"));
  say(two, "TP/1.1\r\n\r\n");
  EXPECT_TRUE(heard(two).ends_with("page /two<end>"));
}

TEST_F(HttpServerTest, DropsASilentClientAndServesTheNextOnes) {
  serve(page_rules(), {.connections = 4, .seconds = 0.2});
  std::vector<Descriptor> silent;
  for (int count = 0; count < 20; ++count) silent.push_back(client());
  const Descriptor asking = client();
  say(asking, "GET /me HTTP/1.1\r\n\r\n");
  EXPECT_THAT(heard(asking, "page"), HasSubstr("page /me"));
  EXPECT_EQ(heard(silent.front()), "<end>");
}

TEST_F(HttpServerTest, AClientThatDoesNotReadBlocksNoOther) {
  HttpRules rules = page_rules();
  rules.answer = [](const HttpRequest& request) -> HttpReply {
    return {.body = std::string(request.path == "/much" ? 64u << 20 : 1, 'x')};
  };
  serve(std::move(rules), {.seconds = 0.5});
  const Descriptor deaf = client(), other = client();
  say(deaf, "GET /much HTTP/1.1\r\n\r\n");
  say(other, "GET /little HTTP/1.1\r\n\r\n");
  EXPECT_TRUE(heard(other).ends_with("x<end>"));
  server_->wait(0.6);
  EXPECT_LT(heard(deaf).size(), 64u << 20) << "dropped before it read all";
}

TEST_F(HttpServerTest, TalksWithABrowser) {
  serve(talk_rules());
  const Descriptor browser = talk();
  ASSERT_EQ(opened_.size(), 1u);
  say(browser, framed("left"));
  server_->send(opened_[0], std::make_shared<std::string>("ouch"), HttpServer::Kind::kText);
  heard(browser, "ouch");
  for (int turn = 0; turn < 1000 && messages_.empty(); ++turn) server_->wait(0.01);
  EXPECT_THAT(messages_, ElementsAre("left"));
  server_->close(opened_[0]);
  EXPECT_THAT(heard(browser), testing::EndsWith("<end>"));
  EXPECT_EQ(closed_, opened_);
  server_->send(opened_[0], std::make_shared<std::string>("gone"), HttpServer::Kind::kText);
}

TEST_F(HttpServerTest, OpensNoWebSocketForUnknownPeers) {
  serve(talk_rules());
  for (const std::string& request :
       {std::string("GET /talk HTTP/1.1\r\n") + kUpgrade,
        std::string("GET /other?token=t HTTP/1.1\r\n") + kUpgrade,
        std::string("GET /talk?token=t HTTP/1.1\r\n") + kUpgrade + "Origin: http://evil.example\r\n"}) {
    const Descriptor unknown = client();
    say(unknown, request + "\r\n");
    EXPECT_THAT(heard(unknown), StartsWith("HTTP/1.1 40")) << request;
  }
  EXPECT_THAT(opened_, ElementsAre());
}

TEST_F(HttpServerTest, EndsTalksThatSayTooMuchTooOftenOrNonsense) {
  serve(talk_rules(), {.body_bytes = 100, .messages_per_s = 5});
  Descriptor chatty = talk(), loud = talk(), broken = talk();
  for (int count = 0; count < 20; ++count) say(chatty, framed("again"));
  say(loud, framed(std::string(101, 'x')));
  say(broken, std::string(20, '\xff'));
  for (Descriptor* one : {&chatty, &loud, &broken}) {
    EXPECT_THAT(heard(*one), testing::EndsWith("<end>"));
    one->close();
  }
  for (int turn = 0; turn < 1000 && closed_.size() < 3; ++turn) server_->wait(0.01);
  EXPECT_EQ(closed_.size(), 3u);
  EXPECT_LE(messages_.size(), 5u);
}

TEST_F(HttpServerTest, ATalkThatDoesNotReadLosesPicturesAndThenEnds) {
  serve(talk_rules(), {.silent_s = 0.5, .picture_bytes = 1 << 20});
  const Descriptor deaf = talk();
  const auto picture = std::make_shared<std::string>(1 << 18, 'p');
  for (int count = 0; count < 100; ++count) {
    server_->send(opened_[0], picture, HttpServer::Kind::kPicture);
    server_->tick();
  }
  for (int turn = 0; turn < 500 && closed_.empty(); ++turn) server_->wait(0.01);
  EXPECT_EQ(closed_, opened_) << "it gave no sign of life";
  const std::string text = heard(deaf);
  EXPECT_LT(text.size(), 100u << 18);
}

TEST_F(HttpServerTest, ATalkWithTooMuchWaitingEnds) {
  serve(talk_rules(), {.queue_bytes = 1 << 20});
  const Descriptor deaf = talk();
  const auto words = std::make_shared<std::string>(1 << 18, 'w');
  for (int count = 0; count < 100 && closed_.empty(); ++count) {
    server_->send(opened_[0], words, HttpServer::Kind::kText);
    server_->tick();
  }
  EXPECT_EQ(closed_, opened_);
}

TEST_F(HttpServerTest, ListensToOtherDescriptorsUntilRemoved) {
  serve(page_rules());
  Expected<Pipe> pipe = Pipe::open();
  ASSERT_TRUE(pipe);
  int calls = 0;
  server_->listen_to(pipe->read_end.get(), [&] {
    char byte = 0;
    calls += static_cast<int>(read(pipe->read_end.get(), &byte, 1));
    if (byte == 'q') server_->forget(pipe->read_end.get());
  });
  ASSERT_EQ(write(pipe->write_end.get(), "abq!", 4), 4);
  for (int turn = 0; turn < 10; ++turn) server_->wait(0.01);
  EXPECT_EQ(calls, 3);
}

TEST_F(HttpServerTest, ATakenPortAndAForeignAddressAreNamed) {
  serve(page_rules());
  const Expected<HttpServer> taken = HttpServer::open("127.0.0.1", server_->port(), page_rules());
  ASSERT_FALSE(taken);
  EXPECT_THAT(taken.error().message, HasSubstr("is taken by another process"));
  const Expected<HttpServer> foreign = HttpServer::open("192.0.2.7", 0, page_rules());
  ASSERT_FALSE(foreign);
  EXPECT_THAT(foreign.error().message, HasSubstr("is no address of this machine"));
}

}  // namespace http_server_test
}  // namespace comrad::deploy
