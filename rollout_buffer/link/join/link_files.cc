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

std::string json_text(const json& object) {
  return object.dump(2, ' ', false, json::error_handler_t::replace) + "\n";
}

json read_json(const std::string& path) {
  const std::optional<std::string> text = read_file(path);
  return text ? json::parse(*text, nullptr, /*allow_exceptions=*/false) : json();
}

std::optional<FrameAccount> frames_in(const json& feed) {
  const auto frames = feed.find("frames");
  if (frames == feed.end() || !frames->is_object()) return std::nullopt;
  FrameAccount account;
  account.decisions = number_in(*frames, "decisions");
  account.raw_bytes = number_in(*frames, "bytes");
  account.sent_bytes = number_in(*frames, "bytes_sent");
  account.duplicates = number_in(*frames, "duplicates");
  account.is_compressed = flag_in(*frames, "is_compressed");
  account.latency_us_p50 = real_in(*frames, "latency_us_p50");
  account.latency_us_p90 = real_in(*frames, "latency_us_p90");
  account.latency_us_p99 = real_in(*frames, "latency_us_p99");
  return account;
}

}  // namespace

Status write_peers(const std::string& run_dir, const ServingFiles& files,
                   const std::vector<PeerRecord>& records) {
  json guests = json::array();
  for (const PeerRecord& record : records)
    guests.push_back({{"id", record.peer_id},
                      {"host", record.host},
                      {"is_here", record.is_here},
                      {"workers", record.workers},
                      {"credits", record.credits},
                      {"decisions_played", record.played_there},
                      {"decisions_delivered", record.decisions},
                      {"decisions_lost", record.lost_there},
                      {"trajectories", record.slabs},
                      {"duplicates", record.duplicates},
                      {"refused", record.refused},
                      {"missing", record.missing}});
  return write_file_atomically(run_dir + "/" + files.guests, json_text(json{{"guests", guests}}), false);
}

std::vector<PeerRecord> read_peers(const std::string& run_dir, const ServingFiles& files) {
  std::vector<PeerRecord> records;
  const json read = read_json(run_dir + "/" + files.guests);
  if (!read.is_object() || !read.contains("guests") || !read["guests"].is_array()) return records;
  for (const json& guest : read["guests"]) {
    if (!guest.is_object()) continue;
    PeerRecord record;
    record.host = text_in(guest, "host");
    record.peer_id = number_in(guest, "id");
    record.is_here = flag_in(guest, "is_here");
    record.workers = static_cast<int>(number_in(guest, "workers"));
    record.credits = number_in(guest, "credits");
    record.played_there = number_in(guest, "decisions_played");
    record.decisions = number_in(guest, "decisions_delivered");
    record.lost_there = number_in(guest, "decisions_lost");
    record.slabs = number_in(guest, "trajectories");
    record.duplicates = number_in(guest, "duplicates");
    record.refused = number_in(guest, "refused");
    record.missing = number_in(guest, "missing");
    records.push_back(std::move(record));
  }
  return records;
}

std::vector<PeerRecord> all_peers(const std::string& run_dir) {
  std::vector<PeerRecord> all = read_peers(run_dir, kTrajectoryFiles);
  for (PeerRecord& record : read_peers(run_dir, kFrameFiles)) all.push_back(std::move(record));
  return all;
}

Status write_feed(const std::string& run_dir, const Feed& feed) {
  const SenderAccount& account = feed.account;
  json written = {{"is_fed", feed.is_fed},
                  {"has_ended", feed.has_ended},
                  {"silent_s", feed.silent_s},
                  {"decisions_played", account.played},
                  {"decisions_delivered", account.delivered},
                  {"decisions_waiting", account.waiting},
                  {"decisions_unfinished", account.unfinished},
                  {"decisions_lost", account.lost},
                  {"resent", account.resent}};
  if (feed.frames)
    written["frames"] = {{"latency_us_p50", feed.frames->latency_us_p50},
                         {"latency_us_p90", feed.frames->latency_us_p90},
                         {"latency_us_p99", feed.frames->latency_us_p99},
                         {"decisions", feed.frames->decisions},
                         {"bytes", feed.frames->raw_bytes},
                         {"bytes_sent", feed.frames->sent_bytes},
                         {"duplicates", feed.frames->duplicates},
                         {"is_compressed", feed.frames->is_compressed}};
  return write_file_atomically(run_dir + "/" + kFeedFile, json_text(written), false);
}

std::optional<Feed> read_feed(const std::string& run_dir) {
  const json read = read_json(run_dir + "/" + kFeedFile);
  if (!read.is_object()) return std::nullopt;
  return Feed{.account = {.played = number_in(read, "decisions_played"),
                          .delivered = number_in(read, "decisions_delivered"),
                          .waiting = number_in(read, "decisions_waiting"),
                          .unfinished = number_in(read, "decisions_unfinished"),
                          .lost = number_in(read, "decisions_lost"),
                          .resent = number_in(read, "resent")},
              .is_fed = flag_in(read, "is_fed"),
              .has_ended = flag_in(read, "has_ended"),
              .silent_s = real_in(read, "silent_s"),
              .frames = frames_in(read)};
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
       {kTrajectoryFiles.guests, kTrajectoryFiles.leave, kFrameFiles.guests, kFrameFiles.leave, kFeedFile})
    unlink((run_dir + "/" + file).c_str());
}

}  // namespace comrad::link
