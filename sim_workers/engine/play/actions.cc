#include "sim_workers/engine/play/actions.h"

#include <algorithm>
#include <array>

namespace comrad::doom {
namespace {

constexpr std::array<ActionFunction, static_cast<std::size_t>(ActionId::kCount)> kActions = {
    nullptr,
#define COMRAD_ACTION(name) action_##name,
    COMRAD_ACTOR_ACTIONS(COMRAD_ACTION) COMRAD_WEAPON_ACTIONS(COMRAD_ACTION)
#undef COMRAD_ACTION
};

}  // namespace

int32_t ActionCall::integer(std::size_t index, int32_t fallback) const {
  if (index >= args.size()) return fallback;
  const ActionArg& arg = args[index];
  switch (arg.kind) {
    case ActionArg::Kind::kInteger:
      return arg.a;
    case ActionArg::Kind::kFixed:
      return arg.a / kFracUnit;
    case ActionArg::Kind::kRandom: {
      const int64_t low = std::min(arg.a, arg.b), high = std::max(arg.a, arg.b);
      const auto span = static_cast<uint32_t>(std::min<int64_t>(high - low + 1, UINT32_MAX));
      return static_cast<int32_t>(low + world.rng().below(span));
    }
    default:
      return fallback;
  }
}

Fixed ActionCall::fixed(std::size_t index, Fixed fallback) const {
  if (index >= args.size()) return fallback;
  const ActionArg& arg = args[index];
  if (arg.kind == ActionArg::Kind::kFixed) return arg.a;
  if (arg.kind != ActionArg::Kind::kInteger && arg.kind != ActionArg::Kind::kRandom) return fallback;
  return to_fixed(std::clamp(integer(index), -32767, 32767));
}

uint32_t ActionCall::type(std::size_t index, uint32_t fallback) const {
  if (index >= args.size() || args[index].kind != ActionArg::Kind::kType) return fallback;
  const auto wanted = static_cast<uint32_t>(args[index].a);
  return wanted < world.catalog().size() ? wanted : fallback;
}

uint32_t ActionCall::label(std::size_t index) const {
  if (index >= args.size() || args[index].kind != ActionArg::Kind::kState) return kNoState;
  return static_cast<uint32_t>(args[index].a);
}

void run_action(ActionCall& call) {
  const auto id = static_cast<std::size_t>(call.state.action);
  if (id < kActions.size() && kActions[id] != nullptr) kActions[id](call);
}

}  // namespace comrad::doom
