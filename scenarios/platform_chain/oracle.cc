// The scripted team of Platform Chain. One moves at a time: the one behind, or of two on the same platform
// the one who came last, so that nobody is in a runner's lane. A jump is begun only when the next
// platform will be low enough and free of panels and ceilings for as long as the pair needs it. Both look
// east all the time and sidestep.
#include <algorithm>
#include <array>
#include <cmath>
#include <utility>
#include <vector>

#include "sim_workers/oracle/oracle.h"
#include "sim_workers/oracle/steering.h"

namespace comrad::sim {
namespace {

constexpr int kTallColumn = 30, kShortColumn = 31;  // editor numbers
constexpr int kFirstPlatformTag = 8000, kTicsPerDecision = 4;
constexpr double kHalf = 56;
// Along the way (s) and across it (l), from the platform's centre.
constexpr double kStartS = -30, kJumpS = 38, kEdgeS = 66, kLandS = -6;
constexpr double kLane = -24, kNorthLane = -28, kLaneByColumn = -54, kParkL = 36;
constexpr double kParkAheadS = 4, kParkBehindS = -14, kParkNorthS = 30;
constexpr double kRiseMax = 42, kDropMax = 64;  // of the next platform, when the runner gets there
constexpr double kClearance = 110;              // below a crusher's ceiling
constexpr double kVisitTics = 160, kLiftTics = 380;
constexpr int kPanelPeriod = 175;

struct Platform {
  Place centre;
  uint32_t sector = 0;
  double floor = 0, ceiling = 0;
  double floor_speed = 0, ceiling_speed = 0;  // units a tic
  int still_tics = 0;  // that its floor has been at rest; a rising one counts as long at rest
  bool is_lift = false, is_crusher = false, has_column = false;
};
struct Panel {
  double x = 0, start_y = 0, travel = 0, sign = 0;
};
enum class Phase { kWait, kRun, kFly };

class Climbers final : public Oracle {
 public:
  /// `checkpoint` are the numbers of the exports that count each agent's platforms.
  Climbers(const DoomGame& game, std::vector<int> checkpoint) : checkpoint_(std::move(checkpoint)) {
    const auto levels = static_cast<std::size_t>(game.layout.parameter("levels", 48));
    platforms_.resize(levels);
    for (std::size_t sector = 0; sector < game.level->sectors.size(); ++sector) {
      const int i = game.level->sectors[sector].tag - kFirstPlatformTag;
      if (i >= 0 && i < static_cast<int>(levels)) at(i).centre = extent_of(*game.level, sector).middle();
    }
    for (const doom::MapThing& thing : game.level->things)
      if (thing.editor_number == kTallColumn || thing.editor_number == kShortColumn)
        for (Platform& platform : platforms_)
          platform.has_column |=
              distance_between(platform.centre, {doom::to_double(thing.x), doom::to_double(thing.y)}) < kHalf;
    const int panels = static_cast<int>(game.layout.parameter("panels", 8));
    for (int k = 1; k <= panels; ++k) {
      int i = last() * k / (panels + 1);
      if (goes_north(i)) --i;
      const int j = k - 1;
      panels_.push_back({(at(i).centre.x + at(i + 1).centre.x) / 2, at(i).centre.y + 20, 128.0 + 32 * (j % 3),
                         j % 2 == 0 ? -1.0 : 1.0});
    }
  }

  void reset(const doom::World& world) override {
    for (std::size_t i = 0; i < world.sectors().size(); ++i) {
      const int index = world.sectors()[i].tag - kFirstPlatformTag;
      if (index >= 0 && index < static_cast<int>(platforms_.size()))
        at(index).sector = static_cast<uint32_t>(i);
    }
    for (Platform& platform : platforms_) {
      const doom::Sector& sector = world.sectors()[platform.sector];
      platform.floor = doom::to_double(sector.floor_height),
      platform.ceiling = doom::to_double(sector.ceiling_height);
      platform.floor_speed = platform.ceiling_speed = 0;
    }
    phase_ = {Phase::kWait, Phase::kWait};
    index_ = {0, 1};
    last_landed_ = 1;
  }

  void press(const doom::World& world, std::span<doom::Buttons> buttons) override {
    if (world.tic_count() == 0) return;  // the scripts have not chosen lifts and crushers yet
    look_at_platforms(world);
    for (int who = 0; who < 2; ++who) notice_landing(world, who);
    const int mover = choose_mover();
    for (int who = 0; who < 2; ++who) {
      doom::Buttons& keys = buttons[static_cast<std::size_t>(who)];
      if (phase_[who] == Phase::kFly) {
        walk_to(world.body(who), point(index_[who] + 1, kLandS, lane(index_[who]), index_[who]),
                {.stop_units = 8}, keys);
      } else if (who == mover) {
        advance(world, who, keys);
      } else if (is_left_behind(world, who)) {
        const int i = index_[who];
        walk_to(world.body(who), round_column(i, place_of(world.body(who)), point(i, kStartS, lane(i), i)),
                {.stop_units = 8}, keys);
      } else {
        park(world, who, keys);
      }
    }
  }

 private:
  Platform& at(int i) { return platforms_[static_cast<std::size_t>(i)]; }
  const Platform& at(int i) const { return platforms_[static_cast<std::size_t>(i)]; }
  int last() const { return static_cast<int>(platforms_.size()) - 1; }
  bool goes_north(int i) const { return i < last() && at(i + 1).centre.y > at(i).centre.y; }
  /// Of the way from i to i + 1: +-1 east or west; 0 where it goes north.
  double east_sign(int i) const {
    if (goes_north(i)) return 0;
    const int from = std::min(i, last() - 1);
    return at(from + 1).centre.x > at(from).centre.x ? 1 : -1;
  }
  double lane(int i) const {
    if (goes_north(i)) return kNorthLane;
    return at(i).has_column || at(std::min(i + 1, last())).has_column ? kLaneByColumn : kLane;
  }
  /// A place on `platform`, in the terms of the way from `from` on.
  Place point(int platform, double s, double l, int from) const {
    const Place c = at(std::min(platform, last())).centre;
    if (goes_north(from)) return {c.x + l, c.y + s};
    return {c.x + s * east_sign(from), c.y + l};
  }
  double s_of(Place p, int platform, int from) const {
    const Place c = at(platform).centre;
    return goes_north(from) ? p.y - c.y : (p.x - c.x) * east_sign(from);
  }
  double l_of(Place p, int platform, int from) const {
    const Place c = at(platform).centre;
    return goes_north(from) ? p.x - c.x : p.y - c.y;
  }

  void look_at_platforms(const doom::World& world) {
    for (Platform& platform : platforms_) {
      const doom::Sector& sector = world.sectors()[platform.sector];
      const double floor = doom::to_double(sector.floor_height),
                   ceiling = doom::to_double(sector.ceiling_height);
      platform.floor_speed = (floor - platform.floor) / kTicsPerDecision;
      platform.ceiling_speed = (ceiling - platform.ceiling) / kTicsPerDecision;
      platform.still_tics = platform.floor_speed < 0   ? 0
                            : platform.floor_speed > 0 ? 1000
                                                       : platform.still_tics + kTicsPerDecision;
      platform.floor = floor, platform.ceiling = ceiling;
      platform.is_lift = sector.floor_texture == "FLAT14";
      platform.is_crusher = sector.floor_texture == "BLOOD1";
    }
  }

  void notice_landing(const doom::World& world, int who) {
    const doom::Actor& body = world.body(who);
    if (body.z > body.floor_z) return;
    const Place here = place_of(body);
    for (int i = std::max(0, index_[who] - 1); i <= std::min(last(), index_[who] + 1); ++i) {
      const Place c = at(i).centre;
      if (std::abs(here.x - c.x) > kHalf + kPlayerRadius || std::abs(here.y - c.y) > kHalf + kPlayerRadius)
        continue;
      if (i == index_[who] && phase_[who] == Phase::kFly && fly_decisions_[who]++ < 3) return;  // not off yet
      if (i != index_[who]) last_landed_ = who;
      index_[who] = i;
      if (phase_[who] == Phase::kFly) phase_[who] = Phase::kWait;
      return;
    }
  }

  /// The partner has jumped off; time to take its place.
  bool is_left_behind(const doom::World& world, int who) const {
    const int partner = 1 - who, i = index_[who];
    return phase_[partner] == Phase::kFly && index_[partner] == i && i < last() &&
           s_of(place_of(world.body(partner)), i, i) > kHalf;
  }

  int choose_mover() const {
    for (int who = 0; who < 2; ++who)
      if (phase_[who] == Phase::kFly) return -1;
    for (int who = 0; who < 2; ++who)
      if (phase_[who] == Phase::kRun) return who;
    if (index_[0] != index_[1]) return index_[0] < index_[1] ? 0 : 1;
    return index_[0] >= last() ? -1 : last_landed_;
  }

  /// Beside the lane: behind a partner who is ahead at the front, else at the back.
  void park(const doom::World& world, int who, doom::Buttons& keys) {
    const int i = index_[who];
    const bool partner_is_behind = index_[1 - who] < i;
    const int from = partner_is_behind ? i - 1 : std::min(i, last() - 1);
    const double ahead = goes_north(from) ? kParkNorthS : kParkAheadS;
    const Place goal = point(i, partner_is_behind ? kParkBehindS : ahead, kParkL, from);
    walk_to(world.body(who), round_column(i, place_of(world.body(who)), goal), {.stop_units = 8}, keys);
  }

  void advance(const doom::World& world, int who, doom::Buttons& keys) {
    const int i = index_[who];
    const doom::Actor& body = world.body(who);
    const Place here = place_of(body);
    const double vx = doom::to_double(body.velocity_x), vy = doom::to_double(body.velocity_y);
    const double s = s_of(here, i, i), l = l_of(here, i, i), wanted_l = lane(i);
    const double speed_s = goes_north(i) ? vy : vx * east_sign(i), speed_l = goes_north(i) ? vx : vy;
    if (world.exported(checkpoint_[static_cast<std::size_t>(who)]) < i) {  // stands on it, but not far enough
      walk_to(body, round_column(i, here, {at(i).centre.x - 30, at(i).centre.y - 30}), {.stop_units = 8},
              keys);
      return;
    }
    if (phase_[who] == Phase::kWait) {
      const bool is_there = std::abs(s - kStartS) < 14 &&
                            std::abs(l - wanted_l) < (wanted_l == kLaneByColumn ? 7 : 12) &&
                            std::hypot(vx, vy) < 2.5;
      if (!is_there || !may_go(world, who, 28)) {
        walk_to(body, round_column(i, here, point(i, kStartS, wanted_l, i)), {.stop_units = 8}, keys);
        return;
      }
      phase_[who] = Phase::kRun;
      run_decisions_ = 0;
    }
    if (speed_s < (s >= kJumpS - 10 ? 2.5 : 0.5) && run_decisions_++ > 2) {  // something is in the way
      phase_[who] = Phase::kWait;
      return;
    }
    const bool is_last_chance = s + speed_s * kTicsPerDecision + 3 > kEdgeS;
    const double contact_tics = std::max(0.0, kJumpS + 10 - s) / std::max(speed_s + 1.5, 4.0) + 9;
    if (!may_go(world, who, contact_tics) && s < kJumpS + 14) {
      phase_[who] = Phase::kWait;
      walk_to(body, point(i, kStartS, wanted_l, i), {.stop_units = 8}, keys);
      return;
    }
    // To a side only where that brings the landing nearer to the middle of the lane.
    const double ground_tics = std::max(0.0, kJumpS + 8 - s) / std::max(3.0, speed_s + 1.5);
    int sideways = 0;
    for (const int side : {-1, 1})
      if (std::abs(landing_l(l, speed_l, side, ground_tics) - wanted_l) + 2 <
          std::abs(landing_l(l, speed_l, sideways, ground_tics) - wanted_l))
        sideways = side;
    if (goes_north(i)) {
      keys.left = true;  // looking east
      keys.forward = sideways > 0, keys.backward = sideways < 0;
    } else {
      (east_sign(i) > 0 ? keys.forward : keys.backward) = true;
      keys.left = sideways > 0, keys.right = sideways < 0;
    }
    if (s >= kJumpS || is_last_chance) {
      keys.jump = true;
      phase_[who] = Phase::kFly;
      fly_decisions_[who] = 0;
    }
  }

  /// Where across the way a runner lands that pushes to a side (-1, 0, 1) for one decision.
  static double landing_l(double l, double speed, int push, double ground_tics) {
    constexpr double kPush = 0.75, kFriction = 0.90625, kAirTics = 15;
    for (int t = 0; t < std::max(4, static_cast<int>(ground_tics)); ++t) {
      if (t < kTicsPerDecision) speed += push * kPush;
      l += speed;
      speed *= kFriction;
    }
    return l + speed * kAirTics;
  }

  /// The goal, or a place on the way to it round the column that stands on some platforms.
  Place round_column(int i, Place here, Place goal) const {
    if (!at(i).has_column) return goal;
    const Place c = at(i).centre;
    const Place h{here.x - c.x, here.y - c.y}, g{goal.x - c.x, goal.y - c.y};
    bool is_barred = false;
    for (int k = 0; k <= 16; ++k) {
      const double x = h.x + (g.x - h.x) * k / 16, y = h.y + (g.y - h.y) * k / 16;
      is_barred |= x > -16 && x < 52 && y > -47 && y < 19;
    }
    if (!is_barred) return goal;
    if (h.x >= 46) return {here.x, c.y + (g.y > -14 ? 34 : -58)};
    if (h.x > -20) return {c.x - 32, c.y + (h.y > -14 ? 36 : -58)};
    return {c.x - 32, c.y + (g.y > -14 ? 36 : -60)};
  }

  /// Will the next platform do for a runner who gets there in `tics`?
  bool may_go(const doom::World& world, int who, double tics) const {
    const int i = index_[who], next = i + 1;
    const Platform &from = at(i), &to = at(next);
    const double rise =
        to.floor + to.floor_speed * tics - from.floor - from.floor_speed * std::max(0.0, tics - 10);
    if (rise > kRiseMax || rise < -kDropMax) return false;
    if (!panel_is_clear(world, i, tics + 12)) return false;
    const bool joins = index_[1 - who] >= next;
    // To wait under a ceiling is no better than to continue under another one.
    if (to.is_crusher && safe_tics(to) < (joins ? 50 : from.is_crusher ? kVisitTics : need_tics(next)))
      return false;
    // From below a ceiling two in a row must make it onto a lift: the first one while it still sinks.
    if (from.is_crusher && to.is_lift && index_[1 - who] == i && phase_[who] == Phase::kWait &&
        to.floor_speed >= 0 && to.still_tics > 12)
      return false;
    // The partner out of both lanes.
    const int partner = 1 - who;
    const Place there = place_of(world.body(partner));
    const double across = std::abs(l_of(there, next, i) - lane(i)), along = s_of(there, i, i);
    return across >= 34 || along < s_of(place_of(world.body(who)), i, i) - 33;
  }

  /// Tics until the ceiling comes near; 0 while it is.
  double safe_tics(const Platform& platform) const {
    const double room = platform.ceiling - platform.floor;
    const double down = (2048 - platform.floor - kClearance) / 8;
    if (room < kClearance) return 0;
    if (platform.ceiling_speed > 0) return (2048 - platform.ceiling) / 4 + down;
    return (room - kClearance) / 8;
  }
  /// How long a pair needs a crusher's platform, what comes after it included.
  double need_tics(int i) const {
    double need = kVisitTics;
    for (int next = i + 1; next <= last(); ++next) {
      if (at(next).is_lift) need += kLiftTics;
      if (!goes_north(next - 1) && is_swept(next - 1)) need += kPanelPeriod;
      if (!at(next).is_crusher) break;
      need += kVisitTics - 30;
    }
    const double longest = (2048 - at(i).floor - kClearance) * (1.0 / 4 + 1.0 / 8);
    return std::min(need, longest - 60);
  }

  bool is_swept(int i) const {
    for (const Panel& panel : panels_)
      if (std::abs(panel.x - (at(i).centre.x + at(i + 1).centre.x) / 2) < 110 &&
          std::abs(panel.start_y - at(i).centre.y) < 200)
        return true;
    return false;
  }

  /// No panel in the gap behind platform i for that long; panels of other rows swing into it as well.
  bool panel_is_clear(const doom::World& world, int i, double tics) const {
    if (goes_north(i)) return true;
    const double x = (at(i).centre.x + at(i + 1).centre.x) / 2, y = at(i).centre.y + lane(i);
    for (const Panel& panel : panels_) {
      if (std::abs(panel.x - x) > 110 || std::abs(panel.start_y - y) > 300) continue;
      for (int t = std::max(0, static_cast<int>(tics) - 30); t <= static_cast<int>(tics); ++t) {
        const auto phase =
            static_cast<int>((world.tic_count() + static_cast<uint64_t>(t)) % (2 * kPanelPeriod));
        const double gone = phase < kPanelPeriod
                                ? std::min(2.0 * phase, panel.travel)
                                : panel.travel - std::min(2.0 * (phase - kPanelPeriod), panel.travel);
        if (std::abs(panel.start_y + panel.sign * gone - y) < 10 + kPlayerRadius + 5) return false;
      }
    }
    return true;
  }

  std::vector<int> checkpoint_;  // [agent]
  std::vector<Platform> platforms_;
  std::vector<Panel> panels_;
  std::array<Phase, 2> phase_{};
  std::array<int, 2> index_{};
  std::array<int, 2> fly_decisions_{};
  int last_landed_ = 1, run_decisions_ = 0;
};

}  // namespace

Expected<std::unique_ptr<Oracle>> make_platform_chain_oracle(const DoomGame& game) {
  COMRAD_TRY_ASSIGN(std::vector<int> checkpoint, game.spec.user_numbers({"checkpoint_1", "checkpoint_2"}));
  return std::unique_ptr<Oracle>(std::make_unique<Climbers>(game, std::move(checkpoint)));
}

}  // namespace comrad::sim
