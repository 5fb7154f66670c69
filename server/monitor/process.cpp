#include "server/monitor/process.h"

#include <sys/resource.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <system_error>

namespace rustle::monitor {

ProcessFigures process_figures() {
  namespace fs = std::filesystem;
  ProcessFigures out;
  rusage used{};
  if (::getrusage(RUSAGE_SELF, &used) == 0) {
    const auto seconds = [](const timeval& time) {
      return static_cast<double>(time.tv_sec) + 1e-6 * static_cast<double>(time.tv_usec);
    };
    out.cpu_s = seconds(used.ru_utime) + seconds(used.ru_stime);
  }
  double pages = 0, resident_pages = 0;
  if (std::ifstream("/proc/self/statm") >> pages >> resident_pages)
    out.resident_bytes = resident_pages * static_cast<double>(::sysconf(_SC_PAGESIZE));
  std::error_code failed;
  for (auto file = fs::directory_iterator("/proc/self/fd", failed); !failed && file != fs::directory_iterator();
       file.increment(failed))
    ++out.open_files;
  failed.clear();
  for (auto task = fs::directory_iterator("/proc/self/task", failed); !failed && task != fs::directory_iterator();
       task.increment(failed)) {
    std::string name;
    double running_ns = 0, waiting_ns = 0;
    if (!std::getline(std::ifstream(task->path() / "comm"), name)) continue;  // it has ended
    std::ifstream(task->path() / "schedstat") >> running_ns >> waiting_ns;
    auto& threads = out.threads[name];
    ++threads.count;
    threads.running_s += 1e-9 * running_ns;
    threads.waiting_s += 1e-9 * waiting_ns;
  }
  return out;
}

}  // namespace rustle::monitor
