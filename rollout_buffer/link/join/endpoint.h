// A run's join endpoint: what is played here, and the files for it, for hosts that want to join. Nothing is assumed to lie on
// the other host but this program, the scenario and the IWAD, whose hashes it compares. Stage: before a run.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/dds/link_bus.h"

namespace comrad::link {

constexpr int kJoinProtocol = 1;
constexpr const char* kOfferFile = "link_offer.json";  ///< in a run that serves, and in those that joined it

/// One file that a host needs to play.
struct OfferedFile {
  std::string name;  ///< in the joined run's folder: "config.toml", "layouts/map.wad"
  std::string path;  ///< on the serving host; never sent
  uint64_t bytes = 0;
  uint64_t checksum = 0;
};

/// What a run offers.
struct Offer {
  std::string scenario;
  uint64_t scenario_checksum = 0;  ///< of the scenario's folder
  uint64_t iwad_checksum = 0;
  uint64_t frame_workers = 0;  ///< room for so many simulators of hosts without a policy
  bool has_cuda = false;       ///< policy workers there compute on a GPU
  std::vector<OfferedFile> files;
};

/// The offer as it is sent; its checksum64 is the run's fingerprint, by which both ends know that they mean the same game.
std::string text_of(const Offer& offer, bool with_paths);
/// Reads the text of another host or a file. Errors: kBadFormat; a file's name never leads out of a folder.
Expected<Offer> parse_offer(const std::string& text);
uint64_t fingerprint_of(const Offer& offer);

/// `<run_dir>/link_offer.json`, with the files' paths on this host. Errors: kNotFound, kBadFormat, kNoSpace, kSystem.
Status write_offer(const std::string& run_dir, const Offer& offer);
Expected<Offer> read_offer(const std::string& run_dir);

/// Answers questions from the offer. Threads: one.
class JoinEndpoint {
 public:
  explicit JoinEndpoint(Offer offer) : offer_(std::move(offer)), text_(text_of(offer_, false)) {}
  /// Any question gets an answer, if only what is wrong with it.
  dds::JoinAnswer answer(const dds::JoinQuestion& question) const;

 private:
  const Offer offer_;
  const std::string text_;
};

/// The other side, for a host that joins. Threads: one.
class JoinClient {
 public:
  JoinClient(dds::LinkBus& bus, uint64_t peer_id, double timeout_s)
      : bus_(bus), peer_id_(peer_id), timeout_s_(timeout_s) {}

  /// Errors: kTimeout without an answer, kBadInput with the endpoint's own words, kBadFormat.
  Expected<Offer> offer();
  /// The bytes of a file of the offer, checked. Errors: as offer().
  Expected<std::string> file(const OfferedFile& file);
  /// Requests `bytes` bytes of padding, at most dds::kChunkBytes. The other host's wall clock, seconds. Errors: as offer().
  Expected<double> ping(std::size_t bytes);

 private:
  Expected<std::string> fetch(const std::string& what, const std::string& name, uint64_t most_bytes);
  struct Said;
  Expected<Said> ask(const std::string& what, const std::string& name, uint64_t number);

  dds::LinkBus& bus_;
  const uint64_t peer_id_;
  const double timeout_s_;
  uint32_t questions_ = 0;
};

}  // namespace comrad::link
