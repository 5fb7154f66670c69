#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <span>
#include <vector>

namespace rustle::cloth {

/// A vertex in contact.
struct ContactSample {
  std::uint32_t vertex = 0;
  float speed_m_per_s = 0;  ///< at which it slides, 0 or more
  float area_m2 = 0;        ///< of its contact
  std::uint32_t patch = 0;  ///< of the sheet, that it belongs to
};

/// How fast every vertex in contact slides, through time: s_v(t) of An et al. 2012, section 2 (C1). Between frames a
/// monotone cubic; zero without contact; zero until a vertex has been faster than s_thresh for the first time, live and
/// offline alike. Times are samples. [analysis worker]
class ContactTrack {
 public:
  explicit ContactTrack(double speed_threshold_m_per_s) : threshold_m_per_s_(speed_threshold_m_per_s) {}

  /// The contacts at a time, one sample per vertex. \pre times rise
  void add(std::int64_t at, std::vector<ContactSample> contacts);

  /// The mesh has been made anew: vertex v of the new one lies where origins[v] of the old one did. What is known goes along
  /// with the material.
  void renumber(std::span<const std::uint32_t> origins);
  /// The mesh has been made anew, and nothing is known of its vertices: each has slid all the time as it will in the next
  /// frame.
  void forget_vertices();

  /// Where the track can no longer change: the newest frame but one. Nothing is known without two frames.
  bool settled_at(std::int64_t time) const noexcept { return frames_.size() >= 2 && time <= frames_[frames_.size() - 2].at; }
  /// \pre not empty for newest()
  bool empty() const noexcept { return frames_.empty(); }
  std::int64_t newest() const noexcept { return frames_.back().at; }

  /// Calls visit(sample) for every vertex that slides at a time, its speed and area as they are then, by rising vertex.
  /// Before the first frame and after the newest one they are held. Returns whether there were any.
  bool at(std::int64_t time, const std::function<void(const ContactSample&)>& visit) const;

  /// Times before this one will not be asked for.
  void forget(std::int64_t before);

 private:
  struct Frame {
    std::int64_t at = 0;
    std::vector<ContactSample> contacts;  ///< by rising vertex
  };

  static constexpr float kNoArea = -1;  ///< of a sample of another mesh: that of its neighbour in time counts

  double threshold_m_per_s_;
  std::vector<std::uint8_t> moved_;  ///< [vertex] it has been faster than the threshold
  std::deque<Frame> frames_;
  bool held_back_ = false;  ///< the next frame's speeds hold for the one before, too
};

}  // namespace rustle::cloth
