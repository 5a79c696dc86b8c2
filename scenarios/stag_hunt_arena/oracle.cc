// The scripted team of Stag Hunt Arena: everybody waits around the stag's spot, shoots it as soon as it
// stands there unshielded, and shoots hares that come near in the meantime.
#include <algorithm>
#include <cmath>
#include <numbers>

#include "sim_workers/oracle/oracle.h"
#include "sim_workers/oracle/steering.h"

namespace comrad::sim {
namespace {

constexpr int32_t kStagId = 200, kHareId = 300;
constexpr double kRing = 170;  // from the stag: all pellets hit, claws do not reach
constexpr double kTooNear = 115;
constexpr double kHareReach = 380;

class StagHunters final : public Oracle {
 public:
  void reset(const doom::World&) override {}

  void press(const doom::World& world, std::span<doom::Buttons> buttons) override {
    const doom::Actor* stag = nullptr;
    std::vector<const doom::Actor*> hares;
    for (const doom::Actor& actor : world.actors()) {
      if (actor.removed || actor.health <= 0) continue;
      if (actor.thing_id == kStagId) stag = &actor;
      if (actor.thing_id == kHareId && !actor.has(doom::ActorFlag::kInvulnerable)) hares.push_back(&actor);
    }
    const int count = world.player_count();
    for (int agent = 0; agent < count; ++agent) {
      const doom::Actor& body = world.body(agent);
      if (!world.player(agent).alive) continue;
      const Place here = place_of(body);
      // Hunters stand side by side in the south, where they come from, so that nobody shoots through
      // a partner.
      const double angle = (-90.0 + (agent - (count - 1) / 2.0) * 50.0) * std::numbers::pi / 180;
      const Place centre = stag != nullptr ? place_of(*stag) : Place{0, 0};
      Place post{centre.x + kRing * std::cos(angle), centre.y + kRing * std::sin(angle)};
      if (stag != nullptr) {
        const double far = distance_between(here, centre);
        if (far < kTooNear) {  // step back
          post = {here.x + (here.x - centre.x) / std::max(far, 1.0) * 120,
                  here.y + (here.y - centre.y) / std::max(far, 1.0) * 120};
        } else if (far < kRing + 90) {
          post = here;
        }
      }
      walk_to(body, post, {.stop_units = 12}, buttons[agent]);
      const doom::Actor* target = stag;
      if (target == nullptr) {
        double best = kHareReach;
        for (const doom::Actor* hare : hares) {
          const double far = distance_between(here, place_of(*hare));
          if (far < best) best = far, target = hare;
        }
      }
      if (target == nullptr) {
        if (distance_between(here, post) > 300)
          turn_to(body, bearing_degrees(here, post), buttons[agent]);
        else
          aim_at(world.player(agent), body, bearing_degrees(here, {0, 0}), buttons[agent]);
        continue;
      }
      const Place there{doom::to_double(target->x) + doom::to_double(target->velocity_x) * 3,
                        doom::to_double(target->y) + doom::to_double(target->velocity_y) * 3};
      const double far = std::max(1.0, distance_between(here, there));
      const double off = aim_at(world.player(agent), body, bearing_degrees(here, there), buttons[agent]);
      const double wide = std::atan2(doom::to_double(target->radius), far) * 180 / std::numbers::pi;
      const bool shielded = target->has(doom::ActorFlag::kInvulnerable);
      buttons[agent].attack = !shielded && off < std::max(wide * 0.8, 2.5) && far < 700;
    }
  }
};

}  // namespace

Expected<std::unique_ptr<Oracle>> make_stag_hunt_arena_oracle(const DoomGame&) {
  return std::unique_ptr<Oracle>(std::make_unique<StagHunters>());
}

}  // namespace comrad::sim
