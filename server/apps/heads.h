#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include <tl/expected.hpp>

#include "server/session/session_options.h"
#include "server/spatial/hrtf.h"
#include "server/wire/error.h"

namespace rustle::apps {

/// The heads with which a daemon's binaural sessions may hear. A session chooses by name among those that the operator named
/// (a SOFA file by its stem), "kemar" where it is installed, and "structural"; what a session says never opens a file.
class Heads {
 public:
  /// Loads all of them at `rate_hz`. `chosen`: the operator's, "structural", "kemar" or SOFA files; the first is the
  /// default. Error: a sentence that names flag, file and remedy.
  static tl::expected<Heads, std::string> open(const std::vector<std::string>& chosen, std::uint32_t rate_hz);

  /// What a session hears with that names none.
  const std::string& default_name() const { return offers_.front().name; }

  /// The head that a session asks for; null where its sound is not binaural. Another rate than open()'s is made ready once.
  tl::expected<std::shared_ptr<const spatial::Hrtf>, wire::Error> head_for(const session::SessionOptions& options);

 private:
  struct Offer {
    std::string name, source;
  };
  std::vector<Offer> offers_;                                                                   ///< the default first
  std::map<std::pair<std::string, std::uint32_t>, std::shared_ptr<const spatial::Hrtf>> held_;  ///< by source and rate
};

}  // namespace rustle::apps
