#include "drivers/can/canopen/objects.hpp"

namespace wb::can {

const char* name_of(SdoAbort code) {
  switch (code) {
    case SdoAbort::kNone:
      return "none";
    case SdoAbort::kToggle:
      return "toggle bit not alternated";
    case SdoAbort::kTimeout:
      return "time-out";
    case SdoAbort::kCommand:
      return "unknown command specifier";
    case SdoAbort::kUnsupportedAccess:
      return "unsupported access";
    case SdoAbort::kWriteOnly:
      return "object is write only";
    case SdoAbort::kReadOnly:
      return "object is read only";
    case SdoAbort::kNoObject:
      return "no such object";
    case SdoAbort::kNotMappable:
      return "object cannot be mapped";
    case SdoAbort::kMappingTooLong:
      return "mapping longer than a PDO";
    case SdoAbort::kLength:
      return "wrong length";
    case SdoAbort::kNoSubindex:
      return "no such sub-index";
    case SdoAbort::kRange:
      return "value out of range";
    case SdoAbort::kGeneral:
      return "general error";
    case SdoAbort::kCannotStore:
      return "cannot be transferred to the application";
    case SdoAbort::kDeviceState:
      return "not in the present device state";
  }
  return "abort code not in CiA 301";
}

}  // namespace wb::can
