#include "server/synthesis/cloth/joins.h"

#include <algorithm>
#include <cassert>
#include <utility>

namespace rustle::cloth {
namespace {

bool alike(float a, float b) noexcept {
  return (a > 0 && b > 0) || (a < 0 && b < 0);
}

}  // namespace

JoinedSource::JoinedSource(std::vector<std::span<const float>> recordings, std::uint32_t unit_samples)
    : recordings_(std::move(recordings)), unit_samples_(unit_samples) {
  assert(unit_samples >= 2);
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
  const std::size_t unit = units_.size(), finish = begin + unit_samples_, reach = unit_samples_ / 2;
  std::size_t a = begin;
  const std::size_t low = begin - std::min(reach, begin);
  while (a > low && alike(recording[a], recording[a - 1])) --a;
  std::size_t b = finish;
  const std::size_t high = std::min(recording.size(), finish + reach);
  while (b < high && alike(recording[b - 1], recording[b])) ++b;
  const auto before = static_cast<std::uint32_t>(begin - a), after = static_cast<std::uint32_t>(b - finish);
  units_.push_back(recording.data() + begin);
  heads_.push_back({recording.data() + a, before, -static_cast<std::int32_t>(before)});
  tails_.push_back({recording.data() + finish, after, static_cast<std::int32_t>(unit_samples_)});
  if (before > 0 && a > 0 && alike(recording[a], recording[a - 1])) {
    places.push_back({2 * unit, faded_.size()});
    for (std::uint32_t k = 0; k < before; ++k)
      faded_.push_back(recording[a + k] * ((static_cast<float>(k) + 0.5F) / static_cast<float>(before)));
  }
  if (after > 0 && b < recording.size() && alike(recording[b - 1], recording[b])) {
    places.push_back({2 * unit + 1, faded_.size()});
    for (std::uint32_t k = 0; k < after; ++k)
      faded_.push_back(recording[finish + k] * (1 - (static_cast<float>(k) + 0.5F) / static_cast<float>(after)));
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
