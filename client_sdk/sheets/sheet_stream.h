#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <vector>

#include "client_sdk/sheets/animated_sheet.h"

namespace rustle::sheets {

/// A place where a sheet is being torn.
struct SheetTearTip {
  std::uint32_t id = 1;
  Point3 position_m = {0, 0, 0};
  Point3 direction = {0, 0, 0};  ///< of its advance, unit length
  double speed_m_per_s = 0;
};

/// One frame of a sheet that streams.
struct StreamedFrame {
  std::shared_ptr<const SheetMesh> mesh;  ///< another object than the frame's before: another topology
  std::vector<float> xyz_m;               ///< [3V]
  std::vector<std::uint8_t> anchored;     ///< [V], 1: held
  std::vector<SheetTearTip> tear_tips;    ///< where the sheet's maker knows them
  bool fresh = false;                     ///< another sheet than before: nothing moved there, it is compared with nothing
};

/// A sheet as a simulator has it: frame after frame, its topology changing as it goes.
class SheetStream {
 public:
  virtual ~SheetStream() = default;
  virtual double duration_s() const = 0;
  /// Whether a table, solid below z = 0, belongs to it.
  virtual bool on_table() const = 0;
  /// The next frame, at this time. The reference holds until the next call. The same times give the same bits.
  /// \pre times ascend
  virtual const StreamedFrame& frame(double time_s) = 0;
};

/// A sheet that is a pure function of time, as a stream.
[[nodiscard]] std::unique_ptr<SheetStream> make_stream(std::shared_ptr<const AnimatedSheet> sheet);

}  // namespace rustle::sheets
