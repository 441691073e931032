// Numbers of CiA 301 and CiA 402 that master and simulated drive share: COB identifiers, NMT, SDO
// abort codes, object indices. Any world. Sources: CiA 301 (communication), CiA 402 (drives);
// 0x6007, 0x6065 and 0x1029 from memory of these, see docs/how-to/can.md.
#pragma once
#include <cstdint>

namespace wb::can {

namespace cob {
inline constexpr std::uint32_t kNmt = 0x000, kSync = 0x080;
inline constexpr std::uint32_t kEmergency = 0x080;  // + node
inline constexpr std::uint32_t kTpdo1 = 0x180, kRpdo1 = 0x200, kTpdo2 = 0x280;
inline constexpr std::uint32_t kSdoAnswer = 0x580, kSdoRequest = 0x600;  // + node
inline constexpr std::uint32_t kHeartbeat = 0x700;                       // + node
inline constexpr std::uint32_t kInvalid = 0x80000000;                    // bit 31 of a PDO's COB-ID
}  // namespace cob

namespace nmt {
inline constexpr std::uint8_t kBootUp = 0x00, kStopped = 0x04, kOperational = 0x05,
                              kPreOperational = 0x7F;
inline constexpr std::uint8_t kStart = 0x01, kStop = 0x02, kEnterPreOperational = 0x80,
                              kResetNode = 0x81, kResetCommunication = 0x82;
}  // namespace nmt

namespace object {
inline constexpr std::uint16_t kDeviceType = 0x1000, kErrorRegister = 0x1001, kDeviceName = 0x1008,
                               kConsumerHeartbeat = 0x1016, kProducerHeartbeat = 0x1017,
                               kIdentity = 0x1018, kErrorBehaviour = 0x1029, kRpdo1 = 0x1400,
                               kRpdo1Map = 0x1600, kTpdo1 = 0x1800, kTpdo1Map = 0x1A00,
                               kTpdo2 = 0x1801, kTpdo2Map = 0x1A01;
inline constexpr std::uint16_t kAbortConnection = 0x6007, kErrorCode = 0x603F,
                               kControlword = 0x6040, kStatusword = 0x6041,
                               kQuickStopOption = 0x605A, kDisableOption = 0x605C,
                               kFaultReactionOption = 0x605E, kMode = 0x6060, kModeDisplay = 0x6061,
                               kPositionActual = 0x6064, kFollowingWindow = 0x6065,
                               kVelocityActual = 0x606C, kTargetTorque = 0x6071,
                               kTorqueActual = 0x6077, kTargetPosition = 0x607A,
                               kProfileDeceleration = 0x6084, kQuickStopDeceleration = 0x6085,
                               kInterpolationPeriod = 0x60C2, kTargetVelocity = 0x60FF,
                               kSupportedModes = 0x6502;
}  // namespace object

enum class SdoAbort : std::uint32_t {
  kNone = 0,
  kToggle = 0x05030000,
  kTimeout = 0x05040000,
  kCommand = 0x05040001,
  kUnsupportedAccess = 0x06010000,
  kWriteOnly = 0x06010001,
  kReadOnly = 0x06010002,
  kNoObject = 0x06020000,
  kNotMappable = 0x06040041,
  kMappingTooLong = 0x06040042,
  kLength = 0x06070010,
  kNoSubindex = 0x06090011,
  kRange = 0x06090030,
  kGeneral = 0x08000000,
  kCannotStore = 0x08000020,
  kDeviceState = 0x08000022,
};
const char* name_of(SdoAbort code);

}  // namespace wb::can
