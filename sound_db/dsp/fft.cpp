#include "sound_db/dsp/fft.h"

#include <algorithm>
#include <cassert>
#include <mutex>
#include <new>

#include <fftw3.h>

namespace rustle::dsp {

namespace {

std::mutex& planner_mutex() {
  static std::mutex mutex;
  return mutex;
}

}  // namespace

struct RealFft::Plan {
  explicit Plan(int points) : size(points) {
    const auto bins = static_cast<std::size_t>(points / 2 + 1);
    time = fftwf_alloc_real(static_cast<std::size_t>(points));
    spectrum = fftwf_alloc_complex(bins);
    if (!time || !spectrum) throw std::bad_alloc();
    const std::lock_guard lock(planner_mutex());
    forward = fftwf_plan_dft_r2c_1d(points, time, spectrum, FFTW_ESTIMATE | FFTW_PRESERVE_INPUT);
    inverse = fftwf_plan_dft_c2r_1d(points, spectrum, time, FFTW_ESTIMATE | FFTW_DESTROY_INPUT);
    std::fill_n(time, points, 0.0f);
    std::fill_n(&spectrum[0][0], 2 * bins, 0.0f);
  }
  Plan(const Plan&) = delete;
  Plan& operator=(const Plan&) = delete;
  ~Plan() {
    {
      const std::lock_guard lock(planner_mutex());
      fftwf_destroy_plan(forward);
      fftwf_destroy_plan(inverse);
    }
    fftwf_free(time);
    fftwf_free(spectrum);
  }

  int size;
  float* time = nullptr;
  fftwf_complex* spectrum = nullptr;
  fftwf_plan forward = nullptr;
  fftwf_plan inverse = nullptr;
};

RealFft::RealFft(int size) {
  assert(size >= 2 && size % 2 == 0 && "an FFT has an even number of points");
  plan_ = std::make_unique<Plan>(size);
}

RealFft::RealFft(RealFft&&) noexcept = default;
RealFft& RealFft::operator=(RealFft&&) noexcept = default;
RealFft::~RealFft() = default;

int RealFft::size() const noexcept {
  return plan_->size;
}

std::span<float> RealFft::time() noexcept {
  return {plan_->time, static_cast<std::size_t>(plan_->size)};
}

std::span<std::complex<float>> RealFft::spectrum() noexcept {
  return {reinterpret_cast<std::complex<float>*>(plan_->spectrum), static_cast<std::size_t>(bins())};
}

void RealFft::forward() noexcept {
  fftwf_execute(plan_->forward);
}

void RealFft::inverse() noexcept {
  fftwf_execute(plan_->inverse);
  const float scale = 1.0f / static_cast<float>(plan_->size);
  for (float& x : time()) x *= scale;
}

void RealFft::forward(std::span<const float> in, std::span<std::complex<float>> out) noexcept {
  assert(in.size() == time().size() && out.size() == spectrum().size());
  std::copy(in.begin(), in.end(), time().begin());
  forward();
  std::copy(spectrum().begin(), spectrum().end(), out.begin());
}

void RealFft::inverse(std::span<const std::complex<float>> in, std::span<float> out) noexcept {
  assert(in.size() == spectrum().size() && out.size() == time().size());
  std::copy(in.begin(), in.end(), spectrum().begin());
  inverse();
  std::copy(time().begin(), time().end(), out.begin());
}

}  // namespace rustle::dsp
