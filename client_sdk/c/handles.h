#pragma once

#include <deque>
#include <optional>
#include <string>
#include <vector>

#include "client_sdk/c/rustle.h"
#include "client_sdk/cpp/connection.h"
#include "client_sdk/cpp/observation_reader.h"
#include "client_sdk/cpp/pcm_reader.h"
#include "client_sdk/cpp/session.h"

/// What the opaque handles of rustle.h are: an object of the C++ SDK, and what the newest answer points into.

struct rustle_connection {
  rustle::client::Connection connection;
};

struct rustle_session {
  rustle::client::Session session;
  std::deque<rustle::client::Notice> notices{};
  rustle::client::Notice told{};  ///< what the newest rustle_notice points into
  std::optional<rustle::client::Statistics> last{};
  std::vector<std::string> figure_names{};
  std::vector<rustle_figure> figures{};
};

struct rustle_reader {
  rustle::client::PcmReader reader;
  rustle::client::PcmBlock block{};
  rustle::client::Sound sound{};
  std::vector<rustle_gap> gaps{};
};

struct rustle_observer {
  rustle::client::ObservationReader reader;
  rustle::client::Observation observation{};
  std::deque<std::vector<rustle_resonator>> resonators{};
  std::vector<rustle_crumpling_event> crumpling{};
  std::vector<rustle_friction_contact> friction{};
};
