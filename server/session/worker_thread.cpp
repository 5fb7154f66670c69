#include "server/session/worker_thread.h"

#include <fcntl.h>
#include <pthread.h>
#include <sched.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <charconv>

#include <fmt/format.h>

namespace rustle::session {
namespace {

constexpr int kRealTimePriority = 10;  // above the least, below what audio servers take
constexpr int kNice = -11;

}  // namespace

Priority raise_this_thread() {
  sched_param wanted{};
  wanted.sched_priority = kRealTimePriority;
  if (pthread_setschedparam(pthread_self(), SCHED_RR, &wanted) == 0) return Priority::kRealTime;
  const auto thread = static_cast<id_t>(::syscall(SYS_gettid));
  return ::setpriority(PRIO_PROCESS, thread, kNice) == 0 ? Priority::kNice : Priority::kNormal;
}

bool pin_this_thread(const std::vector<int>& cpus) {
  if (cpus.empty()) return true;
  cpu_set_t set;
  CPU_ZERO(&set);
  for (const int cpu : cpus) CPU_SET(static_cast<std::size_t>(cpu), &set);
  return pthread_setaffinity_np(pthread_self(), sizeof(set), &set) == 0;
}

RunDelay::RunDelay() : file_(::open("/proc/thread-self/schedstat", O_RDONLY | O_CLOEXEC)) {}

RunDelay::~RunDelay() {
  if (file_ >= 0) ::close(file_);
}

std::chrono::nanoseconds RunDelay::total() const {
  // "RUNNING_NS WAITING_NS TURNS"
  std::array<char, 96> text;
  const ssize_t size = file_ >= 0 ? ::pread(file_, text.data(), text.size(), 0) : 0;
  if (size <= 0) return {};
  const char* const end = text.data() + size;
  const char* waiting = std::find(static_cast<const char*>(text.data()), end, ' ');
  std::int64_t ns = 0;
  if (waiting != end) std::from_chars(waiting + 1, end, ns);
  return std::chrono::nanoseconds(ns);
}

void RunDelay::note(std::chrono::nanoseconds now) {
  if (noted_ > 0 && now - notes_[(noted_ - 1) % kNotes].at < std::chrono::milliseconds(1)) return;
  notes_[noted_++ % kNotes] = {now, total()};
}

std::chrono::nanoseconds RunDelay::since(std::chrono::nanoseconds moment) const {
  const std::size_t oldest = noted_ > kNotes ? noted_ - kNotes : 0;
  if (noted_ == 0) return {};
  std::size_t k = noted_ - 1;
  while (k > oldest && notes_[k % kNotes].at > moment) --k;
  return total() - notes_[k % kNotes].total;
}

void name_this_thread(const char* name) {
  pthread_setname_np(pthread_self(), name);
}

tl::expected<std::vector<int>, std::string> parse_cpus(std::string_view list) {
  std::vector<int> cpus;
  const auto number = [](std::string_view text) -> int {
    int value = -1;
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
    return error == std::errc() && end == text.data() + text.size() && value >= 0 && value < CPU_SETSIZE ? value : -1;
  };
  for (std::string_view rest = list;;) {
    const auto comma = rest.find(',');
    const std::string_view part = rest.substr(0, comma);
    const auto dash = part.find('-');
    const int first = number(part.substr(0, dash));
    const int last = dash == std::string_view::npos ? first : number(part.substr(dash + 1));
    if (first < 0 || last < first)
      return tl::unexpected(
          fmt::format("\"{}\" is no list of processors; write it as 0-2,5, each below {}", list, CPU_SETSIZE));
    for (int cpu = first; cpu <= last; ++cpu) cpus.push_back(cpu);
    if (comma == std::string_view::npos) break;
    rest.remove_prefix(comma + 1);
  }
  std::sort(cpus.begin(), cpus.end());
  cpus.erase(std::unique(cpus.begin(), cpus.end()), cpus.end());
  return cpus;
}

int usable_cpus() {
  cpu_set_t set;
  CPU_ZERO(&set);
  if (::sched_getaffinity(0, sizeof(set), &set) != 0) return 1;
  return std::max(1, CPU_COUNT(&set));
}

}  // namespace rustle::session
