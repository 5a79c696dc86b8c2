// The scripted team of Armory Siege: each agent arms itself with what it can reach, fetches ammunition when
// it runs low, and otherwise shoots whatever comes nearest to the core.
#include <algorithm>
#include <cmath>

#include "sim_workers/engine/play/inventory.h"
#include "sim_workers/oracle/navigator.h"
#include "sim_workers/oracle/oracle.h"
#include "sim_workers/oracle/steering.h"

namespace comrad::sim {
namespace {

constexpr int32_t kEnemyId = 60, kCoreId = 50;

struct Wares {
  std::optional<uint32_t> pistol, shotgun, clip, shells, shell_box, medikit;
};

class Defenders final : public Oracle {
 public:
  void reset(const doom::World& world) override {
    const doom::ActorCatalog& catalog = world.catalog();
    wares_ = {catalog.find("SiegePistol"), catalog.find("SiegeShotgun"), catalog.find("Clip"),
              catalog.find("Shell"),       catalog.find("ShellBox"),     catalog.find("Medikit")};
    sidesteps_.assign(static_cast<std::size_t>(world.player_count()), {});
    goals_.assign(static_cast<std::size_t>(world.player_count()), 0);
  }

  void press(const doom::World& world, std::span<doom::Buttons> buttons) override {
    navigator_.refresh(world);
    enemies_.clear(), items_.clear();
    core_ = nullptr;
    for (const doom::Actor& actor : world.actors()) {
      if (actor.removed) continue;
      if (actor.thing_id == kEnemyId && actor.health > 0) enemies_.push_back(&actor);
      if (actor.thing_id == kCoreId) core_ = &actor;
      if (is(actor, wares_.pistol) || is(actor, wares_.shotgun) || is(actor, wares_.clip) ||
          is(actor, wares_.shell_box) || is(actor, wares_.medikit))
        items_.push_back(&actor);
    }
    for (int agent = 0; agent < world.player_count(); ++agent) {
      if (!world.player(agent).alive) continue;
      act(world, agent, buttons[agent]);
      sidesteps_[agent].apply(world.body(agent), buttons[agent]);
    }
  }

 private:
  static bool is(const doom::Actor& actor, std::optional<uint32_t> type) {
    return type && actor.type == *type;
  }
  int count(const doom::World& world, int agent, std::optional<uint32_t> type) const {
    return type ? doom::count_item(world, agent, *type) : 0;
  }

  void act(const doom::World& world, int agent, doom::Buttons& buttons) {
    const doom::Actor& body = world.body(agent);
    const doom::Player& player = world.player(agent);
    const Place here = place_of(body), core = core_ != nullptr ? place_of(*core_) : Place{};
    const bool pistol = count(world, agent, wares_.pistol) > 0,
               shotgun = count(world, agent, wares_.shotgun) > 0;
    const int clips = count(world, agent, wares_.clip), shells = count(world, agent, wares_.shells);
    const bool armed = (pistol && clips > 0) || (shotgun && shells >= 2);

    // Whom to shoot: what is near, and what is near the core.
    const doom::Actor* target = nullptr;
    double best = 1e9;
    if (armed)
      for (const doom::Actor* enemy : enemies_) {
        const double far = distance_between(here, place_of(*enemy));
        const double turn =
            std::abs(wrap_degrees(bearing_degrees(here, place_of(*enemy)) - angle_degrees(body)));
        const double cost = far + 1.5 * turn + 0.4 * distance_between(core, place_of(*enemy));
        if (cost < best && far < 1000 && sees(world, body, *enemy)) best = cost, target = enemy;
      }

    // What to fetch.
    const doom::Actor* item = nullptr;
    double best_value = 0;
    for (const doom::Actor* thing : items_) {
      double worth = 0;
      if (is(*thing, wares_.pistol)) worth = !armed ? 12 : !pistol ? 4 : clips < 100 ? 2 : 0;
      if (is(*thing, wares_.shotgun)) worth = !shotgun ? 14 : shells < 42 ? 4 : 0;
      if (is(*thing, wares_.shell_box)) worth = shotgun ? (shells < 30 ? 10 : 0) : 3;
      if (is(*thing, wares_.clip)) worth = pistol ? (clips < 60 ? 3 : 1) : 0.5;
      if (is(*thing, wares_.medikit)) worth = body.health < 75 ? 6 : 0;
      if (worth == 0) continue;
      const auto way = navigator_.way_length(here, place_of(*thing));
      if (!way || taken(thing->id, agent)) continue;
      if (target != nullptr && *way > 250 && armed && worth < 10) continue;  // first the fight
      double value = worth / (*way + 120);
      if (thing->id == goals_[agent]) value *= 1.3;
      if (value > best_value) best_value = value, item = thing;
    }
    goals_[agent] = item != nullptr ? item->id : 0;

    Place goal = here;
    if (item != nullptr) {
      goal = place_of(*item);
    } else if (!armed) {
      goal = away_from_enemies(here, core);
    } else {
      // Beside the core, on one's own side.
      const double angle = (90.0 + 360.0 * agent / world.player_count()) * 3.14159265 / 180;
      goal = {core.x + 90 * std::cos(angle), core.y + 90 * std::sin(angle)};
      if (!navigator_.is_open(goal)) goal = navigator_.nearest_open(goal, 128).value_or(here);
    }
    if (target != nullptr) {
      const Place there = place_of(*target);
      const double far = std::max(1.0, distance_between(here, there));
      if (far < 90 && item == nullptr)  // out of its reach
        goal = navigator_
                   .nearest_open(
                       {here.x + (here.x - there.x) / far * 120, here.y + (here.y - there.y) / far * 120}, 96)
                   .value_or(goal);
      else if (item == nullptr && shotgun && shells >= 2 && far > 220)
        goal = distance_between(core, there) < 420 ? there : goal;  // the shotgun wants it near
      const Place ahead{there.x + doom::to_double(target->velocity_x) * 3,
                        there.y + doom::to_double(target->velocity_y) * 3};
      const double off = aim_at(player, body, bearing_degrees(here, ahead), buttons);
      const double wide = std::atan2(doom::to_double(target->radius) * 0.9, far) * 180 / 3.14159265;
      const bool use_shotgun = shotgun && shells >= 2 && (far < 420 || !(pistol && clips > 0));
      select(world, agent, use_shotgun, shotgun, pistol, buttons);
      buttons.attack = off < std::max(wide, use_shotgun ? 3.5 : 2.0);
    }
    const Place next = navigator_.waypoint(here, goal).value_or(goal);
    if (target != nullptr)
      walk_to(body, next, {.stop_units = 10}, buttons);
    else
      go_to(body, next, {.stop_units = item != nullptr ? 2.0 : 24.0}, buttons);
  }

  static void select(const doom::World& world, int agent, bool use_shotgun, bool shotgun, bool pistol,
                     doom::Buttons& buttons) {
    if (!shotgun || !pistol) return;
    const doom::Player& player = world.player(agent);
    const auto wanted = world.catalog().find(use_shotgun ? "SiegeShotgun" : "SiegePistol");
    if (!wanted || player.ready_weapon == *wanted || player.pending_weapon == *wanted) return;
    buttons.select_weapon = use_shotgun ? 2 : 1;
  }

  bool taken(uint32_t item, int agent) const {
    for (std::size_t other = 0; other < goals_.size(); ++other)
      if (static_cast<int>(other) < agent && goals_[other] == item) return true;
    return false;
  }

  Place away_from_enemies(Place here, Place core) const {
    Place away{0, 0};
    for (const doom::Actor* enemy : enemies_) {
      const double far = std::max(40.0, distance_between(here, place_of(*enemy)));
      if (far > 300) continue;
      away.x += (here.x - place_of(*enemy).x) / far / far,
          away.y += (here.y - place_of(*enemy).y) / far / far;
    }
    const double length = std::hypot(away.x, away.y);
    if (length < 1e-6) return distance_between(here, core) > 150 ? core : here;
    return navigator_.nearest_open({here.x + away.x / length * 120, here.y + away.y / length * 120}, 160)
        .value_or(here);
  }

  Navigator navigator_{{.cell_units = 16}};
  Wares wares_;
  const doom::Actor* core_ = nullptr;
  std::vector<const doom::Actor*> enemies_, items_;
  std::vector<uint32_t> goals_;  // [N] actor id of the item on the way to, 0 none
  std::vector<Sidestep> sidesteps_;
};

}  // namespace

Expected<std::unique_ptr<Oracle>> make_armory_siege_oracle(const DoomGame&) {
  return std::unique_ptr<Oracle>(std::make_unique<Defenders>());
}

}  // namespace comrad::sim
