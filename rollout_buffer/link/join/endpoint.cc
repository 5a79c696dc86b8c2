#include "rollout_buffer/link/join/endpoint.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cstdlib>
#include <nlohmann/json.hpp>
#include <optional>
#include <span>

#include "rollout_buffer/core/checksum.h"
#include "rollout_buffer/core/clock.h"
#include "rollout_buffer/core/files.h"
#include "rollout_buffer/link/join/json_members.h"

namespace comrad::link {
namespace {

using nlohmann::json;

constexpr double kAskAgainS = 1.0;
constexpr uint64_t kMostOfferBytes = 4 << 20;
constexpr uint64_t kMostFileBytes = 256 << 20;
constexpr std::size_t kMostFiles = 4096;

std::string hex(uint64_t number) { return fmt::format("{:016x}", number); }
uint64_t hex_in(const json& object, const char* key) {
  return std::strtoull(member<std::string>(object, key).c_str(), nullptr, 16);
}

/// "config.toml", "layouts/map.wad": words without a way out of the folder.
bool is_plain_name(const std::string& name) {
  if (name.empty() || name.size() > 200 || name[0] == '/' || name[0] == '.') return false;
  if (name.find("/.") != std::string::npos || name.find("//") != std::string::npos) return false;
  return std::ranges::all_of(name, [](unsigned char c) {
    return std::isalnum(c) || c == '_' || c == '-' || c == '.' || c == '/' || c == '+';
  });
}

uint64_t checksum_of(const std::string& text) { return checksum64(std::as_bytes(std::span(text))); }

}  // namespace

std::string text_of(const Offer& offer, bool with_paths) {
  json files = json::array();
  for (const OfferedFile& file : offer.files) {
    json entry = {{"name", file.name}, {"bytes", file.bytes}, {"checksum", hex(file.checksum)}};
    if (with_paths) entry["path"] = file.path;
    files.push_back(std::move(entry));
  }
  return json{{"scenario", offer.scenario},
              {"scenario_checksum", hex(offer.scenario_checksum)},
              {"iwad_checksum", hex(offer.iwad_checksum)},
              {"frame_workers", offer.frame_workers},
              {"has_cuda", offer.has_cuda},
              {"files", files}}
      .dump();
}

Expected<Offer> parse_offer(const std::string& text) {
  const auto bad = [](const std::string& what) {
    return Error{ErrorCode::kBadFormat, "a run's offer " + what};
  };
  const json object = json::parse(text, nullptr, /*allow_exceptions=*/false);
  if (!object.is_object() || !object.contains("files") || !object["files"].is_array())
    return bad("is no object with files");
  Offer offer;
  offer.scenario = member<std::string>(object, "scenario");
  offer.scenario_checksum = hex_in(object, "scenario_checksum");
  offer.iwad_checksum = hex_in(object, "iwad_checksum");
  offer.frame_workers = member<uint64_t>(object, "frame_workers");
  offer.has_cuda = member<bool>(object, "has_cuda");
  if (!is_plain_name(offer.scenario) || offer.scenario.find('/') != std::string::npos)
    return bad("names no scenario");
  if (object["files"].size() > kMostFiles) return bad("has too many files");
  for (const json& entry : object["files"]) {
    if (!entry.is_object()) return bad("has a file without a name");
    OfferedFile file{.name = member<std::string>(entry, "name"),
                     .path = member<std::string>(entry, "path"),
                     .bytes = member<uint64_t>(entry, "bytes"),
                     .checksum = hex_in(entry, "checksum")};
    if (!is_plain_name(file.name)) return bad("has a file of the name '" + file.name.substr(0, 80) + "'");
    if (file.bytes > kMostFileBytes) return bad(fmt::format("has a file of {} bytes", file.bytes));
    offer.files.push_back(std::move(file));
  }
  return offer;
}

uint64_t fingerprint_of(const Offer& offer) { return checksum_of(text_of(offer, false)); }

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

dds::JoinAnswer JoinEndpoint::answer(const dds::JoinQuestion& question) const {
  dds::JoinAnswer answer{.peer_id = question.peer_id, .question_id = question.question_id};
  const auto refuse = [&](const std::string& why) {
    answer.text = json{{"error", why}}.dump();
    return answer;
  };
  const json asked = json::parse(question.text, nullptr, /*allow_exceptions=*/false);
  if (!asked.is_object()) return refuse("the question is no JSON object");
  if (member<uint64_t>(asked, "protocol") != kJoinProtocol ||
      member<uint64_t>(asked, "link") != dds::kLinkVersion)
    return refuse(fmt::format(
        "this host speaks join protocol {} and link version {}, the one that joins {} and {}; install the "
        "same version on both",
        kJoinProtocol, dds::kLinkVersion, member<uint64_t>(asked, "protocol"),
        member<uint64_t>(asked, "link")));
  const std::string what = member<std::string>(asked, "ask"), name = member<std::string>(asked, "name");
  std::optional<std::string> bytes;
  if (what == "ping") {
    answer.text = json{{"time_s", wall_s()}}.dump();
    answer.payload.resize(std::min<uint64_t>(member<uint64_t>(asked, "bytes"), dds::kChunkBytes));
    return answer;
  }
  if (what == "offer") {
    bytes = text_;
  } else if (what == "file") {
    const auto found = std::ranges::find(offer_.files, name, &OfferedFile::name);
    if (found == offer_.files.end()) return refuse("no file of that name is offered");
    bytes = read_file(found->path);
    if (!bytes || bytes->size() != found->bytes || checksum_of(*bytes) != found->checksum)
      return refuse(name + " has changed since the run began; restart the run that serves");
  } else {
    return refuse("the question is neither for an offer nor a file nor a ping");
  }
  const uint64_t offset = std::min<uint64_t>(member<uint64_t>(asked, "offset"), bytes->size());
  answer.text = json{{"bytes", bytes->size()}, {"offset", offset}}.dump();
  answer.payload = bytes->substr(offset, dds::kChunkBytes);
  return answer;
}

struct JoinClient::Said {
  json text;
  std::string payload;
};

Expected<double> JoinClient::ping(std::size_t bytes) {
  COMRAD_TRY_ASSIGN(const Said said, ask("ping", "", bytes));
  const auto time = said.text.find("time_s");
  if (time == said.text.end() || !time->is_number() || said.payload.size() != bytes)
    return Error{ErrorCode::kBadFormat, "the answer to a ping has no time, or another length"};
  return time->get<double>();
}

/// `number` is how many bytes of padding are requested, or how many of a file are there already.
Expected<JoinClient::Said> JoinClient::ask(const std::string& what, const std::string& name,
                                           uint64_t number) {
  json question = {{"protocol", kJoinProtocol}, {"link", dds::kLinkVersion}, {"ask", what}};
  question[what == "ping" ? "bytes" : "offset"] = number;
  if (what != "ping") question["name"] = name;
  const std::string text = question.dump();
  const uint32_t question_id = ++questions_;
  std::optional<dds::JoinAnswer> answer;
  const auto hear = [&] {
    bus_.take_answers([&](const dds::JoinAnswer& heard) {
      if (heard.peer_id == peer_id_ && heard.question_id == question_id) answer = heard;
    });
  };
  hear();  // the reader is there before the question
  double asked_s = 0;
  for (const double end_s = monotonic_s() + timeout_s_; !answer && monotonic_s() < end_s; hear()) {
    if (monotonic_s() - asked_s >= kAskAgainS) {
      asked_s = monotonic_s();
      COMRAD_TRY(
          bus_.write(dds::JoinQuestion{.peer_id = peer_id_, .question_id = question_id, .text = text}));
    }
    bus_.wait(50);
  }
  if (!answer)
    return Error{ErrorCode::kTimeout, fmt::format("no answer within {} s", static_cast<int>(timeout_s_))};
  Said said{json::parse(answer->text, nullptr, /*allow_exceptions=*/false), std::move(answer->payload)};
  if (!said.text.is_object()) return Error{ErrorCode::kBadFormat, "the answer is no JSON object"};
  if (said.text.contains("error"))
    return Error{ErrorCode::kBadInput, member<std::string>(said.text, "error")};
  return said;
}

Expected<std::string> JoinClient::fetch(const std::string& what, const std::string& name,
                                        uint64_t most_bytes) {
  std::string bytes;
  for (;;) {
    COMRAD_TRY_ASSIGN(const Said said, ask(what, name, bytes.size()));
    const auto size = member<uint64_t>(said.text, "bytes");
    if (size > most_bytes || member<uint64_t>(said.text, "offset") != bytes.size() ||
        bytes.size() + said.payload.size() > size || (said.payload.empty() && bytes.size() < size))
      return Error{ErrorCode::kBadFormat, "the answer does not continue " + (name.empty() ? what : name)};
    bytes += said.payload;
    if (bytes.size() == size) return bytes;
  }
}

Expected<Offer> JoinClient::offer() {
  COMRAD_TRY_ASSIGN(const std::string text, fetch("offer", "", kMostOfferBytes));
  return parse_offer(text);
}

Expected<std::string> JoinClient::file(const OfferedFile& file) {
  COMRAD_TRY_ASSIGN(std::string bytes, fetch("file", file.name, kMostFileBytes));
  if (bytes.size() != file.bytes || checksum_of(bytes) != file.checksum)
    return Error{ErrorCode::kBadFormat, file.name + ": what arrived is not what was offered"};
  return bytes;
}

}  // namespace comrad::link
