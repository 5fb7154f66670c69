#include <atomic>
#include <cstdio>
#include <functional>
#include <thread>

#include <unistd.h>
#include <catch2/catch.hpp>
#include <zmq.hpp>

#include "server/wire/endpoint.h"
#include "server/wire/sockets.h"

namespace sockets_test {

using namespace rustle::wire;
using namespace std::chrono_literals;

namespace {

Sockets::Options local() {
  Sockets::Options options;
  options.control = options.stream = options.out = "tcp://127.0.0.1:*";
  return options;
}

std::string ipc_path(const std::string& name) {
  return "ipc:///tmp/rustle-test-" + std::to_string(::getpid()) + "-" + name;
}

/// Polls until `found` says so of some event; the events so far are kept.
bool wait_for(Sockets& sockets, std::vector<Event>& events, const std::function<bool(const Event&)>& found) {
  std::size_t seen = 0;
  for (int round = 0; round < 500; ++round) {
    sockets.poll(10ms, events);
    for (; seen < events.size(); ++seen)
      if (found(events[seen])) return true;
  }
  return false;
}

std::string text(const Message& message) {
  return {reinterpret_cast<const char*>(message.bytes().data()), message.bytes().size()};
}

auto subscription_to(std::string topic, bool on = true) {
  return [topic, on](const Event& event) {
    const auto* change = std::get_if<SubscriptionChanged>(&event);
    return change != nullptr && change->topic == topic && change->on == on;
  };
}

std::vector<std::string> receive(zmq::socket_t& socket) {
  std::vector<std::string> parts;
  zmq::message_t part;
  do {
    if (!socket.recv(part)) return parts;
    parts.push_back(part.to_string());
  } while (part.more());
  return parts;
}

}  // namespace

TEST_CASE("endpoints that can be bound, and those that only this machine reaches", "[wire][sockets]") {
  CHECK(check_bind_endpoint("tcp://127.0.0.1:7390", "--control") == std::string("tcp://127.0.0.1:7390"));
  CHECK(check_bind_endpoint("tcp://localhost:7390", "--control") == std::string("tcp://127.0.0.1:7390"));
  CHECK(check_bind_endpoint("tcp://127.3.2.1:*", "--control").has_value());
  CHECK(check_bind_endpoint("tcp://[::1]:7390", "--control").has_value());
  CHECK(check_bind_endpoint("ipc:///tmp/x", "--control").has_value());
  for (const char* local :
       {"tcp://127.0.0.1:7390", "tcp://localhost:*", "tcp://127.3.2.1:1", "tcp://[::1]:7390", "ipc:///x"})
    CHECK(is_local(local));
  for (const char* exposed : {"tcp://*:7390", "tcp://0.0.0.0:7390", "tcp://192.168.1.4:7390", "tcp://eth0:7390",
                              "tcp://[::]:7390", "tcp://127.0.0.1.example.org:1", "tcp://127.0.0.256:1", "tcp://127.1:1"}) {
    INFO(exposed);
    CHECK(check_bind_endpoint(exposed, "--control").has_value());
    CHECK_FALSE(is_local(exposed));
  }
  for (const char* endpoint : {"tcp://127.0.0.1", "tcp://127.0.0.1:", "tcp://127.0.0.1:99999", "tcp://:7390",
                               "tcp://::1:7390", "udp://127.0.0.1:1", "7390", "", "ipc://", "inproc://x"}) {
    const auto checked = check_bind_endpoint(endpoint, "--stream");
    INFO(endpoint);
    REQUIRE_FALSE(checked.has_value());
    CHECK(checked.error().find("--stream") != std::string::npos);
  }
  CHECK_FALSE(check_bind_endpoint("ipc://" + std::string(200, 'x'), "--control").has_value());
  CHECK(check_connect_endpoint("tcp://simulator.example.org:5555", "--connect").has_value());
  CHECK_FALSE(check_connect_endpoint("tcp://*:5555", "--connect").has_value());
  CHECK_FALSE(check_connect_endpoint("tcp://host:*", "--connect").has_value());
}

TEST_CASE("a bind that is refused says what to do", "[wire][sockets]") {
  auto options = local();
  options.out = "tcp://0.0.0.0:7392";
  const auto opened = Sockets::open(options);
  REQUIRE_FALSE(opened.has_value());
  CHECK(opened.error().find("--out") != std::string::npos);
  CHECK(opened.error().find("127.0.0.1") != std::string::npos);
  options.out = "tcp://0.0.0.0:*";
  CHECK_FALSE(Sockets::open(options).has_value());
  options.insecure = true;
  CHECK(Sockets::open(options).has_value());
}

TEST_CASE("a port in use is named, with its flag", "[wire][sockets]") {
  const auto first = Sockets::open(local());
  REQUIRE(first.has_value());
  auto options = local();
  options.stream = (*first)->stream_endpoint();
  const auto second = Sockets::open(options);
  REQUIRE_FALSE(second.has_value());
  CHECK(second.error().find("port " + std::string(port_of(options.stream)) + " is in use") != std::string::npos);
  CHECK(second.error().find("--stream") != std::string::npos);
}

TEST_CASE("an ipc path in use is not taken away", "[wire][sockets]") {
  auto options = local();
  options.control = ipc_path("in-use");
  {
    const auto first = Sockets::open(options);
    REQUIRE(first.has_value());
    CHECK((*first)->control_endpoint() == options.control);
    const auto second = Sockets::open(options);
    REQUIRE_FALSE(second.has_value());
    CHECK(second.error().find("--control") != std::string::npos);
  }
  CHECK(Sockets::open(options).has_value());
}

TEST_CASE("control requests are answered, from DEALER and from REQ", "[wire][sockets]") {
  auto sockets = std::move(*Sockets::open(local()));
  zmq::context_t context;
  for (const auto type : {zmq::socket_type::dealer, zmq::socket_type::req}) {
    zmq::socket_t client(context, type);
    client.set(zmq::sockopt::linger, 0);
    client.set(zmq::sockopt::rcvtimeo, 5000);
    client.connect(sockets->control_endpoint());
    client.send(zmq::str_buffer("ask"));
    std::vector<Event> events;
    REQUIRE(wait_for(*sockets, events, [](const Event& e) { return std::holds_alternative<ControlRequestReceived>(e); }));
    const auto& request = std::get<ControlRequestReceived>(events.back());
    CHECK(text(request.bytes) == "ask");
    CHECK(sockets->send_control(request.peer, "answer"));
    CHECK(receive(client) == std::vector<std::string>{"answer"});
  }
  CHECK_FALSE(sockets->send_control({.identity = "nobody", .delimited = false}, "x"));
  CHECK(sockets->counters().unsent_replies == 1);
}

TEST_CASE("a publisher is heard, bound and connected to, with and without topic", "[wire][sockets]") {
  zmq::context_t context;
  zmq::socket_t bound(context, zmq::socket_type::pub);
  bound.set(zmq::sockopt::linger, 0);
  bound.bind("tcp://127.0.0.1:*");
  auto options = local();
  options.connect = {{.endpoint = bound.get(zmq::sockopt::last_endpoint), .public_key = {}}};
  auto sockets = std::move(*Sockets::open(options));
  zmq::socket_t connected(context, zmq::socket_type::xpub);
  connected.set(zmq::sockopt::linger, 0);
  connected.connect(sockets->stream_endpoint());

  std::vector<Event> events;
  const auto heard = [&](const std::string& body) {
    return [&, body](const Event& e) {
      const auto* received = std::get_if<StreamReceived>(&e);
      return received != nullptr && text(received->bytes) == body;
    };
  };
  // PUB drops until the subscription has arrived; XPUB tells when.
  bool arrived = false;
  for (int round = 0; round < 500 && !arrived; ++round) {
    bound.send(zmq::str_buffer("from bound"));
    sockets->poll(10ms, events);
    for (const Event& event : events) arrived |= heard("from bound")(event);
  }
  CHECK(arrived);
  connected.set(zmq::sockopt::rcvtimeo, 10);
  std::vector<std::string> subscription;
  while ((subscription = receive(connected)).empty()) sockets->poll(1ms, events);
  CHECK(subscription == std::vector<std::string>{"\1"});
  connected.send(zmq::str_buffer("topic"), zmq::send_flags::sndmore);
  connected.send(zmq::str_buffer("from connected"));
  events.clear();
  REQUIRE(wait_for(*sockets, events, heard("from connected")));
  for (const Event& event : events)
    if (heard("from connected")(event)) CHECK(std::get<StreamReceived>(event).topic == "topic");

  for (int part = 0; part < 5; ++part)
    connected.send(zmq::str_buffer("x"), part < 4 ? zmq::send_flags::sndmore : zmq::send_flags::none);
  connected.send(zmq::str_buffer("after"));
  REQUIRE(wait_for(*sockets, events, heard("after")));
  CHECK(sockets->counters().malformed_messages == 1);
}

TEST_CASE("who listens is known, and only listeners get messages", "[wire][sockets]") {
  auto sockets = std::move(*Sockets::open(local()));
  zmq::context_t context;
  zmq::socket_t listener(context, zmq::socket_type::sub);
  listener.set(zmq::sockopt::linger, 0);
  listener.set(zmq::sockopt::rcvtimeo, 5000);
  listener.connect(sockets->out_endpoint());
  listener.set(zmq::sockopt::subscribe, "s/pcm/mix/f32/4");
  std::vector<Event> events;
  REQUIRE(wait_for(*sockets, events, subscription_to("s/pcm/mix/f32/4")));
  CHECK(sockets->has_listener("s/pcm/mix/f32/4"));
  CHECK_FALSE(sockets->has_listener("s/notices"));
  CHECK(sockets->subscriptions() == std::vector<std::string>{"s/pcm/mix/f32/4"});
  sockets->publish("s/notices", "not wanted");
  sockets->publish("s/pcm/mix/f32/4", "wanted");
  CHECK(receive(listener) == std::vector<std::string>{"s/pcm/mix/f32/4", "wanted"});
  listener.set(zmq::sockopt::unsubscribe, "s/pcm/mix/f32/4");
  REQUIRE(wait_for(*sockets, events, subscription_to("s/pcm/mix/f32/4", false)));
  CHECK_FALSE(sockets->has_listener("s/pcm/mix/f32/4"));
}

TEST_CASE("a second listener learns too that its subscription is in force", "[wire][sockets]") {
  auto sockets = std::move(*Sockets::open(local()));
  zmq::context_t context;
  std::vector<zmq::socket_t> listeners;
  std::vector<Event> events;
  for (const std::string name : {"subscribed/a", "subscribed/b"}) {
    auto& listener = listeners.emplace_back(context, zmq::socket_type::sub);
    listener.set(zmq::sockopt::linger, 0);
    listener.set(zmq::sockopt::rcvtimeo, 10);
    listener.connect(sockets->out_endpoint());
    listener.set(zmq::sockopt::subscribe, "topic");
    listener.set(zmq::sockopt::subscribe, name);
    std::vector<std::string> answer;
    for (int round = 0; round < 500 && answer.empty(); ++round) {
      sockets->poll(1ms, events);
      answer = receive(listener);
    }
    REQUIRE(answer == std::vector<std::string>{name, ""});
  }
  std::size_t told = 0;
  for (const Event& event : events) told += std::holds_alternative<SubscriptionChanged>(event);
  CHECK(told == 1);  // the topic, once; the questions are answered below
  sockets->publish("topic", "x");
  for (auto& listener : listeners) {
    listener.set(zmq::sockopt::rcvtimeo, 5000);
    CHECK(receive(listener) == std::vector<std::string>{"topic", "x"});
  }
}

TEST_CASE("other threads hand over, in order", "[wire][sockets]") {
  auto sockets = std::move(*Sockets::open(local()));
  zmq::context_t context;
  zmq::socket_t listener(context, zmq::socket_type::sub);
  listener.set(zmq::sockopt::linger, 0);
  listener.set(zmq::sockopt::rcvtimeo, 5000);
  listener.connect(sockets->out_endpoint());
  listener.set(zmq::sockopt::subscribe, "t");
  std::vector<Event> events;
  REQUIRE(wait_for(*sockets, events, subscription_to("t")));
  constexpr int kPosts = 2'000;
  std::thread poster([&] {
    for (int k = 0; k < kPosts; ++k) sockets->post("t", std::to_string(k));
  });
  std::atomic<bool> done{false};
  std::thread reader([&] {
    for (int k = 0; k < kPosts; ++k) {
      const auto parts = receive(listener);
      if (parts.size() != 2 || parts[1] != std::to_string(k)) return;
    }
    done = true;
  });
  for (int round = 0; round < 1000 && !done; ++round) sockets->poll(10ms, events);
  poster.join();
  reader.join();
  CHECK(done);
}

TEST_CASE("wake ends a poll that waits", "[wire][sockets]") {
  auto sockets = std::move(*Sockets::open(local()));
  std::atomic<bool> returned{false};
  std::thread waker([&] {
    while (!returned) {
      sockets->wake();
      std::this_thread::sleep_for(1ms);
    }
  });
  std::vector<Event> events;
  sockets->poll(600'000ms, events);
  returned = true;
  waker.join();
  CHECK(events.empty());
}

TEST_CASE("a message beyond the limit never arrives, the next one of others does", "[wire][sockets]") {
  auto options = local();
  options.message_bytes = 1000;
  auto sockets = std::move(*Sockets::open(options));
  zmq::context_t context;
  std::vector<Event> events;
  const auto publisher = [&] {
    zmq::socket_t out(context, zmq::socket_type::xpub);
    out.set(zmq::sockopt::linger, 0);
    out.set(zmq::sockopt::rcvtimeo, 10);
    out.connect(sockets->stream_endpoint());
    while (receive(out).empty()) sockets->poll(1ms, events);  // until the subscription has come
    return out;
  };
  auto large = publisher(), small = publisher();
  large.send(zmq::message_t(100'000), zmq::send_flags::none);
  small.send(zmq::message_t(900), zmq::send_flags::none);
  REQUIRE(wait_for(*sockets, events, [](const Event& e) { return std::holds_alternative<StreamReceived>(e); }));
  CHECK(std::get<StreamReceived>(events.back()).bytes.bytes().size() == 900);
}

TEST_CASE("a listener that does not read loses its own messages only", "[wire][sockets]") {
  auto options = local();
  options.out_queue_messages = 10;
  auto sockets = std::move(*Sockets::open(options));
  zmq::context_t context;
  const auto listen = [&](int queue) {
    zmq::socket_t listener(context, zmq::socket_type::sub);
    listener.set(zmq::sockopt::linger, 0);
    listener.set(zmq::sockopt::rcvtimeo, 5000);
    listener.set(zmq::sockopt::rcvhwm, queue);
    listener.set(zmq::sockopt::rcvbuf, 4096);
    listener.connect(sockets->out_endpoint());
    listener.set(zmq::sockopt::subscribe, "t");
    return listener;
  };
  auto slow = listen(1);
  std::vector<Event> events;
  REQUIRE(wait_for(*sockets, events, subscription_to("t")));
  auto quick = listen(0);
  quick.set(zmq::sockopt::subscribe, "subscribed/q");
  for (bool seen = false; !seen;) {
    sockets->poll(1ms, events);
    quick.set(zmq::sockopt::rcvtimeo, 10);
    seen = !receive(quick).empty();
  }
  quick.set(zmq::sockopt::rcvtimeo, 5000);
  const std::string payload(100'000, 'p');
  constexpr int kMessages = 300;
  int received = 0;
  for (int k = 0; k < kMessages; ++k) {
    sockets->publish("t", payload);
    received += receive(quick).size() == 2;
  }
  CHECK(received == kMessages);
  int late = 0;
  slow.set(zmq::sockopt::rcvtimeo, 200);
  while (receive(slow).size() == 2) ++late;
  CHECK(late < kMessages);
}

}  // namespace sockets_test
