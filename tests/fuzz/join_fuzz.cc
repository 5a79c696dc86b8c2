// What comes to the sockets of a run: bytes of a process that is about to join, bytes of a run that a worker joins, the arena
// that such a run hands over, and requests at the control socket and the metrics page. The first byte selects which.
#include <fcntl.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <string>
#include <string_view>
#include <thread>

#include "deploy/launch/control_socket.h"
#include "deploy/launch/metrics_page.h"
#include "rollout_buffer/core/log.h"
#include "rollout_buffer/shm/accounts.h"
#include "rollout_buffer/shm/arena.h"
#include "rollout_buffer/shm/arena_socket.h"
#include "rollout_buffer/shm/episode_stream.h"
#include "rollout_buffer/shm/slab_pool.h"
#include "rollout_buffer/shm/weight_buffers.h"
#include "tests/fuzz/input.h"

namespace {

using namespace comrad;
using namespace comrad::fuzz;

sockaddr_un address_of(const std::string& name, socklen_t& size) {
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  std::memcpy(address.sun_path + 1, name.data(), name.size());
  size = static_cast<socklen_t>(offsetof(sockaddr_un, sun_path) + 1 + name.size());
  return address;
}

std::string socket_name(const char* what) {
  return std::string("comrad-fuzz-") + what + std::to_string(getpid());
}

shm::ArenaShape small_shape() {
  shm::ArenaShape shape;
  shape.trajectory.env = {
      .num_agents = 2, .channels = 3, .height = 6, .width = 8, .measurement_count = 1, .head_count = 1};
  shape.trajectory.env.head_sizes = {3};
  shape.trajectory.rollout_steps = 4;
  shape.envs_per_worker = 2;
  shape.slab_count = 4;
  return shape;
}

/// An unknown process's datagram. A right one is answered with the arena, whatever else is refused.
void join_with(std::string_view bytes) {
  static const shm::Arena arena = *shm::Arena::create(small_shape(), 7);
  static shm::ArenaServer server = std::move(shm::ArenaServer::listen(socket_name("server"), arena)).value();
  const int client = socket(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0);
  socklen_t size = 0;
  const sockaddr_un address = address_of(server.name(), size);
  require(connect(client, reinterpret_cast<const sockaddr*>(&address), size) == 0);
  shm::JoinRequest request;  // right, but for what the input changes
  std::string datagram(reinterpret_cast<const char*>(&request), sizeof request);
  const bool is_whole = !bytes.empty() && (bytes[0] & 1) != 0;
  if (!bytes.empty()) bytes.remove_prefix(1);
  if (is_whole)
    for (; bytes.size() >= 2; bytes.remove_prefix(2))
      datagram[static_cast<uint8_t>(bytes[0]) % datagram.size()] = bytes[1];
  else
    datagram.assign(bytes);
  (void)!send(client, datagram.data(), datagram.size(), MSG_NOSIGNAL);
  shutdown(client, SHUT_WR);
  const Expected<shm::JoinRequest> joined = server.serve_one();
  if (joined) require(std::memchr(joined->role, 0, sizeof joined->role) != nullptr);
  close(client);
}

/// A run that a worker believes in: what it answers, and what descriptor rides on it.
void answer_a_worker_with(std::string_view bytes) {
  static const std::string name = socket_name("liar");
  static const int listener = [] {
    const int made = socket(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0);
    socklen_t size = 0;
    const sockaddr_un address = address_of(name, size);
    require(bind(made, reinterpret_cast<const sockaddr*>(&address), size) == 0 && listen(made, 8) == 0);
    return made;
  }();
  const std::string answer(bytes);
  std::thread liar([&answer] {
    const int worker = accept4(listener, nullptr, nullptr, SOCK_CLOEXEC);
    iovec part{const_cast<char*>(answer.data()), answer.size()};
    alignas(cmsghdr) char control[CMSG_SPACE(2 * sizeof(int))] = {};
    msghdr message{};
    message.msg_iov = &part;
    message.msg_iovlen = 1;
    const int count = answer.empty() ? 0 : static_cast<uint8_t>(answer.back()) % 3;
    const int null = open("/dev/null", O_RDONLY | O_CLOEXEC);
    if (count > 0) {
      message.msg_control = control;
      message.msg_controllen = CMSG_SPACE(static_cast<std::size_t>(count) * sizeof(int));
      cmsghdr* rider = CMSG_FIRSTHDR(&message);
      rider->cmsg_level = SOL_SOCKET;
      rider->cmsg_type = SCM_RIGHTS;
      rider->cmsg_len = CMSG_LEN(static_cast<std::size_t>(count) * sizeof(int));
      for (int index = 0; index < count; ++index)
        std::memcpy(CMSG_DATA(rider) + static_cast<std::size_t>(index) * sizeof(int), &null, sizeof(int));
    }
    (void)!sendmsg(worker, &message, MSG_NOSIGNAL);
    close(null);
    close(worker);
  });
  const Expected<shm::Arena> joined = shm::join_arena(name, {}, 1000);
  require(!joined);  // /dev/null is no arena
  liar.join();
}

/// An arena whose header holds the input's bytes over right ones. One that is taken can be walked through.
void adopt_arena_of(std::string_view bytes) {
  static const std::string right = [] {
    const shm::Arena arena = *shm::Arena::create(small_shape(), 7);
    std::string header(4096, '\0');
    require(pread(arena.descriptor(), header.data(), header.size(), 0) ==
            static_cast<ssize_t>(header.size()));
    return header;
  }();
  std::string header = right;
  for (; bytes.size() >= 3; bytes.remove_prefix(3))
    header[(static_cast<uint8_t>(bytes[0]) | static_cast<std::size_t>(static_cast<uint8_t>(bytes[1])) << 8) %
           512] = bytes[2];
  const int memory = memfd_create("fuzzed", MFD_CLOEXEC | MFD_ALLOW_SEALING);
  const int64_t size = shm::Arena::size_bytes(small_shape());
  require(ftruncate(memory, size) == 0);
  require(pwrite(memory, header.data(), 512, 0) == 512);
  require(fcntl(memory, F_ADD_SEALS, F_SEAL_SHRINK | F_SEAL_GROW | F_SEAL_SEAL) == 0);
  const Expected<shm::Arena> arena = shm::Arena::adopt(memory);
  if (!arena) return;
  (void)arena->slabs().counts();
  (void)arena->accounts().counts();
  (void)arena->episodes().read(shm::EpisodeReader::kSupervisor);
  for (const uint32_t slab : arena->slabs().drain(100)) arena->slabs().release(slab);
  for (int sim = 0; sim < arena->shape().sim_worker_count; ++sim) (void)arena->reclaim_sim_worker(sim);
  std::vector<std::byte> weights;
  (void)arena->weights().read(weights);
}

void ask_at_the_door(std::string_view bytes) {
  int orders = 0;
  const deploy::ControlCommands commands = {.status = [] { return std::string("{}"); },
                                            .pause = [&] { return ++orders, Status(); },
                                            .resume = [&] { return ++orders, Status(); },
                                            .stop = [&] { return ++orders, Status(); },
                                            .checkpoint = [&] { return ++orders, Expected<uint32_t>(1u); },
                                            .drain =
                                                [&](const std::string& host) {
                                                  require(host.size() <= 255);
                                                  return ++orders, Status();
                                                }};
  const std::string answer = deploy::answer_command(bytes, commands);
  require(answer.ends_with('\n') && answer.find('\n') == answer.size() - 1 && orders <= 1);
  const std::string page =
      deploy::http_answer(bytes, deploy::metrics_rules([] { return std::string("page"); }));
  require(page.starts_with("HTTP/1.1 ") || page.starts_with("HTTP/1.0 "));
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, std::size_t size) {
  static const bool is_quiet = (spdlog::set_level(spdlog::level::off), true);
  (void)is_quiet;
  if (size == 0) return 0;
  const std::string_view bytes(reinterpret_cast<const char*>(data + 1), size - 1);
  switch (data[0] % 4) {
    case 0:
      join_with(bytes);
      break;
    case 1:
      answer_a_worker_with(bytes);
      break;
    case 2:
      adopt_arena_of(bytes);
      break;
    case 3:
      ask_at_the_door(bytes);
      break;
  }
  return 0;
}
