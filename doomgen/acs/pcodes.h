// The instructions of ACS bytecode: number, name, operands in the code, values taken from and left on the
// stack. Shared by what writes a BEHAVIOR lump (doomgen/acs) and what runs it (sim_workers/engine/acs).
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <string_view>

namespace comrad::bytecode {

/// The table, in order of the numbers. X(name, operands, pops, pushes); operands, one letter each:
///   w  4 bytes                          b  1 byte in compact code, 4 in plain
///   B  1 byte                           h  2 bytes in compact code, 4 in plain
///   n  a count byte and that many bytes
///   t  padding to a multiple of 4 from the start of the lump, a count, and that many pairs of words
///      (value, address)
/// What depends on the call (Call, CallFunc, PushBytes, the ends of HudMessage) pops and pushes more than the
/// table states; CaseGoto and CaseGotoSorted drop their value only when they jump.
// clang-format off
#define COMRAD_PCODES(X) \
  X(Nop, "", 0, 0)                                            /*   0 */ \
  X(Terminate, "", 0, 0)                                                \
  X(Suspend, "", 0, 0)                                                  \
  X(PushNumber, "w", 0, 1)                                              \
  X(Lspec1, "b", 1, 0)                                                  \
  X(Lspec2, "b", 2, 0)                                                  \
  X(Lspec3, "b", 3, 0)                                                  \
  X(Lspec4, "b", 4, 0)                                                  \
  X(Lspec5, "b", 5, 0)                                                  \
  X(Lspec1Direct, "bw", 0, 0)                                           \
  X(Lspec2Direct, "bww", 0, 0)                                /*  10 */ \
  X(Lspec3Direct, "bwww", 0, 0)                                         \
  X(Lspec4Direct, "bwwww", 0, 0)                                        \
  X(Lspec5Direct, "bwwwww", 0, 0)                                       \
  X(Add, "", 2, 1)                                                      \
  X(Subtract, "", 2, 1)                                                 \
  X(Multiply, "", 2, 1)                                                 \
  X(Divide, "", 2, 1)                                                   \
  X(Modulus, "", 2, 1)                                                  \
  X(Equal, "", 2, 1)                                                    \
  X(NotEqual, "", 2, 1)                                       /*  20 */ \
  X(Less, "", 2, 1)                                                     \
  X(Greater, "", 2, 1)                                                  \
  X(LessOrEqual, "", 2, 1)                                              \
  X(GreaterOrEqual, "", 2, 1)                                           \
  X(AssignScriptVar, "b", 1, 0)                                         \
  X(AssignMapVar, "b", 1, 0)                                            \
  X(AssignWorldVar, "b", 1, 0)                                          \
  X(PushScriptVar, "b", 0, 1)                                           \
  X(PushMapVar, "b", 0, 1)                                              \
  X(PushWorldVar, "b", 0, 1)                                  /*  30 */ \
  X(AddScriptVar, "b", 1, 0)                                            \
  X(AddMapVar, "b", 1, 0)                                               \
  X(AddWorldVar, "b", 1, 0)                                             \
  X(SubScriptVar, "b", 1, 0)                                            \
  X(SubMapVar, "b", 1, 0)                                               \
  X(SubWorldVar, "b", 1, 0)                                             \
  X(MulScriptVar, "b", 1, 0)                                            \
  X(MulMapVar, "b", 1, 0)                                               \
  X(MulWorldVar, "b", 1, 0)                                             \
  X(DivScriptVar, "b", 1, 0)                                  /*  40 */ \
  X(DivMapVar, "b", 1, 0)                                               \
  X(DivWorldVar, "b", 1, 0)                                             \
  X(ModScriptVar, "b", 1, 0)                                            \
  X(ModMapVar, "b", 1, 0)                                               \
  X(ModWorldVar, "b", 1, 0)                                             \
  X(IncScriptVar, "b", 0, 0)                                            \
  X(IncMapVar, "b", 0, 0)                                               \
  X(IncWorldVar, "b", 0, 0)                                             \
  X(DecScriptVar, "b", 0, 0)                                            \
  X(DecMapVar, "b", 0, 0)                                     /*  50 */ \
  X(DecWorldVar, "b", 0, 0)                                             \
  X(Goto, "w", 0, 0)                                                    \
  X(IfGoto, "w", 1, 0)                                                  \
  X(Drop, "", 1, 0)                                                     \
  X(Delay, "", 1, 0)                                                    \
  X(DelayDirect, "w", 0, 0)                                             \
  X(Random, "", 2, 1)                                                   \
  X(RandomDirect, "ww", 0, 1)                                           \
  X(ThingCount, "", 2, 1)                                               \
  X(ThingCountDirect, "ww", 0, 1)                             /*  60 */ \
  X(TagWait, "", 1, 0)                                                  \
  X(TagWaitDirect, "w", 0, 0)                                           \
  X(PolyWait, "", 1, 0)                                                 \
  X(PolyWaitDirect, "w", 0, 0)                                          \
  X(ChangeFloor, "", 2, 0)                                              \
  X(ChangeFloorDirect, "ww", 0, 0)                                      \
  X(ChangeCeiling, "", 2, 0)                                            \
  X(ChangeCeilingDirect, "ww", 0, 0)                                    \
  X(Restart, "", 0, 0)                                                  \
  X(AndLogical, "", 2, 1)                                     /*  70 */ \
  X(OrLogical, "", 2, 1)                                                \
  X(AndBitwise, "", 2, 1)                                               \
  X(OrBitwise, "", 2, 1)                                                \
  X(EorBitwise, "", 2, 1)                                               \
  X(NegateLogical, "", 1, 1)                                            \
  X(LeftShift, "", 2, 1)                                                \
  X(RightShift, "", 2, 1)                                               \
  X(UnaryMinus, "", 1, 1)                                               \
  X(IfNotGoto, "w", 1, 0)                                               \
  X(LineSide, "", 0, 1)                                       /*  80 */ \
  X(ScriptWait, "", 1, 0)                                               \
  X(ScriptWaitDirect, "w", 0, 0)                                        \
  X(ClearLineSpecial, "", 0, 0)                                         \
  X(CaseGoto, "ww", 1, 1)                                               \
  X(BeginPrint, "", 0, 0)                                               \
  X(EndPrint, "", 0, 0)                                                 \
  X(PrintString, "", 1, 0)                                              \
  X(PrintNumber, "", 1, 0)                                              \
  X(PrintCharacter, "", 1, 0)                                           \
  X(PlayerCount, "", 0, 1)                                    /*  90 */ \
  X(GameType, "", 0, 1)                                                 \
  X(GameSkill, "", 0, 1)                                                \
  X(Timer, "", 0, 1)                                                    \
  X(SectorSound, "", 2, 0)                                              \
  X(AmbientSound, "", 2, 0)                                             \
  X(SoundSequence, "", 1, 0)                                            \
  X(SetLineTexture, "", 4, 0)                                           \
  X(SetLineBlocking, "", 2, 0)                                          \
  X(SetLineSpecial, "", 7, 0)                                           \
  X(ThingSound, "", 3, 0)                                     /* 100 */ \
  X(EndPrintBold, "", 0, 0)                                             \
  X(ActivatorSound, "", 2, 0)                                           \
  X(LocalAmbientSound, "", 2, 0)                                        \
  X(SetLineMonsterBlocking, "", 2, 0)                                   \
  X(PlayerBlueSkull, "", 0, 1)                                          \
  X(PlayerRedSkull, "", 0, 1)                                           \
  X(PlayerYellowSkull, "", 0, 1)                                        \
  X(PlayerMasterSkull, "", 0, 1)                                        \
  X(PlayerBlueCard, "", 0, 1)                                           \
  X(PlayerRedCard, "", 0, 1)                                  /* 110 */ \
  X(PlayerYellowCard, "", 0, 1)                                         \
  X(PlayerMasterCard, "", 0, 1)                                         \
  X(PlayerBlackSkull, "", 0, 1)                                         \
  X(PlayerSilverSkull, "", 0, 1)                                        \
  X(PlayerGoldSkull, "", 0, 1)                                          \
  X(PlayerBlackCard, "", 0, 1)                                          \
  X(PlayerSilverCard, "", 0, 1)                                         \
  X(IsNetworkGame, "", 0, 1)                                            \
  X(PlayerTeam, "", 0, 1)                                               \
  X(PlayerHealth, "", 0, 1)                                   /* 120 */ \
  X(PlayerArmorPoints, "", 0, 1)                                        \
  X(PlayerFrags, "", 0, 1)                                              \
  X(PlayerExpert, "", 0, 1)                                             \
  X(BlueTeamCount, "", 0, 1)                                            \
  X(RedTeamCount, "", 0, 1)                                             \
  X(BlueTeamScore, "", 0, 1)                                            \
  X(RedTeamScore, "", 0, 1)                                             \
  X(IsOneFlagCtf, "", 0, 1)                                             \
  X(GetInvasionWave, "", 0, 1)                                          \
  X(GetInvasionState, "", 0, 1)                               /* 130 */ \
  X(PrintName, "", 1, 0)                                                \
  X(MusicChange, "", 2, 0)                                              \
  X(ConsoleCommandDirect, "www", 0, 0)                                  \
  X(ConsoleCommand, "", 3, 0)                                           \
  X(SinglePlayer, "", 0, 1)                                             \
  X(FixedMul, "", 2, 1)                                                 \
  X(FixedDiv, "", 2, 1)                                                 \
  X(SetGravity, "", 1, 0)                                               \
  X(SetGravityDirect, "w", 0, 0)                                        \
  X(SetAirControl, "", 1, 0)                                  /* 140 */ \
  X(SetAirControlDirect, "w", 0, 0)                                     \
  X(ClearInventory, "", 0, 0)                                           \
  X(GiveInventory, "", 2, 0)                                            \
  X(GiveInventoryDirect, "ww", 0, 0)                                    \
  X(TakeInventory, "", 2, 0)                                            \
  X(TakeInventoryDirect, "ww", 0, 0)                                    \
  X(CheckInventory, "", 1, 1)                                           \
  X(CheckInventoryDirect, "w", 0, 1)                                    \
  X(Spawn, "", 6, 1)                                                    \
  X(SpawnDirect, "wwwwww", 0, 1)                              /* 150 */ \
  X(SpawnSpot, "", 4, 1)                                                \
  X(SpawnSpotDirect, "wwww", 0, 1)                                      \
  X(SetMusic, "", 3, 0)                                                 \
  X(SetMusicDirect, "www", 0, 0)                                        \
  X(LocalSetMusic, "", 3, 0)                                            \
  X(LocalSetMusicDirect, "www", 0, 0)                                   \
  X(PrintFixed, "", 1, 0)                                               \
  X(PrintLocalized, "", 1, 0)                                           \
  X(MoreHudMessage, "", 0, 0)                                           \
  X(OptHudMessage, "", 0, 0)                                  /* 160 */ \
  X(EndHudMessage, "", 0, 0)                                            \
  X(EndHudMessageBold, "", 0, 0)                                        \
  X(SetStyle, "", 1, 0)                                                 \
  X(SetStyleDirect, "w", 0, 0)                                          \
  X(SetFont, "", 1, 0)                                                  \
  X(SetFontDirect, "w", 0, 0)                                           \
  X(PushByte, "B", 0, 1)                                                \
  X(Lspec1DirectB, "BB", 0, 0)                                          \
  X(Lspec2DirectB, "BBB", 0, 0)                                         \
  X(Lspec3DirectB, "BBBB", 0, 0)                              /* 170 */ \
  X(Lspec4DirectB, "BBBBB", 0, 0)                                       \
  X(Lspec5DirectB, "BBBBBB", 0, 0)                                      \
  X(DelayDirectB, "B", 0, 0)                                            \
  X(RandomDirectB, "BB", 0, 1)                                          \
  X(PushBytes, "n", 0, 0)                                               \
  X(Push2Bytes, "BB", 0, 2)                                             \
  X(Push3Bytes, "BBB", 0, 3)                                            \
  X(Push4Bytes, "BBBB", 0, 4)                                           \
  X(Push5Bytes, "BBBBB", 0, 5)                                          \
  X(SetThingSpecial, "", 7, 0)                                /* 180 */ \
  X(AssignGlobalVar, "b", 1, 0)                                         \
  X(PushGlobalVar, "b", 0, 1)                                           \
  X(AddGlobalVar, "b", 1, 0)                                            \
  X(SubGlobalVar, "b", 1, 0)                                            \
  X(MulGlobalVar, "b", 1, 0)                                            \
  X(DivGlobalVar, "b", 1, 0)                                            \
  X(ModGlobalVar, "b", 1, 0)                                            \
  X(IncGlobalVar, "b", 0, 0)                                            \
  X(DecGlobalVar, "b", 0, 0)                                            \
  X(FadeTo, "", 5, 0)                                         /* 190 */ \
  X(FadeRange, "", 9, 0)                                                \
  X(CancelFade, "", 0, 0)                                               \
  X(PlayMovie, "", 1, 1)                                                \
  X(SetFloorTrigger, "", 8, 0)                                          \
  X(SetCeilingTrigger, "", 8, 0)                                        \
  X(GetActorX, "", 1, 1)                                                \
  X(GetActorY, "", 1, 1)                                                \
  X(GetActorZ, "", 1, 1)                                                \
  X(StartTranslation, "", 1, 0)                                         \
  X(TranslationRange1, "", 4, 0)                              /* 200 */ \
  X(TranslationRange2, "", 8, 0)                                        \
  X(EndTranslation, "", 0, 0)                                           \
  X(Call, "b", 0, 0)                                                    \
  X(CallDiscard, "b", 0, 0)                                             \
  X(ReturnVoid, "", 0, 0)                                               \
  X(ReturnValue, "", 1, 0)                                              \
  X(PushMapArray, "b", 1, 1)                                            \
  X(AssignMapArray, "b", 2, 0)                                          \
  X(AddMapArray, "b", 2, 0)                                             \
  X(SubMapArray, "b", 2, 0)                                   /* 210 */ \
  X(MulMapArray, "b", 2, 0)                                             \
  X(DivMapArray, "b", 2, 0)                                             \
  X(ModMapArray, "b", 2, 0)                                             \
  X(IncMapArray, "b", 1, 0)                                             \
  X(DecMapArray, "b", 1, 0)                                             \
  X(Duplicate, "", 1, 2)                                                \
  X(Swap, "", 2, 2)                                                     \
  X(WriteToIni, "", 0, 0)                                               \
  X(GetFromIni, "", 0, 0)                                               \
  X(Sin, "", 1, 1)                                            /* 220 */ \
  X(Cos, "", 1, 1)                                                      \
  X(VectorAngle, "", 2, 1)                                              \
  X(CheckWeapon, "", 1, 1)                                              \
  X(SetWeapon, "", 1, 1)                                                \
  X(TagString, "", 1, 1)                                                \
  X(PushWorldArray, "b", 1, 1)                                          \
  X(AssignWorldArray, "b", 2, 0)                                        \
  X(AddWorldArray, "b", 2, 0)                                           \
  X(SubWorldArray, "b", 2, 0)                                           \
  X(MulWorldArray, "b", 2, 0)                                 /* 230 */ \
  X(DivWorldArray, "b", 2, 0)                                           \
  X(ModWorldArray, "b", 2, 0)                                           \
  X(IncWorldArray, "b", 1, 0)                                           \
  X(DecWorldArray, "b", 1, 0)                                           \
  X(PushGlobalArray, "b", 1, 1)                                         \
  X(AssignGlobalArray, "b", 2, 0)                                       \
  X(AddGlobalArray, "b", 2, 0)                                          \
  X(SubGlobalArray, "b", 2, 0)                                          \
  X(MulGlobalArray, "b", 2, 0)                                          \
  X(DivGlobalArray, "b", 2, 0)                                /* 240 */ \
  X(ModGlobalArray, "b", 2, 0)                                          \
  X(IncGlobalArray, "b", 1, 0)                                          \
  X(DecGlobalArray, "b", 1, 0)                                          \
  X(SetMarineWeapon, "", 2, 0)                                          \
  X(SetActorProperty, "", 3, 0)                                         \
  X(GetActorProperty, "", 2, 1)                                         \
  X(PlayerNumber, "", 0, 1)                                             \
  X(ActivatorTid, "", 0, 1)                                             \
  X(SetMarineSprite, "", 2, 0)                                          \
  X(GetScreenWidth, "", 0, 1)                                 /* 250 */ \
  X(GetScreenHeight, "", 0, 1)                                          \
  X(ThingProjectile2, "", 7, 0)                                         \
  X(StrLen, "", 1, 1)                                                   \
  X(SetHudSize, "", 3, 0)                                               \
  X(GetCvar, "", 1, 1)                                                  \
  X(CaseGotoSorted, "t", 1, 1)                                          \
  X(SetResultValue, "", 1, 0)                                           \
  X(GetLineRowOffset, "", 0, 1)                                         \
  X(GetActorFloorZ, "", 1, 1)                                           \
  X(GetActorAngle, "", 1, 1)                                  /* 260 */ \
  X(GetSectorFloorZ, "", 3, 1)                                          \
  X(GetSectorCeilingZ, "", 3, 1)                                        \
  X(Lspec5Result, "b", 5, 1)                                            \
  X(GetSigilPieces, "", 0, 1)                                           \
  X(GetLevelInfo, "", 1, 1)                                             \
  X(ChangeSky, "", 2, 0)                                                \
  X(PlayerInGame, "", 1, 1)                                             \
  X(PlayerIsBot, "", 1, 1)                                              \
  X(SetCameraToTexture, "", 3, 0)                                       \
  X(EndLog, "", 0, 0)                                         /* 270 */ \
  X(GetAmmoCapacity, "", 1, 1)                                          \
  X(SetAmmoCapacity, "", 2, 0)                                          \
  X(PrintMapCharArray, "", 2, 0)                                        \
  X(PrintWorldCharArray, "", 2, 0)                                      \
  X(PrintGlobalCharArray, "", 2, 0)                                     \
  X(SetActorAngle, "", 2, 0)                                            \
  X(GrabInput, "", 0, 0)                                                \
  X(SetMousePointer, "", 0, 0)                                          \
  X(MoveMousePointer, "", 0, 0)                                         \
  X(SpawnProjectile, "", 7, 0)                                /* 280 */ \
  X(GetSectorLightLevel, "", 1, 1)                                      \
  X(GetActorCeilingZ, "", 1, 1)                                         \
  X(SetActorPosition, "", 5, 1)                                         \
  X(ClearActorInventory, "", 1, 0)                                      \
  X(GiveActorInventory, "", 3, 0)                                       \
  X(TakeActorInventory, "", 3, 0)                                       \
  X(CheckActorInventory, "", 2, 1)                                      \
  X(ThingCountName, "", 2, 1)                                           \
  X(SpawnSpotFacing, "", 3, 1)                                          \
  X(PlayerClass, "", 1, 1)                                    /* 290 */ \
  X(AndScriptVar, "b", 1, 0)                                            \
  X(AndMapVar, "b", 1, 0)                                               \
  X(AndWorldVar, "b", 1, 0)                                             \
  X(AndGlobalVar, "b", 1, 0)                                            \
  X(AndMapArray, "b", 2, 0)                                             \
  X(AndWorldArray, "b", 2, 0)                                           \
  X(AndGlobalArray, "b", 2, 0)                                          \
  X(EorScriptVar, "b", 1, 0)                                            \
  X(EorMapVar, "b", 1, 0)                                               \
  X(EorWorldVar, "b", 1, 0)                                   /* 300 */ \
  X(EorGlobalVar, "b", 1, 0)                                            \
  X(EorMapArray, "b", 2, 0)                                             \
  X(EorWorldArray, "b", 2, 0)                                           \
  X(EorGlobalArray, "b", 2, 0)                                          \
  X(OrScriptVar, "b", 1, 0)                                             \
  X(OrMapVar, "b", 1, 0)                                                \
  X(OrWorldVar, "b", 1, 0)                                              \
  X(OrGlobalVar, "b", 1, 0)                                             \
  X(OrMapArray, "b", 2, 0)                                              \
  X(OrWorldArray, "b", 2, 0)                                  /* 310 */ \
  X(OrGlobalArray, "b", 2, 0)                                           \
  X(LeftShiftScriptVar, "b", 1, 0)                                      \
  X(LeftShiftMapVar, "b", 1, 0)                                         \
  X(LeftShiftWorldVar, "b", 1, 0)                                       \
  X(LeftShiftGlobalVar, "b", 1, 0)                                      \
  X(LeftShiftMapArray, "b", 2, 0)                                       \
  X(LeftShiftWorldArray, "b", 2, 0)                                     \
  X(LeftShiftGlobalArray, "b", 2, 0)                                    \
  X(RightShiftScriptVar, "b", 1, 0)                                     \
  X(RightShiftMapVar, "b", 1, 0)                              /* 320 */ \
  X(RightShiftWorldVar, "b", 1, 0)                                      \
  X(RightShiftGlobalVar, "b", 1, 0)                                     \
  X(RightShiftMapArray, "b", 2, 0)                                      \
  X(RightShiftWorldArray, "b", 2, 0)                                    \
  X(RightShiftGlobalArray, "b", 2, 0)                                   \
  X(GetPlayerInfo, "", 2, 1)                                            \
  X(ChangeLevel, "", 4, 0)                                              \
  X(SectorDamage, "", 5, 0)                                             \
  X(ReplaceTextures, "", 3, 0)                                          \
  X(NegateBinary, "", 1, 1)                                   /* 330 */ \
  X(GetActorPitch, "", 1, 1)                                            \
  X(SetActorPitch, "", 2, 0)                                            \
  X(PrintBind, "", 1, 0)                                                \
  X(SetActorState, "", 3, 1)                                            \
  X(ThingDamage2, "", 3, 1)                                             \
  X(UseInventory, "", 1, 1)                                             \
  X(UseActorInventory, "", 2, 1)                                        \
  X(CheckActorCeilingTexture, "", 2, 1)                                 \
  X(CheckActorFloorTexture, "", 2, 1)                                   \
  X(GetActorLightLevel, "", 1, 1)                             /* 340 */ \
  X(SetMugshotState, "", 1, 0)                                          \
  X(ThingCountSector, "", 3, 1)                                         \
  X(ThingCountNameSector, "", 3, 1)                                     \
  X(CheckPlayerCamera, "", 1, 1)                                        \
  X(MorphActor, "", 7, 1)                                               \
  X(UnmorphActor, "", 2, 1)                                             \
  X(GetPlayerInput, "", 2, 1)                                           \
  X(ClassifyActor, "", 1, 1)                                            \
  X(PrintBinary, "", 1, 0)                                              \
  X(PrintHex, "", 1, 0)                                       /* 350 */ \
  X(CallFunc, "bh", 0, 0)                                               \
  X(SaveString, "", 0, 1)                                               \
  X(PrintMapChRange, "", 4, 0)                                          \
  X(PrintWorldChRange, "", 4, 0)                                        \
  X(PrintGlobalChRange, "", 4, 0)                                       \
  X(StrCpyToMapChRange, "", 6, 1)                                       \
  X(StrCpyToWorldChRange, "", 6, 1)                                     \
  X(StrCpyToGlobalChRange, "", 6, 1)                                    \
  X(PushFunction, "b", 0, 1)                                            \
  X(CallStack, "", 1, 0)                                      /* 360 */ \
  X(ScriptWaitNamed, "", 1, 0)                                          \
  X(TranslationRange3, "", 8, 0)                                        \
  X(GotoStack, "", 1, 0)                                                \
  X(AssignScriptArray, "b", 2, 0)                                       \
  X(PushScriptArray, "b", 1, 1)                                         \
  X(AddScriptArray, "b", 2, 0)                                          \
  X(SubScriptArray, "b", 2, 0)                                          \
  X(MulScriptArray, "b", 2, 0)                                          \
  X(DivScriptArray, "b", 2, 0)                                          \
  X(ModScriptArray, "b", 2, 0)                                /* 370 */ \
  X(IncScriptArray, "b", 1, 0)                                          \
  X(DecScriptArray, "b", 1, 0)                                          \
  X(AndScriptArray, "b", 2, 0)                                          \
  X(EorScriptArray, "b", 2, 0)                                          \
  X(OrScriptArray, "b", 2, 0)                                           \
  X(LeftShiftScriptArray, "b", 2, 0)                                    \
  X(RightShiftScriptArray, "b", 2, 0)                                   \
  X(PrintScriptCharArray, "", 2, 0)                                     \
  X(PrintScriptChRange, "", 4, 0)                                       \
  X(StrCpyToScriptChRange, "", 6, 1)                          /* 380 */ \
  X(Lspec5Ex, "w", 5, 0)                                                \
  X(Lspec5ExResult, "w", 5, 1)
// clang-format on

enum class PCode : uint16_t {
#define COMRAD_PCODE(name, operands, pops, pushes) k##name,
  COMRAD_PCODES(COMRAD_PCODE)
#undef COMRAD_PCODE
      kCount
};
constexpr std::size_t kPCodeCount = static_cast<std::size_t>(PCode::kCount);
static_assert(static_cast<int>(PCode::kCallFunc) == 351 && kPCodeCount == 383, "a row is missing or doubled");

struct PCodeInfo {
  std::string_view name;
  std::string_view operands;
  uint8_t pops = 0, pushes = 0;
};

constexpr std::array<PCodeInfo, kPCodeCount> kPCodes = {{
#define COMRAD_PCODE(name, operands, pops, pushes) {#name, operands, pops, pushes},
    COMRAD_PCODES(COMRAD_PCODE)
#undef COMRAD_PCODE
}};

/// What a p-code does to a variable or an element of an array.
enum class Operation : uint8_t {
  kNone,
  kAssign,
  kPush,
  kAdd,
  kSub,
  kMul,
  kDiv,
  kMod,
  kInc,
  kDec,
  kAnd,
  kEor,
  kOr,
  kLeftShift,
  kRightShift
};
/// Where the variable lives; the arrays stand four further than the plain ones.
enum class VariableScope : uint8_t {
  kScript,
  kMap,
  kWorld,
  kGlobal,
  kScriptArray,
  kMapArray,
  kWorldArray,
  kGlobalArray
};
constexpr bool is_array(VariableScope scope) { return scope >= VariableScope::kScriptArray; }

struct VariableCode {
  Operation operation = Operation::kNone;  ///< kNone: the p-code is about something else
  VariableScope scope = VariableScope::kScript;
  constexpr bool operator==(const VariableCode&) const = default;
};

/// By p-code. The numbers follow the history of the language: three scopes at first, then globals,
/// arrays, bits.
constexpr std::array<VariableCode, kPCodeCount> make_variable_codes() {
  using enum Operation;
  using enum VariableScope;
  std::array<VariableCode, kPCodeCount> codes{};
  std::size_t at = static_cast<std::size_t>(PCode::kAssignScriptVar);
  for (const Operation operation : {kAssign, kPush, kAdd, kSub, kMul, kDiv, kMod, kInc, kDec})
    for (const VariableScope scope : {kScript, kMap, kWorld}) codes[at++] = {operation, scope};
  at = static_cast<std::size_t>(PCode::kAssignGlobalVar);
  for (const Operation operation : {kAssign, kPush, kAdd, kSub, kMul, kDiv, kMod, kInc, kDec})
    codes[at++] = {operation, kGlobal};
  const auto arrays = [&](PCode first, VariableScope scope) {  // here Push comes first
    std::size_t place = static_cast<std::size_t>(first);
    for (const Operation operation : {kPush, kAssign, kAdd, kSub, kMul, kDiv, kMod, kInc, kDec})
      codes[place++] = {operation, scope};
  };
  arrays(PCode::kPushMapArray, kMapArray);
  arrays(PCode::kPushWorldArray, kWorldArray);
  arrays(PCode::kPushGlobalArray, kGlobalArray);
  at = static_cast<std::size_t>(PCode::kAndScriptVar);
  for (const Operation operation : {kAnd, kEor, kOr, kLeftShift, kRightShift})
    for (const VariableScope scope : {kScript, kMap, kWorld, kGlobal, kMapArray, kWorldArray, kGlobalArray})
      codes[at++] = {operation, scope};
  at = static_cast<std::size_t>(PCode::kAssignScriptArray);
  for (const Operation operation :
       {kAssign, kPush, kAdd, kSub, kMul, kDiv, kMod, kInc, kDec, kAnd, kEor, kOr, kLeftShift, kRightShift})
    codes[at++] = {operation, kScriptArray};
  return codes;
}
constexpr std::array<VariableCode, kPCodeCount> kVariableCodes = make_variable_codes();

/// The p-code that does this to a variable of that scope; kNop for kNone.
constexpr PCode variable_code(Operation operation, VariableScope scope) {
  if (operation == Operation::kNone) return PCode::kNop;
  for (std::size_t code = 0; code < kPCodeCount; ++code)
    if (kVariableCodes[code] == VariableCode{operation, scope}) return static_cast<PCode>(code);
  return PCode::kNop;
}
static_assert(variable_code(Operation::kDec, VariableScope::kWorld) == PCode::kDecWorldVar);
static_assert(variable_code(Operation::kDec, VariableScope::kGlobalArray) == PCode::kDecGlobalArray);
static_assert(variable_code(Operation::kRightShift, VariableScope::kGlobalArray) ==
              PCode::kRightShiftGlobalArray);
static_assert(variable_code(Operation::kRightShift, VariableScope::kScriptArray) ==
              PCode::kRightShiftScriptArray);

/// Bytes of one operand; of `n` and `t` the least that they take.
constexpr int operand_bytes(char operand, bool compact) {
  switch (operand) {
    case 'b':
      return compact ? 1 : 4;
    case 'h':
      return compact ? 2 : 4;
    case 'w':
    case 't':
      return 4;
    default:
      return 1;
  }
}

/// In compact code numbers up to 239 take one byte, the others two: 240 + high, low, of number - 240.
constexpr int kFirstWidePCode = 240;

/// What the functions of CallFunc are called; numbers as in the code.
// clang-format off
#define COMRAD_ACS_FUNCTIONS(X) \
  X(GetLineUDMFInt, 1) \
  X(GetLineUDMFFixed, 2) \
  X(GetThingUDMFInt, 3) \
  X(GetThingUDMFFixed, 4) \
  X(GetSectorUDMFInt, 5) \
  X(GetSectorUDMFFixed, 6) \
  X(GetSideUDMFInt, 7) \
  X(GetSideUDMFFixed, 8) \
  X(GetActorVelX, 9) \
  X(GetActorVelY, 10) \
  X(GetActorVelZ, 11) \
  X(SetActivator, 12) \
  X(SetActivatorToTarget, 13) \
  X(GetActorViewHeight, 14) \
  X(GetChar, 15) \
  X(GetAirSupply, 16) \
  X(SetAirSupply, 17) \
  X(SetSkyScrollSpeed, 18) \
  X(GetArmorType, 19) \
  X(SpawnSpotForced, 20) \
  X(SpawnSpotFacingForced, 21) \
  X(CheckActorProperty, 22) \
  X(SetActorVelocity, 23) \
  X(SetUserVariable, 24) \
  X(GetUserVariable, 25) \
  X(Radius_Quake2, 26) \
  X(CheckActorClass, 27) \
  X(SetUserArray, 28) \
  X(GetUserArray, 29) \
  X(SoundSequenceOnActor, 30) \
  X(SoundSequenceOnSector, 31) \
  X(SoundSequenceOnPolyobj, 32) \
  X(GetPolyobjX, 33) \
  X(GetPolyobjY, 34) \
  X(CheckSight, 35) \
  X(SpawnForced, 36) \
  X(AnnouncerSound, 37) \
  X(SetPointer, 38) \
  X(ACS_NamedExecute, 39) \
  X(ACS_NamedSuspend, 40) \
  X(ACS_NamedTerminate, 41) \
  X(ACS_NamedLockedExecute, 42) \
  X(ACS_NamedLockedExecuteDoor, 43) \
  X(ACS_NamedExecuteWithResult, 44) \
  X(ACS_NamedExecuteAlways, 45) \
  X(UniqueTID, 46) \
  X(IsTIDUsed, 47) \
  X(Sqrt, 48) \
  X(FixedSqrt, 49) \
  X(VectorLength, 50) \
  X(SetHUDClipRect, 51) \
  X(SetHUDWrapWidth, 52) \
  X(SetCVar, 53) \
  X(GetUserCVar, 54) \
  X(SetUserCVar, 55) \
  X(GetCVarString, 56) \
  X(SetCVarString, 57) \
  X(GetUserCVarString, 58) \
  X(SetUserCVarString, 59) \
  X(LineAttack, 60) \
  X(PlaySound, 61) \
  X(StopSound, 62) \
  X(StrCmp, 63) \
  X(StrICmp, 64) \
  X(StrLeft, 65) \
  X(StrRight, 66) \
  X(StrMid, 67) \
  X(GetActorClass, 68) \
  X(GetWeapon, 69) \
  X(SoundVolume, 70) \
  X(PlayActorSound, 71) \
  X(SpawnDecal, 72) \
  X(CheckFont, 73) \
  X(DropItem, 74) \
  X(CheckFlag, 75) \
  X(SetLineActivation, 76) \
  X(GetLineActivation, 77) \
  X(GetActorPowerupTics, 78) \
  X(ChangeActorAngle, 79) \
  X(ChangeActorPitch, 80) \
  X(GetArmorInfo, 81) \
  X(DropInventory, 82) \
  X(PickActor, 83) \
  X(IsPointerEqual, 84) \
  X(CanRaiseActor, 85) \
  X(SetActorTeleFog, 86) \
  X(SwapActorTeleFog, 87) \
  X(SetActorRoll, 88) \
  X(ChangeActorRoll, 89) \
  X(GetActorRoll, 90) \
  X(QuakeEx, 91) \
  X(Warp, 92) \
  X(GetMaxInventory, 93) \
  X(SetSectorDamage, 94) \
  X(SetSectorTerrain, 95) \
  X(SpawnParticle, 96) \
  X(SetMusicVolume, 97) \
  X(CheckProximity, 98) \
  X(CheckActorState, 99)
// clang-format on

enum class BuiltIn : uint16_t {
#define COMRAD_ACS_FUNCTION(name, number) k##name = number,
  COMRAD_ACS_FUNCTIONS(COMRAD_ACS_FUNCTION)
#undef COMRAD_ACS_FUNCTION
};
constexpr int kBuiltInCount = 100;  ///< numbers below it

/// The name of a function of CallFunc; empty for numbers of none.
constexpr std::string_view built_in_name(int number) {
  switch (number) {
#define COMRAD_ACS_FUNCTION(name, value) \
  case value:                            \
    return #name;
    COMRAD_ACS_FUNCTIONS(COMRAD_ACS_FUNCTION)
#undef COMRAD_ACS_FUNCTION
    default:
      return {};
  }
}

}  // namespace comrad::bytecode
