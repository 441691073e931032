/* Driver plugin ABI of Wholebody, plain C, version 1, frozen. A plugin is a shared object that
 * exports wb_driver_entry. The rule: what this header says of version 1 never changes, neither a
 * field nor a meaning; anything new is an extension (get_extension, a name with a number of its
 * own), and what cannot be one makes version 2, a header beside this one. The host refuses every
 * other number and names both.
 *
 * Threads: describe, configure, activate, deactivate, destroy: setup (may block, allocate, log).
 * read, write, stop, advance: ports, called by one thread (control): bounded, non-blocking, no
 * allocation; they may call the kernel and take time stamps. acquire_frame and release_frame: one
 * other thread. Time: int64 ns, the host's clock (monotonic or virtual). SI units. Frames, sign
 * conventions, wrench and depth: shared with core/types (readings.hpp, command.hpp,
 * depth_frame.hpp). The plugin stops its joints by itself when no write came for the time-out given
 * in activate. */
#ifndef WB_DRIVER_H
#define WB_DRIVER_H
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define WB_DRIVER_ABI 1u
#define WB_DRIVER_MAX_JOINTS 32

typedef struct wb_driver wb_driver; /* the plugin's instance */

typedef enum {
  WB_OK = 0,
  WB_ERROR = 1,
  WB_NOT_READY = 2,
  WB_NO_DATA = 3,
  WB_BAD_STATE = 4,
  WB_TIMED_OUT = 5
} wb_status;
typedef enum {
  WB_UNCONFIGURED = 0,
  WB_INACTIVE = 1,
  WB_ACTIVE = 2
} wb_state; /* inactive reads, active moves */
/* What a joint is asked to do. A joint supports those that its wb_joint_info::command_kinds names;
 * write refuses others. NONE: the time-out action at once. IMPEDANCE: effort = stiffness (position
 * - q) + damping (velocity - dq) + effort. POSITION: position, with velocity and effort as
 * feed-forward. VELOCITY: velocity. TORQUE: effort. Always clipped to the joint's limits. */
typedef enum {
  WB_CMD_NONE = 0,
  WB_CMD_IMPEDANCE = 1,
  WB_CMD_VELOCITY = 2,
  WB_CMD_POSITION = 3,
  WB_CMD_TORQUE = 4
} wb_command_kind;
/* What a joint is doing, whatever was asked of it. Only WB_JOINT_FOLLOWING moves by command. A
 * drive whose state the plugin cannot name is WB_JOINT_UNKNOWN, and unknown is not safe. */
typedef enum {
  WB_JOINT_UNKNOWN = 0,
  WB_JOINT_DISABLED = 1,  /* no power at the drive, or brake on */
  WB_JOINT_FOLLOWING = 2, /* follows commands */
  WB_JOINT_STOPPED = 3,   /* the time-out action or a stop holds it; latched until activate */
  WB_JOINT_FAULT = 4,     /* the drive reports an error: error_code */
  WB_JOINT_LOST = 5       /* nothing heard from the drive for longer than the plugin allows */
} wb_joint_status;
typedef enum { WB_TIMEOUT_HOLD = 0, WB_TIMEOUT_DAMPED = 1, WB_TIMEOUT_BRAKE = 2 } wb_timeout_action;
typedef enum { WB_LOG_DEBUG = 0, WB_LOG_INFO = 1, WB_LOG_WARN = 2, WB_LOG_ERROR = 3 } wb_log_level;

typedef struct {
  char name[32];
  double position_min, position_max; /* rad or m; equal: unlimited */
  double velocity_max, effort_max;
  uint32_t command_kinds; /* bit mask of 1 << wb_command_kind */
  uint32_t is_wheel;
} wb_joint_info;

typedef struct {
  char name[32]; /* the optical frame's link */
  uint32_t width, height;
  double fx, fy, cx, cy;             /* pixels */
  double range_min, range_max, rate; /* m, m, Hz */
  uint32_t has_colour;
} wb_camera_info;

typedef struct {
  char name[64];
  uint32_t joint_count; /* wheels included */
  wb_joint_info joints[WB_DRIVER_MAX_JOINTS];
  uint32_t camera_count;
  wb_camera_info cameras[8];
  uint32_t has_imu, has_wrench, has_gripper, has_emergency_stop;
  uint32_t can_step; /* advance() is supported: may run on a virtual clock */
} wb_description;

typedef struct {
  int64_t t_ns; /* of the newest sample */
  struct {
    double position, velocity, effort;
    int64_t age_ns;      /* of this joint's sample, at the time of read */
    double quality;      /* share of the samples due in the last second that came in time, 0 to 1 */
    uint32_t status;     /* wb_joint_status */
    uint32_t error_code; /* the drive's own, 0: none */
    uint32_t valid;      /* position, velocity and effort are this drive's and fresh enough */
  } joints[WB_DRIVER_MAX_JOINTS];
  struct {
    double gyro[3], acceleration[3];
    uint32_t valid;
  } imu;
  struct {
    double force[3], torque[3];
    uint32_t valid;
  } wrench;
  struct {
    double opening, force;
    uint32_t valid;
  } gripper;
  uint32_t emergency_stop;
  uint32_t timed_out; /* the plugin's own time-out has stopped the joints */
} wb_readings;

typedef struct {
  int64_t t_ns;
  struct {
    uint32_t kind;
    double position, velocity, effort, stiffness, damping;
  } joints[WB_DRIVER_MAX_JOINTS];
  struct {
    double opening, force;
  } gripper;
} wb_commands;

typedef struct {
  uint32_t camera;       /* index in the description */
  int64_t t_ns;          /* exposure */
  const float* depth;    /* width * height, z-depth [m], +inf where there is no return; or null */
  const uint8_t* colour; /* width * height * 3, or null */
  const float* points;   /* point_count * 3: x, y, z [m] in the camera's link; or null */
  uint32_t point_count;
  uint64_t token; /* for release_frame */
} wb_frame;

/* Extension "wb.diagnostics/1" (get_extension returns one of these): the plugin's counters, for
 * metrics. names: count texts that live as long as the plugin. read: any thread; fills count
 * values.
 */
typedef struct {
  uint32_t count;
  const char* const* names;
  void (*read)(const wb_driver*, uint64_t* values);
} wb_diagnostics;
#define WB_DIAGNOSTICS "wb.diagnostics/1"

typedef void (*wb_log)(void* user, wb_log_level level,
                       const char* text); /* never called from a port */

typedef struct {
  uint32_t abi;  /* WB_DRIVER_ABI */
  uint32_t size; /* sizeof(wb_driver_api) */
  /* Null with a log line on failure. config: text of the plugin's YAML section; folder: what its
   * file names are relative to. */
  wb_driver* (*create)(const char* config, const char* folder, wb_log log, void* log_user);
  void (*destroy)(wb_driver*);
  wb_status (*describe)(const wb_driver*, wb_description*);
  wb_status (*configure)(wb_driver*); /* unconfigured -> inactive */
  /* inactive -> active; nothing moves before the first write. actions: one for each joint of the
   * description. */
  wb_status (*activate)(wb_driver*, int64_t command_timeout_ns, const wb_timeout_action* actions);
  wb_status (*deactivate)(wb_driver*); /* active -> inactive, joints stopped */
  wb_status (*read)(wb_driver*, wb_readings*);
  wb_status (*write)(wb_driver*, const wb_commands*); /* WB_TIMED_OUT: latched until activate */
  wb_status (*stop)(wb_driver*); /* time-out action now, latched until activate */
  wb_status (*acquire_frame)(wb_driver*, wb_frame*); /* oldest frame not yet taken, or WB_NO_DATA */
  wb_status (*release_frame)(wb_driver*, uint64_t token);
  wb_status (*advance)(wb_driver*, int64_t t_ns); /* absolute; plugins with can_step */
  /* Interfaces beyond control, by name (e.g. "wb.sim.truth/1"); null if unknown. No controller asks
   * for them. */
  const void* (*get_extension)(wb_driver*, const char* name);
} wb_driver_api;

/* The one exported symbol. */
typedef const wb_driver_api* (*wb_driver_entry_fn)(void);
#define WB_DRIVER_ENTRY "wb_driver_entry"

#ifdef __cplusplus
}
#endif
#endif
