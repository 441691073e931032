/* The fake driver plugin of the tests: it does what its script says and notes what it was told.
 * Its configuration: {name: a, joints: [..], wheels: [..], kinds: [impedance, ...], effort_max: 10,
 * sensors: [imu, wrench, gripper, emergency_stop], counters: [..], camera: {name, width, height}},
 * all but name optional. The script is its extension "wb.fake/<name>". */
#ifndef WB_TESTS_FAKE_DRIVER_H
#define WB_TESTS_FAKE_DRIVER_H
#include "drivers/driver.h"

typedef struct {
  /* what it does */
  wb_readings readings;            /* joints: valid, following, position 0.1 times index */
  wb_status read, write, activate; /* the ports' results, WB_OK at first */
  uint64_t counters[4];            /* of wb.diagnostics/1 */
  float depth[16];                 /* of its camera, if `frames` are waiting */
  uint32_t frames, frames_without_depth;
  /* what it was told */
  wb_state state;
  wb_commands commands; /* newest */
  uint32_t writes, activations, deactivations, released;
  int64_t timeout_ns;
  wb_timeout_action actions[WB_DRIVER_MAX_JOINTS];
} wb_fake_script;
#endif
