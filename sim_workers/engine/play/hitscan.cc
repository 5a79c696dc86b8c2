#include "sim_workers/engine/play/hitscan.h"

#include <algorithm>
#include <array>
#include <cstdlib>
#include <tuple>

#include "sim_workers/engine/map/level_index.h"
#include "sim_workers/engine/play/actor_states.h"
#include "sim_workers/engine/play/damage.h"
#include "sim_workers/engine/world/polyobject_lines.h"

namespace comrad::doom {
namespace {

constexpr int kFractionBits = 32;  // of a fraction inside this file; PathCrossing has 16
constexpr int64_t kWhole = int64_t{1} << kFractionBits;
constexpr int64_t kPieceLength = int64_t{to_fixed(128)};  // a path is searched in pieces as long as a cell
constexpr std::size_t kCrossingsAtOnce = 24;              // what more a piece holds is searched again
constexpr Fixed kUseRange = to_fixed(64);
constexpr Fixed kAimRange = to_fixed(1024);
constexpr Fixed kRailRange = to_fixed(8192);
constexpr Fixed kSawRange = to_fixed(65);  // a saw's 65; puffs of longer attacks look like bullets'
constexpr int kAimDegrees = 35;
constexpr Angle kAimSideways = 1u << 26;         // 5.6 degrees
constexpr Angle kAimFreely = 0x80000000u / 360;  // half a degree
constexpr Angle kSteepest = degrees_to_angle(85);
constexpr Fixed kPuffGap = to_fixed(4);   // a puff stands before its wall
constexpr Fixed kShoulder = to_fixed(8);  // a shot starts this far above the middle of a body

// What a search requires of actors: where the path crosses a diagonal of their box (aiming, contacts), or where
// it enters and leaves the box (shots).
enum class ActorShape { kNone, kDiagonal, kBox };

struct Path {
  int64_t x = 0, y = 0;
  int64_t dx = 0, dy = 0;

  int64_t x_at(int64_t fraction) const {
    return x + static_cast<int64_t>((static_cast<__int128>(dx) * fraction) >> kFractionBits);
  }
  int64_t y_at(int64_t fraction) const {
    return y + static_cast<int64_t>((static_cast<__int128>(dy) * fraction) >> kFractionBits);
  }
};

struct Crossing {
  int64_t fraction = -1;
  int64_t leaves = 0;     // of a box
  bool is_actor = false;  // a line comes before an actor at the same place
  uint32_t index = 0;     // linedef, or the actor's id
  Actor* actor = nullptr;

  bool operator<(const Crossing& other) const {
    return std::tie(fraction, is_actor, index) < std::tie(other.fraction, other.is_actor, other.index);
  }
};

/// above / below as a fraction, cut off far outside of the way.
int64_t fraction_of(int64_t above, int64_t below) {
  const __int128 fraction = (static_cast<__int128>(above) << kFractionBits) / below;
  return static_cast<int64_t>(std::clamp<__int128>(fraction, -4 * kWhole, 4 * kWhole));
}

__int128 cross(int64_t ax, int64_t ay, int64_t bx, int64_t by) {
  return static_cast<__int128>(ax) * by - static_cast<__int128>(ay) * bx;
}

/// Where `path` crosses the segment, as a fraction; -1 where it does not.
int64_t cross_segment(const Path& path, int64_t x1, int64_t y1, int64_t x2, int64_t y2) {
  const bool first = cross(path.dx, path.dy, x1 - path.x, y1 - path.y) >= 0;
  const bool second = cross(path.dx, path.dy, x2 - path.x, y2 - path.y) >= 0;
  if (first == second) return -1;
  __int128 below = cross(path.dx, path.dy, x2 - x1, y2 - y1);
  __int128 above = cross(x1 - path.x, y1 - path.y, x2 - x1, y2 - y1);
  if (below < 0) below = -below, above = -above;
  if (below == 0 || above < 0 || above > below) return -1;
  return static_cast<int64_t>((above << kFractionBits) / below);
}

/// Where `path` enters and leaves the box of `actor`; false where it misses.
bool cross_box(const Path& path, const Actor& actor, int64_t& enters, int64_t& leaves) {
  enters = 0, leaves = kWhole;
  const auto clip = [&](int64_t start, int64_t delta, int64_t low, int64_t high) {
    if (delta == 0) return start > low && start < high;
    int64_t first = fraction_of(low - start, delta), second = fraction_of(high - start, delta);
    if (first > second) std::swap(first, second);
    enters = std::max(enters, first), leaves = std::min(leaves, second);
    return enters < leaves;
  };
  return clip(path.x, path.dx, int64_t{actor.x} - actor.radius, int64_t{actor.x} + actor.radius) &&
         clip(path.y, path.dy, int64_t{actor.y} - actor.radius, int64_t{actor.y} + actor.radius);
}

int64_t cross_diagonal(const Path& path, const Actor& actor) {
  const int64_t x = actor.x, y = actor.y, radius = actor.radius;
  const bool rising = (path.dx > 0 && path.dy > 0) || (path.dx < 0 && path.dy < 0);
  return rising ? cross_segment(path, x - radius, y + radius, x + radius, y - radius)
                : cross_segment(path, x - radius, y - radius, x + radius, y + radius);
}

/// The nearest crossings after a given one, in order.
class NearestCrossings {
 public:
  explicit NearestCrossings(const Crossing& after) : after_(after) {}
  void add(const Crossing& crossing) {
    if (!(after_ < crossing)) return;
    std::size_t place = count_;
    while (place > 0 && crossing < list_[place - 1]) --place;
    if (place > 0 && !(list_[place - 1] < crossing)) return;  // seen in another cell
    if (count_ == list_.size()) {
      overflowed_ = true;
      if (place == count_) return;
      --count_;
    }
    std::move_backward(list_.begin() + static_cast<std::ptrdiff_t>(place),
                       list_.begin() + static_cast<std::ptrdiff_t>(count_),
                       list_.begin() + static_cast<std::ptrdiff_t>(count_) + 1);
    list_[place] = crossing;
    ++count_;
  }
  const Crossing* begin() const { return list_.data(); }
  const Crossing* end() const { return list_.data() + count_; }
  bool overflowed() const { return overflowed_; }

 private:
  Crossing after_;
  std::array<Crossing, kCrossingsAtOnce> list_;
  std::size_t count_ = 0;
  bool overflowed_ = false;
};

void collect_actors(World& world, const Path& path, const Box& piece, ActorShape shape, int64_t until,
                    NearestCrossings& found) {
  const WorldState& state = world.state();
  const Blockmap& blockmap = world.index().blockmap;
  const int64_t reach = state.radius_max;
  const int first_column = blockmap.column_of(piece.left - reach);
  const int last_column = blockmap.column_of(piece.right + reach);
  const int first_row = blockmap.row_of(piece.bottom - reach);
  const int last_row = blockmap.row_of(piece.top + reach);
  for (int row = first_row; row <= last_row; ++row) {
    for (int column = first_column; column <= last_column; ++column) {
      const std::size_t cell = static_cast<std::size_t>(row) * static_cast<std::size_t>(blockmap.columns()) +
                               static_cast<std::size_t>(column);
      if (cell >= state.cell_heads.size()) continue;
      for (int32_t slot = state.cell_heads[cell]; slot >= 0;
           slot = state.links[static_cast<std::size_t>(slot)].next) {
        Actor& actor = world.state().actors[static_cast<std::size_t>(slot)];
        if (actor.removed || !(actor.has(ActorFlag::kShootable) || actor.has(ActorFlag::kSolid))) continue;
        Crossing crossing{.is_actor = true, .index = actor.id, .actor = &actor};
        if (shape == ActorShape::kBox) {
          if (!cross_box(path, actor, crossing.fraction, crossing.leaves)) continue;
        } else {
          crossing.fraction = cross_diagonal(path, actor);
        }
        if (crossing.fraction >= 0 && crossing.fraction <= until) found.add(crossing);
      }
    }
  }
}

/// Visits what `path` crosses, nearest first, until `visit(crossing)` returns false.
template <typename Visit>
bool walk(World& world, const Path& path, bool lines, ActorShape shape, Visit&& visit) {
  const int64_t length = std::max(std::abs(path.dx), std::abs(path.dy));
  const int64_t pieces = length / kPieceLength + 1;
  Crossing last;
  for (int64_t piece = 0; piece < pieces; ++piece) {
    const int64_t from = kWhole / pieces * piece;
    const int64_t until = piece + 1 == pieces ? kWhole : kWhole / pieces * (piece + 1);
    const int64_t ax = path.x_at(from), ay = path.y_at(from), bx = path.x_at(until), by = path.y_at(until);
    const Box box = {clamped_fixed(std::min(ax, bx) - kFracUnit), clamped_fixed(std::max(ax, bx) + kFracUnit),
                     clamped_fixed(std::min(ay, by) - kFracUnit),
                     clamped_fixed(std::max(ay, by) + kFracUnit)};
    bool complete = false;
    while (!complete) {
      NearestCrossings found(last);
      if (lines) {
        const auto add = [&](uint32_t line, int64_t x1, int64_t y1, int64_t x2, int64_t y2) {
          const int64_t fraction = cross_segment(path, x1, y1, x2, y2);
          if (fraction >= 0 && fraction <= until) found.add({.fraction = fraction, .index = line});
          return true;
        };
        world.index().blockmap.for_each_line(box, [&](const BlockLine& line) {
          return add(line.linedef_index, line.x1, line.y1, line.x2, line.y2);
        });
        if (!world.state().movers.polyobjects.empty())
          for_each_polyobject_line(world, box.left, box.right, box.bottom, box.top, add);
      }
      if (shape != ActorShape::kNone) collect_actors(world, path, box, shape, until, found);
      complete = !found.overflowed();
      for (const Crossing& crossing : found) {
        last = crossing;
        if (!visit(crossing)) return false;
      }
    }
  }
  return true;
}

/// Sectors of a line, as seen by somebody who comes from (x, y): near and far (-1: none).
struct Sides {
  bool from_back = false;
  int32_t near = -1, far = -1;
};

Sides sides_of(const World& world, uint32_t line_index, int64_t x, int64_t y) {
  const Level& level = world.level();
  const Linedef& line = level.linedefs[line_index];
  const auto front = static_cast<int32_t>(level.sidedefs[line.front].sector_index);
  const int32_t back = line.back ? static_cast<int32_t>(level.sidedefs[*line.back].sector_index) : -1;
  int64_t x1 = level.vertices[line.start].x, y1 = level.vertices[line.start].y;
  int64_t x2 = level.vertices[line.end].x, y2 = level.vertices[line.end].y;
  if (!world.state().movers.polyobjects.empty()) {
    for_each_polyobject_line(world, INT32_MIN, INT32_MAX, INT32_MIN, INT32_MAX,
                             [&](uint32_t moved, Fixed ax, Fixed ay, Fixed bx, Fixed by) {
                               if (moved != line_index) return true;
                               x1 = ax, y1 = ay, x2 = bx, y2 = by;
                               return false;
                             });
  }
  const bool from_back = cross(x2 - x1, y2 - y1, x - x1, y - y1) > 0;
  return from_back ? Sides{true, back, front} : Sides{false, front, back};
}

bool is_sky(const std::string& flat) { return flat == "F_SKY1"; }

/// The height that shots of `shooter` start at.
int64_t shot_height(World& world, const Actor& shooter) {
  int64_t height = int64_t{shooter.z} + shooter.height / 2;
  if (const Player* player = world.player_of(shooter)) {
    height += fixed_mul(player->attack_z_offset, player->crouch_factor);
  } else {
    height += kShoulder;
  }
  return height;
}

/// The pitch (positive down) from `height` to `z`, `far` away.
int32_t pitch_to(int64_t height, int64_t z, int64_t far) {
  return -static_cast<int32_t>(vector_angle(clamped_fixed(far), clamped_fixed(z - height)));
}

/// A pitch that does not come near the vertical.
int32_t limited_pitch(const Actor& shooter) {
  constexpr auto kSteep = static_cast<int32_t>(kSteepest);
  return std::clamp(static_cast<int32_t>(shooter.pitch), -kSteep, kSteep);
}

/// A shot's way in space. `distance` counts along it, as its range does.
struct Ray {
  Path path;
  int64_t z = 0, dz = 0;
  int64_t distance = 0;

  Ray(World& world, const Actor& shooter, Angle angle, Fixed range, int32_t pitch) {
    const auto down = static_cast<Angle>(pitch);
    const int64_t flat = (int64_t{range} * fine_cosine(down)) >> kFracBits;
    path.x = shooter.x, path.y = shooter.y;
    path.dx = (flat * fine_cosine(angle)) >> kFracBits;
    path.dy = (flat * fine_sine(angle)) >> kFracBits;
    z = shot_height(world, shooter);
    dz = -((int64_t{range} * fine_sine(down)) >> kFracBits);
    distance = std::max<int64_t>(range, 1);
  }
  int64_t z_at(int64_t fraction) const {
    return z + static_cast<int64_t>((static_cast<__int128>(dz) * fraction) >> kFractionBits);
  }
  /// Where it comes to `height`; only for rays that rise or fall.
  int64_t reaches(int64_t height) const { return fraction_of(height - z, dz); }
};

/// What a shot ended at.
struct ShotEnd {
  enum class Kind { kNothing, kWall, kPlane, kActor } kind = Kind::kNothing;
  int64_t fraction = kWhole;
  Actor* actor = nullptr;
};

/// The part of a body that a ray meets: its sides, or its top or bottom where it comes from above or below.
bool meets_body(const Ray& ray, const Crossing& crossing, int64_t& fraction) {
  const int64_t bottom = crossing.actor->z, top = bottom + crossing.actor->height;
  const int64_t height = ray.z_at(crossing.fraction);
  fraction = crossing.fraction;
  if (height > top) {
    if (ray.dz >= 0) return false;
    fraction = ray.reaches(top);
  } else if (height < bottom) {
    if (ray.dz <= 0) return false;
    fraction = ray.reaches(bottom);
  }
  return fraction <= crossing.leaves;
}

/// Follows a shot. `hits(actor, fraction)` returns whether a body stops it.
template <typename Hits>
ShotEnd follow_shot(World& world, const Ray& ray, Actor& shooter, Hits&& hits) {
  ShotEnd end;
  int32_t sector_index = static_cast<int32_t>(shooter.sector_index);
  // The floor or ceiling of the present sector, if the ray comes to it before `fraction`.
  const auto meets_plane = [&](int64_t fraction) {
    const Sector& sector = world.sectors()[static_cast<std::size_t>(sector_index)];
    const int64_t height = ray.z_at(fraction);
    const bool floor = height <= sector.floor_height && ray.dz < 0;
    if (!floor && !(height >= sector.ceiling_height && ray.dz > 0)) return false;
    const bool sky = is_sky(floor ? sector.floor_texture : sector.ceiling_texture);
    end.kind = sky ? ShotEnd::Kind::kNothing : ShotEnd::Kind::kPlane;
    end.fraction =
        std::clamp<int64_t>(ray.reaches(floor ? sector.floor_height : sector.ceiling_height), 0, fraction);
    return true;
  };
  const bool free = walk(world, ray.path, true, ActorShape::kBox, [&](const Crossing& crossing) {
    if (crossing.is_actor) {
      int64_t fraction = 0;
      if (crossing.actor->id == shooter.id || !meets_body(ray, crossing, fraction)) return true;
      if (meets_plane(fraction)) return false;
      if (!hits(*crossing.actor, fraction)) return true;
      end = {ShotEnd::Kind::kActor, fraction, crossing.actor};
      return false;
    }
    if (meets_plane(crossing.fraction)) return false;
    const Sides sides = sides_of(world, crossing.index, ray.path.x, ray.path.y);
    const int64_t height = ray.z_at(crossing.fraction);
    bool wall = sides.far < 0 || sides.near < 0 ||
                (world.lines()[crossing.index].flags & (kLineBlockEverything | kLineBlockHitscan)) != 0;
    bool sky = false;
    if (!wall) {
      const Sector& near = world.sectors()[static_cast<std::size_t>(sides.near)];
      const Sector& far = world.sectors()[static_cast<std::size_t>(sides.far)];
      const bool above = height >= far.ceiling_height;
      wall = above || height <= far.floor_height;
      sky = above && is_sky(near.ceiling_texture) && is_sky(far.ceiling_texture);
    }
    // A line that acts when shot does so when the bullet only passes it, too.
    if (world.lines()[crossing.index].special != 0)
      world.events().activate_line(world, crossing.index, shooter, sides.from_back, Activation::kImpact);
    if (wall) {
      end = {sky ? ShotEnd::Kind::kNothing : ShotEnd::Kind::kWall, crossing.fraction, nullptr};
      return false;
    }
    sector_index = sides.far;
    return true;
  });
  if (free) meets_plane(kWhole);
  return end;
}

bool can_be_shot(const Actor& actor) {
  return actor.has(ActorFlag::kShootable) && !actor.has(ActorFlag::kCorpse);
}

void shorten(World& world, Actor& actor) {
  if (!actor.removed && actor.tics > 1)
    actor.tics = std::max(1, actor.tics - static_cast<int32_t>(world.rng().below(4)));
}

Fixed scattered(World& world, int64_t height) {
  return clamped_fixed(height + int64_t{world.random_triangle()} * (kFracUnit / 64));
}

void spawn_puff(World& world, Actor& shooter, uint32_t puff_type, const Ray& ray, int64_t fraction,
                bool on_actor) {
  if (puff_type == kNoType) return;
  Actor& puff =
      world.spawn_unchecked(puff_type, clamped_fixed(ray.path.x_at(fraction)),
                            clamped_fixed(ray.path.y_at(fraction)), scattered(world, ray.z_at(fraction)));
  puff.velocity_z = kFracUnit;
  puff.angle = angle_to(puff.x, puff.y, shooter.x, shooter.y);
  if (puff.has(ActorFlag::kPuffGetsOwner)) puff.target_id = shooter.id;
  if (!on_actor && world.type_of(puff).state(StateLabel::kCrash) != kNoState) {
    set_label(world, puff, StateLabel::kCrash);
  } else if (on_actor && world.type_of(puff).state(StateLabel::kXDeath) != kNoState) {
    set_label(world, puff, StateLabel::kXDeath);
  } else if (ray.distance <= kSawRange && world.type_of(puff).state(StateLabel::kMelee) != kNoState) {
    set_label(world, puff, StateLabel::kMelee);
  }
  shorten(world, puff);
}

void spawn_blood(World& world, Actor& victim, const Ray& ray, int64_t fraction, int32_t damage) {
  uint32_t type = world.type_of(victim).blood_type;
  if (type == kNoType) type = world.catalog().known().blood;
  if (type == kNoType) return;
  Actor& blood =
      world.spawn_unchecked(type, clamped_fixed(ray.path.x_at(fraction)),
                            clamped_fixed(ray.path.y_at(fraction)), scattered(world, ray.z_at(fraction)));
  blood.velocity_z = to_fixed(2);
  blood.angle = angle_to(blood.x, blood.y, clamped_fixed(ray.path.x), clamped_fixed(ray.path.y));
  blood.target_id = victim.id;
  // A scratch bleeds less: it starts at the second or third picture.
  int skipped = damage < 9 ? 2 : damage <= 12 ? 1 : 0;
  for (; skipped > 0 && blood.state != kNoState; --skipped) {
    const uint32_t next = world.catalog().state(blood.state).next;
    if (next == kNoState || !set_state(world, blood, next)) return;
  }
  shorten(world, blood);
}

/// Hurts a body that a shot met, and shows it.
void strike(World& world, Actor& shooter, Actor& victim, const Ray& ray, int64_t fraction, int32_t damage,
            DamageType type, uint32_t puff_type) {
  const ActorFlags puff_flags = puff_type == kNoType ? ActorFlags{} : world.catalog()[puff_type].flags;
  const bool bleeds = !puff_flags.has(ActorFlag::kBloodlessImpact) && !victim.has(ActorFlag::kNoBlood) &&
                      !victim.has(ActorFlag::kInvulnerable) && !victim.has(ActorFlag::kDormant);
  if (!bleeds || puff_flags.has(ActorFlag::kPuffOnActors))
    spawn_puff(world, shooter, puff_type, ray, fraction, true);
  int32_t lost = damage;
  if (damage != 0) {
    if (type == DamageType::kNormal && puff_type != kNoType) type = world.catalog()[puff_type].damage_type;
    const uint32_t flags = puff_flags.has(ActorFlag::kPierceArmor) ? kDamageNoArmor : 0u;
    lost = damage_actor(world, victim, &shooter, &shooter, damage, type, flags);
  }
  if (bleeds) spawn_blood(world, victim, ray, fraction, lost > 0 ? lost : damage);
}

}  // namespace

Angle vector_angle(Fixed x, Fixed y) {
  constexpr uint32_t kSlopes = 2048;
  static const std::array<Angle, kSlopes + 1> kAngles = [] {
    std::array<Angle, kSlopes + 1> angles{};
    for (uint32_t i = 0; i <= kSlopes; ++i) {
      // Euler's series of the arctangent: each term is 2n / (2n + 1) x^2 / (1 + x^2) of the one before.
      const double slope = static_cast<double>(i) / kSlopes, ratio = slope * slope / (1 + slope * slope);
      double term = slope / (1 + slope * slope), sum = 0;
      for (int n = 1; n <= 60; ++n) {
        sum += term;
        term *= ratio * (2 * n) / (2 * n + 1);
      }
      angles[i] = static_cast<Angle>(sum / 6.283185307179586 * 4294967295.0);
    }
    return angles;
  }();
  const auto angle_of = [](uint32_t small, uint32_t large) {
    if (large < 512) return kAngles[kSlopes];
    return kAngles[std::min<uint64_t>((uint64_t{small} << 3) / (large >> 8), kSlopes)];
  };
  if (x == 0 && y == 0) return 0;
  const uint32_t width = static_cast<uint32_t>(std::abs(int64_t{x})),
                 height = static_cast<uint32_t>(std::abs(int64_t{y}));
  Angle angle = 0;
  if (x >= 0 && y >= 0) {
    angle = width > height ? angle_of(height, width) : kAngle90 - 1 - angle_of(width, height);
  } else if (x >= 0) {
    angle = width > height ? 0u - angle_of(height, width) : kAngle180 + kAngle90 + angle_of(width, height);
  } else if (y >= 0) {
    angle = width > height ? kAngle180 - 1 - angle_of(height, width) : kAngle90 + angle_of(width, height);
  } else {
    angle = width > height ? kAngle180 + angle_of(height, width)
                           : kAngle180 + kAngle90 - 1 - angle_of(width, height);
  }
  return angle;
}

bool trace_path(World& world, Fixed x, Fixed y, Fixed dx, Fixed dy, bool lines, bool actors,
                const std::function<bool(const PathCrossing&)>& visit) {
  return walk(world, {x, y, dx, dy}, lines, actors ? ActorShape::kDiagonal : ActorShape::kNone,
              [&](const Crossing& crossing) {
                const auto fraction = static_cast<Fixed>(crossing.fraction >> (kFractionBits - kFracBits));
                return visit(crossing.is_actor
                                 ? PathCrossing{fraction, -1, crossing.actor}
                                 : PathCrossing{fraction, static_cast<int32_t>(crossing.index), nullptr});
              });
}

Aim aim_line(World& world, Actor& shooter, Angle angle, Fixed distance, Fixed vertical_range) {
  // Up and down: what was requested, else 35 degrees; a player that looks freely without auto-aim gets half
  // a degree.
  Angle range = degrees_to_angle(kAimDegrees);
  const Player* player = world.player_of(shooter);
  const bool looks_freely = player != nullptr && world.options().free_look;
  if (vertical_range != 0) {
    range = static_cast<Angle>((int64_t{std::min(vertical_range, to_fixed(85))} << kFracBits) / 360);
  } else if (looks_freely) {
    const bool aims_itself = world.options().autoaim &&
                             !(player->ready_weapon != kNoType &&
                               world.catalog()[player->ready_weapon].flags.has(ActorFlag::kWeaponNoAutoaim));
    if (!aims_itself) range = kAimFreely;
  }
  Aim aim{nullptr, limited_pitch(shooter)};
  int32_t top = aim.pitch - static_cast<int32_t>(range), bottom = aim.pitch + static_cast<int32_t>(range);
  const int64_t height = shot_height(world, shooter);
  const Path path = {shooter.x, shooter.y, (int64_t{distance} * fine_cosine(angle)) >> kFracBits,
                     (int64_t{distance} * fine_sine(angle)) >> kFracBits};
  walk(world, path, true, ActorShape::kBox, [&](const Crossing& crossing) {
    const int64_t far = std::max<int64_t>(
        1, static_cast<int64_t>((static_cast<__int128>(distance) * crossing.fraction) >> kFractionBits));
    if (!crossing.is_actor) {
      const Linedef& line = world.level().linedefs[crossing.index];
      if (!line.back ||
          (world.lines()[crossing.index].flags & (kLineBlockEverything | kLineBlockHitscan)) != 0)
        return false;
      const Opening opening = opening_of(world, crossing.index);
      if (opening.range() <= 0) return false;
      bottom = std::min(bottom, pitch_to(height, opening.bottom, far));
      top = std::max(top, pitch_to(height, opening.top, far));
      return top < bottom;
    }
    Actor& actor = *crossing.actor;
    if (actor.id == shooter.id || !can_be_shot(actor)) return true;
    const int32_t actor_top = pitch_to(height, int64_t{actor.z} + actor.height, far);
    const int32_t actor_bottom = pitch_to(height, actor.z, far);
    if (actor_top > bottom || actor_bottom < top) return true;
    aim = {&actor, std::max(actor_top, top) / 2 + std::min(actor_bottom, bottom) / 2};
    return false;
  });
  return aim;
}

Aim aim_bullet(World& world, Actor& shooter) {
  const Aim straight = aim_line(world, shooter, shooter.angle, kAimRange);
  const bool exact =
      world.player_of(shooter) != nullptr && world.options().free_look && !world.options().autoaim;
  if (straight.target != nullptr || exact) return straight;
  const Aim left = aim_line(world, shooter, shooter.angle + kAimSideways, kAimRange);
  return left.target != nullptr ? left : aim_line(world, shooter, shooter.angle - kAimSideways, kAimRange);
}

Actor* line_attack(World& world, Actor& shooter, Angle angle, Fixed distance, int32_t pitch, int32_t damage,
                   DamageType type, uint32_t puff_type) {
  const Ray ray(world, shooter, angle, distance, pitch);
  const ShotEnd end =
      follow_shot(world, ray, shooter, [](Actor& actor, int64_t) { return can_be_shot(actor); });
  if (end.kind == ShotEnd::Kind::kActor) {
    strike(world, shooter, *end.actor, ray, end.fraction, damage, type, puff_type);
    return end.actor;
  }
  const bool shown = end.kind != ShotEnd::Kind::kNothing ||
                     (puff_type != kNoType && world.catalog()[puff_type].flags.has(ActorFlag::kAlwaysPuff));
  const int64_t gap = (int64_t{kPuffGap} << kFractionBits) / ray.distance;
  if (shown) spawn_puff(world, shooter, puff_type, ray, std::max<int64_t>(0, end.fraction - gap), false);
  return nullptr;
}

void rail_attack(World& world, Actor& shooter, int32_t damage, Angle angle_offset, uint32_t puff_type) {
  struct Struck {
    Actor* actor = nullptr;
    int64_t fraction = 0;
  };
  std::array<Struck, 64> all{};  // more bodies on one line go unharmed
  std::size_t count = 0;
  const Ray ray(world, shooter, shooter.angle + angle_offset, kRailRange, limited_pitch(shooter));
  // Harm comes after the search, because it may move and remove bodies.
  const ShotEnd end = follow_shot(world, ray, shooter, [&](Actor& actor, int64_t fraction) {
    if (can_be_shot(actor) && count < all.size()) all[count++] = {&actor, fraction};
    return false;
  });
  for (std::size_t i = 0; i < count; ++i)
    if (!all[i].actor->removed)
      strike(world, shooter, *all[i].actor, ray, all[i].fraction, damage, DamageType::kRailgun, puff_type);
  const int64_t gap = (int64_t{kPuffGap} << kFractionBits) / ray.distance;
  if (end.kind != ShotEnd::Kind::kNothing)
    spawn_puff(world, shooter, puff_type, ray, std::max<int64_t>(0, end.fraction - gap), false);
}

Opening opening_of(const World& world, uint32_t line_index) {
  const Level& level = world.level();
  const Linedef& line = level.linedefs[line_index];
  const Sector& front = world.sectors()[level.sidedefs[line.front].sector_index];
  if (!line.back) return {front.floor_height, front.floor_height, front.floor_height};
  const Sector& back = world.sectors()[level.sidedefs[*line.back].sector_index];
  return {std::min(front.ceiling_height, back.ceiling_height),
          std::max(front.floor_height, back.floor_height), std::min(front.floor_height, back.floor_height)};
}

bool use_lines(World& world, Actor& user) {
  bool answered = false;
  const Path path = {user.x, user.y, (int64_t{kUseRange} * fine_cosine(user.angle)) >> kFracBits,
                     (int64_t{kUseRange} * fine_sine(user.angle)) >> kFracBits};
  walk(world, path, true, ActorShape::kNone, [&](const Crossing& crossing) {
    const LineState& line = world.lines()[crossing.index];
    const uint32_t flags = line.flags;
    const bool one_sided = !world.level().linedefs[crossing.index].back;
    if (line.special != 0 && (flags & (kLinePlayerUse | kLinePlayerUseBack)) != 0) {
      // What can be used ends the search, whether it answers or not; from the side that it does not care for
      // it is passed over.
      const bool back = sides_of(world, crossing.index, path.x, path.y).from_back;
      if ((flags & (back ? kLinePlayerUseBack : kLinePlayerUse)) == 0) return !one_sided;
      answered |= world.events().activate_line(world, crossing.index, user, back,
                                               back ? Activation::kUseBack : Activation::kUse);
      return (flags & kLinePassUse) != 0 && !one_sided && opening_of(world, crossing.index).range() > 0;
    }
    const bool wall = one_sided || (flags & (kLineBlockEverything | kLineBlockUse)) != 0;
    return !wall && opening_of(world, crossing.index).range() > 0;
  });
  return answered;
}

}  // namespace comrad::doom
