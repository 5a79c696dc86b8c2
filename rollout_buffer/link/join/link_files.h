// What both ends of a link leave in their run's folder once a second: the account of what was played, delivered and lost,
// for the supervisor and for people. Stage: beside the flow.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/link/session/accounts.h"

namespace comrad::link {

/// What an end of a link on the learner's host writes and reads.
struct ServingFiles {
  const char* peers;  ///< how each host stands
  const char* leave;  ///< a line for each host that is to leave
};
constexpr ServingFiles kTrajectoryFiles = {"guests.json", "hosts_to_leave.txt"};
constexpr ServingFiles kFrameFiles = {"frame_guests.json", "frame_hosts_to_leave.txt"};
constexpr const char* kFeedFile = "feed.json";  ///< of a run that joined another

/// Errors: kNoSpace, kSystem.
Status write_peers(const std::string& run_dir, const ServingFiles& files,
                   const std::vector<PeerRecord>& records);

/// How a host stands that feeds another one's learner.
struct Feed {
  SenderAccount account;
  bool is_fed = false;                      ///< the run has a place for it
  bool has_ended = false;                   ///< the run is over
  double silent_s = 0;                      ///< since something was heard of the learner's host
  std::optional<FrameAccount> frames = {};  ///< where its policy plays with this host, frame by frame
};
Status write_feed(const std::string& run_dir, const Feed& feed);
/// What write_feed() wrote; nothing where that is not there or damaged.
std::optional<Feed> read_feed(const std::string& run_dir);
/// What write_peers() wrote; empty where that is not there or damaged.
std::vector<PeerRecord> read_peers(const std::string& run_dir, const ServingFiles& files);
/// Of both links.
std::vector<PeerRecord> all_peers(const std::string& run_dir);

/// A host that plays is to leave; both ends on the learner's host hear of it within a second. Errors: kNoSpace, kSystem.
Status ask_to_leave(const std::string& run_dir, const std::string& host);
/// The names that ask_to_leave() wrote since the last call, once.
std::vector<std::string> take_hosts_to_leave(const std::string& run_dir, const ServingFiles& files);

/// Away with the accounts of an earlier life of this run.
void remove_accounts(const std::string& run_dir);

}  // namespace comrad::link
