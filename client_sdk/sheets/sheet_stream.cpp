#include "client_sdk/sheets/sheet_stream.h"

#include <utility>

namespace rustle::sheets {
namespace {

class AnimatedStream : public SheetStream {
 public:
  explicit AnimatedStream(std::shared_ptr<const AnimatedSheet> sheet) : sheet_(std::move(sheet)) {
    const std::size_t vertices = sheet_->mesh().material_coordinates.size();
    frame_.mesh = std::shared_ptr<const SheetMesh>(sheet_, &sheet_->mesh());
    frame_.xyz_m.resize(3 * vertices);
    frame_.anchored.resize(vertices);
  }

  double duration_s() const override { return sheet_->duration_s(); }
  bool on_table() const override { return sheet_->on_table(); }
  const StreamedFrame& frame(double time_s) override {
    frame_.fresh = !begun_;
    begun_ = true;
    sheet_->positions(time_s, frame_.xyz_m);
    sheet_->anchored(time_s, frame_.anchored);
    return frame_;
  }

 private:
  std::shared_ptr<const AnimatedSheet> sheet_;
  StreamedFrame frame_;
  bool begun_ = false;
};

}  // namespace

std::unique_ptr<SheetStream> make_stream(std::shared_ptr<const AnimatedSheet> sheet) {
  return std::make_unique<AnimatedStream>(std::move(sheet));
}

}  // namespace rustle::sheets
