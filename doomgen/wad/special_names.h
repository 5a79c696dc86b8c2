// The line specials: the public numbering of Hexen as ZDoom extended it. One list gives their numbers, their names
// and what the engine makes of them; the compiler of scripts, the readers of maps and the engine all read it here.
// Stage: loading and messages.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string_view>

namespace comrad::wad {

/// What the engine makes of a special.
enum class SpecialSupport : uint8_t {
  kSupported,        ///< does what it does in ZDoom, or has nothing to do here (sounds, quakes)
  kUnsupported,      ///< a call does nothing; one warning per level
  kUnsupportedShape  ///< the same; loading a map with such a line logs a warning
};

// X(number, name, support) by rising number; not every number has a special. Taken by the enum below and by the
// table of special_names().
#define COMRAD_SPECIALS(X)                             \
  X(1, Polyobj_StartLine, kSupported)                  \
  X(2, Polyobj_RotateLeft, kSupported)                 \
  X(3, Polyobj_RotateRight, kSupported)                \
  X(4, Polyobj_Move, kSupported)                       \
  X(5, Polyobj_ExplicitLine, kSupported)               \
  X(6, Polyobj_MoveTimes8, kSupported)                 \
  X(7, Polyobj_DoorSwing, kSupported)                  \
  X(8, Polyobj_DoorSlide, kSupported)                  \
  X(9, Line_Horizon, kUnsupportedShape)                \
  X(10, Door_Close, kSupported)                        \
  X(11, Door_Open, kSupported)                         \
  X(12, Door_Raise, kSupported)                        \
  X(13, Door_LockedRaise, kSupported)                  \
  X(14, Door_Animated, kSupported)                     \
  X(15, Autosave, kSupported)                          \
  X(16, Transfer_WallLight, kUnsupported)              \
  X(17, Thing_Raise, kSupported)                       \
  X(18, StartConversation, kSupported)                 \
  X(19, Thing_Stop, kSupported)                        \
  X(20, Floor_LowerByValue, kSupported)                \
  X(21, Floor_LowerToLowest, kSupported)               \
  X(22, Floor_LowerToNearest, kSupported)              \
  X(23, Floor_RaiseByValue, kSupported)                \
  X(24, Floor_RaiseToHighest, kSupported)              \
  X(25, Floor_RaiseToNearest, kSupported)              \
  X(26, Stairs_BuildDown, kSupported)                  \
  X(27, Stairs_BuildUp, kSupported)                    \
  X(28, Floor_RaiseAndCrush, kSupported)               \
  X(29, Pillar_Build, kSupported)                      \
  X(30, Pillar_Open, kSupported)                       \
  X(31, Stairs_BuildDownSync, kSupported)              \
  X(32, Stairs_BuildUpSync, kSupported)                \
  X(33, ForceField, kSupported)                        \
  X(34, ClearForceField, kSupported)                   \
  X(35, Floor_RaiseByValueTimes8, kSupported)          \
  X(36, Floor_LowerByValueTimes8, kSupported)          \
  X(37, Floor_MoveToValue, kSupported)                 \
  X(38, Ceiling_Waggle, kSupported)                    \
  X(39, Teleport_ZombieChanger, kSupported)            \
  X(40, Ceiling_LowerByValue, kSupported)              \
  X(41, Ceiling_RaiseByValue, kSupported)              \
  X(42, Ceiling_CrushAndRaise, kSupported)             \
  X(43, Ceiling_LowerAndCrush, kSupported)             \
  X(44, Ceiling_CrushStop, kSupported)                 \
  X(45, Ceiling_CrushRaiseAndStay, kSupported)         \
  X(46, Floor_CrushStop, kSupported)                   \
  X(47, Ceiling_MoveToValue, kSupported)               \
  X(48, Sector_Attach3dMidtex, kUnsupportedShape)      \
  X(49, GlassBreak, kSupported)                        \
  X(50, ExtraFloor_LightOnly, kUnsupportedShape)       \
  X(51, Sector_SetLink, kUnsupportedShape)             \
  X(52, Scroll_Wall, kSupported)                       \
  X(53, Line_SetTextureOffset, kSupported)             \
  X(54, Sector_ChangeFlags, kSupported)                \
  X(55, Line_SetBlocking, kSupported)                  \
  X(56, Line_SetTextureScale, kUnsupported)            \
  X(57, Sector_SetPortal, kUnsupportedShape)           \
  X(58, Sector_CopyScroller, kUnsupported)             \
  X(59, Polyobj_OR_MoveToSpot, kSupported)             \
  X(60, Plat_PerpetualRaise, kSupported)               \
  X(61, Plat_Stop, kSupported)                         \
  X(62, Plat_DownWaitUpStay, kSupported)               \
  X(63, Plat_DownByValue, kSupported)                  \
  X(64, Plat_UpWaitDownStay, kSupported)               \
  X(65, Plat_UpByValue, kSupported)                    \
  X(66, Floor_LowerInstant, kSupported)                \
  X(67, Floor_RaiseInstant, kSupported)                \
  X(68, Floor_MoveToValueTimes8, kSupported)           \
  X(69, Ceiling_MoveToValueTimes8, kSupported)         \
  X(70, Teleport, kSupported)                          \
  X(71, Teleport_NoFog, kSupported)                    \
  X(72, ThrustThing, kSupported)                       \
  X(73, DamageThing, kSupported)                       \
  X(74, Teleport_NewMap, kSupported)                   \
  X(75, Teleport_EndGame, kSupported)                  \
  X(76, TeleportOther, kSupported)                     \
  X(77, TeleportGroup, kSupported)                     \
  X(78, TeleportInSector, kSupported)                  \
  X(79, Thing_SetConversation, kUnsupported)           \
  X(80, ACS_Execute, kSupported)                       \
  X(81, ACS_Suspend, kSupported)                       \
  X(82, ACS_Terminate, kSupported)                     \
  X(83, ACS_LockedExecute, kSupported)                 \
  X(84, ACS_ExecuteWithResult, kSupported)             \
  X(85, ACS_LockedExecuteDoor, kSupported)             \
  X(86, Polyobj_MoveToSpot, kSupported)                \
  X(87, Polyobj_Stop, kSupported)                      \
  X(88, Polyobj_MoveTo, kSupported)                    \
  X(89, Polyobj_OR_MoveTo, kSupported)                 \
  X(90, Polyobj_OR_RotateLeft, kSupported)             \
  X(91, Polyobj_OR_RotateRight, kSupported)            \
  X(92, Polyobj_OR_Move, kSupported)                   \
  X(93, Polyobj_OR_MoveTimes8, kSupported)             \
  X(94, Pillar_BuildAndCrush, kSupported)              \
  X(95, FloorAndCeiling_LowerByValue, kSupported)      \
  X(96, FloorAndCeiling_RaiseByValue, kSupported)      \
  X(97, Ceiling_LowerAndCrushDist, kSupported)         \
  X(98, Sector_SetTranslucent, kUnsupported)           \
  X(99, Floor_RaiseAndCrushDoom, kSupported)           \
  X(100, Scroll_Texture_Left, kSupported)              \
  X(101, Scroll_Texture_Right, kSupported)             \
  X(102, Scroll_Texture_Up, kSupported)                \
  X(103, Scroll_Texture_Down, kSupported)              \
  X(104, Ceiling_CrushAndRaiseSilentDist, kSupported)  \
  X(105, Door_WaitRaise, kSupported)                   \
  X(106, Door_WaitClose, kSupported)                   \
  X(107, Line_SetPortalTarget, kUnsupportedShape)      \
  X(109, Light_ForceLightning, kSupported)             \
  X(110, Light_RaiseByValue, kSupported)               \
  X(111, Light_LowerByValue, kSupported)               \
  X(112, Light_ChangeToValue, kSupported)              \
  X(113, Light_Fade, kSupported)                       \
  X(114, Light_Glow, kSupported)                       \
  X(115, Light_Flicker, kSupported)                    \
  X(116, Light_Strobe, kSupported)                     \
  X(117, Light_Stop, kSupported)                       \
  X(118, Plane_Copy, kUnsupportedShape)                \
  X(119, Thing_Damage, kSupported)                     \
  X(120, Radius_Quake, kSupported)                     \
  X(121, Line_SetIdentification, kSupported)           \
  X(125, Thing_Move, kSupported)                       \
  X(127, Thing_SetSpecial, kSupported)                 \
  X(128, ThrustThingZ, kSupported)                     \
  X(129, UsePuzzleItem, kSupported)                    \
  X(130, Thing_Activate, kSupported)                   \
  X(131, Thing_Deactivate, kSupported)                 \
  X(132, Thing_Remove, kSupported)                     \
  X(133, Thing_Destroy, kSupported)                    \
  X(134, Thing_Projectile, kSupported)                 \
  X(135, Thing_Spawn, kSupported)                      \
  X(136, Thing_ProjectileGravity, kSupported)          \
  X(137, Thing_SpawnNoFog, kSupported)                 \
  X(138, Floor_Waggle, kSupported)                     \
  X(139, Thing_SpawnFacing, kSupported)                \
  X(140, Sector_ChangeSound, kSupported)               \
  X(145, Player_SetTeam, kUnsupported)                 \
  X(152, Team_Score, kUnsupported)                     \
  X(153, Team_GivePoints, kUnsupported)                \
  X(154, Teleport_NoStop, kSupported)                  \
  X(156, Line_SetPortal, kUnsupportedShape)            \
  X(157, SetGlobalFogParameter, kSupported)            \
  X(158, FS_Execute, kUnsupported)                     \
  X(159, Sector_SetPlaneReflection, kUnsupportedShape) \
  X(160, Sector_Set3DFloor, kUnsupportedShape)         \
  X(161, Sector_SetContents, kUnsupportedShape)        \
  X(168, Ceiling_CrushAndRaiseDist, kSupported)        \
  X(169, Generic_Crusher2, kSupported)                 \
  X(170, Sector_SetCeilingScale2, kSupported)          \
  X(171, Sector_SetFloorScale2, kSupported)            \
  X(172, Plat_UpNearestWaitDownStay, kSupported)       \
  X(173, NoiseAlert, kSupported)                       \
  X(174, SendToCommunicator, kUnsupported)             \
  X(175, Thing_ProjectileIntercept, kSupported)        \
  X(176, Thing_ChangeTID, kSupported)                  \
  X(177, Thing_Hate, kSupported)                       \
  X(178, Thing_ProjectileAimed, kSupported)            \
  X(179, ChangeSkill, kUnsupported)                    \
  X(180, Thing_SetTranslation, kSupported)             \
  X(181, Plane_Align, kUnsupportedShape)               \
  X(182, Line_Mirror, kUnsupportedShape)               \
  X(183, Line_AlignCeiling, kUnsupported)              \
  X(184, Line_AlignFloor, kUnsupported)                \
  X(185, Sector_SetRotation, kSupported)               \
  X(186, Sector_SetCeilingPanning, kSupported)         \
  X(187, Sector_SetFloorPanning, kSupported)           \
  X(188, Sector_SetCeilingScale, kSupported)           \
  X(189, Sector_SetFloorScale, kSupported)             \
  X(190, Static_Init, kUnsupportedShape)               \
  X(191, SetPlayerProperty, kSupported)                \
  X(192, Ceiling_LowerToHighestFloor, kSupported)      \
  X(193, Ceiling_LowerInstant, kSupported)             \
  X(194, Ceiling_RaiseInstant, kSupported)             \
  X(195, Ceiling_CrushRaiseAndStayA, kSupported)       \
  X(196, Ceiling_CrushAndRaiseA, kSupported)           \
  X(197, Ceiling_CrushAndRaiseSilentA, kSupported)     \
  X(198, Ceiling_RaiseByValueTimes8, kSupported)       \
  X(199, Ceiling_LowerByValueTimes8, kSupported)       \
  X(200, Generic_Floor, kSupported)                    \
  X(201, Generic_Ceiling, kSupported)                  \
  X(202, Generic_Door, kSupported)                     \
  X(203, Generic_Lift, kSupported)                     \
  X(204, Generic_Stairs, kSupported)                   \
  X(205, Generic_Crusher, kSupported)                  \
  X(206, Plat_DownWaitUpStayLip, kSupported)           \
  X(207, Plat_PerpetualRaiseLip, kSupported)           \
  X(208, TranslucentLine, kSupported)                  \
  X(209, Transfer_Heights, kUnsupportedShape)          \
  X(210, Transfer_FloorLight, kUnsupported)            \
  X(211, Transfer_CeilingLight, kUnsupported)          \
  X(212, Sector_SetColor, kSupported)                  \
  X(213, Sector_SetFade, kSupported)                   \
  X(214, Sector_SetDamage, kSupported)                 \
  X(215, Teleport_Line, kSupported)                    \
  X(216, Sector_SetGravity, kSupported)                \
  X(217, Stairs_BuildUpDoom, kSupported)               \
  X(218, Sector_SetWind, kSupported)                   \
  X(219, Sector_SetFriction, kSupported)               \
  X(220, Sector_SetCurrent, kSupported)                \
  X(221, Scroll_Texture_Both, kSupported)              \
  X(222, Scroll_Texture_Model, kSupported)             \
  X(223, Scroll_Floor, kSupported)                     \
  X(224, Scroll_Ceiling, kSupported)                   \
  X(225, Scroll_Texture_Offsets, kSupported)           \
  X(226, ACS_ExecuteAlways, kSupported)                \
  X(227, PointPush_SetForce, kSupported)               \
  X(228, Plat_RaiseAndStayTx0, kSupported)             \
  X(229, Thing_SetGoal, kSupported)                    \
  X(230, Plat_UpByValueStayTx, kSupported)             \
  X(231, Plat_ToggleCeiling, kSupported)               \
  X(232, Light_StrobeDoom, kSupported)                 \
  X(233, Light_MinNeighbor, kSupported)                \
  X(234, Light_MaxNeighbor, kSupported)                \
  X(235, Floor_TransferTrigger, kSupported)            \
  X(236, Floor_TransferNumeric, kSupported)            \
  X(237, ChangeCamera, kSupported)                     \
  X(238, Floor_RaiseToLowestCeiling, kSupported)       \
  X(239, Floor_RaiseByValueTxTy, kSupported)           \
  X(240, Floor_RaiseByTexture, kSupported)             \
  X(241, Floor_LowerToLowestTxTy, kSupported)          \
  X(242, Floor_LowerToHighest, kSupported)             \
  X(243, Exit_Normal, kSupported)                      \
  X(244, Exit_Secret, kSupported)                      \
  X(245, Elevator_RaiseToNearest, kSupported)          \
  X(246, Elevator_MoveToFloor, kSupported)             \
  X(247, Elevator_LowerToNearest, kSupported)          \
  X(248, HealThing, kSupported)                        \
  X(249, Door_CloseWaitOpen, kSupported)               \
  X(250, Floor_Donut, kSupported)                      \
  X(251, FloorAndCeiling_LowerRaise, kSupported)       \
  X(252, Ceiling_RaiseToNearest, kSupported)           \
  X(253, Ceiling_LowerToLowest, kSupported)            \
  X(254, Ceiling_LowerToFloor, kSupported)             \
  X(255, Ceiling_CrushRaiseAndStaySilA, kSupported)    \
  X(256, Floor_LowerToHighestEE, kSupported)           \
  X(257, Floor_RaiseToLowest, kSupported)              \
  X(258, Floor_LowerToLowestCeiling, kSupported)       \
  X(259, Floor_RaiseToCeiling, kSupported)             \
  X(260, Floor_ToCeilingInstant, kSupported)           \
  X(261, Floor_LowerByTexture, kSupported)             \
  X(262, Ceiling_RaiseToHighest, kSupported)           \
  X(263, Ceiling_ToHighestInstant, kSupported)         \
  X(264, Ceiling_LowerToNearest, kSupported)           \
  X(265, Ceiling_RaiseToLowest, kSupported)            \
  X(266, Ceiling_RaiseToHighestFloor, kSupported)      \
  X(267, Ceiling_ToFloorInstant, kSupported)           \
  X(268, Ceiling_RaiseByTexture, kSupported)           \
  X(269, Ceiling_LowerByTexture, kSupported)           \
  X(270, Stairs_BuildDownDoom, kSupported)             \
  X(271, Stairs_BuildUpDoomSync, kSupported)           \
  X(272, Stairs_BuildDownDoomSync, kSupported)         \
  X(273, Stairs_BuildUpDoomCrush, kSupported)          \
  X(274, Door_AnimatedClose, kUnsupported)             \
  X(275, Floor_Stop, kSupported)                       \
  X(276, Ceiling_Stop, kSupported)                     \
  X(277, Sector_SetFloorGlow, kUnsupported)            \
  X(278, Sector_SetCeilingGlow, kUnsupported)          \
  X(279, Floor_MoveToValueAndCrush, kUnsupported)      \
  X(280, Ceiling_MoveToValueAndCrush, kUnsupported)

/// The numbers by name: Special::kDoor_Open is 11. The names are the published ones, underscores included. Any
/// number may come out of a map or a script, so what carries one is an int32_t.
enum Special : int32_t {
#define COMRAD_SPECIAL_NUMBER(number, name, support) k##name = number,
  COMRAD_SPECIALS(COMRAD_SPECIAL_NUMBER)
#undef COMRAD_SPECIAL_NUMBER
};

struct SpecialName {
  int16_t number;
  std::string_view name;
  SpecialSupport support;
};

/// By rising number.
std::span<const SpecialName> special_names();

/// "Door_Open" -> 11, in any case. Nothing for what is no special's name.
std::optional<int32_t> find_special(std::string_view name);

/// 11 -> "Door_Open"; empty for what is no special's number.
std::string_view special_name(int32_t number);

}  // namespace comrad::wad
