// `comrad keys`: makes the keys of a run and of the hosts that may join it, and looks at them.

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cstdio>
#include <ctime>
#include <filesystem>

#include "deploy/run/command.h"
#include "deploy/settings/command_line.h"
#include "deploy/settings/output_check.h"
#include "rollout_buffer/core/text.h"
#include "rollout_buffer/dds/keys.h"

namespace comrad::deploy {
namespace {

namespace fs = std::filesystem;

struct KeysOptions {
  std::string action, folder;
  std::vector<std::string> hosts;
  double days = dds::KeyRequest().days;
};

std::string day(int64_t at_s) {
  char text[32];
  const time_t when = at_s;
  std::tm parts{};
  gmtime_r(&when, &parts);
  std::strftime(text, sizeof text, "%Y-%m-%d", &parts);
  return text;
}

/// Prints a line for one identity; the error where it cannot be used.
Status show_identity(const std::string& folder) {
  COMRAD_TRY_ASSIGN(const dds::KeyIdentity identity, dds::check_keys(folder));
  std::printf("%-40s  %-4s  until %s  authority %s\n", folder.c_str(),
              identity.role == dds::KeyRole::kRun ? "run" : "host", day(identity.until_s).c_str(),
              identity.authority.c_str());
  return {};
}

/// All identities below a folder of keys, or the one that lies in it. Errors: the first that cannot be used, after all
/// were shown.
Status show(const std::string& folder) {
  std::error_code code;
  if (!fs::is_directory(folder + "/hosts", code)) return show_identity(folder);
  std::vector<std::string> hosts;
  for (const auto& entry : fs::directory_iterator(folder + "/hosts", code))
    hosts.push_back(entry.path().string());
  std::ranges::sort(hosts);
  hosts.insert(hosts.begin(), folder + "/run");
  Status result;
  for (const std::string& one : hosts) {
    const Status shown = show_identity(one);
    if (shown) continue;
    std::printf("%-40s  cannot be used: %s\n", one.c_str(), shown.error().message.c_str());
    if (result) result = shown;
  }
  return result;
}

Status run(const KeysOptions& options) {
  const std::vector<std::string> actions = {"make", "add", "show"};
  if (std::ranges::find(actions, options.action) == actions.end())
    return Error{ErrorCode::kBadInput, unknown_word("action", options.action, actions)};
  if (options.action == "show") return show(options.folder);
  if (options.days < 1 || options.days > dds::kMostKeyDays || options.days != static_cast<int>(options.days))
    return bad_value("days", real_text(options.days), fmt::format("1 to {} whole days", dds::kMostKeyDays));
  dds::KeyRequest request{
      .folder = options.folder, .hosts = options.hosts, .days = static_cast<int>(options.days)};
  COMRAD_TRY(options.action == "make" ? dds::make_keys(request) : dds::add_keys(request));
  COMRAD_TRY(show(options.folder));
  std::printf(
      "\nCopy each host's folder to it, and nothing else (scp -r %s/hosts/NAME NAME:). %s/run is for\n"
      "the host that serves. %s/authority signs new hosts: keep it where no other user can read it.\n",
      options.folder.c_str(), options.folder.c_str(), options.folder.c_str());
  return {};
}

}  // namespace

int keys_command(Arguments arguments) {
  KeysOptions options;
  CommandLine line(
      "keys (make | add | show) FOLDER [--hosts a,b] [--days 365]",
      "Makes the keys that let hosts share a run over a network (deploy/SECURITY.md). make: an authority, "
      "an\n"
      "identity for the host that serves (FOLDER/run) and for each host that joins (FOLDER/hosts/NAME). "
      "add:\n"
      "identities for more hosts. show: list the hosts and when their certificates expire; exit code 2 where "
      "one cannot be used.\n"
      "Nothing is ever replaced.");
  line.add_positional("ACTION", options.action, "make, add or show");
  line.add_positional("FOLDER", options.folder, "folder of the keys; show also takes one identity's folder");
  line.add_option("hosts", options.hosts, "NAMES", "hosts that may join; names are for people alone");
  line.add_option("days", options.days, "N", "how long they hold (default 365)");
  return run_command("keys", line, arguments, [&]() -> Expected<int> {
    COMRAD_TRY(run(options));
    return kExitDone;
  });
}

}  // namespace comrad::deploy
