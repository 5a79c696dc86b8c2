#include "rollout_buffer/link/join/link_check.h"

#include <algorithm>
#include <cstddef>
#include <vector>

#include "rollout_buffer/core/clock.h"
#include "rollout_buffer/core/rng.h"

namespace comrad::link {
namespace {

constexpr int kPings = 40;
constexpr double kDownS = 1.0, kUpS = 1.0;
constexpr double kUpWarmS = 0.5;  // what the writer and the sockets hold is full by then
constexpr double kStuckS = 5.0;

}  // namespace

Expected<LinkReport> check_link(dds::LinkBus& bus, JoinClient& endpoint) {
  LinkReport report;
  std::vector<double> round_trips_ms;
  COMRAD_TRY(endpoint.ping(0));  // discovery is over with the first answer
  for (int ping = 0; ping < kPings; ++ping) {
    const double asked_s = monotonic_s();
    const double before_s = wall_s();
    COMRAD_TRY_ASSIGN(const double there_s, endpoint.ping(0));
    const double round_trip_ms = 1000 * (monotonic_s() - asked_s);
    if (round_trips_ms.empty() || round_trip_ms < *std::ranges::min_element(round_trips_ms))
      report.clock_ahead_ms = 1000 * (before_s - there_s) + round_trip_ms / 2;
    round_trips_ms.push_back(round_trip_ms);
  }
  std::ranges::sort(round_trips_ms);
  report.round_trip_ms_min = round_trips_ms.front();
  report.round_trip_ms_median = round_trips_ms[round_trips_ms.size() / 2];
  report.round_trip_ms_max = round_trips_ms.back();

  const double down_began_s = monotonic_s();
  double down_bytes = 0;
  while (monotonic_s() - down_began_s < kDownS) {
    COMRAD_TRY(endpoint.ping(dds::kChunkBytes));
    down_bytes += static_cast<double>(dds::kChunkBytes);
  }
  report.down_bytes_per_s = down_bytes / (monotonic_s() - down_began_s);

  // Fragments without a known sender: the other end takes them from the network and throws them away.
  std::vector<std::byte> noise(dds::kFragmentBytes);
  Rng rng(1);
  for (std::byte& byte : noise) byte = static_cast<std::byte>(rng.below(256));
  dds::TrajectoryFragment fragment{.fragment_count = 1, .raw_bytes = static_cast<uint32_t>(noise.size())};
  fragment.payload = noise;
  const double up_began_s = monotonic_s();
  double counted_from_s = 0, written_s = up_began_s, up_bytes = 0;
  while (counted_from_s == 0 || written_s - counted_from_s < kUpS) {
    const Status written = bus.write(fragment);
    const double now_s = monotonic_s();
    if (written) {
      written_s = now_s;
      if (counted_from_s > 0) up_bytes += static_cast<double>(noise.size());
      if (counted_from_s == 0 && now_s - up_began_s >= kUpWarmS) counted_from_s = now_s;
    } else if (written.error().code != ErrorCode::kTimeout) {
      return written.error();
    } else if (now_s - written_s > kStuckS) {
      return Error{ErrorCode::kTimeout, "the other host takes no trajectories"};
    }
  }
  report.up_bytes_per_s = up_bytes / (written_s - counted_from_s);
  return report;
}

}  // namespace comrad::link
