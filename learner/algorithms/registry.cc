// The learning algorithms, one line each; what the rest of the system reads of them is
// in rollout_buffer/settings/algorithms.cc.
#include <string>
#include <utility>
#include <vector>

#include "learner/algorithms/algorithm.h"
#include "learner/algorithms/happo.h"
#include "learner/algorithms/idqn.h"
#include "learner/algorithms/ippo.h"
#include "learner/algorithms/mappo.h"
#include "learner/algorithms/qmix.h"
#include "learner/algorithms/qplex.h"
#include "learner/algorithms/vdn.h"
#include "rollout_buffer/core/check.h"

namespace comrad::learn {

Status Algorithm::learn_with(RankGroup&) {
  return Error{ErrorCode::kUnsupported,
               "this algorithm has one learner; train it with --learners 1 (or say in its learn_with() what "
               "several of them add up)"};
}
namespace {

template <typename T>
std::unique_ptr<Algorithm> make(const RunConfig& config, const EnvShape& env, torch::Device device) {
  return std::make_unique<T>(config, env, device);
}

struct Entry {
  std::string name;
  MakeAlgorithm make;
};

std::vector<Entry>& algorithms() {
  static std::vector<Entry> all = {
      {"ippo", make<Ippo>}, {"mappo", make<Mappo>}, {"happo", make<Happo>},   {"idqn", make<Idqn>},
      {"vdn", make<Vdn>},   {"qmix", make<Qmix>},   {"qplex_d", make<Qplex>}, {"qplex_q", make<Qplex>},
  };
  return all;
}

}  // namespace

void add_learner(const std::string& name, MakeAlgorithm make) {
  COMRAD_CHECK(find_algorithm(name) != nullptr,
               "add_algorithm() comes first: the settings must know the name");
  algorithms().push_back({name, make});
}

Expected<std::unique_ptr<Algorithm>> make_algorithm(const RunConfig& config, const EnvShape& env,
                                                    torch::Device device) {
  for (const Entry& entry : algorithms())
    if (config.run.algo->name == entry.name) return entry.make(config, env, device);
  return Error{ErrorCode::kBadInput,
               "algo is " + config.run.algo.name() + "; this build has no learner for it"};
}

}  // namespace comrad::learn
