#include "server/apps/emitter_files.h"

#include <fmt/format.h>

#include <nlohmann/json.hpp>
#include <vector>

namespace rustle::apps {

tl::expected<EmitterFiles, std::string> EmitterFiles::create(const std::filesystem::path& folder, int rate_hz,
                                                             sinks::WavFormat format) {
  std::error_code failed;
  std::filesystem::create_directories(folder, failed);
  if (failed) return tl::unexpected(fmt::format("{}: cannot be made ({})", folder.string(), failed.message()));
  const auto name = folder / "emitters.jsonl";
  std::FILE* lines = std::fopen(name.c_str(), "w");
  if (lines == nullptr) return tl::unexpected(fmt::format("{}: cannot be written", name.string()));
  return EmitterFiles(folder, lines, rate_hz, format);
}

tl::expected<void, std::string> EmitterFiles::add(const Stretch& stretch) {
  auto known = open_.find(stretch.emitter);
  const bool begins = known == open_.end();
  if (begins) {
    auto name = fmt::format("sheet-{}-{}-{:05}.wav", stretch.sheet, stretch.kind, ++count_);
    auto wav = sinks::WavWriter::create(folder_ / name, rate_hz_, 1, format_);
    if (!wav) return tl::unexpected(wav.error());
    known = open_.emplace(stretch.emitter, Open{std::move(name), std::move(*wav), {}, 0}).first;
  }
  Open& file = known->second;
  if (begins || file.newest.position_m != stretch.position_m || file.newest.normal != stretch.normal) {
    if (auto written = write_line(file.name, stretch, stretch.first_sample, false); !written) return written;
  }
  file.newest = stretch;
  file.newest.samples = {};
  file.next_sample = stretch.first_sample + static_cast<std::int64_t>(stretch.samples.size());
  if (stretch.missing > 0 && !begins) {
    if (auto written = file.wav.write(std::vector<float>(stretch.missing)); !written) return written;
  }
  if (auto written = file.wav.write(stretch.samples); !written) return written;
  if (!stretch.last) return {};
  if (auto written = write_line(file.name, stretch, file.next_sample, true); !written) return written;
  auto closed = file.wav.close();
  open_.erase(known);
  return closed;
}

tl::expected<void, std::string> EmitterFiles::write_line(const std::string& name, const Stretch& stretch,
                                                         std::int64_t sample, bool last) {
  const auto point = [](const sheet::Vec3d& v) { return nlohmann::json{v.x(), v.y(), v.z()}; };
  const nlohmann::ordered_json line{{"file", name},
                                    {"emitter", fmt::format("{:016x}", stretch.emitter)},
                                    {"sheet", stretch.sheet},
                                    {"kind", stretch.kind},
                                    {"sample", sample},
                                    {"position_m", point(stretch.position_m)},
                                    {"normal", point(stretch.normal)},
                                    {"last", last}};
  if (std::fprintf(lines_.get(), "%s\n", line.dump().c_str()) >= 0) return {};
  return tl::unexpected(fmt::format("{}: cannot be written; is the disk full?", (folder_ / "emitters.jsonl").string()));
}

tl::expected<void, std::string> EmitterFiles::close() {
  while (!open_.empty()) {
    Stretch end = open_.begin()->second.newest;
    end.first_sample = open_.begin()->second.next_sample;
    end.missing = 0;
    end.last = true;
    if (auto closed = add(end); !closed) return closed;
  }
  if (std::fflush(lines_.get()) != 0)
    return tl::unexpected(fmt::format("{}: cannot be written; is the disk full?", (folder_ / "emitters.jsonl").string()));
  return {};
}

}  // namespace rustle::apps
