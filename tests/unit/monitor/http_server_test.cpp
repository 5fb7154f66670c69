#include <arpa/inet.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <atomic>
#include <catch2/catch.hpp>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include <fmt/format.h>

#include "server/monitor/http_client.h"
#include "server/monitor/http_server.h"

namespace http_server_test {

namespace {

using namespace rustle::monitor;
using std::chrono::milliseconds;

HttpServer::Response text(std::string body, int status = 200) {
  return [body = std::move(body), status] { return HttpResponse{status, "text/plain", body}; };
}

/// Answers that a test gives when it likes.
class Held {
 public:
  HttpServer::Route route() {
    return {[this](const HttpRequest&, HttpServer::Answer answer) {
      std::lock_guard lock(mutex_);
      answers_.push_back(std::move(answer));
    }};
  }
  /// Waits for the n-th request.
  HttpServer::Answer at(std::size_t n) {
    for (int round = 0; round < 2000; ++round) {
      {
        std::lock_guard lock(mutex_);
        if (answers_.size() > n) return answers_[n];
      }
      std::this_thread::sleep_for(milliseconds(5));
    }
    FAIL("the request does not come");
    return {};
  }

 private:
  std::mutex mutex_;
  std::vector<HttpServer::Answer> answers_;
};

std::unique_ptr<HttpServer> serve(HttpServer::Options options = {}, std::map<std::string, HttpServer::Route> more = {}) {
  std::map<std::string, HttpServer::Route> routes = std::move(more);
  routes["/hello"] = {[](const HttpRequest& request, const HttpServer::Answer& answer) {
    const auto name = request.query.find("name");
    answer(text("hello " + (name == request.query.end() ? "you" : name->second)));
  }};
  routes["/long"] = {[](const HttpRequest&, const HttpServer::Answer& answer) { answer(text(std::string(32 << 20, 'x'))); }};
  auto server = HttpServer::open({"127.0.0.1", 0}, {std::move(routes)}, options);
  REQUIRE(server);
  return std::move(*server);
}

/// A client that says what it likes.
class Client {
 public:
  explicit Client(const HttpServer& server) : socket_(::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0)) {
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_port = htons(server.address().port);
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    REQUIRE(::connect(socket_, static_cast<const sockaddr*>(static_cast<const void*>(&address)), sizeof address) == 0);
  }
  ~Client() { ::close(socket_); }

  void say(const std::string& bytes) { static_cast<void>(::send(socket_, bytes.data(), bytes.size(), MSG_NOSIGNAL)); }
  /// Reads until `enough` has come, the server has hung up, or nothing comes for ten seconds.
  std::string hear(const std::function<bool(const std::string& heard)>& enough = {}) {
    while (!enough || !enough(heard_)) {
      pollfd ready{socket_, POLLIN, 0};
      if (::poll(&ready, 1, 10'000) <= 0) FAIL("the server neither answers nor hangs up; heard so far: " << heard_);
      char bytes[65536];
      const ssize_t size = ::recv(socket_, bytes, sizeof bytes, 0);
      if (size <= 0) {
        hung_up = true;
        break;
      }
      heard_.append(bytes, static_cast<std::size_t>(size));
    }
    return heard_;
  }
  bool hung_up = false;

 private:
  int socket_;
  std::string heard_;
};

std::size_t count(const std::string& text, const std::string& part) {
  std::size_t found = 0;
  for (auto at = text.find(part); at != std::string::npos; at = text.find(part, at + 1)) ++found;
  return found;
}

std::string get(const std::string& target, const std::string& more = "") {
  return "GET " + target + " HTTP/1.1\r\nHost: here\r\n" + more + "\r\n";
}
const std::string kLast = "Connection: close\r\n";

void check_alive(const HttpServer& server) {
  const auto reply = http_get(server.address(), "/hello", milliseconds(10'000));
  REQUIRE(reply);
  CHECK(reply->status == 200);
  CHECK(reply->body == "hello you");
}

TEST_CASE("What was asked is answered by its status; where nobody answers is an error") {
  const auto server = serve();
  const auto posted = http_ask(server->address(), {.verb = "POST", .target = "/hello", .json = "{}"}, milliseconds(10'000));
  REQUIRE(posted);
  CHECK(posted->status / 100 == 4);
  CHECK(http_ask(server->address(), {.target = "/hello"}, milliseconds(10'000))->body == "hello you");
  CHECK_FALSE(http_ask({"127.0.0.1", 1}, {.target = "/hello"}, milliseconds(10'000)));
}

TEST_CASE("A path is answered, its query decoded; HEAD gets the same header and no body") {
  const auto server = serve();
  Client client(*server);
  client.say(get("/hello?name=a%20b%2fc+d", kLast));
  const std::string heard = client.hear();
  CHECK(heard.starts_with("HTTP/1.1 200"));
  CHECK(heard.ends_with("\r\n\r\nhello a b/c d"));
  CHECK(client.hung_up);
  Client head(*server);
  head.say("HEAD /hello?name=a%20b%2fc+d HTTP/1.1\r\nHost: here\r\n" + kLast + "\r\n");
  CHECK(head.hear() + "hello a b/c d" == heard);
  CHECK(http_get(server->address(), "/hello?name=" + in_query("ä&=%+ /"), milliseconds(10'000))->body == "hello ä&=%+ /");
}

TEST_CASE("What is no request costs the one who sent it the connection, and nobody else anything") {
  const auto server = serve();
  const auto [bytes, status] = GENERATE(table<std::string, const char*>({
      {"HELLO\r\n\r\n", "400"},
      {"GET\r\n\r\n", "400"},
      {std::string("\0\xff\x16\x03\x01\r\n\r\n", 9), "400"},
      {"GET /hello HTTP/9.9\r\n\r\n", "400"},
      {"GET /hello HTTP/1.1\r\nno colon\r\n\r\n", "400"},
      {get("hello"), "400"},
      {get("/hello?name=%zz"), "400"},
      {get("/hello?name=%4"), "400"},
      {get("/%"), "400"},
      {get("/nowhere"), "404"},
      {"POST /hello HTTP/1.1\r\nHost: here\r\nContent-Length: 0\r\n\r\n", "405"},
      {"POST /hello HTTP/1.1\r\nHost: here\r\nContent-Length: 5\r\n\r\nhello", "413"},
      {fmt::format("GET /hello HTTP/1.1\r\nX: {:x<10000}\r\n\r\n", ""), "431"},
      {get(fmt::format("/{:x<10000}", "")), "431"},
      {"GET /" + std::string(100'000, 'x'), "431"},
  }));
  Client client(*server);
  client.say(bytes);
  const std::string heard =
      client.hear([](const std::string& so_far) { return so_far.find("\r\n\r\n") != std::string::npos; });
  INFO(heard);
  CHECK(heard.starts_with(std::string("HTTP/1.1 ") + status));
  if (std::string(status) == "404") {
    CHECK(heard.find("/hello") != std::string::npos);  // what there is
  } else {
    client.hear();
    CHECK(client.hung_up);
  }
  check_alive(*server);
}

TEST_CASE("Requests sent at once are answered in their order, however long the first takes") {
  Held held;
  const auto server = serve({}, {{"/held", held.route()}});
  Client client(*server);
  client.say(get("/held") + get("/hello?name=2") + get("/nowhere") + get("/hello?name=4", kLast));
  const auto answer = held.at(0);
  check_alive(*server);
  answer(text("first"));
  const std::string heard = client.hear();
  CHECK(count(heard, "HTTP/1.1 ") == 4);
  const auto first = heard.find("first"), second = heard.find("hello 2"), third = heard.find("404"),
             fourth = heard.find("hello 4");
  CHECK(first < second);
  CHECK(second < third);
  CHECK(third < fourth);
  CHECK(fourth != std::string::npos);
}

TEST_CASE("Who takes too long to ask, or to read, loses the connection") {
  HttpServer::Options options;
  options.request_within = milliseconds(100);
  options.send_within = milliseconds(100);
  const auto server = serve(options);
  Client silent(*server), slow(*server), idle(*server);
  slow.say("GET /hello HTTP/1.1\r\nHost:");
  idle.say(get("/hello"));
  CHECK(silent.hear().empty());
  CHECK(silent.hung_up);
  CHECK(slow.hear().empty());
  CHECK(slow.hung_up);
  CHECK(count(idle.hear(), "hello you") == 1);
  CHECK(idle.hung_up);
  Client reader(*server);
  reader.say(get("/long"));
  std::this_thread::sleep_for(milliseconds(400));
  const std::string heard = reader.hear();
  CHECK(reader.hung_up);
  CHECK(heard.size() < std::size_t{32} << 20);
  check_alive(*server);
}

TEST_CASE("Connections beyond the limit are turned away with a word, and there is room again when one ends") {
  HttpServer::Options options;
  options.connections = 2;
  const auto server = serve(options);
  {
    Client one(*server), two(*server);
    one.say(get("/hello"));
    two.say(get("/hello"));
    one.hear([](const std::string& heard) { return heard.ends_with("hello you"); });
    two.hear([](const std::string& heard) { return heard.ends_with("hello you"); });
    Client three(*server);
    CHECK(three.hear().starts_with("HTTP/1.1 503"));
    CHECK(three.hung_up);
    one.say(get("/hello"));
    one.hear([](const std::string& heard) { return count(heard, "hello you") == 2; });
  }
  for (int round = 0; round < 1000; ++round) {
    const auto reply = http_get(server->address(), "/hello", milliseconds(10'000));
    if (reply && reply->status == 200) break;
    std::this_thread::sleep_for(milliseconds(5));
  }
  check_alive(*server);
}

TEST_CASE("A handler that does not answer in time is answered for, and what it says later reaches nobody") {
  Held held;
  auto route = held.route();
  route.late = {503, "text/plain", "too late"};
  HttpServer::Options options;
  options.answer_within = milliseconds(50);
  const auto server = serve(options, {{"/held", route}});
  Client client(*server);
  client.say(get("/held"));
  client.hear([](const std::string& heard) { return heard.ends_with("too late"); });
  client.say(get("/held", kLast));
  const auto second = held.at(1);
  held.at(0)(text("of the first"));
  second(text("of the second"));
  const std::string heard = client.hear();
  CHECK(heard.find("of the first") == std::string::npos);
  CHECK((heard.ends_with("of the second") || count(heard, "too late") == 2));
  CHECK(count(heard, "HTTP/1.1 ") == 2);
}

TEST_CASE("A server may end while requests are open, and answers may come after its end") {
  Held held;
  HttpServer::Answer late;
  {
    const auto server = serve({}, {{"/held", held.route()}});
    Client asking(*server), reading(*server), silent(*server);
    asking.say(get("/held"));
    reading.say(get("/long"));
    late = held.at(0);
  }
  late(text("nobody is there"));
}

TEST_CASE("A port in use, an address that is none and one that others could reach are refused with the mend") {
  const auto server = serve();
  const auto again = HttpServer::open(server->address(), {}, {});
  REQUIRE_FALSE(again);
  CHECK_THAT(again.error(),
             Catch::Contains(server->address().text()) && Catch::Contains("--http") && Catch::Contains("off"));

  for (const char* wrong :
       {"", "127.0.0.1", "127.0.0.1:", "127.0.0.1:65536", "127.0.0.1:x", "nowhere:80", ":80", "[::1:80"}) {
    const auto refused = parse_http_address(wrong, "network.http");
    INFO(wrong);
    REQUIRE_FALSE(refused);
    CHECK_THAT(refused.error(), Catch::StartsWith("network.http") && Catch::Contains("write"));
  }
  for (const char* outside : {"0.0.0.0:7393", "192.168.1.2:*", "[::]:80"}) {
    const auto address = parse_http_address(outside, "network.http");
    REQUIRE(address);
    CHECK_FALSE(address->is_local());
  }
  CHECK(parse_http_address("127.0.0.9:80", "x")->is_local());
  CHECK(parse_http_address("localhost:80", "x")->text() == "127.0.0.1:80");
  CHECK(parse_http_address("[::1]:*", "x")->text() == "[::1]:0");
}

TEST_CASE("Where nobody answers, the client says so") {
  HttpAddress address;
  { address = serve()->address(); }
  const auto reply = http_get(address, "/hello", milliseconds(10'000));
  REQUIRE_FALSE(reply);
  CHECK_THAT(reply.error(), Catch::Contains(address.text()) && Catch::Contains("start rustled"));
}

}  // namespace

}  // namespace http_server_test
