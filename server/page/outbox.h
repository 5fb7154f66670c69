#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "server/monitor/web_socket.h"

namespace rustle::page {

using Message = monitor::WebSocketMessage;

/// What a message cannot be understood without: sent before it, unless the viewer has it.
struct Needed {
  std::uint64_t place = 0;  ///< of it: what comes later for the same place replaces it
  Message message;
};
inline constexpr std::uint64_t kObstaclePlaces = std::uint64_t{1} << 32;  ///< of sheets' topologies: below

/// What one viewer is to be sent. Who reads slowly loses its own: the older of pictures and figures of which two wait
/// already, the oldest events, and PCM once a second of it waits. Never waits for the network. Any thread.
class Outbox {
 public:
  static constexpr std::size_t kPictures = 2;  ///< of a sheet, a scene, figures
  static constexpr std::size_t kEvents = 64;   ///< messages
  static constexpr double kPcm_s = 1;
  static constexpr std::size_t kTexts = 256;                    ///< hellos and notices
  static constexpr std::size_t kBytes = std::size_t{64} << 20;  ///< beyond, only texts are taken

  struct Lost {
    std::uint64_t pictures = 0, events = 0, pcm = 0;  ///< messages
  };

  /// Hellos and notices: none is lost. False: kTexts wait, the viewer is gone or asks without reading.
  bool add_text(std::string text);
  void add_figures(std::string text);
  void add_scene(std::shared_ptr<const std::string> text, std::vector<Needed> meshes);
  void add_frame(std::uint32_t place, std::shared_ptr<const std::string> frame, Needed topology);
  void add_events(std::shared_ptr<const std::string> text);
  void add_pcm(std::shared_ptr<const std::string> bytes, double length_s);
  /// Another session is watched, or none: what waits of the last one is dropped, and nothing of it is known any more.
  void forget_pictures();
  void forget_pcm();

  /// The next message to send; nothing: none waits.
  std::optional<Message> next();
  Lost lost() const;

 private:
  enum class Kind : std::uint8_t { kText, kFigures, kScene, kFrame, kEvents, kPcm };
  struct Waiting {
    Kind kind;
    std::uint32_t place = 0;
    Message message;
    std::vector<Needed> needed;
    double length_s = 0;
  };

  std::size_t count(Kind kind, std::uint32_t place) const;
  void drop_oldest(Kind kind, std::uint32_t place);
  /// Puts a picture behind what waits, in the place of an older one where kPictures do.
  void add_picture(Waiting picture);
  void put(Waiting waiting);
  void forget(bool (*is_one)(Kind kind));

  mutable std::mutex mutex_;
  std::deque<Waiting> waiting_;
  std::size_t bytes_ = 0;
  double pcm_s_ = 0;
  std::map<std::uint64_t, std::shared_ptr<const std::string>> has_;  ///< by place, what the viewer was sent
  Lost lost_;
};

}  // namespace rustle::page
