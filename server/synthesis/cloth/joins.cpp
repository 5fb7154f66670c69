#include "server/synthesis/cloth/joins.h"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <limits>
#include <utility>

namespace rustle::cloth {
namespace {

bool alike(float a, float b) noexcept {
  return (a > 0 && b > 0) || (a < 0 && b < 0);
}

/// How many samples a run reaches beyond its units, and whether it fades over them.
struct Reach {
  std::int64_t samples = 0;
  bool fades = false;
};

/// How far a run steps where it reaches `samples` beyond its units, over the RMS step of the half unit that it sounds
/// beside.
template <class Outward>
double relative_step(const Outward& outward, std::int64_t samples, std::int64_t half_unit) {
  const auto step = [&](std::int64_t n) { return static_cast<double>(outward(n)) - static_cast<double>(outward(n - 1)); };
  double sum = 0;
  for (std::int64_t n = samples - 1; n > samples - half_unit; --n) sum += step(n) * step(n);
  const double largest = std::max(std::abs(static_cast<double>(outward(samples - 1))), std::abs(step(samples - 1)));
  return largest == 0 ? 0 : largest / std::sqrt(sum / static_cast<double>(half_unit - 1));
}

/// \param outward  the source's n-th sample beyond the run's units, inside of them where n is negative
/// \param there    samples that there are beyond
template <class Outward>
Reach reach_of(const Outward& outward, std::int64_t there, std::int64_t half_unit) {
  constexpr double kGentle = 1;
  const std::int64_t most = std::min(there, half_unit);
  Reach best{most, true};
  double least = std::numeric_limits<double>::infinity();
  for (std::int64_t n = 0; n <= most && least > kGentle; ++n) {
    if (n < there && alike(outward(n - 1), outward(n))) continue;
    const double step = relative_step(outward, n, half_unit);
    if (best.fades || step < least) best = {n, false};
    least = std::min(least, step);
  }
  return best;
}

}  // namespace

JoinedSource::JoinedSource(std::vector<std::span<const float>> recordings, std::uint32_t unit_samples)
    : recordings_(std::move(recordings)), unit_samples_(unit_samples) {
  assert(unit_samples >= 4);
  std::vector<std::array<std::size_t, 2>> faded;  // 2 unit + (0: its head, 1: its tail), and where in faded_
  for (const std::span<const float> recording : recordings_) {
    for (std::size_t begin = 0; begin + unit_samples <= recording.size(); begin += unit_samples) {
      begins_.push_back(begin == 0);
      extend(recording, begin, faded);
    }
  }
  for (const auto& [which, place] : faded) {
    Piece& piece = which % 2 == 0 ? heads_[which / 2] : tails_[which / 2];
    piece.samples = faded_.data() + place;
  }
}

void JoinedSource::extend(std::span<const float> recording, std::size_t begin,
                          std::vector<std::array<std::size_t, 2>>& places) {
  const std::size_t unit = units_.size(), finish = begin + unit_samples_;
  const float *first = recording.data() + begin, *end = first + unit_samples_;
  const auto half_unit = static_cast<std::int64_t>(unit_samples_ / 2);
  const Reach head = reach_of([&](std::int64_t n) { return first[-1 - n]; }, static_cast<std::int64_t>(begin), half_unit);
  const Reach tail =
      reach_of([&](std::int64_t n) { return end[n]; }, static_cast<std::int64_t>(recording.size() - finish), half_unit);
  units_.push_back(first);
  heads_.push_back(
      {first - head.samples, static_cast<std::uint32_t>(head.samples), -static_cast<std::int32_t>(head.samples)});
  tails_.push_back({end, static_cast<std::uint32_t>(tail.samples), static_cast<std::int32_t>(unit_samples_)});
  const auto fade = [](std::int64_t n, const Reach& reach) {
    return (static_cast<float>(n) + 0.5F) / static_cast<float>(reach.samples);
  };
  if (head.fades) {
    places.push_back({2 * unit, faded_.size()});
    for (std::int64_t n = 0; n < head.samples; ++n) faded_.push_back(first[n - head.samples] * fade(n, head));
  }
  if (tail.fades) {
    places.push_back({2 * unit + 1, faded_.size()});
    for (std::int64_t n = 0; n < tail.samples; ++n) faded_.push_back(end[n] * (1 - fade(n, tail)));
  }
}

void RunBuilder::Pieces::add(const Piece& piece) noexcept {
  if (piece.count == 0) return;
  if (count > 0) {
    Piece& last = pieces[count - 1];
    const auto length = static_cast<std::int32_t>(last.count);
    if (last.samples + last.count == piece.samples && last.offset + length == piece.offset) {
      last.count += piece.count;
      return;
    }
  }
  pieces[count++] = piece;
}

RunBuilder::Pieces RunBuilder::next(std::uint32_t unit) {
  Pieces out;
  if (!goes_on(unit)) {
    out = finish();
    out.begins = true;
    out.add(source_.before(unit));
  }
  out.add(source_.unit(unit));
  last_ = unit;
  return out;
}

RunBuilder::Pieces RunBuilder::finish() {
  Pieces out;
  if (last_ != kNoUnit) {
    Piece tail = source_.after(last_);
    tail.offset -= static_cast<std::int32_t>(source_.unit_samples());
    out.add(tail);
  }
  last_ = kNoUnit;
  return out;
}

std::vector<float> concatenated(const JoinedSource& source, std::span<const Choice> choices,
                                std::vector<std::int64_t>* joins) {
  std::vector<float> out(choices.size() * source.unit_samples());
  const auto length = static_cast<std::int64_t>(out.size());
  RunBuilder runs(source);
  const auto add = [&](const RunBuilder::Pieces& pieces, std::int64_t place) {
    for (const Piece& piece : pieces.all()) {
      for (std::int64_t k = 0; k < piece.count; ++k) {
        const std::int64_t at = place + piece.offset + k;
        if (at >= 0 && at < length) out[static_cast<std::size_t>(at)] += piece.samples[k];
      }
    }
  };
  for (std::size_t i = 0; i < choices.size(); ++i) {
    const auto place = static_cast<std::int64_t>(i * source.unit_samples());
    const auto pieces = runs.next(choices[i].unit);
    add(pieces, place);
    if (!joins || !pieces.begins) continue;
    if (i > 0) joins->push_back(place + source.after(choices[i - 1].unit).count);
    joins->push_back(place + source.before(choices[i].unit).offset);
  }
  add(runs.finish(), length);
  return out;
}

}  // namespace rustle::cloth
