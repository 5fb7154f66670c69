#pragma once

#include <complex>
#include <memory>
#include <span>

namespace rustle::dsp {

/// Real discrete Fourier transform of one size with its own work space.
///   forward  X_k = Σ_n x_n exp(-2πi kn/N)                    k = 0 .. N/2
///   inverse  x_n = 1/N Σ_k X_k exp(2πi kn/N)                 the upper half by symmetry
/// Plans are estimated, never measured, so that the same input gives the same bits in every run.
/// Construction and destruction allocate and lock: control side. The transforms neither allocate nor lock; one object
/// serves one thread at a time.
class RealFft {
 public:
  /// \pre size is even and at least 2
  explicit RealFft(int size);
  RealFft(RealFft&&) noexcept;
  RealFft& operator=(RealFft&&) noexcept;
  ~RealFft();

  int size() const noexcept;
  int bins() const noexcept { return size() / 2 + 1; }

  /// \pre time.size() == size(), spectrum.size() == bins()
  void forward(std::span<const float> time, std::span<std::complex<float>> spectrum) noexcept;
  /// \pre spectrum.size() == bins(), time.size() == size()
  void inverse(std::span<const std::complex<float>> spectrum, std::span<float> time) noexcept;

  /// The work space, for callers that fill and read it in place.
  std::span<float> time() noexcept;
  std::span<std::complex<float>> spectrum() noexcept;
  /// time() to spectrum(); time() is kept.
  void forward() noexcept;
  /// spectrum() to time(); spectrum() is destroyed.
  void inverse() noexcept;

 private:
  struct Plan;
  std::unique_ptr<Plan> plan_;
};

}  // namespace rustle::dsp
