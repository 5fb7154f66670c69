#include "server/validation/check.h"

#include <fmt/format.h>

#include <atomic>
#include <exception>
#include <mutex>
#include <thread>

namespace rustle::validation {
namespace {

std::string with_unit(std::string text, std::string_view unit) {
  if (!unit.empty()) text += fmt::format(" {}", unit);
  return text;
}

}  // namespace

Bound at_least(double low, std::string_view unit) {
  return {with_unit(fmt::format("at least {:g}", low), unit), low, kUnbounded};
}

Bound at_most(double high, std::string_view unit) {
  return {with_unit(fmt::format("at most {:g}", high), unit), -kUnbounded, high};
}

Bound between(double low, double high, std::string_view unit) {
  return {with_unit(fmt::format("{:g} to {:g}", low, high), unit), low, high};
}

Bound above_to(double low, double high, std::string_view unit) {
  return {with_unit(fmt::format("above {:g}, at most {:g}", low, high), unit), low, high, true};
}

Bound shown() {
  return {"none", -kUnbounded, kUnbounded};
}

Bound around(double value, double margin, std::string_view unit) {
  return {with_unit(fmt::format("{:g} ± {:g}", value, margin), unit), value - margin, value + margin};
}

void run_all(const Setting& setting, std::size_t count, const std::function<void(std::size_t)>& job) {
  std::atomic<std::size_t> next{0}, done{0};
  std::mutex mutex;
  std::exception_ptr failure;
  const auto work = [&] {
    for (std::size_t i = next++; i < count; i = next++) {
      try {
        job(i);
      } catch (...) {
        const std::lock_guard lock(mutex);
        if (!failure) failure = std::current_exception();
        next = count;
      }
      const std::lock_guard lock(mutex);
      setting.progress(static_cast<double>(++done) / static_cast<double>(count));
    }
  };
  std::vector<std::thread> helpers;
  for (int k = 1; k < setting.workers && static_cast<std::size_t>(k) < count; ++k) helpers.emplace_back(work);
  work();
  for (std::thread& helper : helpers) helper.join();
  if (failure) std::rethrow_exception(failure);
}

}  // namespace rustle::validation
