#include "sim_workers/engine/play/actor_states.h"

#include "sim_workers/engine/play/actions.h"

namespace comrad::doom {
namespace {

constexpr int kStatesAtOnceMax = 64;  // states without tics that one change may run through

}  // namespace

bool set_state(World& world, Actor& actor, uint32_t state_index) {
  for (int count = 0; count < kStatesAtOnceMax; ++count) {
    if (state_index == kNoState || state_index >= world.catalog().state_count()) {
      world.remove(actor.id);
      return false;
    }
    const State& state = world.catalog().state(state_index);
    actor.state = state_index;
    actor.tics = state.tics;
    if (state.fast && world.is_fast() && actor.tics > 1) actor.tics = (actor.tics + 1) / 2;
    if (state.tics > 0 && state.random_tics > 0)
      actor.tics +=
          static_cast<int32_t>(world.state().rng.below(static_cast<uint32_t>(state.random_tics) + 1));
    actor.sprite = state.sprite, actor.frame = state.frame;
    if (state.action != ActionId::kNone) {
      ActionCall call{.world = world, .self = actor, .state = state, .args = world.catalog().args(state)};
      run_action(call);
      if (actor.removed) return false;
      if (actor.state != state_index) return true;  // the action chose another state, which has begun
      if (call.has_jump) {
        state_index = call.jump;
        continue;
      }
    }
    if (actor.tics != 0) return true;
    state_index = state.next;
  }
  actor.tics = 1;  // a circle of states without time: continue in the next tic
  return true;
}

bool set_label(World& world, Actor& actor, StateLabel label) {
  const uint32_t state = world.type_of(actor).state(label);
  return state != kNoState && set_state(world, actor, state);
}

}  // namespace comrad::doom
