// One Cyclone DDS participant with its topics, writers, readers and wait set: what the link between hosts and its monitors
// have in common. Cyclone's header stays in the sources of this folder.
#pragma once

#include <dds/dds.h>

#include <algorithm>
#include <cstring>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/core/log.h"
#include "rollout_buffer/dds/bus_config.h"

namespace comrad::dds {

/// How a topic travels. All are reliable.
struct TopicTraits {
  const char* name;
  const dds_topic_descriptor_t* type;
  bool is_kept_for_late_joiners = false;  ///< transient-local
  int history = 1;                        ///< keep-last; 0: every sample counts
  int sample_limit = 0;      ///< of a reader or writer that keeps all; what comes beyond waits at the writer
  bool is_separate = false;  ///< it has the second partition of the participant
};

class Strangers;

/// Calls `visit(sample, info)` for all that lies ready at a reader, oldest first.
template <typename Visitor>
void take_all(dds_entity_t reader, Visitor visit) {
  constexpr int kAtOnce = 32;
  for (int taken = kAtOnce; reader > 0 && taken == kAtOnce;) {
    void* samples[kAtOnce] = {};
    dds_sample_info_t infos[kAtOnce];
    taken = dds_take(reader, samples, infos, kAtOnce, kAtOnce);
    for (int i = 0; i < taken; ++i) visit(samples[i], infos[i]);
    if (taken > 0) dds_return_loan(reader, samples, taken);
  }
}

/// Writers and readers are made on first use. Threads: one.
class Participant {
 public:
  /// Errors: those of validate(), kBadInput where another run uses the domain in this process, kSystem with Cyclone's
  /// return code and what to check. `topics` outlives the participant.
  static Expected<std::unique_ptr<Participant>> open(const BusConfig& config,
                                                     std::span<const TopicTraits> topics,
                                                     const std::string& partition,
                                                     const std::string& separate_partition = "");
  Participant(const Participant&) = delete;
  Participant& operator=(const Participant&) = delete;
  ~Participant();

  /// Errors: kTimeout where a reader does not keep up (nothing was written); kSystem.
  template <typename Wire>
  Status write(int topic, const Wire& sample) {
    return write_sample(topic, &sample);
  }
  /// Whether every reader has all that was written. Does not wait.
  bool is_acknowledged(int topic) const;
  /// The first partition of each writer or reader of any participant, as discovery reports them.
  std::vector<std::string> partitions_of_writers() const;
  std::vector<std::string> partitions_of_readers() const;

  /// Calls `visit(sample, info)` for all that lies ready, oldest first.
  template <typename Wire, typename Visitor>
  void take(int topic, Visitor visit) {
    Expected<dds_entity_t> from = reader_of(topic);
    if (!from) {
      spdlog::warn("{}", from.error().message);
      return;
    }
    take_all(*from, [&](const void* sample, const dds_sample_info_t& info) {
      visit(*static_cast<const Wire*>(sample), info);
    });
  }

  /// Blocks until something lies ready on any reader made so far, or `timeout_ms`. True if something does.
  bool wait(int timeout_ms);

 private:
  Participant(const BusConfig& config, std::span<const TopicTraits> topics);
  struct Entities {
    dds_entity_t topic = 0, writer = 0, reader = 0;
  };
  Status make(const std::string& partition, const std::string& separate_partition);
  Expected<dds_entity_t> topic_of(int index);
  Expected<dds_entity_t> writer_of(int index);
  Expected<dds_entity_t> reader_of(int index);
  Status write_sample(int topic, const void* sample);
  Error error(dds_return_t code, const std::string& what) const;

  const BusConfig config_;
  const std::span<const TopicTraits> topics_;
  bool is_in_domain_ = false;
  dds_entity_t participant_ = 0, waitset_ = 0;
  dds_entity_t publisher_[2] = {}, subscriber_[2] = {};  // of the partition, and of the separate one
  std::vector<Entities> entities_;
  std::unique_ptr<Strangers> strangers_;  // where there are keys
};

/// Copies into a bounded wire string and cuts what does not fit, never inside a UTF-8 character.
template <std::size_t size>
void put(char (&out)[size], const std::string& text) {
  std::size_t length = std::min(text.size(), size - 1);
  if (length < text.size()) {
    while (length > 0 && (static_cast<unsigned char>(text[length]) & 0xC0) == 0x80) --length;
  }
  std::memcpy(out, text.data(), length);
  out[length] = '\0';
}

template <std::size_t size>
std::string get(const char (&in)[size]) {
  return std::string(in, strnlen(in, size));
}

/// A sequence that Cyclone only reads while it writes a sample.
template <typename Sequence, typename T>
Sequence sequence_of(std::span<const T> values) {
  Sequence sequence{};
  sequence._length = sequence._maximum = static_cast<uint32_t>(values.size());
  sequence._buffer = reinterpret_cast<decltype(sequence._buffer)>(const_cast<T*>(values.data()));
  return sequence;
}

}  // namespace comrad::dds
