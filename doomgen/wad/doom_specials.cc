#include "doomgen/wad/doom_specials.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <iterator>

#include "doomgen/wad/special_names.h"

namespace comrad::wad {
namespace {

/// How a line type is touched; once, or repeatedly.
enum Trigger : uint8_t {
  kStatic,  // not set by any special; constant from the start
  kW1,      // walked over
  kWR,
  kS1,  // switch
  kSR,
  kD1,  // a door pushed open by hand: its own back sector
  kDR,
  kG1,  // shot
  kGR,
};

/// Activators besides players.
enum Who : uint8_t { kPlayers, kMonstersToo, kMonstersOnly };

// Speeds are in eighths of a unit per tic, waits in tics unless said otherwise.
constexpr int16_t kSlow = 8, kFast = 32;                            // floors
constexpr int16_t kDoor = 16, kBlazing = 64, kDoorWait = 150;       // doors; 150 tics
constexpr int16_t kLift = 32, kFastLift = 64, kLiftWait = 105;      // lifts; 105 tics
constexpr int16_t kChangeSpeed = 4, kBuild = 2, kTurboStairs = 32;  // floors that change; stairs
constexpr int16_t kCrush = 10;                                      // damage
constexpr int16_t kCloseWait = 240;                                 // 30 s in eighths of a second
constexpr int16_t kRed = 129, kBlue = 130, kYellow = 131;           // card or skull
// Is in the arguments for the line's tag.
constexpr int16_t kTag = INT16_MIN;

struct Row {
  int16_t type;
  Trigger trigger;
  int16_t special;
  std::array<int16_t, 5> args;
  Who who = kPlayers;
};

// By rising type.
constexpr Row kRows[] = {
    {1, kDR, Special::kDoor_Raise, {0, kDoor, kDoorWait}, kMonstersToo},
    {2, kW1, Special::kDoor_Open, {kTag, kDoor}},
    {3, kW1, Special::kDoor_Close, {kTag, kDoor}},
    {4, kW1, Special::kDoor_Raise, {kTag, kDoor, kDoorWait}, kMonstersToo},
    {5, kW1, Special::kFloor_RaiseToLowestCeiling, {kTag, kSlow}},
    {6, kW1, Special::kCeiling_CrushAndRaiseA, {kTag, 16, 16, kCrush}},
    {7, kS1, Special::kStairs_BuildUpDoom, {kTag, kBuild, 8}},
    {8, kW1, Special::kStairs_BuildUpDoom, {kTag, kBuild, 8}},
    {9, kS1, Special::kFloor_Donut, {kTag, 4, 4}},
    {10, kW1, Special::kPlat_DownWaitUpStayLip, {kTag, kLift, kLiftWait}, kMonstersToo},
    {11, kS1, Special::kExit_Normal, {}},
    {12, kW1, Special::kLight_MaxNeighbor, {kTag}},
    {13, kW1, Special::kLight_ChangeToValue, {kTag, 255}},
    {14, kS1, Special::kPlat_UpByValueStayTx, {kTag, kChangeSpeed, 4}},
    {15, kS1, Special::kPlat_UpByValueStayTx, {kTag, kChangeSpeed, 3}},
    {16, kW1, Special::kDoor_CloseWaitOpen, {kTag, kDoor, kCloseWait}},
    {17, kW1, Special::kLight_StrobeDoom, {kTag, 5, 35}},
    {18, kS1, Special::kFloor_RaiseToNearest, {kTag, kSlow}},
    {19, kW1, Special::kFloor_LowerToHighest, {kTag, kSlow, 128}},
    {20, kS1, Special::kPlat_RaiseAndStayTx0, {kTag, kChangeSpeed}},
    {21, kS1, Special::kPlat_DownWaitUpStayLip, {kTag, kLift, kLiftWait}},
    {22, kW1, Special::kPlat_RaiseAndStayTx0, {kTag, kChangeSpeed}},
    {23, kS1, Special::kFloor_LowerToLowest, {kTag, kSlow}},
    {24, kG1, Special::kFloor_RaiseToLowestCeiling, {kTag, kSlow}},
    {25, kW1, Special::kCeiling_CrushAndRaiseA, {kTag, kSlow, kSlow, kCrush}},
    {26, kDR, Special::kDoor_LockedRaise, {0, kDoor, kDoorWait, kBlue}},
    {27, kDR, Special::kDoor_LockedRaise, {0, kDoor, kDoorWait, kYellow}},
    {28, kDR, Special::kDoor_LockedRaise, {0, kDoor, kDoorWait, kRed}},
    {29, kS1, Special::kDoor_Raise, {kTag, kDoor, kDoorWait}},
    {30, kW1, Special::kFloor_RaiseByTexture, {kTag, kSlow}},
    {31, kD1, Special::kDoor_Open, {0, kDoor}},
    {32, kD1, Special::kDoor_LockedRaise, {0, kDoor, 0, kBlue}},
    {33, kD1, Special::kDoor_LockedRaise, {0, kDoor, 0, kRed}},
    {34, kD1, Special::kDoor_LockedRaise, {0, kDoor, 0, kYellow}},
    {35, kW1, Special::kLight_ChangeToValue, {kTag, 35}},
    {36, kW1, Special::kFloor_LowerToHighest, {kTag, kFast, 136}},
    {37, kW1, Special::kFloor_LowerToLowestTxTy, {kTag, kSlow}},
    {38, kW1, Special::kFloor_LowerToLowest, {kTag, kSlow}},
    {39, kW1, Special::kTeleport, {0, kTag}, kMonstersToo},
    {40, kW1, Special::kGeneric_Ceiling, {kTag, kSlow, 0, 1, 8}},
    {41, kS1, Special::kCeiling_LowerToFloor, {kTag, kSlow}},
    {42, kSR, Special::kDoor_Close, {kTag, kDoor}},
    {43, kSR, Special::kCeiling_LowerToFloor, {kTag, kSlow}},
    {44, kW1, Special::kCeiling_LowerAndCrush, {kTag, kSlow}},
    {45, kSR, Special::kFloor_LowerToHighest, {kTag, kSlow, 128}},
    {46, kGR, Special::kDoor_Open, {kTag, kDoor}, kMonstersToo},
    {47, kG1, Special::kPlat_RaiseAndStayTx0, {kTag, kChangeSpeed}},
    {48, kStatic, Special::kScroll_Texture_Left, {64}},
    {49, kS1, Special::kCeiling_CrushAndRaiseA, {kTag, kSlow, kSlow, kCrush}},
    {50, kS1, Special::kDoor_Close, {kTag, kDoor}},
    {51, kS1, Special::kExit_Secret, {}},
    {52, kW1, Special::kExit_Normal, {}},
    {53, kW1, Special::kPlat_PerpetualRaiseLip, {kTag, kSlow, kLiftWait}},
    {54, kW1, Special::kPlat_Stop, {kTag}},
    {55, kS1, Special::kFloor_RaiseAndCrushDoom, {kTag, kSlow, kCrush}},
    {56, kW1, Special::kFloor_RaiseAndCrushDoom, {kTag, kSlow, kCrush}},
    {57, kW1, Special::kCeiling_CrushStop, {kTag}},
    {58, kW1, Special::kFloor_RaiseByValue, {kTag, kSlow, 24}},
    {59, kW1, Special::kFloor_RaiseByValueTxTy, {kTag, kSlow, 24}},
    {60, kSR, Special::kFloor_LowerToLowest, {kTag, kSlow}},
    {61, kSR, Special::kDoor_Open, {kTag, kDoor}},
    {62, kSR, Special::kPlat_DownWaitUpStayLip, {kTag, kLift, kLiftWait}},
    {63, kSR, Special::kDoor_Raise, {kTag, kDoor, kDoorWait}},
    {64, kSR, Special::kFloor_RaiseToLowestCeiling, {kTag, kSlow}},
    {65, kSR, Special::kFloor_RaiseAndCrushDoom, {kTag, kSlow, kCrush}},
    {66, kSR, Special::kPlat_UpByValueStayTx, {kTag, kChangeSpeed, 3}},
    {67, kSR, Special::kPlat_UpByValueStayTx, {kTag, kChangeSpeed, 4}},
    {68, kSR, Special::kPlat_RaiseAndStayTx0, {kTag, kChangeSpeed}},
    {69, kSR, Special::kFloor_RaiseToNearest, {kTag, kSlow}},
    {70, kSR, Special::kFloor_LowerToHighest, {kTag, kFast, 136}},
    {71, kS1, Special::kFloor_LowerToHighest, {kTag, kFast, 136}},
    {72, kWR, Special::kCeiling_LowerAndCrush, {kTag, kSlow}},
    {73, kWR, Special::kCeiling_CrushAndRaiseA, {kTag, kSlow, kSlow, kCrush}},
    {74, kWR, Special::kCeiling_CrushStop, {kTag}},
    {75, kWR, Special::kDoor_Close, {kTag, kDoor}},
    {76, kWR, Special::kDoor_CloseWaitOpen, {kTag, kDoor, kCloseWait}},
    {77, kWR, Special::kCeiling_CrushAndRaiseA, {kTag, 16, 16, kCrush}},
    {78, kSR, Special::kFloor_TransferNumeric, {kTag}},
    {79, kWR, Special::kLight_ChangeToValue, {kTag, 35}},
    {80, kWR, Special::kLight_MaxNeighbor, {kTag}},
    {81, kWR, Special::kLight_ChangeToValue, {kTag, 255}},
    {82, kWR, Special::kFloor_LowerToLowest, {kTag, kSlow}},
    {83, kWR, Special::kFloor_LowerToHighest, {kTag, kSlow, 128}},
    {84, kWR, Special::kFloor_LowerToLowestTxTy, {kTag, kSlow}},
    {85, kStatic, Special::kScroll_Texture_Right, {64}},
    {86, kWR, Special::kDoor_Open, {kTag, kDoor}},
    {87, kWR, Special::kPlat_PerpetualRaiseLip, {kTag, kSlow, kLiftWait}},
    {88, kWR, Special::kPlat_DownWaitUpStayLip, {kTag, kLift, kLiftWait}, kMonstersToo},
    {89, kWR, Special::kPlat_Stop, {kTag}},
    {90, kWR, Special::kDoor_Raise, {kTag, kDoor, kDoorWait}},
    {91, kWR, Special::kFloor_RaiseToLowestCeiling, {kTag, kSlow}},
    {92, kWR, Special::kFloor_RaiseByValue, {kTag, kSlow, 24}},
    {93, kWR, Special::kFloor_RaiseByValueTxTy, {kTag, kSlow, 24}},
    {94, kWR, Special::kFloor_RaiseAndCrushDoom, {kTag, kSlow, kCrush}},
    {95, kWR, Special::kPlat_RaiseAndStayTx0, {kTag, kChangeSpeed}},
    {96, kWR, Special::kFloor_RaiseByTexture, {kTag, kSlow}},
    {97, kWR, Special::kTeleport, {0, kTag}, kMonstersToo},
    {98, kWR, Special::kFloor_LowerToHighest, {kTag, kFast, 136}},
    {99, kSR, Special::kDoor_LockedRaise, {kTag, kBlazing, 0, kBlue}},
    {100, kW1, Special::kStairs_BuildUpDoom, {kTag, kTurboStairs, 16}},
    {101, kS1, Special::kFloor_RaiseToLowestCeiling, {kTag, kSlow}},
    {102, kS1, Special::kFloor_LowerToHighest, {kTag, kSlow, 128}},
    {103, kS1, Special::kDoor_Open, {kTag, kDoor}},
    {104, kW1, Special::kLight_MinNeighbor, {kTag}},
    {105, kWR, Special::kDoor_Raise, {kTag, kBlazing, kDoorWait}},
    {106, kWR, Special::kDoor_Open, {kTag, kBlazing}},
    {107, kWR, Special::kDoor_Close, {kTag, kBlazing}},
    {108, kW1, Special::kDoor_Raise, {kTag, kBlazing, kDoorWait}},
    {109, kW1, Special::kDoor_Open, {kTag, kBlazing}},
    {110, kW1, Special::kDoor_Close, {kTag, kBlazing}},
    {111, kS1, Special::kDoor_Raise, {kTag, kBlazing, kDoorWait}},
    {112, kS1, Special::kDoor_Open, {kTag, kBlazing}},
    {113, kS1, Special::kDoor_Close, {kTag, kBlazing}},
    {114, kSR, Special::kDoor_Raise, {kTag, kBlazing, kDoorWait}},
    {115, kSR, Special::kDoor_Open, {kTag, kBlazing}},
    {116, kSR, Special::kDoor_Close, {kTag, kBlazing}},
    {117, kDR, Special::kDoor_Raise, {0, kBlazing, kDoorWait}},
    {118, kD1, Special::kDoor_Open, {0, kBlazing}},
    {119, kW1, Special::kFloor_RaiseToNearest, {kTag, kSlow}},
    {120, kWR, Special::kPlat_DownWaitUpStayLip, {kTag, kFastLift, kLiftWait}},
    {121, kW1, Special::kPlat_DownWaitUpStayLip, {kTag, kFastLift, kLiftWait}},
    {122, kS1, Special::kPlat_DownWaitUpStayLip, {kTag, kFastLift, kLiftWait}},
    {123, kSR, Special::kPlat_DownWaitUpStayLip, {kTag, kFastLift, kLiftWait}},
    {124, kW1, Special::kExit_Secret, {}},
    {125, kW1, Special::kTeleport, {0, kTag}, kMonstersOnly},
    {126, kWR, Special::kTeleport, {0, kTag}, kMonstersOnly},
    {127, kS1, Special::kStairs_BuildUpDoom, {kTag, kTurboStairs, 16}},
    {128, kWR, Special::kFloor_RaiseToNearest, {kTag, kSlow}},
    {129, kWR, Special::kFloor_RaiseToNearest, {kTag, kFast}},
    {130, kW1, Special::kFloor_RaiseToNearest, {kTag, kFast}},
    {131, kS1, Special::kFloor_RaiseToNearest, {kTag, kFast}},
    {132, kSR, Special::kFloor_RaiseToNearest, {kTag, kFast}},
    {133, kS1, Special::kDoor_LockedRaise, {kTag, kBlazing, 0, kBlue}},
    {134, kSR, Special::kDoor_LockedRaise, {kTag, kBlazing, 0, kRed}},
    {135, kS1, Special::kDoor_LockedRaise, {kTag, kBlazing, 0, kRed}},
    {136, kSR, Special::kDoor_LockedRaise, {kTag, kBlazing, 0, kYellow}},
    {137, kS1, Special::kDoor_LockedRaise, {kTag, kBlazing, 0, kYellow}},
    {138, kSR, Special::kLight_ChangeToValue, {kTag, 255}},
    {139, kSR, Special::kLight_ChangeToValue, {kTag, 35}},
    {140, kS1, Special::kFloor_RaiseByValueTimes8, {kTag, kSlow, 64}},
    {141, kW1, Special::kCeiling_CrushAndRaiseSilentA, {kTag, kSlow, kSlow, kCrush}},
    // Boom.
    {142, kW1, Special::kFloor_RaiseByValueTimes8, {kTag, kSlow, 64}},
    {143, kW1, Special::kPlat_UpByValueStayTx, {kTag, kChangeSpeed, 3}},
    {144, kW1, Special::kPlat_UpByValueStayTx, {kTag, kChangeSpeed, 4}},
    {145, kW1, Special::kCeiling_LowerToFloor, {kTag, kSlow}},
    {146, kW1, Special::kFloor_Donut, {kTag, 4, 4}},
    {147, kWR, Special::kFloor_RaiseByValueTimes8, {kTag, kSlow, 64}},
    {148, kWR, Special::kPlat_UpByValueStayTx, {kTag, kChangeSpeed, 3}},
    {149, kWR, Special::kPlat_UpByValueStayTx, {kTag, kChangeSpeed, 4}},
    {150, kWR, Special::kCeiling_CrushAndRaiseSilentA, {kTag, kSlow, kSlow, kCrush}},
    {151, kWR, Special::kGeneric_Ceiling, {kTag, kSlow, 0, 1, 8}},
    {152, kWR, Special::kCeiling_LowerToFloor, {kTag, kSlow}},
    {153, kW1, Special::kFloor_TransferTrigger, {kTag}},
    {154, kWR, Special::kFloor_TransferTrigger, {kTag}},
    {155, kWR, Special::kFloor_Donut, {kTag, 4, 4}},
    {156, kWR, Special::kLight_StrobeDoom, {kTag, 5, 35}},
    {157, kWR, Special::kLight_MinNeighbor, {kTag}},
    {158, kS1, Special::kFloor_RaiseByTexture, {kTag, kSlow}},
    {159, kS1, Special::kFloor_LowerToLowestTxTy, {kTag, kSlow}},
    {160, kS1, Special::kFloor_RaiseByValueTxTy, {kTag, kSlow, 24}},
    {161, kS1, Special::kFloor_RaiseByValue, {kTag, kSlow, 24}},
    {162, kS1, Special::kPlat_PerpetualRaiseLip, {kTag, kSlow, kLiftWait}},
    {163, kS1, Special::kPlat_Stop, {kTag}},
    {164, kS1, Special::kCeiling_CrushAndRaiseA, {kTag, 16, 16, kCrush}},
    {165, kS1, Special::kCeiling_CrushAndRaiseSilentA, {kTag, kSlow, kSlow, kCrush}},
    {166, kS1, Special::kFloorAndCeiling_LowerRaise, {kTag, kSlow, kSlow}},
    {167, kS1, Special::kCeiling_LowerAndCrush, {kTag, kSlow}},
    {168, kS1, Special::kCeiling_CrushStop, {kTag}},
    {169, kS1, Special::kLight_MaxNeighbor, {kTag}},
    {170, kS1, Special::kLight_ChangeToValue, {kTag, 35}},
    {171, kS1, Special::kLight_ChangeToValue, {kTag, 255}},
    {172, kS1, Special::kLight_StrobeDoom, {kTag, 5, 35}},
    {173, kS1, Special::kLight_MinNeighbor, {kTag}},
    {174, kS1, Special::kTeleport, {0, kTag}, kMonstersToo},
    {175, kS1, Special::kDoor_CloseWaitOpen, {kTag, kDoor, kCloseWait}},
    {176, kSR, Special::kFloor_RaiseByTexture, {kTag, kSlow}},
    {177, kSR, Special::kFloor_LowerToLowestTxTy, {kTag, kSlow}},
    {178, kSR, Special::kFloor_RaiseByValueTimes8, {kTag, kSlow, 64}},
    {179, kSR, Special::kFloor_RaiseByValueTxTy, {kTag, kSlow, 24}},
    {180, kSR, Special::kFloor_RaiseByValue, {kTag, kSlow, 24}},
    {181, kSR, Special::kPlat_PerpetualRaiseLip, {kTag, kSlow, kLiftWait}},
    {182, kSR, Special::kPlat_Stop, {kTag}},
    {183, kSR, Special::kCeiling_CrushAndRaiseA, {kTag, 16, 16, kCrush}},
    {184, kSR, Special::kCeiling_CrushAndRaiseA, {kTag, kSlow, kSlow, kCrush}},
    {185, kSR, Special::kCeiling_CrushAndRaiseSilentA, {kTag, kSlow, kSlow, kCrush}},
    {186, kSR, Special::kFloorAndCeiling_LowerRaise, {kTag, kSlow, kSlow}},
    {187, kSR, Special::kCeiling_LowerAndCrush, {kTag, kSlow}},
    {188, kSR, Special::kCeiling_CrushStop, {kTag}},
    {189, kS1, Special::kFloor_TransferTrigger, {kTag}},
    {190, kSR, Special::kFloor_TransferTrigger, {kTag}},
    {191, kSR, Special::kFloor_Donut, {kTag, 4, 4}},
    {192, kSR, Special::kLight_MaxNeighbor, {kTag}},
    {193, kSR, Special::kLight_StrobeDoom, {kTag, 5, 35}},
    {194, kSR, Special::kLight_MinNeighbor, {kTag}},
    {195, kSR, Special::kTeleport, {0, kTag}, kMonstersToo},
    {196, kSR, Special::kDoor_CloseWaitOpen, {kTag, kDoor, kCloseWait}},
    {197, kG1, Special::kExit_Normal, {}},
    {198, kG1, Special::kExit_Secret, {}},
    {199, kW1, Special::kCeiling_LowerToLowest, {kTag, kSlow}},
    {200, kW1, Special::kCeiling_LowerToHighestFloor, {kTag, kSlow}},
    {201, kWR, Special::kCeiling_LowerToLowest, {kTag, kSlow}},
    {202, kWR, Special::kCeiling_LowerToHighestFloor, {kTag, kSlow}},
    {203, kS1, Special::kCeiling_LowerToLowest, {kTag, kSlow}},
    {204, kS1, Special::kCeiling_LowerToHighestFloor, {kTag, kSlow}},
    {205, kSR, Special::kCeiling_LowerToLowest, {kTag, kSlow}},
    {206, kSR, Special::kCeiling_LowerToHighestFloor, {kTag, kSlow}},
    {207, kW1, Special::kTeleport_NoFog, {0, 0, kTag, 1}, kMonstersToo},
    {208, kWR, Special::kTeleport_NoFog, {0, 0, kTag, 1}, kMonstersToo},
    {209, kS1, Special::kTeleport_NoFog, {0, 0, kTag, 1}, kMonstersToo},
    {210, kSR, Special::kTeleport_NoFog, {0, 0, kTag, 1}, kMonstersToo},
    {211, kSR, Special::kPlat_ToggleCeiling, {kTag}},
    {212, kWR, Special::kPlat_ToggleCeiling, {kTag}},
    {213, kStatic, Special::kTransfer_FloorLight, {kTag}},
    {214, kStatic, Special::kScroll_Ceiling, {kTag, 6}},
    {215, kStatic, Special::kScroll_Floor, {kTag, 6}},
    {216, kStatic, Special::kScroll_Floor, {kTag, 6, 1}},
    {217, kStatic, Special::kScroll_Floor, {kTag, 6, 2}},
    {218, kStatic, Special::kScroll_Texture_Model, {kTag, 2}},
    {219, kW1, Special::kFloor_LowerToNearest, {kTag, kSlow}},
    {220, kWR, Special::kFloor_LowerToNearest, {kTag, kSlow}},
    {221, kS1, Special::kFloor_LowerToNearest, {kTag, kSlow}},
    {222, kSR, Special::kFloor_LowerToNearest, {kTag, kSlow}},
    {223, kStatic, Special::kSector_SetFriction, {kTag}},
    {224, kStatic, Special::kSector_SetWind, {kTag, 0, 0, 1}},
    {225, kStatic, Special::kSector_SetCurrent, {kTag, 0, 0, 1}},
    {226, kStatic, Special::kPointPush_SetForce, {kTag, 0, 0, 1}},
    {227, kW1, Special::kElevator_RaiseToNearest, {kTag, kLift}},
    {228, kWR, Special::kElevator_RaiseToNearest, {kTag, kLift}},
    {229, kS1, Special::kElevator_RaiseToNearest, {kTag, kLift}},
    {230, kSR, Special::kElevator_RaiseToNearest, {kTag, kLift}},
    {231, kW1, Special::kElevator_LowerToNearest, {kTag, kLift}},
    {232, kWR, Special::kElevator_LowerToNearest, {kTag, kLift}},
    {233, kS1, Special::kElevator_LowerToNearest, {kTag, kLift}},
    {234, kSR, Special::kElevator_LowerToNearest, {kTag, kLift}},
    {235, kW1, Special::kElevator_MoveToFloor, {kTag, kLift}},
    {236, kWR, Special::kElevator_MoveToFloor, {kTag, kLift}},
    {237, kS1, Special::kElevator_MoveToFloor, {kTag, kLift}},
    {238, kSR, Special::kElevator_MoveToFloor, {kTag, kLift}},
    {239, kW1, Special::kFloor_TransferNumeric, {kTag}},
    {240, kWR, Special::kFloor_TransferNumeric, {kTag}},
    {241, kS1, Special::kFloor_TransferNumeric, {kTag}},
    {242, kStatic, Special::kTransfer_Heights, {kTag}},
    {243, kW1, Special::kTeleport_Line, {kTag, kTag}, kMonstersToo},
    {244, kWR, Special::kTeleport_Line, {kTag, kTag}, kMonstersToo},
    {245, kStatic, Special::kScroll_Ceiling, {kTag, 5}},
    {246, kStatic, Special::kScroll_Floor, {kTag, 5}},
    {247, kStatic, Special::kScroll_Floor, {kTag, 5, 1}},
    {248, kStatic, Special::kScroll_Floor, {kTag, 5, 2}},
    {249, kStatic, Special::kScroll_Texture_Model, {kTag, 1}},
    {250, kStatic, Special::kScroll_Ceiling, {kTag, 4}},
    {251, kStatic, Special::kScroll_Floor, {kTag, 4}},
    {252, kStatic, Special::kScroll_Floor, {kTag, 4, 1}},
    {253, kStatic, Special::kScroll_Floor, {kTag, 4, 2}},
    {254, kStatic, Special::kScroll_Texture_Model, {kTag}},
    {255, kStatic, Special::kScroll_Texture_Offsets, {}},
    {256, kWR, Special::kStairs_BuildUpDoom, {kTag, kBuild, 8}},
    {257, kWR, Special::kStairs_BuildUpDoom, {kTag, kTurboStairs, 16}},
    {258, kSR, Special::kStairs_BuildUpDoom, {kTag, kBuild, 8}},
    {259, kSR, Special::kStairs_BuildUpDoom, {kTag, kTurboStairs, 16}},
    {260, kStatic, Special::kTranslucentLine, {kTag, 168}},
    {261, kStatic, Special::kTransfer_CeilingLight, {kTag}},
    {262, kW1, Special::kTeleport_Line, {kTag, kTag, 1}, kMonstersToo},
    {263, kWR, Special::kTeleport_Line, {kTag, kTag, 1}, kMonstersToo},
    {264, kW1, Special::kTeleport_Line, {kTag, kTag, 1}, kMonstersOnly},
    {265, kWR, Special::kTeleport_Line, {kTag, kTag, 1}, kMonstersOnly},
    {266, kW1, Special::kTeleport_Line, {kTag, kTag}, kMonstersOnly},
    {267, kWR, Special::kTeleport_Line, {kTag, kTag}, kMonstersOnly},
    {268, kW1, Special::kTeleport_NoFog, {0, 0, kTag, 1}, kMonstersOnly},
    {269, kWR, Special::kTeleport_NoFog, {0, 0, kTag, 1}, kMonstersOnly},
};

void set_trigger(UdmfLinedef& line, Trigger trigger, Who who) {
  const bool players = who != kMonstersOnly, monsters = who != kPlayers;
  line.repeat_special = trigger == kWR || trigger == kSR || trigger == kDR || trigger == kGR;
  switch (trigger) {
    case kStatic:
      break;
    case kW1:
    case kWR:
      line.player_cross = players, line.monster_cross = monsters;
      break;
    case kS1:
    case kSR:
    case kD1:
    case kDR:
      line.player_use = players, line.monster_use = monsters;
      break;
    case kG1:
    case kGR:
      line.impact = true, line.monster_activate = monsters;
      break;
  }
}

/// Boom packs trigger, speed and the rest into the bits of types 0x2F80..0x7FFF.
std::optional<TranslatedLine> translate_generalized(int32_t type, int32_t tag, UdmfLinedef& line) {
  static constexpr Trigger kTriggers[8] = {kW1, kWR, kS1, kSR, kG1, kGR, kD1, kDR};
  const auto bits = [type](int first, int count) { return type >> first & ((1 << count) - 1); };
  const Trigger trigger = kTriggers[bits(0, 3)];
  const int32_t speed = bits(3, 2);
  bool monsters = false;
  TranslatedLine result;
  const auto by_speed = [speed](int32_t slow, int32_t normal, int32_t fast, int32_t turbo) {
    return std::array{slow, normal, fast, turbo}[static_cast<std::size_t>(speed)];
  };
  if (type >= 0x4000) {  // floors, ceilings
    const bool is_floor = type >= 0x6000;
    const int32_t target = bits(7, 3), change = bits(10, 2);
    const bool option = bits(5, 1) != 0;  // with a change: by number; else monsters may
    monsters = change == 0 && option;
    result.special = is_floor ? Special::kGeneric_Floor : Special::kGeneric_Ceiling;
    result.args = {
        tag, by_speed(8, 16, 32, 64),
        target == 6   ? 24
        : target == 7 ? 32
                      : 0,
        target < 6 ? target + 1 : 0,
        change | (change != 0 && option ? 4 : 0) | (bits(6, 1) != 0 ? 8 : 0) | (bits(12, 1) != 0 ? 16 : 0)};
  } else if (type >= 0x3C00) {  // doors
    static constexpr int32_t kDelays[4] = {8, 32, 72, 240};
    monsters = bits(7, 1) != 0;
    result.special = Special::kGeneric_Door;
    result.args = {tag, by_speed(16, 32, 64, 128), bits(5, 2), kDelays[bits(8, 2)], 0};
  } else if (type >= 0x3800) {  // locked doors
    const int32_t key = bits(6, 3);
    const bool skull_is_card = bits(9, 1) != 0;
    const int32_t lock = key == 0   ? 100
                         : key == 7 ? (skull_is_card ? 229 : 101)
                                    : (skull_is_card ? kRed + (key - 1) % 3 : key);
    result.special = Special::kGeneric_Door;
    result.args = {tag, by_speed(16, 32, 64, 128), bits(5, 1), 34, lock};
  } else if (type >= 0x3400) {  // lifts
    static constexpr int32_t kDelays[4] = {8, 24, 40, 80};
    monsters = bits(5, 1) != 0;
    result.special = Special::kGeneric_Lift;
    result.args = {tag, by_speed(16, 32, 64, 128), kDelays[bits(6, 2)], bits(8, 2) + 1, 0};
  } else if (type >= 0x3000) {  // stairs
    static constexpr int32_t kSteps[4] = {4, 8, 16, 24};
    monsters = bits(5, 1) != 0;
    result.special = Special::kGeneric_Stairs;
    result.args = {tag, by_speed(2, 4, 16, 32), kSteps[bits(6, 2)], bits(8, 1) | bits(9, 1) << 1, 0};
  } else if (type >= 0x2F80) {  // crushers
    monsters = bits(5, 1) != 0;
    result.special = Special::kGeneric_Crusher;
    result.args = {tag, by_speed(8, 16, 32, 64), by_speed(8, 16, 32, 64), bits(6, 1), kCrush};
  } else {
    return std::nullopt;
  }
  const bool by_hand = trigger == kD1 || trigger == kDR;
  if (by_hand) result.args[0] = 0;  // the sector behind it
  result.uses_tag = !by_hand;
  set_trigger(line, trigger, monsters ? kMonstersToo : kPlayers);
  return result;
}

}  // namespace

std::optional<TranslatedLine> translate_doom_line(int32_t type, int32_t tag, UdmfLinedef& line) {
  if (type == 0) return TranslatedLine{};
  if (type >= 0x2F80 && type < 0x8000) return translate_generalized(type, tag, line);
  const auto* const row =
      std::lower_bound(std::begin(kRows), std::end(kRows), type,
                       [](const Row& candidate, int32_t wanted) { return candidate.type < wanted; });
  if (row == std::end(kRows) || row->type != type) return std::nullopt;
  TranslatedLine result;
  result.special = row->special;
  for (std::size_t i = 0; i < result.args.size(); ++i) {
    result.args[i] = row->args[i] == kTag ? tag : row->args[i];
    result.uses_tag |= row->args[i] == kTag;
  }
  set_trigger(line, row->trigger, row->who);
  if (type >= 213 && type <= 269 && row->trigger == kStatic) result.uses_tag = false;
  return result;
}

void translate_doom_map(UdmfMap& map) {
  int unknown = 0, first_text_line = 0;
  for (UdmfSector& sector : map.sectors) sector.special = translate_doom_sector(sector.special);
  for (UdmfLinedef& line : map.linedefs) {
    const int32_t type = line.special, tag = line.args[0];
    line.special = 0, line.args = {};
    const std::optional<TranslatedLine> translated = translate_doom_line(type, tag, line);
    if (!translated) {
      if (unknown++ == 0) first_text_line = line.text_line;
    } else if (!translated->uses_tag || tag != 0) {
      line.special = translated->special, line.args = translated->args;
    }
  }
  if (unknown > 0)
    map.warnings.push_back(
        fmt::format("{} linedefs of types that are not known, the first in line {}; they do nothing", unknown,
                    first_text_line));
  map.name_space = "zdoom";
}

int32_t translate_doom_sector(int32_t type) {
  constexpr int32_t kSecret = 0x400;
  if (type < 0) return 0;
  // Boom's bits 5..9 (damage, secret, friction, wind) lie three places higher in ZDoom.
  const int32_t low = type & 0x1F, generalized = (type & 0x3E0) << 3;
  if (type > 0x3FF) return 0;
  if (low == 9) return kSecret | generalized;
  if (low == 0) return generalized;
  // The first seventeen follow 64; beyond, only what is plain light or damage in Doom is known.
  return low <= 17 ? (low + 64) | generalized : generalized;
}

}  // namespace comrad::wad
