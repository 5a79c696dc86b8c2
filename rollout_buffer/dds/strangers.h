// Logs one line for each unknown peer without our keys. Cyclone's plugins keep such a participant out: it is seen,
// but no writer or reader of it ever is.
#pragma once

#include <dds/dds.h>

#include <map>
#include <string>
#include <string_view>

namespace comrad::dds {

/// Whether a line of Cyclone's log only reports a failed handshake or a refused peer.
bool is_about_a_stranger(std::string_view line);

/// Threads: one.
class Strangers {
 public:
  explicit Strangers(dds_entity_t participant);
  /// Looks once a second at most. Call often.
  void look();

 private:
  struct Guest {
    double since_s = 0;
    std::string who;
    bool is_known = false;    ///< its key was accepted
    bool is_written = false;  ///< to the log
  };
  using Key = std::string;  ///< the 16 bytes of a participant's id

  dds_entity_t participants_ = 0, writers_ = 0, readers_ = 0;
  Key own_;
  std::map<Key, Guest> guests_;
  int lines_ = 0;
  double looked_s_ = 0;
};

}  // namespace comrad::dds
