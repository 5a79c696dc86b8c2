#include "rollout_buffer/link/join/link_files.h"

#include <unistd.h>

#include <cstdio>
#include <nlohmann/json.hpp>

#include "rollout_buffer/core/files.h"
#include "rollout_buffer/core/parts.h"
#include "rollout_buffer/link/join/json_members.h"

namespace comrad::link {
namespace {

using nlohmann::json;

// Each member of a file once, for writing and for reading.

template <typename Use>
void visit_members(PeerRecord& record, Use use) {
  use("id", record.peer_id);
  use("host", record.host);
  use("is_here", record.is_here);
  use("workers", record.workers);
  use("credits", record.credits);
  use("decisions_played", record.played_there);
  use("decisions_delivered", record.decisions);
  use("decisions_lost", record.lost_there);
  use("trajectories", record.slabs);
  use("duplicates", record.duplicates);
  use("refused", record.refused);
  use("missing", record.missing);
}

template <typename Use>
void visit_members(Feed& feed, Use use) {
  use("is_fed", feed.is_fed);
  use("has_ended", feed.has_ended);
  use("silent_s", feed.silent_s);
  use("decisions_played", feed.account.played);
  use("decisions_delivered", feed.account.delivered);
  use("decisions_waiting", feed.account.waiting);
  use("decisions_unfinished", feed.account.unfinished);
  use("decisions_lost", feed.account.lost);
  use("resent", feed.account.resent);
}

template <typename Use>
void visit_members(FrameAccount& account, Use use) {
  use("decisions", account.decisions);
  use("bytes", account.raw_bytes);
  use("bytes_sent", account.sent_bytes);
  use("duplicates", account.duplicates);
  use("is_compressed", account.is_compressed);
  use("latency_us_p50", account.latency_us_p50);
  use("latency_us_p90", account.latency_us_p90);
  use("latency_us_p99", account.latency_us_p99);
}

template <typename Record>
json json_of(Record record) {
  json object;
  visit_members(record, [&](const char* key, const auto& value) { object[key] = value; });
  return object;
}

template <typename Record>
Record record_in(const json& object) {
  Record record;
  visit_members(record, [&]<typename T>(const char* key, T& value) { value = member<T>(object, key); });
  return record;
}

Status write_json(const std::string& path, const json& object) {
  return write_file_atomically(path, object.dump(2, ' ', false, json::error_handler_t::replace) + "\n",
                               /*durable=*/false);
}

json read_json(const std::string& path) {
  const std::optional<std::string> text = read_file(path);
  return text ? json::parse(*text, nullptr, /*allow_exceptions=*/false) : json();
}

}  // namespace

Status write_peers(const std::string& run_dir, const ServingFiles& files,
                   const std::vector<PeerRecord>& records) {
  json peers = json::array();
  for (const PeerRecord& record : records) peers.push_back(json_of(record));
  return write_json(run_dir + "/" + files.peers, {{"guests", peers}});
}

std::vector<PeerRecord> read_peers(const std::string& run_dir, const ServingFiles& files) {
  std::vector<PeerRecord> records;
  const json read = read_json(run_dir + "/" + files.peers);
  if (!read.is_object() || !read.contains("guests") || !read["guests"].is_array()) return records;
  for (const json& peer : read["guests"])
    if (peer.is_object()) records.push_back(record_in<PeerRecord>(peer));
  return records;
}

std::vector<PeerRecord> all_peers(const std::string& run_dir) {
  std::vector<PeerRecord> all = read_peers(run_dir, kTrajectoryFiles);
  for (PeerRecord& record : read_peers(run_dir, kFrameFiles)) all.push_back(std::move(record));
  return all;
}

Status write_feed(const std::string& run_dir, const Feed& feed) {
  json written = json_of(feed);
  if (feed.frames) written["frames"] = json_of(*feed.frames);
  return write_json(run_dir + "/" + kFeedFile, written);
}

std::optional<Feed> read_feed(const std::string& run_dir) {
  const json read = read_json(run_dir + "/" + kFeedFile);
  if (!read.is_object()) return std::nullopt;
  Feed feed = record_in<Feed>(read);
  if (const auto frames = read.find("frames"); frames != read.end() && frames->is_object())
    feed.frames = record_in<FrameAccount>(*frames);
  return feed;
}

Status ask_to_leave(const std::string& run_dir, const std::string& host) {
  for (const ServingFiles& files : {kTrajectoryFiles, kFrameFiles}) {
    const std::string path = run_dir + "/" + files.leave;
    COMRAD_TRY(write_file_atomically(path, read_file(path).value_or("") + host + "\n", /*durable=*/false));
  }
  return {};
}

std::vector<std::string> take_hosts_to_leave(const std::string& run_dir, const ServingFiles& files) {
  // Moved away before it is read: a name that is written meanwhile stays for the next call.
  const std::string path = run_dir + "/" + files.leave, taken = path + ".taken";
  if (rename(path.c_str(), taken.c_str()) != 0) return {};
  const std::optional<std::string> text = read_file(taken);
  unlink(taken.c_str());
  return parts_of(text.value_or(""), '\n');
}

void remove_accounts(const std::string& run_dir) {
  for (const char* file :
       {kTrajectoryFiles.peers, kTrajectoryFiles.leave, kFrameFiles.peers, kFrameFiles.leave, kFeedFile})
    unlink((run_dir + "/" + file).c_str());
}

}  // namespace comrad::link
