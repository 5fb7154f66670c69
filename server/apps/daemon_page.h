#pragma once

#include <memory>
#include <string>
#include <vector>

#include "server/apps/daemon.h"
#include "server/page/page.h"

namespace rustle::apps {

/// What the page may ask of a daemon: what the control socket would let the same key do. [network thread]
class DaemonPage final : public page::Host {
 public:
  /// The daemon outlives it.
  explicit DaemonPage(Daemon& daemon) : daemon_(daemon) {}

  page::Figures figures(const std::vector<std::string>& users) override;
  page::Rights rights(const std::string& user) override;
  bool asks_for_keys() const override { return daemon_.options_.gate != nullptr; }
  tl::expected<std::string, std::string> user_of(const std::string& secret) override;
  Done watch(const std::string& session, std::shared_ptr<session::Watch> watch) override;
  Done may_listen(const std::string& user, const std::string& session) override;
  Done set_gain(const std::string& user, const std::string& session, const synthesis::Gain& gain) override;
  Done move_listener(const std::string& user, const std::string& session, const sheet::Vec3d& position_m) override;

 private:
  /// As the control socket would answer.
  Done ask(const std::string& user, const wire::ControlRequest& request);
  /// What the user may do with this session.
  page::Rights rights(const std::string& user, const Daemon::Guest& guest) const;
  page::SessionFigures figures_of(Daemon::Guest& guest) const;

  Daemon& daemon_;
};

}  // namespace rustle::apps
