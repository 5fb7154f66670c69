#pragma once

#include <algorithm>
#include <atomic>
#include <cstring>
#include <functional>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "rustle/v1/session.pb.h"
#include "server/wire/control.h"
#include "server/wire/encode.h"
#include "server/wire/sockets.h"
#include "server/wire/stream_envelope.h"
#include "server/wire/topics.h"

namespace rustle::client::test {

/// The daemon's sockets with a loop that admits sessions and keeps what arrives; nothing sounds.
class FakeDaemon {
 public:
  struct Behaviour {
    bool answers = true;
    bool takes_streams = true;
    std::uint32_t window_messages = 4;
    std::uint64_t window_bytes = 0;
    bool acknowledges = true;
    bool knows_sessions = true;     ///< false: only those attached here, as a daemon that was started anew
    std::string error_on_attach{};  ///< refused with this message
    std::string stream = "tcp://127.0.0.1:*", out = "tcp://127.0.0.1:*";
  };

  explicit FakeDaemon(Behaviour behaviour, const std::string& control = "tcp://127.0.0.1:*")
      : behaviour_(std::move(behaviour)) {
    wire::Sockets::Options options;
    options.control = control;
    options.stream = behaviour_.takes_streams ? behaviour_.stream : "";
    options.out = behaviour_.out;
    options.stream_queue_messages = 16;
    sockets_ = std::move(*wire::Sockets::open(options));
    acknowledges_ = behaviour_.acknowledges;
    knows_session_ = behaviour_.knows_sessions;
    thread_ = std::thread([this] { run(); });
  }
  ~FakeDaemon() {
    stop_ = true;
    sockets_->wake();
    thread_.join();
  }

  std::string control() const { return sockets_->control_endpoint(); }
  std::string out() const { return sockets_->out_endpoint(); }

  /// Publishes from the test's thread.
  void post(std::string topic, std::string bytes) { sockets_->post(std::move(topic), std::move(bytes)); }
  void acknowledge(std::uint64_t sequence) {
    post(wire::acknowledgements_topic("s1"),
         wire::encode_credit({.session_id = "s1", .sequence = 0},
                             {sequence, behaviour_.window_messages, behaviour_.window_bytes}));
  }
  void set_acknowledges(bool on) { acknowledges_ = on; }
  /// As if the session had ended.
  void forget_session() { knows_session_ = false; }
  /// False: the network thread stands still.
  void set_running(bool on) { running_ = on; }

  std::vector<v1::StreamMessage> received() const {
    const std::lock_guard lock(mutex_);
    return received_;
  }
  std::size_t received_count() const {
    const std::lock_guard lock(mutex_);
    return received_.size();
  }
  /// Of the newest attach.
  session::SessionOptions attached_options() const {
    const std::lock_guard lock(mutex_);
    return attached_options_;
  }
  std::vector<std::string> attached_materials() const {
    const std::lock_guard lock(mutex_);
    return attached_materials_;
  }
  std::size_t asked_count(const std::string& what) const {
    const std::lock_guard lock(mutex_);
    return static_cast<std::size_t>(std::count(asked_.begin(), asked_.end(), what));
  }
  /// Of the newest detach.
  std::uint64_t last_sequence() const {
    const std::lock_guard lock(mutex_);
    return last_sequence_;
  }
  std::vector<std::string> asked() const {
    const std::lock_guard lock(mutex_);
    return asked_;
  }
  /// Waits, at most ten seconds.
  bool wait_until(const std::function<bool()>& condition) const {
    for (int round = 0; round < 10'000; ++round) {
      if (condition()) return true;
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
    return false;
  }

 private:
  void run() {
    std::vector<wire::Event> events;
    while (!stop_) {
      if (!running_) {
        std::this_thread::sleep_for(std::chrono::milliseconds(1));
        continue;
      }
      events.clear();
      sockets_->poll(std::chrono::milliseconds(20), events);
      for (auto& event : events) {
        if (auto* request = std::get_if<wire::ControlRequestReceived>(&event)) handle(*request);
        if (auto* stream = std::get_if<wire::StreamReceived>(&event)) handle(*stream);
      }
    }
  }

  void handle(const wire::ControlRequestReceived& received) {
    const auto request = wire::decode_control(received.bytes.bytes());
    if (!behaviour_.answers || !request) return;
    const auto reply = [&](const wire::ControlReply& answer) {
      sockets_->send_control(received.peer, wire::encode_reply(request->request_id, answer));
    };
    const auto note = [&](const std::string& what) {
      const std::lock_guard lock(mutex_);
      asked_.push_back(what);
    };
    if (std::holds_alternative<wire::HelloRequest>(request->body)) {
      note("hello");
      reply(wire::Welcome{.server = "fake",
                          .stream_endpoint = sockets_->stream_endpoint(),
                          .out_endpoint = sockets_->out_endpoint(),
                          .rate_hz = 48'000,
                          .block_size = 128});
    } else if (const auto* attach = std::get_if<wire::AttachRequest>(&request->body)) {
      note("attach " + attach->name);
      if (!behaviour_.error_on_attach.empty()) {
        wire::Error error;
        error.code = wire::ErrorCode::kUnknownMaterial;
        error.field = "attach.sheets[0].material";
        error.message = behaviour_.error_on_attach;
        error.remedy = "Choose another.";
        reply(error);
        return;
      }
      knows_session_ = true;
      {
        const std::lock_guard lock(mutex_);
        attached_options_ = attach->options;
        attached_materials_.clear();
        for (const auto& sheet : attach->sheets) attached_materials_.push_back(sheet.material);
      }
      wire::Attached attached{.session_id = "s1", .options = attach->options, .credit = {}, .recording_file_name = {}};
      attached.options.rate_hz = 48'000;
      attached.options.block_size = 128;
      if (attach->options.clock == session::Clock::kSimulation)
        attached.credit = wire::FlowCredit{0, behaviour_.window_messages, behaviour_.window_bytes};
      reply(attached);
    } else if (std::holds_alternative<wire::DetachRequest>(request->body)) {
      note("detach " + request->session_id);
      {
        const std::lock_guard lock(mutex_);
        last_sequence_ = std::get<wire::DetachRequest>(request->body).last_sequence;
      }
      wire::Statistics statistics;
      statistics.session_id = request->session_id;
      statistics.messages_received = received_count();
      statistics.frames_dropped["late"] = 2;
      reply(wire::Detached{statistics});
    } else if (std::holds_alternative<wire::GetStatisticsRequest>(request->body) && !knows_session_) {
      wire::Error error;
      error.code = wire::ErrorCode::kUnknownSession;
      error.message = "There is no such session.";
      reply(error);
    } else if (std::holds_alternative<wire::GetStatisticsRequest>(request->body)) {
      wire::Statistics statistics;
      statistics.session_id = request->session_id;
      reply(statistics);
    } else if (const auto* gains = std::get_if<wire::SetGainsRequest>(&request->body)) {
      note("gains");
      reply(wire::GainsSet{gains->gains});
    } else if (const auto* change = std::get_if<wire::ChangePackRequest>(&request->body)) {
      wire::PackInfo pack;
      pack.material = change->material;
      pack.touched_surface = change->touched_surface;
      reply(wire::PackChanged{pack});
    } else if (const auto* reload = std::get_if<wire::ReloadPackRequest>(&request->body)) {
      wire::PackInfo pack;
      pack.name = reload->name;
      reply(wire::PackList{{pack, pack}});
    } else if (std::holds_alternative<wire::ListPacksRequest>(request->body)) {
      wire::PackInfo pack;
      pack.name = "printer-paper";
      pack.models = {"crumpling", "friction"};
      reply(wire::PackList{{pack}});
    } else if (std::holds_alternative<wire::ListSessionsRequest>(request->body)) {
      wire::SessionInfo info;
      info.session_id = "s1";
      info.clock = session::Clock::kSimulation;
      reply(wire::SessionList{{info}});
    }
  }

  void handle(const wire::StreamReceived& stream) {
    v1::StreamMessage message;
    const auto bytes = stream.bytes.bytes();
    if (!message.ParseFromArray(bytes.data(), static_cast<int>(bytes.size()))) return;
    const std::uint64_t sequence = message.sequence();
    {
      const std::lock_guard lock(mutex_);
      received_.push_back(std::move(message));
    }
    if (acknowledges_)
      sockets_->publish(wire::acknowledgements_topic("s1"),
                        wire::encode_credit({.session_id = "s1", .sequence = sequence},
                                            {sequence, behaviour_.window_messages, behaviour_.window_bytes}));
  }

  const Behaviour behaviour_;
  std::unique_ptr<wire::Sockets> sockets_;
  std::atomic<bool> stop_{false}, acknowledges_{true}, running_{true}, knows_session_{true};
  mutable std::mutex mutex_;
  std::vector<v1::StreamMessage> received_{};
  std::vector<std::string> asked_{};
  session::SessionOptions attached_options_{};
  std::vector<std::string> attached_materials_{};
  std::uint64_t last_sequence_ = 0;
  std::thread thread_;
};

}  // namespace rustle::client::test
