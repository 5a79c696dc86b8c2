#include "deploy/hosts/host_calls.h"

#include <arpa/inet.h>
#include <netdb.h>
#include <spdlog/fmt/fmt.h>
#include <sys/socket.h>

#include <charconv>
#include <cstdlib>
#include <optional>

#include "deploy/process/child_program.h"
#include "rollout_buffer/core/host_name.h"
#include "rollout_buffer/core/parts.h"
#include "rollout_buffer/link/join/link_address.h"

namespace comrad::deploy {
namespace {

constexpr int kSshTimeoutS = 10;

int64_t number_of(const std::string& text) {
  int64_t number = 0;
  std::from_chars(text.data(), text.data() + text.size(), number);
  return number;
}

/// The IPv4 address of a host, as "user@host" has it. Errors: kNotFound.
Expected<std::string> address_of(const std::string& host) {
  const std::string name = host.substr(host.rfind('@') + 1);
  addrinfo wanted{};
  wanted.ai_family = AF_INET;
  addrinfo* found = nullptr;
  const int failed = getaddrinfo(name.c_str(), nullptr, &wanted, &found);
  if (failed != 0) return Error{ErrorCode::kNotFound, "host '" + name + "': " + gai_strerror(failed)};
  char text[INET_ADDRSTRLEN] = {};
  inet_ntop(AF_INET, &reinterpret_cast<const sockaddr_in*>(found->ai_addr)->sin_addr, text, sizeof text);
  freeaddrinfo(found);
  return std::string(text);
}

/// This node, as Slurm calls it.
std::string own_node(const Variable& variable) {
  const std::string node = variable("SLURMD_NODENAME");
  return node.empty() ? short_host_name() : node;
}

/// The nodes of the allocation but this one, as Slurm lists them.
Expected<std::vector<std::string>> other_nodes(const Variable& variable) {
  COMRAD_TRY_ASSIGN(const ProgramResult listed,
                    run_program({"scontrol", "show", "hostnames", variable("SLURM_JOB_NODELIST")}));
  if (listed.exit_code != 0)
    return Error{ErrorCode::kSystem, "scontrol show hostnames: " + last_words(listed)};
  std::vector<std::string> nodes = parts_of(listed.output, '\n');
  const std::string own = own_node(variable);
  std::erase(nodes, own);
  return nodes;
}

/// In single quotes, for the shell that ssh starts.
std::string quoted(const std::string& word) {
  std::string text = "'";
  for (const char letter : word) text += letter == '\'' ? std::string("'\\''") : std::string(1, letter);
  return text + "'";
}

std::vector<std::string> join_words(const RunConfig& config) {
  // Its lines go to this run's log; one of progress now and then is enough.
  std::vector<std::string> words = {"join", "-", "--leave_with_input", "--progress_interval=600"};
  if (config.hosts.insecure_network) words.emplace_back("--insecure_network");
  if (!config.hosts.host_keys.empty()) words.push_back("--keys=" + config.hosts.host_keys);
  words.push_back(fmt::format("--link_buffer_mb={}", config.hosts.link_buffer_mb));
  if (config.hosts.link_datagram_bytes > 0)
    words.push_back(fmt::format("--link_datagram_bytes={}", config.hosts.link_datagram_bytes));
  return words;
}

}  // namespace

std::string environment_variable(const char* name) {
  const char* value = std::getenv(name);
  return value == nullptr ? "" : value;
}

bool is_alone_in_an_allocation(const Variable& variable) {
  if (variable("SLURM_JOB_ID").empty()) return false;
  // srun numbers the steps that it starts; a job's script and the shell of salloc are none.
  const std::string step = variable("SLURM_STEP_ID");
  if (!step.empty() && number_of(step) < 0xFFFFFFF0) return false;
  return number_of(variable("SLURM_NTASKS")) > 1 || number_of(variable("SLURM_JOB_NUM_NODES")) > 1;
}

Status prepare_calls(RunConfig& config, const Variable& variable) {
  if (config.hosts.hosts == "none") return {};
  std::string first;
  if (!config.hosts.hosts.empty()) {
    first = parts_of(config.hosts.hosts, ',')[0];
  } else if (is_alone_in_an_allocation(variable) && !config.collection.deterministic &&
             config.collection.async_rl) {
    config.hosts.serve = true;
    if (number_of(variable("SLURM_JOB_NUM_NODES")) > 1) {
      COMRAD_TRY_ASSIGN(const std::vector<std::string> nodes, other_nodes(variable));
      if (!nodes.empty()) first = nodes[0];
    }
  }
  if (first.empty() || config.hosts.interface != "auto") return {};
  COMRAD_TRY_ASSIGN(const std::string address, address_of(first));
  // A host that is this one is reached on loopback.
  const Expected<std::string> interface = link::interface_towards(address);
  if (!interface && interface.error().code != ErrorCode::kBadInput) return interface.error();
  config.hosts.interface = interface ? *interface : link::kLoopback;
  return {};
}

std::vector<HostStart> ssh_calls(const std::string& hosts, const std::vector<std::string>& words,
                                 const std::string& own_program) {
  std::string join, path = quoted(own_program);
  for (const std::string& word : words) join += " " + quoted(word);
  const std::string command =
      "if [ -x " + path + " ]; then exec " + path + join + "; else exec comrad" + join + "; fi";
  std::vector<HostStart> calls;
  for (const std::string& host : parts_of(hosts, ','))
    calls.push_back(
        {.name = "host " + host,
         .command = {"ssh", "-T", "-o", "BatchMode=yes", "-o", fmt::format("ConnectTimeout={}", kSshTimeoutS),
                     "-o", "ServerAliveInterval=15", "-o", "ServerAliveCountMax=4", "--", host, command}});
  return calls;
}

std::vector<HostStart> host_calls(const RunConfig& config, const Variable& variable,
                                  const std::string& own_program) {
  std::vector<HostStart> calls;
  if (!config.hosts.serve || config.hosts.hosts == "none") return calls;
  const std::vector<std::string> words = join_words(config);
  if (!config.hosts.hosts.empty()) {
    return ssh_calls(config.hosts.hosts, words, own_program);
  }
  if (!is_alone_in_an_allocation(variable)) return calls;
  const int64_t nodes = number_of(variable("SLURM_JOB_NUM_NODES")),
                tasks = number_of(variable("SLURM_NTASKS"));
  std::vector<std::string> command = {"srun", "--overlap", "--kill-on-bad-exit=0"};
  if (nodes > 1) {
    const std::string own = own_node(variable);
    command.insert(command.end(),
                   {fmt::format("--nodes={}", nodes - 1), fmt::format("--ntasks={}", nodes - 1),
                    "--ntasks-per-node=1", "--exclude=" + own});
  } else {
    command.insert(command.end(), {"--nodes=1", fmt::format("--ntasks={}", tasks - 1)});
  }
  if (const std::string cpus = variable("SLURM_CPUS_PER_TASK"); !cpus.empty())
    command.push_back("--cpus-per-task=" + cpus);
  command.push_back(own_program);
  command.insert(command.end(), words.begin(), words.end());
  calls.push_back({.name = "srun", .command = command});
  return calls;
}

}  // namespace comrad::deploy
