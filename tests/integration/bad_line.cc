// bad_line DEVICE DEVICE DELAY_MS LOSS DUPLICATES SWAPS SEED: a relay between two network devices that delays every frame,
// and loses, doubles or holds back some. The last three before the seed are fractions. Until SIGTERM.
#include <arpa/inet.h>
#include <linux/if_ether.h>
#include <linux/if_packet.h>
#include <net/if.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cstdio>
#include <cstdlib>
#include <map>
#include <vector>

#include "rollout_buffer/core/clock.h"
#include "rollout_buffer/core/rng.h"

namespace {

using namespace comrad;

constexpr std::size_t kFrameBytesMax =
    70'000;  // a veth pair carries frames that a network card would cut later
constexpr double kSwapS = 0.004;
constexpr std::size_t kMostHeld = 20'000;

int open_device(const char* name) {
  const int device = socket(AF_PACKET, SOCK_RAW | SOCK_CLOEXEC, htons(ETH_P_ALL));
  sockaddr_ll address{};
  address.sll_family = AF_PACKET;
  address.sll_protocol = htons(ETH_P_ALL);
  address.sll_ifindex = static_cast<int>(if_nametoindex(name));
  const int bytes = 32 << 20;
  setsockopt(device, SOL_SOCKET, SO_RCVBUFFORCE, &bytes, sizeof bytes);
  setsockopt(device, SOL_SOCKET, SO_SNDBUFFORCE, &bytes, sizeof bytes);
  const int ignores_own = 1;
  setsockopt(device, SOL_PACKET, PACKET_IGNORE_OUTGOING, &ignores_own, sizeof ignores_own);
  // Frames keep the kernel's header before them, which marks a checksum as still to be computed.
  const int keeps_header = 1;
  setsockopt(device, SOL_PACKET, PACKET_VNET_HDR, &keeps_header, sizeof keeps_header);
  return bind(device, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0 ? device : -1;
}

struct Held {
  int to = 0;
  std::vector<char> frame;
};

}  // namespace

int main(int argc, char** argv) {
  if (argc != 8)
    return std::fputs("usage: bad_line DEVICE DEVICE DELAY_MS LOSS DUPLICATES SWAPS SEED\n", stderr), 2;
  const int devices[2] = {open_device(argv[1]), open_device(argv[2])};
  if (devices[0] < 0 || devices[1] < 0) return std::perror("bad_line"), 1;
  const double delay_s = std::atof(argv[3]) / 1000;
  const float loss = std::strtof(argv[4], nullptr), doubles = std::strtof(argv[5], nullptr),
              swaps = std::strtof(argv[6], nullptr);
  Rng rng(std::strtoull(argv[7], nullptr, 10));
  const auto happens = [&rng](float share) {
    return static_cast<float>(rng.below(1 << 20)) < share * (1 << 20);
  };
  std::multimap<double, Held> held;  // by the time at which they continue
  std::vector<char> buffer(kFrameBytesMax);
  for (;;) {
    pollfd sources[2] = {{.fd = devices[0], .events = POLLIN, .revents = 0},
                         {.fd = devices[1], .events = POLLIN, .revents = 0}};
    poll(sources, 2, held.empty() ? 1000 : 1);
    for (int from = 0; from < 2; ++from)
      for (int count = 0; count < 64; ++count) {
        const ssize_t size = recv(devices[from], buffer.data(), buffer.size(), MSG_DONTWAIT);
        if (size <= 0) break;
        if (happens(loss) || held.size() >= kMostHeld) continue;
        const std::vector<char> frame(buffer.begin(), buffer.begin() + size);
        const double due_s = monotonic_s() + delay_s;
        for (int copies = happens(doubles) ? 2 : 1; copies > 0; --copies)
          held.emplace(due_s + (happens(swaps) ? kSwapS : 0), Held{.to = 1 - from, .frame = frame});
      }
    for (const double now_s = monotonic_s(); !held.empty() && held.begin()->first <= now_s;
         held.erase(held.begin())) {
      const Held& next = held.begin()->second;
      [[maybe_unused]] const ssize_t sent = send(devices[next.to], next.frame.data(), next.frame.size(), 0);
    }
  }
}
