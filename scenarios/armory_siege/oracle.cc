// The scripted team of Armory Siege: the team shares out what it can reach, guns to those without one and shells to
// those with few; everybody else shoots whatever comes nearest to the core.
#include <algorithm>
#include <cmath>
#include <map>

#include "sim_workers/engine/play/inventory.h"
#include "sim_workers/oracle/navigator.h"
#include "sim_workers/oracle/oracle.h"
#include "sim_workers/oracle/steering.h"

namespace comrad::sim {
namespace {

constexpr int32_t kEnemyId = 60, kCoreId = 50;
constexpr int kFrail = 20;  // health that two bullets of a pistol take
constexpr double kSight = 1000;
constexpr int kShotgunDamage = 110,
              kPistolDamage = 30;  // that an agent is good for until it is looked at again

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
    team_.assign(static_cast<std::size_t>(world.player_count()), {});
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
    look(world);
    share_out(world);
    for (int agent = 0; agent < world.player_count(); ++agent) {
      if (!world.player(agent).alive) continue;
      act(world, agent, buttons[agent]);
      sidesteps_[agent].apply(world.body(agent), buttons[agent]);
    }
  }

 private:
  /// An agent at a decision.
  struct Defender {
    bool alive = false, pistol = false, shotgun = false;
    int clips = 0, shells = 0;
    uint32_t target_before = 0,
             target_id = 0;               ///< at which it aimed at the last decision and does now, 0 none
    const doom::Actor* target = nullptr;  ///< the same
    const doom::Actor* item = nullptr;    ///< which it fetches
    bool armed() const { return (pistol && clips > 0) || (shotgun && shells >= 2); }
  };

  static bool is(const doom::Actor& actor, std::optional<uint32_t> type) {
    return type && actor.type == *type;
  }
  int count(const doom::World& world, int agent, std::optional<uint32_t> type) const {
    return type ? doom::count_item(world, agent, *type) : 0;
  }

  /// What everybody carries, and whom each would shoot: what is near, and what is near the core.
  void look(const doom::World& world) {
    struct Mark {
      double cost;
      int agent;
      const doom::Actor* enemy;
    };
    std::vector<Mark> marks;
    const Place core = core_ != nullptr ? place_of(*core_) : Place{};
    for (int agent = 0; agent < world.player_count(); ++agent) {
      Defender& one = team_[agent];
      one = {.target_before = one.target_id};
      one.alive = world.player(agent).alive;
      if (!one.alive) continue;
      const doom::Actor& body = world.body(agent);
      one.pistol = count(world, agent, wares_.pistol) > 0,
      one.shotgun = count(world, agent, wares_.shotgun) > 0;
      one.clips = count(world, agent, wares_.clip), one.shells = count(world, agent, wares_.shells);
      if (!one.armed()) continue;
      const Place here = place_of(body);
      for (const doom::Actor* enemy : enemies_) {
        const double far = distance_between(here, place_of(*enemy));
        if (far >= kSight || !sees(world, body, *enemy)) continue;
        const double turn =
            std::abs(wrap_degrees(bearing_degrees(here, place_of(*enemy)) - angle_degrees(body)));
        const double kept = enemy->id == one.target_before ? 60 : 0;
        marks.push_back(
            {far + 1.5 * turn + 0.4 * distance_between(core, place_of(*enemy)) - kept, agent, enemy});
      }
    }
    // The best pair first; a monster that enough of them aim at is left alone by the others, for the shells.
    std::sort(marks.begin(), marks.end(), [](const Mark& a, const Mark& b) { return a.cost < b.cost; });
    std::map<uint32_t, int> pledged;
    for (const Mark& mark : marks) {
      Defender& one = team_[mark.agent];
      int& sum = pledged[mark.enemy->id];
      if (one.target != nullptr || sum >= mark.enemy->health) continue;
      one.target = mark.enemy, one.target_id = mark.enemy->id;
      sum += one.shotgun && one.shells >= 2 ? kShotgunDamage : kPistolDamage;
    }
  }

  /// What a thing that lies about is worth to an agent, in some unit.
  double worth(const doom::Actor& thing, const Defender& one, int health, bool all_have_shotguns) const {
    if (is(thing, wares_.pistol)) return !one.armed() ? 12 : !one.pistol ? 4 : one.clips < 100 ? 2 : 0;
    if (is(thing, wares_.shotgun)) {
      if (!one.shotgun) return 14;
      if (!all_have_shotguns && one.shells >= 2) return 0;  // somebody needs it more
      return one.shells < 12 ? 10 : one.shells < 42 ? 4 : 0;
    }
    if (is(thing, wares_.shell_box)) return !one.shotgun ? 1 : one.shells < 38 ? 14 - 0.25 * one.shells : 0;
    if (is(thing, wares_.clip)) return one.pistol ? (one.clips < 60 ? 3 : 1) : 0.5;
    if (is(thing, wares_.medikit)) return health < 40 ? 10 : health < 75 ? 6 : 0;
    return 0;
  }

  /// Who fetches what: the pair that is worth most for its way first.
  void share_out(const doom::World& world) {
    struct Errand {
      double value;
      int agent;
      const doom::Actor* item;
    };
    const bool all_have_shotguns = std::all_of(team_.begin(), team_.end(),
                                               [](const Defender& one) { return !one.alive || one.shotgun; });
    std::vector<Errand> errands;
    for (int agent = 0; agent < world.player_count(); ++agent) {
      const Defender& one = team_[agent];
      if (!one.alive) continue;
      const doom::Actor& body = world.body(agent);
      for (const doom::Actor* thing : items_) {
        const double gain = worth(*thing, one, body.health, all_have_shotguns);
        if (gain == 0) continue;
        const auto way = navigator_.way_length(place_of(body), place_of(*thing));
        if (!way) continue;
        if (one.target != nullptr && *way > 250 && gain < 10) continue;  // first the fight
        errands.push_back({gain / (*way + 120) * (thing->id == goals_[agent] ? 1.3 : 1.0), agent, thing});
      }
    }
    std::sort(errands.begin(), errands.end(),
              [](const Errand& a, const Errand& b) { return a.value > b.value; });
    std::vector<uint32_t> taken;
    for (const Errand& errand : errands) {
      if (team_[errand.agent].item != nullptr ||
          std::find(taken.begin(), taken.end(), errand.item->id) != taken.end())
        continue;
      team_[errand.agent].item = errand.item;
      taken.push_back(errand.item->id);
    }
    for (std::size_t agent = 0; agent < team_.size(); ++agent)
      goals_[agent] = team_[agent].item != nullptr ? team_[agent].item->id : 0;
  }

  void act(const doom::World& world, int agent, doom::Buttons& buttons) {
    const doom::Actor& body = world.body(agent);
    const doom::Player& player = world.player(agent);
    const Place here = place_of(body), core = core_ != nullptr ? place_of(*core_) : Place{};
    const Defender& one = team_[agent];
    const doom::Actor *const target = one.target, *const item = one.item;
    Place goal = here;
    if (item != nullptr) {
      goal = place_of(*item);
    } else if (!one.armed()) {
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
      else if (item == nullptr && one.shotgun && one.shells >= 2 && far > 220)
        goal = distance_between(core, there) < 420 ? there : goal;  // the shotgun requires it near
      const Place ahead{there.x + doom::to_double(target->velocity_x) * 3,
                        there.y + doom::to_double(target->velocity_y) * 3};
      const double off = aim_at(player, body, bearing_degrees(here, ahead), buttons);
      const double wide = std::atan2(doom::to_double(target->radius) * 0.9, far) * 180 / 3.14159265;
      const bool spares_shells = one.pistol && one.clips > 0 && (far >= 700 || target->health <= kFrail);
      const bool use_shotgun = one.shotgun && one.shells >= 2 && !spares_shells;
      select(world, agent, use_shotgun, one.shotgun, one.pistol, buttons);
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
  std::vector<Defender> team_;   // [N]
  std::vector<uint32_t> goals_;  // [N] actor id of the item on the way to, 0 none
  std::vector<Sidestep> sidesteps_;
};

}  // namespace

Expected<std::unique_ptr<Oracle>> make_armory_siege_oracle(const DoomGame&) {
  return std::unique_ptr<Oracle>(std::make_unique<Defenders>());
}

}  // namespace comrad::sim
