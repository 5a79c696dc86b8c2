// The running scripts of one world as plain data inside WorldState; machine.h has the functions. Stage: tic.
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "sim_workers/engine/fixed.h"
#include "sim_workers/engine/world/stable_list.h"

namespace comrad::doom::acs {

enum class ThreadState : uint8_t {
  kRunning,
  kDelayed,
  kTagWait,
  kPolyWait,
  kScriptWaitPre,
  kScriptWait,
  kSuspended,
  kToBeRemoved
};

struct CallFrame {
  uint32_t return_address = 0;
  uint32_t local_base = 0, local_count = 0;  ///< of the caller, in Thread::locals
  bool discards_result = false;
  int32_t function = -1;
};

/// A script under way.
struct Thread {
  int32_t script = 0;         ///< number
  uint32_t script_index = 0;  ///< into Behavior::scripts()
  ThreadState state = ThreadState::kRunning;
  bool registered =
      true;  ///< the one that suspend, terminate and ScriptWait mean; false for ACS_ExecuteAlways
  int32_t state_data = 0;  ///< tics left, tag, polyobject or script number
  uint32_t address = 0;
  uint32_t activator_id = 0;  ///< actor, 0 the world
  int32_t line = -1;
  bool back_side = false;
  std::vector<int32_t> stack, locals;  ///< stack: what is left on it between two tics
  uint32_t local_base = 0;
  std::vector<CallFrame> calls;
  int32_t function = -1;  ///< that runs now; -1: the script itself
  int32_t result = 0;
  // HUD state of the script.
  int32_t hud_width = 0, hud_height = 0;
  bool hud_covers_bar = false;
  std::string font = "SMALLFONT";
  int32_t clip[4] = {0, 0, 0, 0};
  int32_t wrap_width = 0;
  std::string print_buffer;
  std::vector<uint32_t> print_starts;  ///< where each text that is being built begins in print_buffer
  int32_t option_start = -1;           ///< place on the stack of a HudMessage's optional arguments
};

/// A text or picture that HudMessage and Print put into the frame.
struct HudMessage {
  int32_t id = 0;       ///< of the script; 0: several may stand
  int32_t player = -1;  ///< -1: everyone
  int32_t kind = 0;     ///< 0 plain, 1 fade out, 2 type on, 3 fade in and out
  std::string text;     ///< with \034 colour escapes; where `font` is a picture, drawn as that picture
  std::string font;     ///< SMALLFONT, BIGFONT, CONFONT, or a picture's lump name (text "A")
  int32_t color = 0;    ///< CR_ number, 0..
  Fixed x = 0, y = 0;   ///< as the script gave it: fraction of the screen, or units of hud_width x hud_height
  int32_t hud_width = 0, hud_height = 0;  ///< 0: no SetHudSize
  bool hud_covers_bar = false;
  int32_t layer = 0;  ///< 0 over the HUD, 1 under it, 2 over the map
  bool additive = false, no_wrap = false;
  std::array<int32_t, 4> clip{};  ///< x, y, width, height in HUD units; width 0: none
  int32_t wrap_width = 0;         ///< in HUD units; 0: the screen's
  int32_t age_tics = 0;
  int32_t hold_tics = 0;                                       ///< 0: for ever
  int32_t fade_out_tics = 0, fade_in_tics = 0, type_tics = 0;  ///< type_tics: per letter, 16.16 in tics
  float alpha = 1.0f;
};

/// Id of what Print and PrintBold show: in the middle, one at a time.
constexpr int32_t kPrintMessageId = INT32_MIN;

/// Runs a special once a floor or ceiling passes a height (SetFloorTrigger, SetCeilingTrigger).
struct PlaneWatcher {
  uint32_t sector = 0;
  bool ceiling = false;
  Fixed height = 0, last = 0;
  int32_t special = 0;
  std::array<int32_t, 5> args{};
  uint32_t activator_id = 0;
  int32_t line = -1;
  bool back_side = false;
};

struct MachineState {
  StableList<Thread, 16> threads;                ///< in order of starting
  std::vector<int32_t> map_variables;            ///< [128]
  std::vector<std::vector<int32_t>> map_arrays;  ///< parallel to Behavior::arrays()
  std::array<int32_t, 256> world_variables{};
  std::vector<std::vector<int32_t>> world_arrays, global_arrays;  ///< [variable], grown as written
  std::vector<std::string> dynamic_strings;  ///< of strparam; string numbers from kDynamicStringBase on
  std::vector<uint32_t> free_strings;        ///< places in dynamic_strings that nothing refers to
  uint32_t string_purge_at = 256;            ///< so many strings alive: look which ones still are
  uint64_t dynamic_bytes = 0;                ///< text in all of them
  std::vector<HudMessage> hud_messages;      ///< in order of drawing
  std::vector<PlaneWatcher> plane_watchers;
  std::vector<uint32_t> old_buttons;         ///< [player] button_bits() of the tic before
  int32_t nesting = 0;                       ///< scripts that run inside each other at this moment
  int64_t instructions_left = 0;             ///< of the outermost one, in this tic
  int64_t instructions_per_tic = 2'000'000;  ///< of a script with those whose results it waits for
  int64_t runaway_count = 0;                 ///< scripts that were stopped because they never yielded
  std::string last_error;                    ///< "MAP01: script 3 at 0x1f4: ...", the newest
};

constexpr int32_t kDynamicStringBase = 1 << 24;
constexpr uint32_t kStringPurgeFirst = 256;

}  // namespace comrad::doom::acs
