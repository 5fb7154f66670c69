#include "server/monitor/monitor.h"

#include <charconv>
#include <chrono>
#include <nlohmann/json.hpp>
#include <utility>

#include "server/monitor/health.h"
#include "server/monitor/json.h"
#include "server/monitor/metrics.h"

namespace rustle::monitor {
namespace {

constexpr const char* kJson = "application/json";

HttpResponse health_response(const DaemonFigures* daemon) {
  const auto problems = problems_of(daemon);
  nlohmann::ordered_json body;
  body["healthy"] = problems.empty();
  body["problems"] = problems;
  if (daemon != nullptr) {
    body["sessions"] = daemon->sessions.size();
    body["up_s"] = daemon->up_s;
  }
  return {problems.empty() ? 200 : 503, kJson,
          body.dump(-1, ' ', false, nlohmann::ordered_json::error_handler_t::replace) + "\n"};
}

/// A whole number; absent: it is none.
std::optional<std::uint64_t> whole(const std::string& text) {
  std::uint64_t number = 0;
  const auto [end, failed] = std::from_chars(text.data(), text.data() + text.size(), number);
  return failed == std::errc() && end == text.data() + text.size() ? std::optional(number) : std::nullopt;
}

HttpServer::Response refusal(int status, std::string why) {
  return [response = HttpResponse{status, "text/plain; charset=utf-8", std::move(why) + "\n"}] { return response; };
}

}  // namespace

Monitor::Monitor(std::function<void()> wake) : wake_(std::move(wake)) {}

Monitor::~Monitor() = default;

HttpServer::Route Monitor::of_figures(HttpResponse (*respond)(const DaemonFigures& daemon)) {
  return {[this, respond](const HttpRequest&, HttpServer::Answer answer) {
    ask({{}, [respond, answer = std::move(answer)](std::shared_ptr<const DaemonFigures> daemon, auto) {
           answer([respond, daemon = std::move(daemon)] { return respond(*daemon); });
         }});
  }};
}

tl::expected<std::unique_ptr<Monitor>, std::string> Monitor::open(const HttpAddress& address, std::function<void()> wake,
                                                                  HttpServer::Paths more,
                                                                  const HttpServer::Options& options) {
  std::unique_ptr<Monitor> monitor(new Monitor(std::move(wake)));
  auto& routes = more.routes;
  routes["/metrics"] = monitor->of_figures([](const DaemonFigures& daemon) -> HttpResponse {
    return {200, "text/plain; version=0.0.4; charset=utf-8", metrics_text(daemon, process_figures())};
  });
  routes["/figures"] = monitor->of_figures([](const DaemonFigures& daemon) -> HttpResponse {
    return {200, kJson, figures_json(daemon, process_figures())};
  });
  routes["/healthz"] = monitor->of_figures([](const DaemonFigures& daemon) { return health_response(&daemon); });
  routes["/healthz"].late = health_response(nullptr);
  routes["/trace"] = {[self = monitor.get()](const HttpRequest& request, HttpServer::Answer answer) {
    self->trace(request, std::move(answer));
  }};
  auto server = HttpServer::open(address, std::move(more), options);
  if (!server) return tl::unexpected(server.error());
  monitor->server_ = std::move(*server);
  return monitor;
}

void Monitor::trace(const HttpRequest& request, HttpServer::Answer answer) {
  TraceChoice choice;
  std::optional<std::string> session;
  for (const auto& [key, value] : request.query) {
    const auto number = whole(value);
    if (key == "session") {
      session = value;
    } else if (key != "frame" && key != "sequence" && key != "newest") {
      return answer(refusal(400, "\"" + key + "\" is not asked here; ask session, frame, sequence or newest."));
    } else if (!number) {
      return answer(refusal(400, key + " wants a whole number."));
    } else if (key == "frame") {
      choice.frame = number;
    } else if (key == "sequence") {
      choice.sequence = number;
    } else {
      choice.newest = *number;
    }
  }
  if (!session) return answer(refusal(400, "Name a session: /trace?session=ID."));
  ask({session, [answer = std::move(answer), choice, id = *session](auto, std::shared_ptr<const SessionTraces> traces) {
         if (traces == nullptr) return answer(refusal(404, "There is no session \"" + id + "\"."));
         answer([traces = std::move(traces), choice]() -> HttpResponse {
           return {200, kJson, trace_json(*traces, choice, std::chrono::system_clock::now().time_since_epoch())};
         });
       }});
}

void Monitor::ask(Question question) {
  {
    std::lock_guard lock(mutex_);
    questions_.push_back(std::move(question));
  }
  asked_.store(true, std::memory_order_release);
  wake_();
}

void Monitor::answer(const Source& source) {
  if (!asked_.load(std::memory_order_relaxed) || !asked_.exchange(false, std::memory_order_acquire)) return;
  std::vector<Question> questions;
  {
    std::lock_guard lock(mutex_);
    questions.swap(questions_);
  }
  std::shared_ptr<const DaemonFigures> figures;
  for (const auto& question : questions) {
    if (question.traces_of) {
      auto traces = source.traces(*question.traces_of);
      question.answered(nullptr, traces ? std::make_shared<const SessionTraces>(std::move(*traces)) : nullptr);
    } else {
      if (!figures) figures = std::make_shared<const DaemonFigures>(source.figures());
      question.answered(figures, nullptr);
    }
  }
}

}  // namespace rustle::monitor
