/* Counters of what a driver plugin has refused or lost, by name ("joint_measurements.stale"): the
 * extension "wb.diagnostics/1" of get_extension(). Any thread; counts only grow; names live as long
 * as the driver. */
#ifndef WB_DRIVER_DIAGNOSTICS_H
#define WB_DRIVER_DIAGNOSTICS_H
#include "drivers/driver.h"

#ifdef __cplusplus
extern "C" {
#endif

#define WB_DIAGNOSTICS "wb.diagnostics/1" /* wb_diagnostics */

typedef struct {
  uint32_t (*count)(const wb_driver*);
  wb_status (*counter)(const wb_driver*, uint32_t index, const char** name, uint64_t* value);
} wb_diagnostics;

#ifdef __cplusplus
}
#endif
#endif
