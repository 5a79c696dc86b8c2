#include "rollout_buffer/dds/unknown_peers.h"

#include "rollout_buffer/core/clock.h"
#include "rollout_buffer/core/log.h"

namespace comrad::dds {
namespace {

constexpr double kBetweenLooks_s = 1;
constexpr double kPatience_s = 8;  // a handshake takes 0.3 s; on a busy host seconds
constexpr int kMostLines = 20;     // a peer with a new participant for each line must not fill the disk
constexpr std::size_t kPeersMax = 1000;
constexpr std::size_t kMostShownBytes = 64;

// Another host's description of itself, fit for a log.
std::string printable(const char* text) {
  std::string name = text == nullptr ? "" : std::string(text).substr(0, kMostShownBytes);
  for (char& letter : name)
    if (letter < ' ' || letter > '~') letter = '?';
  return name;
}

std::string property(const dds_qos_t* qos, const char* name) {
  char* value = nullptr;
  if (!dds_qget_prop(qos, name, &value)) return "?";
  std::string text = printable(value);
  dds_free(value);
  return text;
}

std::string key_of(const dds_guid_t& guid) {
  return std::string(reinterpret_cast<const char*>(guid.v), sizeof guid.v);
}

}  // namespace

bool is_about_an_unknown_peer(std::string_view line) {
  const auto has = [&](std::string_view words) { return line.find(words) != std::string_view::npos; };
  return has("handshake") || (has("emote secure participant") && has("not allowed")) ||
         (has("Non secure remote") && has("not allowed"));
}

UnknownPeers::UnknownPeers(dds_entity_t participant)
    : participants_(dds_create_reader(participant, DDS_BUILTIN_TOPIC_DCPSPARTICIPANT, nullptr, nullptr)),
      writers_(dds_create_reader(participant, DDS_BUILTIN_TOPIC_DCPSPUBLICATION, nullptr, nullptr)),
      readers_(dds_create_reader(participant, DDS_BUILTIN_TOPIC_DCPSSUBSCRIPTION, nullptr, nullptr)) {
  dds_guid_t guid;
  if (dds_get_guid(participant, &guid) == DDS_RETCODE_OK) own_ = key_of(guid);
}

void UnknownPeers::look() {
  const double now_s = monotonic_s();
  if (now_s - looked_s_ < kBetweenLooks_s) return;
  looked_s_ = now_s;
  take_all(participants_, [&](const void* sample, const dds_sample_info_t& info) {
    const auto& seen = *static_cast<const dds_builtintopic_participant_t*>(sample);
    const Key key = key_of(seen.key);
    if (info.instance_state != DDS_IST_ALIVE) {
      peers_.erase(key);
    } else if (key != own_ && peers_.size() < kPeersMax) {
      Peer& peer = peers_[key];
      if (peer.since_s == 0) peer.since_s = now_s;
      if (info.valid_data)
        peer.who = "host '" + property(seen.qos, "__Hostname") + "', process " + property(seen.qos, "__Pid");
    }
  });
  for (const dds_entity_t reader : {writers_, readers_})
    take_all(reader, [&](const void* sample, const dds_sample_info_t&) {
      const auto peer =
          peers_.find(key_of(static_cast<const dds_builtintopic_endpoint_t*>(sample)->participant_key));
      if (peer != peers_.end()) peer->second.is_known = true;
    });
  for (auto& [key, peer] : peers_) {
    if (peer.is_known || peer.is_written || now_s - peer.since_s < kPatience_s) continue;
    peer.is_written = true;
    if (++lines_ > kMostLines) continue;
    spdlog::warn(
        "refused a participant (by its own words {}) with this link's id but without a key of the same "
        "authority: "
        "it gets nothing and is not listened to{}",
        peer.who, lines_ == kMostLines ? "; more such are not logged" : "");
  }
}

}  // namespace comrad::dds
