#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "server/session/session.h"
#include "server/sinks/opus_stream.h"
#include "server/wire/encode.h"
#include "server/wire/sockets.h"
#include "server/wire/topics.h"

namespace rustle::apps {

/// What a session's listeners hear: its PCM by topic, each encoded once however many listen. [network thread]
class PcmOutput {
 public:
  /// Both outlive it. The session is rendered in steps of as many blocks as its listeners want in a message, at most
  /// `most_blocks`.
  PcmOutput(session::Session& session, wire::Sockets& sockets, int most_blocks)
      : session_(session), sockets_(sockets), most_blocks_(most_blocks) {
    choose_steps();
  }

  /// Somebody listens to a topic of this session; `name` is the topic as it was subscribed to. What cannot be streamed is
  /// told.
  std::optional<wire::Notice> subscribe(const std::string& name, const wire::PcmTopic& topic);
  /// Nobody does any more.
  void unsubscribe(const std::string& name);

  /// The mix, as the session gave it.
  void publish(const session::AudioBlock& mix);
  /// What has come beside the mix. To be called after publish() of all that there was.
  void publish_beside();
  /// The last message of every topic.
  void publish_end();

  std::uint64_t samples_sent() const { return samples_sent_; }        ///< that somebody listened to
  std::uint64_t samples_in_gaps() const { return samples_in_gaps_; }  ///< of those, not taken by the socket
  std::uint64_t gaps() const { return gaps_; }                        ///< stretches of these
  /// Of the mix, that wait for a message to be full: the most on any topic.
  std::size_t mix_samples_waiting() const;

 private:
  using Content = decltype(wire::PcmHeader::content);

  /// Samples on their way to the listeners: a topic's, or one emitter's.
  struct Stream {
    std::size_t channels = 1;
    std::vector<float> waiting;
    std::int64_t first_sample = 0;  ///< that waits
    Content content;                ///< as it was at that sample
    std::uint64_t missing = 0;      ///< samples that the socket did not take since the last message
    std::unique_ptr<sinks::OpusStream> opus;
  };
  struct Out {
    wire::PcmTopic topic;
    std::uint64_t sequence = 0;
    std::map<std::uint64_t, Stream> streams;  ///< by emitter; of the mix and a stem one, by 0
  };
  struct Stem {
    std::shared_ptr<session::StemTap> tap;
    std::int64_t taken = 0;
    int topics = 0;
  };
  struct Emitters {
    std::shared_ptr<session::EmitterTap> tap;
    int topics = 0;
  };
  using StemKey = std::pair<sheet::SheetId, synthesis::SoundKind>;

  static StemKey key_of(const wire::PcmTopic& topic) { return {topic.sheet_id, topic.kind}; }
  void choose_steps();
  /// What a message lacks that is as long as a step of rendering would come a whole step later: it is sent as it is. Once is
  /// enough, where a listener began to listen.
  void end_messages_with_steps();
  /// False: as many stems as there may be are listened to.
  bool open(const wire::PcmTopic& topic);
  void close(const wire::PcmTopic& topic);
  std::size_t channels() const;
  void end(Out& out);
  void publish_stems();
  void publish_emitters();
  void publish(Out& out, const session::EmitterQuantum& quantum);
  /// Takes in samples that lie where the last ones ended, or begin the stream.
  void add(Out& out, Stream& stream, const Content& now, std::int64_t first_sample, std::span<const float> interleaved);
  /// What is whole, and the rest where the stream has ended.
  void send(Out& out, Stream& stream, const Content& now, bool all);
  void send_samples(Out& out, Stream& stream, const Content& now, bool all);
  void send_packets(Out& out, Stream& stream, const Content& now, bool all);
  wire::PcmHeader header_of(const Out& out, const Stream& stream, bool last) const;
  /// Hands an encoded message of so many samples to the socket.
  void hand_over(const Out& out, Stream& stream, const std::string& message, std::uint64_t samples);

  session::Session& session_;
  wire::Sockets& sockets_;
  const int most_blocks_;
  int step_blocks_ = 1;
  std::map<std::string, Out> outs_;  ///< by topic
  std::map<StemKey, Stem> stems_;
  Emitters emitters_;
  std::vector<float> samples_;
  std::uint64_t samples_sent_ = 0;
  std::uint64_t samples_in_gaps_ = 0;
  std::uint64_t gaps_ = 0;
};

}  // namespace rustle::apps
