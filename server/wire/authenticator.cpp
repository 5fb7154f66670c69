#include "server/wire/authenticator.h"

#include <zmq.h>

#include <array>
#include <cerrno>
#include <utility>
#include <vector>

#include "server/wire/security.h"

namespace rustle::wire {
namespace {

constexpr const char* kHandler = "inproc://zeromq.zap.01";
constexpr const char* kEnd = "inproc://rustle.authenticator.end";
constexpr std::size_t kKeyBytes = 32;

bool receive(void* socket, std::vector<std::string>& parts) {
  parts.clear();
  while (true) {
    zmq_msg_t part;
    zmq_msg_init(&part);
    if (zmq_msg_recv(&part, socket, ZMQ_DONTWAIT) < 0) {
      zmq_msg_close(&part);
      return false;
    }
    parts.emplace_back(static_cast<const char*>(zmq_msg_data(&part)), zmq_msg_size(&part));
    const bool more = zmq_msg_more(&part) != 0;
    zmq_msg_close(&part);
    if (!more) return true;
  }
}

}  // namespace

Authenticator::Authenticator(void* context, std::function<bool(const std::string& public_key)> admits)
    : questions_(zmq_socket(context, ZMQ_REP)),
      end_here_(zmq_socket(context, ZMQ_PAIR)),
      end_there_(zmq_socket(context, ZMQ_PAIR)),
      admits_(std::move(admits)) {
  if (questions_ == nullptr || end_here_ == nullptr || end_there_ == nullptr) return;
  const int linger = 0;
  for (void* socket : {questions_, end_here_, end_there_}) zmq_setsockopt(socket, ZMQ_LINGER, &linger, sizeof(linger));
  if (zmq_bind(questions_, kHandler) != 0 || zmq_bind(end_there_, kEnd) != 0 || zmq_connect(end_here_, kEnd) != 0) return;
  thread_ = std::thread([this] { serve(); });
}

Authenticator::~Authenticator() {
  if (thread_.joinable()) {
    zmq_send(end_here_, "", 0, 0);
    thread_.join();
  }
  for (void* socket : {questions_, end_here_, end_there_})
    if (socket != nullptr) zmq_close(socket);
}

std::string Authenticator::status_of(const std::string& domain, const std::string& mechanism, const std::string& credentials,
                                     std::string& user) const {
  if (domain != kZapDomain || mechanism != "CURVE" || credentials.size() != kKeyBytes) return "400";
  std::array<char, kKeyBytes * 5 / 4 + 1> text{};
  zmq_z85_encode(text.data(), static_cast<const std::uint8_t*>(static_cast<const void*>(credentials.data())), kKeyBytes);
  if (!admits_(text.data())) return "400";
  user = text.data();
  return "200";
}

void Authenticator::serve() {
  std::vector<std::string> parts;
  zmq_pollitem_t items[] = {{questions_, 0, ZMQ_POLLIN, 0}, {end_there_, 0, ZMQ_POLLIN, 0}};
  while (true) {
    if (zmq_poll(items, 2, -1) < 0 && errno == ETERM) return;
    if (items[1].revents != 0) return;
    if (items[0].revents == 0 || !receive(questions_, parts)) continue;
    // version, request id, domain, address, routing id, mechanism, credentials
    const bool whole = parts.size() >= 6 && parts[0] == "1.0";
    std::string user;
    const std::string status = whole ? status_of(parts[2], parts[5], parts.size() == 7 ? parts[6] : "", user) : "500";
    ++(status == "200" ? admitted_ : refused_);
    const std::array<std::string, 6> answer{
        "1.0", parts.size() > 1 ? parts[1] : "", status, status == "200" ? "OK" : "No access", user, ""};
    for (std::size_t k = 0; k < answer.size(); ++k)
      zmq_send(questions_, answer[k].data(), answer[k].size(), k + 1 < answer.size() ? ZMQ_SNDMORE : 0);
  }
}

}  // namespace rustle::wire
