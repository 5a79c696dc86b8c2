// What moves or changes by itself, as plain data inside WorldState: doors, lifts, floors, ceilings, crushers,
// lights, scrollers, polyobjects. movers.h has the functions. Stage: tic.
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "sim_workers/engine/fixed.h"
#include "sim_workers/engine/world/stable_list.h"

namespace comrad::doom {

enum class MoverKind : uint8_t {
  kDoor,
  kPlat,
  kFloor,
  kCeiling,
  kCrusher,
  kElevator,
  kPillar,
  kStair,
  kWaggle
};
enum class MoverPhase : uint8_t { kUp, kDown, kWait, kInStasis, kInitialWait, kDone };

/// A floor or ceiling (or both) on its way.
struct SectorMover {
  uint32_t sector = 0;
  MoverKind kind = MoverKind::kFloor;
  MoverPhase phase = MoverPhase::kUp;
  int32_t type = 0;  ///< variety, by its special (raise-and-close, perpetual, ...)
  Fixed speed = 0, return_speed = 0;
  Fixed low = 0, high = 0;  ///< of a floor or a ceiling: where it stops
  Fixed low_2 = 0,
        high_2 = 0;  ///< of the other plane, where both move; low_2 of a door: the floor it saw last
  int32_t wait_tics = 0, left_tics = 0;
  int32_t crush = -1;  ///< damage; -1: stops and goes back
  int32_t tag = 0;
  std::string texture;  ///< the floor gets at the end
  int32_t new_special = -1;
  int32_t light_tag = 0;
  uint32_t stair_delay = 0;
  Fixed phase_offset = 0, amplitude = 0, base = 0;  ///< waggle
  Fixed target = 0;                                 ///< of one plane that goes one way
  int32_t model_sector = -1;                        ///< the sector gets its special and damage at the end
  bool hexen_crush = false;  ///< a crusher waits at the body it hurts instead of continuing
  bool stepwise = false;     ///< of stairs: pauses after each step of height
  int32_t step_tics = 0, pause_tics = 0, step_left_tics = 0;
  Fixed growth = 0;  ///< of a waggle's amplitude, per tic
  bool removed = false;
};

enum class LightKind : uint8_t { kFlicker, kStrobe, kGlow, kFade, kPhased, kFireFlicker, kFlash };
struct LightEffect {
  uint32_t sector = 0;
  LightKind kind = LightKind::kFlicker;
  int32_t low = 0, high = 0, left_tics = 0, bright_tics = 0, dark_tics = 0, direction = 0;
  int32_t start = 0, end = 0, elapsed = 0;
  bool removed = false;
};

enum class ScrollKind : uint8_t { kSide, kFloor, kCeiling, kCarry, kWind, kPoint };
struct Scroller {
  ScrollKind kind = ScrollKind::kSide;
  uint32_t index = 0;  ///< sidedef or sector
  Fixed dx = 0, dy = 0;
  int32_t part = 0;  ///< of a side: bits 1 top, 2 middle, 4 bottom
};

/// Wall textures that switch back.
struct SwitchTimer {
  uint32_t side = 0;
  int32_t part = 0;  ///< a SideTexture
  int32_t left_tics = 0;
  std::string back_texture;
};

/// A group of lines that slides or turns as one. Vertices live here, because they differ by world.
struct Polyobject {
  int32_t number = 0, mirror = 0;
  Fixed x = 0, y = 0;  ///< where its anchor is now
  Angle angle = 0;
  int32_t crush = -1;                          ///< damage; -1 it stops at bodies
  std::vector<uint32_t> lines;                 ///< linedef indices
  std::vector<uint32_t> vertices;              ///< vertex indices, each once
  std::vector<std::array<Fixed, 2>> offset;    ///< [vertex] from the anchor at angle 0
  std::vector<std::array<Fixed, 2>> position;  ///< [vertex] now
  // Motion.
  int32_t kind = 0;  ///< 0 none, 1 move, 2 rotate, 3 door slide, 4 door swing
  Fixed speed = 0, distance_left = 0, distance_total = 0;
  Angle direction = 0, turn_speed = 0, turn_left = 0;
  bool closing = false, endless = false;
  int32_t wait_tics = 0, left_tics = 0;
  Fixed target_x = 0, target_y = 0;
  bool has_target = false;      ///< a move that ends exactly there
  bool hurts_on_touch = false;  ///< damages whatever it touches, not only what it squeezes
};

struct MoverState {
  StableList<SectorMover> sectors;  ///< in order of starting; crush damage may start another one meanwhile
  std::vector<LightEffect> lights;
  std::vector<Scroller> scrollers;
  std::vector<SwitchTimer> switches;
  std::vector<Polyobject> polyobjects;
  std::vector<int32_t> plane_busy;  ///< [sector] bits: 1 floor, 2 ceiling in motion
};

}  // namespace comrad::doom
