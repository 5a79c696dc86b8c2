// Logs one line for each unknown peer without our keys. Cyclone's plugins keep such a participant out: it is seen,
// but no writer or reader of it ever is.
#pragma once

#include <dds/dds.h>

#include <map>
#include <string>
#include <string_view>

namespace comrad::dds {

/// Calls `visit(sample, info)` for all that lies ready at a reader, oldest first.
template <typename Visit>
void take_all(dds_entity_t reader, Visit visit) {
  constexpr int kAtOnce = 32;
  for (int taken = kAtOnce; reader > 0 && taken == kAtOnce;) {
    void* samples[kAtOnce] = {};
    dds_sample_info_t infos[kAtOnce];
    taken = dds_take(reader, samples, infos, kAtOnce, kAtOnce);
    for (int i = 0; i < taken; ++i) visit(samples[i], infos[i]);
    if (taken > 0) dds_return_loan(reader, samples, taken);
  }
}

/// Whether a line of Cyclone's log only reports a failed handshake or a refused peer.
bool is_about_an_unknown_peer(std::string_view line);

/// Threads: one.
class UnknownPeers {
 public:
  explicit UnknownPeers(dds_entity_t participant);
  /// Looks once a second at most. Call often.
  void look();

 private:
  struct Peer {
    double since_s = 0;
    std::string who;
    bool is_known = false;    ///< its key was accepted
    bool is_written = false;  ///< to the log
  };
  using Key = std::string;  ///< the 16 bytes of a participant's id

  dds_entity_t participants_ = 0, writers_ = 0, readers_ = 0;
  Key own_;
  std::map<Key, Peer> peers_;
  int lines_ = 0;
  double looked_s_ = 0;
};

}  // namespace comrad::dds
