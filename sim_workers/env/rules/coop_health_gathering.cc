#include "sim_workers/env/rules/coop_health_gathering.h"

#include <algorithm>
#include <cstdlib>
#include <string>

#include "sim_workers/engine/play/inventory.h"

namespace comrad::sim {
namespace {

using doom::Fixed;
using doom::to_fixed;

constexpr int32_t kArenaTag = 900;
constexpr int32_t kDamageIntervalTics = 32;
constexpr int32_t kKitIntervalTics = 35, kKitsPerInterval = 3;
constexpr uint32_t kStimpackOfFour = 3;     // three kits of four are Stimpacks
constexpr int32_t kTetherIntervalTics = 5;  // how often its picture is renewed
constexpr int32_t kSlackUnits = 24;         // a pull leaves this much
constexpr int32_t kFlashTics = 6;
constexpr int32_t kNodeHeightUnits = 20;
constexpr int kBarSegmentCount = 20;

constexpr std::array<const char*, 3> kNodeNames = {"TetherCalm", "TetherWarn", "TetherHot"};
// Plasma green, fireball orange, blood red. A blood splat is smaller than a ball, hence its larger scale.
constexpr std::array<const char*, 3> kNodeSprites = {"APLS", "BAL1", "BLUD"};
constexpr std::array<float, 3> kNodeScales = {0.13f, 0.13f, 0.18f};

}  // namespace

void CoopHealthGatheringRules::add_actors(doom::ActorCatalog& catalog) {
  for (std::size_t i = 0; i < kNodeNames.size(); ++i) {
    doom::ActorType node;
    node.name = kNodeNames[i];
    node.radius = to_fixed(1);
    node.height = to_fixed(1);
    node.flags.set(doom::ActorFlag::kNoGravity);
    node.flags.set(doom::ActorFlag::kNoBlockmap);
    node.flags.set(doom::ActorFlag::kBright);
    node.scale_x = node.scale_y = kNodeScales[i];
    catalog.add_simple(std::move(node), kNodeSprites[i], "A", -1, true);
  }
}

std::unique_ptr<NativeRules> CoopHealthGatheringRules::make(const scenarios::LayoutInfo& layout,
                                                            const doom::ActorCatalog& catalog) {
  return std::unique_ptr<NativeRules>(new CoopHealthGatheringRules(layout, catalog));
}

CoopHealthGatheringRules::CoopHealthGatheringRules(const scenarios::LayoutInfo& layout,
                                                   const doom::ActorCatalog& catalog)
    // The lump may have been written by hand: numbers are held inside what the arithmetic below can carry.
    : tether_(to_fixed(
          static_cast<int>(std::clamp<int64_t>(layout.parameter("tether", 400), 2 * kSlackUnits, 16384)))),
      damage_(static_cast<int32_t>(std::clamp<int64_t>(layout.parameter("damage", 5), 0, 1000))),
      kit_cap_(static_cast<int32_t>(std::clamp<int64_t>(layout.parameter("kit_cap", 80), 0, 10000))) {
  const auto type = [&](const char* name) {
    const std::optional<uint32_t> found = catalog.find(name);
    COMRAD_CHECK(found.has_value(), std::string("the catalog has the actor type ") + name);
    return *found;
  };
  stimpack_ = type("Stimpack");
  medikit_ = type("Medikit");
  for (std::size_t i = 0; i < kNodeNames.size(); ++i) node_types_[i] = type(kNodeNames[i]);
}

void CoopHealthGatheringRules::on_open(doom::World& world) {
  spots_.clear();
  for (const doom::MapThing& thing : world.level().things)
    if (thing.editor_number == scenarios::kMapSpotEditorNumber && thing.id >= scenarios::kFirstSpotId)
      spots_.push_back({thing.x, thing.y, world.sectors()[world.sector_at(thing.x, thing.y)].floor_height});
  links_.assign(static_cast<std::size_t>(std::max(0, world.player_count() - 1)), Link{});
  taken_by_.fill(0);
  tic_ = 0;
  spawned_ = taken_ = stretches_ = flash_tics_ = 0;
  exit_in_tics_ = -1;
  world.set_sector_damage(kArenaTag, damage_, kDamageIntervalTics);
  export_counters(world);
}

// Players have 100 health as they enter; their weapons are taken away.
void CoopHealthGatheringRules::on_enter(doom::World& world, int player) {
  doom::clear_inventory(world, player);
}

void CoopHealthGatheringRules::on_tic(doom::World& world) {
  if (exit_in_tics_ == 0) {
    world.exit_level();
    return;
  }
  if (exit_in_tics_ > 0) --exit_in_tics_;

  for (int first = 0; first < static_cast<int>(links_.size()); ++first) pull(world, first);
  if (tic_ % kTetherIntervalTics == 0) {
    for (int first = 0; first < static_cast<int>(links_.size()); ++first) draw_tether(world, first);
    draw_bar(world);
  }
  if (flash_tics_ > 0) --flash_tics_;
  if (tic_ % kKitIntervalTics == 0) spawn_kits(world);
  export_counters(world);
  ++tic_;
}

void CoopHealthGatheringRules::on_death(doom::World& world, int player) {
  (void)world, (void)player;
  if (exit_in_tics_ < 0) exit_in_tics_ = 1;
}

void CoopHealthGatheringRules::on_pickup(doom::World& world, int player, const doom::Actor& item) {
  (void)world;
  if (item.type != stimpack_ && item.type != medikit_) return;
  ++taken_;
  if (player >= 0 && player < static_cast<int>(taken_by_.size())) ++taken_by_[player];
}

void CoopHealthGatheringRules::spawn_kits(doom::World& world) {
  if (spots_.empty()) return;
  const int32_t lying = spawned_ - taken_;
  const int32_t wanted = std::min(kKitsPerInterval, kit_cap_ - lying);
  for (int32_t i = 0; i < wanted; ++i) {
    const Spot& spot = spots_[world.rng().below(static_cast<uint32_t>(spots_.size()))];
    const uint32_t type = world.rng().below(4) < kStimpackOfFour ? stimpack_ : medikit_;
    if (world.spawn(type, spot.x, spot.y, spot.z, 0)) ++spawned_;  // a blocked spot stays empty
  }
}

CoopHealthGatheringRules::Strain CoopHealthGatheringRules::strain(int64_t distance) const {
  if (distance * 10 > int64_t{tether_} * 9) return Strain::kHot;
  if (distance * 4 > int64_t{tether_} * 3) return Strain::kWarn;
  return Strain::kCalm;
}

void CoopHealthGatheringRules::pull(doom::World& world, int first) {
  Link& link = links_[first];
  struct Place {
    int64_t x, y;
  };
  const auto place = [&](int player) { return Place{world.body(player).x, world.body(player).y}; };
  const auto distance = [](Place a, Place b) {
    const int64_t dx = std::abs(a.x - b.x), dy = std::abs(a.y - b.y);
    return std::max(dx, dy) + std::min(dx, dy) / 2;
  };
  const Place a = place(first), b = place(first + 1);
  link.distance = distance(a, b);
  if (link.distance <= tether_ || !world.player(first).alive || !world.player(first + 1).alive) {
    link.is_stuck = false;
    return;
  }
  // Both come in along the line between them until their distance is the tether's length less the slack.
  const int64_t target = tether_ - to_fixed(kSlackUnits);
  const auto scaled = [&](int64_t offset) { return offset * target / link.distance; };
  const Place middle{(a.x + b.x) / 2, (a.y + b.y) / 2};
  const auto move = [&](int player, int64_t x, int64_t y) {
    return world.try_teleport(world.body(player).id, static_cast<Fixed>(x), static_cast<Fixed>(y));
  };
  const bool first_moved = move(first, middle.x + scaled(a.x - middle.x), middle.y + scaled(a.y - middle.y));
  const bool second_moved =
      move(first + 1, middle.x + scaled(b.x - middle.x), middle.y + scaled(b.y - middle.y));
  // Where one is blocked the other takes the whole pull, and a pair that stays overstretched is counted once:
  // the published rules count it at every tic.
  if (first_moved != second_moved && distance(place(first), place(first + 1)) > tether_) {
    if (first_moved)
      move(first, b.x + scaled(a.x - b.x), b.y + scaled(a.y - b.y));
    else
      move(first + 1, a.x + scaled(b.x - a.x), a.y + scaled(b.y - a.y));
  }
  if (!link.is_stuck) {
    ++stretches_;
    flash_tics_ = kFlashTics;
  }
  link.distance = distance(place(first), place(first + 1));
  link.is_stuck = link.distance > tether_;
}

void CoopHealthGatheringRules::draw_tether(doom::World& world, int first) {
  Link& link = links_[first];
  const Strain now = flash_tics_ > 0 ? Strain::kHot : strain(link.distance);
  if (now != link.drawn_as) {
    for (const uint32_t node : link.nodes) world.remove(node);
    link.nodes.clear();
    link.drawn_as = now;
  }
  const doom::Actor &a = world.body(first), &b = world.body(first + 1);
  for (int i = 0; i < kTetherNodeCount; ++i) {
    const auto between = [&](Fixed from, Fixed to) {
      return static_cast<Fixed>(from + (int64_t{to} - from) * (i + 1) / (kTetherNodeCount + 1));
    };
    const Fixed x = between(a.x, b.x), y = between(a.y, b.y),
                z = between(a.z, b.z) + to_fixed(kNodeHeightUnits);
    if (i < static_cast<int>(link.nodes.size())) {
      world.set_position(link.nodes[i], x, y, z);
    } else if (const auto node =
                   world.spawn(node_types_[static_cast<std::size_t>(now)], x, y, z, 0, 0, true)) {
      link.nodes.push_back(*node);
    }
  }
}

/// Each player sees the longer one of its own links.
void CoopHealthGatheringRules::draw_bar(doom::World& world) const {
  constexpr float kPitch = 2.0f / 128.0f, kWidth = 1.0f / 128.0f, kHeight = 2.0f / 72.0f, kCentreY = 0.90f;
  std::vector<doom::HudBox> boxes;
  boxes.reserve(static_cast<std::size_t>(world.player_count()) * kBarSegmentCount);
  for (int player = 0; player < world.player_count() && !links_.empty(); ++player) {
    int64_t distance = 0;
    if (player > 0) distance = links_[player - 1].distance;
    if (player < static_cast<int>(links_.size())) distance = std::max(distance, links_[player].distance);
    const Strain state = flash_tics_ > 0 ? Strain::kHot : strain(distance);
    const std::array<uint8_t, 3> color = state == Strain::kHot    ? std::array<uint8_t, 3>{255, 32, 32}
                                         : state == Strain::kWarn ? std::array<uint8_t, 3>{255, 208, 48}
                                                                  : std::array<uint8_t, 3>{48, 224, 48};
    const int64_t filled = (distance * kBarSegmentCount + tether_ - 1) / tether_;
    for (int segment = 0; segment < kBarSegmentCount; ++segment) {
      doom::HudBox box;
      box.player = player;
      box.x = 0.5f + (static_cast<float>(segment) - 0.5f * (kBarSegmentCount - 1)) * kPitch;
      box.y = kCentreY;
      box.width = kWidth;
      box.height = kHeight;
      box.color = segment < filled ? color : std::array<uint8_t, 3>{40, 40, 40};
      boxes.push_back(box);
    }
  }
  world.set_hud(std::move(boxes));
}

void CoopHealthGatheringRules::export_counters(doom::World& world) const {
  world.set_export(1, spawned_ - taken_);
  world.set_export(2, spawned_);
  world.set_export(3, stretches_);
  world.set_export(4, taken_);
  world.set_export(5, flash_tics_);
  for (std::size_t i = 0; i < taken_by_.size(); ++i)
    world.set_export(kFirstPickupExport + static_cast<int>(i), taken_by_[i]);
}

uint64_t CoopHealthGatheringRules::state_hash() const {
  uint64_t hash = 0;
  const auto mix = [&](uint64_t value) { hash = mix64(hash ^ value) + kGoldenGamma; };
  mix(static_cast<uint64_t>(tic_));
  for (const int32_t value : {spawned_, taken_, stretches_, flash_tics_, exit_in_tics_})
    mix(static_cast<uint32_t>(value));
  for (const int32_t value : taken_by_) mix(static_cast<uint32_t>(value));
  for (const Link& link : links_) {
    mix(static_cast<uint64_t>(link.distance));
    mix(link.is_stuck);
    mix(static_cast<uint64_t>(link.drawn_as));
    for (const uint32_t node : link.nodes) mix(node);
  }
  return hash;
}

}  // namespace comrad::sim
