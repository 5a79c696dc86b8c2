// The learning algorithms, one line each.
#include <string>
#include <vector>

#include "learner/algorithms/algorithm.h"
#include "learner/algorithms/happo.h"
#include "learner/algorithms/idqn.h"
#include "learner/algorithms/ippo.h"
#include "learner/algorithms/mappo.h"
#include "learner/algorithms/qmix.h"
#include "learner/algorithms/qplex.h"
#include "learner/algorithms/vdn.h"
#include "rollout_buffer/core/text.h"

namespace comrad::learn {
namespace {

template <typename T>
std::unique_ptr<Algorithm> make(const RunConfig& config, const EnvShape& env, torch::Device device) {
  return std::make_unique<T>(config, env, device);
}

struct Entry {
  const char* name;
  std::unique_ptr<Algorithm> (*make)(const RunConfig&, const EnvShape&, torch::Device);
};

constexpr Entry kAlgorithms[] = {
    {"ippo", make<Ippo>}, {"mappo", make<Mappo>}, {"happo", make<Happo>},   {"idqn", make<Idqn>},
    {"vdn", make<Vdn>},   {"qmix", make<Qmix>},   {"qplex_d", make<Qplex>}, {"qplex_q", make<Qplex>},
};

}  // namespace

Expected<std::unique_ptr<Algorithm>> make_algorithm(const RunConfig& config, const EnvShape& env,
                                                    torch::Device device) {
  std::vector<std::string> known;
  for (const Entry& entry : kAlgorithms) {
    if (config.algo == entry.name) return entry.make(config, env, device);
    known.emplace_back(entry.name);
  }
  return Error{ErrorCode::kBadInput, "algo is \"" + config.algo + "\"; this build knows: " + joined(known)};
}

}  // namespace comrad::learn
