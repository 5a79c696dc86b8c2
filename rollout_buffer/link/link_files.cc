#include "rollout_buffer/link/link_files.h"

#include <unistd.h>

#include <nlohmann/json.hpp>

#include "rollout_buffer/core/files.h"
#include "rollout_buffer/core/parts.h"

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

uint64_t number_in(const json& object, const char* key) {
  const auto found = object.find(key);
  return found != object.end() && found->is_number_unsigned() ? found->get<uint64_t>() : 0;
}
bool flag_in(const json& object, const char* key) {
  const auto found = object.find(key);
  return found != object.end() && found->is_boolean() && found->get<bool>();
}

}  // namespace

Status write_offer(const std::string& run_dir, const Offer& offer) {
  return write_file_atomically(run_dir + "/" + kOfferFile, text_of(offer, /*with_paths=*/true) + "\n",
                               /*durable=*/false);
}

Expected<Offer> read_offer(const std::string& run_dir) {
  const std::string path = run_dir + "/" + kOfferFile;
  const std::optional<std::string> text = read_file(path);
  if (!text) return Error{ErrorCode::kNotFound, path + ": cannot be read; start the run again"};
  Expected<Offer> offer = parse_offer(*text);
  if (!offer) return Error{offer.error().code, path + ": " + offer.error().message};
  return offer;
}

Status write_guests(const std::string& run_dir, const std::vector<FeederRecord>& records) {
  json guests = json::array();
  for (const FeederRecord& record : records)
    guests.push_back({{"id", record.feeder_id},
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
                      {"missing", record.missing_rollouts}});
  return write_file_atomically(run_dir + "/" + kGuestsFile, json_text(json{{"guests", guests}}), false);
}

std::vector<FeederRecord> read_guests(const std::string& run_dir) {
  std::vector<FeederRecord> records;
  const json read = read_json(run_dir + "/" + kGuestsFile);
  if (!read.is_object() || !read.contains("guests") || !read["guests"].is_array()) return records;
  for (const json& guest : read["guests"]) {
    if (!guest.is_object()) continue;
    FeederRecord record;
    if (const auto host = guest.find("host"); host != guest.end() && host->is_string())
      record.host = host->get<std::string>();
    record.feeder_id = number_in(guest, "id");
    record.is_here = flag_in(guest, "is_here");
    record.workers = static_cast<int>(number_in(guest, "workers"));
    record.credits = number_in(guest, "credits");
    record.played_there = number_in(guest, "decisions_played");
    record.decisions = number_in(guest, "decisions_delivered");
    record.lost_there = number_in(guest, "decisions_lost");
    record.slabs = number_in(guest, "trajectories");
    record.duplicates = number_in(guest, "duplicates");
    record.refused = number_in(guest, "refused");
    record.missing_rollouts = number_in(guest, "missing");
    records.push_back(std::move(record));
  }
  return records;
}

Status write_feed(const std::string& run_dir, const Feed& feed) {
  const FeederAccount& account = feed.account;
  return write_file_atomically(run_dir + "/" + kFeedFile,
                               json_text(json{{"is_fed", feed.is_fed},
                                              {"has_ended", feed.has_ended},
                                              {"silent_s", feed.silent_s},
                                              {"decisions_played", account.played},
                                              {"decisions_delivered", account.delivered},
                                              {"decisions_waiting", account.waiting},
                                              {"decisions_unfinished", account.unfinished},
                                              {"decisions_lost", account.lost},
                                              {"trajectories_resent", account.resent}}),
                               false);
}

std::optional<Feed> read_feed(const std::string& run_dir) {
  const json read = read_json(run_dir + "/" + kFeedFile);
  if (!read.is_object()) return std::nullopt;
  return Feed{.account = {.played = number_in(read, "decisions_played"),
                          .delivered = number_in(read, "decisions_delivered"),
                          .waiting = number_in(read, "decisions_waiting"),
                          .unfinished = number_in(read, "decisions_unfinished"),
                          .lost = number_in(read, "decisions_lost"),
                          .resent = number_in(read, "trajectories_resent")},
              .is_fed = flag_in(read, "is_fed"),
              .has_ended = flag_in(read, "has_ended"),
              .silent_s = read.contains("silent_s") && read["silent_s"].is_number()
                              ? read["silent_s"].get<double>()
                              : 0.0};
}

Status ask_to_leave(const std::string& run_dir, const std::string& host) {
  const std::string path = run_dir + "/" + kLeaveFile;
  return write_file_atomically(path, read_file(path).value_or("") + host + "\n", /*durable=*/false);
}

std::vector<std::string> take_hosts_to_leave(const std::string& run_dir) {
  const std::string path = run_dir + "/" + kLeaveFile;
  const std::optional<std::string> text = read_file(path);
  if (!text) return {};
  unlink(path.c_str());
  return parts_of(*text, '\n');
}

void remove_accounts(const std::string& run_dir) {
  for (const char* file : {kGuestsFile, kFeedFile, kLeaveFile}) unlink((run_dir + "/" + file).c_str());
}

}  // namespace comrad::link
