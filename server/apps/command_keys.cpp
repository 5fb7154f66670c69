#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <cstdlib>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <system_error>

#include "client_sdk/cpp/certificate.h"
#include "server/access/allowed_key.h"
#include "server/access/certificate_file.h"
#include "server/apps/command.h"

/// Who may connect to a daemon: pairs of keys, and the folder of those that it admits.
namespace rustle::apps {
namespace {

namespace fs = std::filesystem;

constexpr const char* kReload =
    "A rustled that runs takes it over on SIGHUP: systemctl reload rustled, or pkill -HUP rustled.";

struct KeysArguments {
  std::string folder, name, file;
  access::AllowedKey key;
  bool json = false;
};

std::string default_folder() {
  if (const char* named = std::getenv("RUSTLE_KEYS"); named != nullptr && *named != '\0') return named;
  if (const char* own = std::getenv("XDG_CONFIG_HOME"); own != nullptr && *own != '\0')
    return (fs::path(own) / "rustle/keys").string();
  if (const char* home = std::getenv("HOME")) return (fs::path(home) / ".config/rustle/keys").string();
  return "keys";
}

std::string text_of(const client::Error& error) {
  return fmt::format("{}: {} {}", error.field, error.message, error.remedy);
}

/// Nothing: the folder is there. Others may look into it: a daemon's user reads who is allowed, secrets have modes of their
/// own.
std::optional<std::string> make_folder(const fs::path& folder) {
  std::error_code failed;
  fs::create_directories(folder, failed);
  if (!failed) return std::nullopt;
  return fmt::format("{}: the folder cannot be made: {}; name another with --folder", folder.string(), failed.message());
}

int run_new(const KeysArguments& arguments) {
  if (!access::is_key_name(arguments.name))
    return complain(arguments.name + " is no name; use letters, digits, dots, dashes and underscores", kWrongUsage);
  if (auto failed = make_folder(arguments.folder)) return complain(*failed, kFailed);
  const fs::path file = fs::path(arguments.folder) / (arguments.name + ".key");
  const fs::path secret = file.string() + "_secret";
  std::error_code failed;
  if (fs::exists(secret, failed) || fs::exists(file, failed))
    return complain(fmt::format("{} is there already; choose another name, or remove the pair", file.string()), kFailed);
  const auto pair = client::make_certificate();
  if (!pair) return complain(text_of(pair.error()), kFailed);
  if (const auto written = access::write_certificate(secret, *pair, true); !written)
    return complain(text_of(written.error()), kFailed);
  if (const auto written = access::write_certificate(file, *pair, false); !written)
    return complain(text_of(written.error()), kFailed);
  fmt::print("{}: for others\n{}: for nobody else\n", file.string(), secret.string());
  return kDone;
}

int run_allow(KeysArguments arguments) {
  const fs::path file = arguments.file;
  arguments.key.name = arguments.name.empty() ? file.stem().string() : arguments.name;
  if (!access::is_key_name(arguments.key.name))
    return complain(
        arguments.key.name + " is no name; give one of letters, digits, dots, dashes and underscores with --name",
        kWrongUsage);
  if (arguments.key.permissions == access::Permissions{})
    return complain("say what the key may: --publish, --listen or --admin", kWrongUsage);
  // What its file says of permissions is its holder's wish, not ours.
  const auto certificate = client::read_certificate(file);
  if (!certificate) return complain(text_of(certificate.error()), kFailed);
  arguments.key.public_key = certificate->public_key;
  const auto known = access::AllowedKeys::read(arguments.folder);
  if (!known) return complain(known.error(), kFailed);
  if (const auto* same = known->find(certificate->public_key); same != nullptr && same->name != arguments.key.name)
    return complain(fmt::format("this key is allowed already, as {}; revoke that first, or change it with --name {}",
                                same->name, same->name),
                    kFailed);
  const fs::path allowed = access::allowed_file(arguments.folder, arguments.key.name);
  if (auto failed = make_folder(arguments.folder)) return complain(*failed, kFailed);
  if (auto failed = make_folder(allowed.parent_path())) return complain(*failed, kFailed);
  if (const auto written = access::write_certificate(allowed, access::certificate_of(arguments.key), false); !written)
    return complain(text_of(written.error()), kFailed);
  fmt::print("{} may {}\n{}\n", arguments.key.name, access::text_of(arguments.key.permissions), kReload);
  return kDone;
}

int run_list(const KeysArguments& arguments) {
  const auto keys = access::AllowedKeys::read(arguments.folder);
  if (!keys) return complain(keys.error(), kFailed);
  auto list = nlohmann::ordered_json::array();
  for (const auto& [public_key, key] : keys->all()) {
    nlohmann::ordered_json quotas = nlohmann::ordered_json::object();
    std::string text;
    for (const auto& [name, member] : access::quota_list()) {
      if (key.quotas.*member == 0) continue;
      quotas[std::string(name)] = key.quotas.*member;
      text += fmt::format(" {}={}", name, key.quotas.*member);
    }
    list.push_back({{"name", key.name},
                    {"public_key", public_key},
                    {"permissions", access::text_of(key.permissions)},
                    {"quotas", quotas}});
    if (!arguments.json) fmt::print("{:<20} {}  {}{}\n", key.name, public_key, access::text_of(key.permissions), text);
  }
  if (arguments.json) fmt::print("{}\n", list.dump());
  return kDone;
}

int run_revoke(const KeysArguments& arguments) {
  std::error_code failed;
  const fs::path file = access::allowed_file(arguments.folder, arguments.name);
  if (!access::is_key_name(arguments.name) || !fs::remove(file, failed))
    return complain(failed ? fmt::format("{}: {}", file.string(), failed.message())
                           : fmt::format("no key {} is allowed in {}; `rustle keys list` shows those that are",
                                         arguments.name, arguments.folder),
                    kFailed);
  fmt::print("{} is revoked\n{} Its sessions end then.\n", arguments.name, kReload);
  return kDone;
}

}  // namespace

void add_keys(CLI::App& app, Action& action) {
  auto* keys = app.add_subcommand("keys", "Who may connect to a daemon that is reached from elsewhere");
  keys->require_subcommand(1);
  keys->footer(
      "Example: rustle keys new server --folder server-keys         # the daemon's own pair\n"
      "         rustle keys new flag --folder my-keys               # a client's pair\n"
      "         rustle keys allow my-keys/flag.key --publish --listen --sessions 4 --folder server-keys\n"
      "         cp server-keys/server.key my-keys/                  # what the client knows the daemon by\n"
      "         rustled --keys server-keys --control tcp://0.0.0.0:7390 --stream tcp://0.0.0.0:7391 --out "
      "tcp://0.0.0.0:7392\n"
      "         rustle listen --keys my-keys --control tcp://HOST:7390 -o heard.wav");
  const auto folder = [](CLI::App& command, KeysArguments& arguments, const char* meaning) {
    arguments.folder = default_folder();
    command.add_option("--folder", arguments.folder, meaning)->capture_default_str();
  };

  auto made = std::make_shared<KeysArguments>();
  auto* make = keys->add_subcommand("new", "Make a pair: NAME.key for others, NAME.key_secret for nobody else");
  make->footer("Example: rustle keys new flag\nThe layout is that of pyzmq's certificates.");
  make->add_option("NAME", made->name, "The pair's name; a daemon's own is called server")->required();
  folder(*make, *made, "Where to put it");
  make->callback([made, &action] { action = [made] { return run_new(*made); }; });

  auto allowed = std::make_shared<KeysArguments>();
  auto* allow = keys->add_subcommand("allow", "Let a key connect to a daemon, or change what it may");
  allow->footer("Example: rustle keys allow flag.key --publish --sessions 4 --frames-per-s 480 --folder /etc/rustle/keys");
  allow->add_option("FILE", allowed->file, "The public key, NAME.key")->required();
  allow->add_option("--name", allowed->name, "What to call it; the file's name when absent");
  allow->add_flag("--publish", allowed->key.permissions.publish,
                  "Attach sessions, send their streams, hear and change its own");
  allow->add_flag("--listen", allowed->key.permissions.listen, "Hear every session");
  allow->add_flag("--admin", allowed->key.permissions.admin, "Both, and change, record and end every session");
  access::Quotas& quotas = allowed->key.quotas;
  allow->add_option("--sessions", quotas.sessions, "Sessions at a time; 0: as many as the daemon has")
      ->capture_default_str();
  allow->add_option("--triangles", quotas.triangles, "Triangles of its sessions' meshes; 0: no limit")
      ->capture_default_str();
  allow->add_option("--bytes-per-s", quotas.bytes_per_s, "Bytes of its streams a second; 0: no limit")
      ->capture_default_str();
  allow->add_option("--frames-per-s", quotas.frames_per_s, "Frames a second; 0: no limit")->capture_default_str();
  allow->add_option("--voices", quotas.voices, "Voices of each of its sessions; 0: 512")->capture_default_str();
  folder(*allow, *allowed, "The daemon's folder of keys");
  allow->callback([allowed, &action] { action = [allowed] { return run_allow(*allowed); }; });

  auto listed = std::make_shared<KeysArguments>();
  auto* list = keys->add_subcommand("list", "Keys that may connect, and what they may");
  list->footer("Example: rustle keys list --folder /etc/rustle/keys --json");
  list->add_flag("--json", listed->json, "Print as JSON");
  folder(*list, *listed, "The daemon's folder of keys");
  list->callback([listed, &action] { action = [listed] { return run_list(*listed); }; });

  auto revoked = std::make_shared<KeysArguments>();
  auto* revoke = keys->add_subcommand("revoke", "Let a key connect no more, and end its sessions");
  revoke->footer("Example: rustle keys revoke flag --folder /etc/rustle/keys && systemctl reload rustled");
  revoke->add_option("NAME", revoked->name, "Its name, as `rustle keys list` shows it")->required();
  folder(*revoke, *revoked, "The daemon's folder of keys");
  revoke->callback([revoked, &action] { action = [revoked] { return run_revoke(*revoked); }; });
}

}  // namespace rustle::apps
