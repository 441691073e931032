/* An example driver plugin: one simulated motor with a gear, a brake and a torque servo, stepped on
 * the host's clock. A real plugin talks to its bus where this one calls turn(), sets can_step to 0
 * and takes its time stamps from CLOCK_MONOTONIC. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <wholebody/driver.h>

static const double kInertia = 0.1, kFriction = 0.5, kDamping = 5.0; /* kg m2, Nms/rad */
static const double kRange = 3.0, kVelocityMax = 3.0, kEffortMax = 10.0;
static const int64_t kStepNs = 500000;

struct wb_driver {
  char joint[32];
  wb_state state;
  int64_t now_ns, timeout_ns, last_write_ns;
  wb_timeout_action action;
  int commanded, stopped, timed_out; /* since activate: a write came; latched */
  double position, velocity, effort;
  wb_commands commands;
};

static wb_driver* create(const char* config, const char* folder, wb_log log, void* user) {
  char joint[32];
  int end = 0;
  (void)folder;
  /* Be strict: a key that you do not know is a mistake of whoever wrote it. */
  if (sscanf(config, " joint: %31[A-Za-z0-9_] %n", joint, &end) != 1 || config[end] != '\0') {
    log(user, WB_LOG_ERROR, "motor: the configuration is one line, 'joint: NAME'");
    return NULL;
  }
  wb_driver* d = calloc(1, sizeof *d);
  if (d) strcpy(d->joint, joint);
  return d;
}

static void destroy(wb_driver* d) { free(d); }

static wb_status describe(const wb_driver* d, wb_description* out) {
  memset(out, 0, sizeof *out);
  strcpy(out->name, "example motor");
  out->joint_count = 1;
  wb_joint_info* j = &out->joints[0];
  strcpy(j->name, d->joint);
  j->position_min = -kRange;
  j->position_max = kRange;
  j->velocity_max = kVelocityMax;
  j->effort_max = kEffortMax;
  j->command_kinds = 1u << WB_CMD_IMPEDANCE;
  out->can_step = 1;
  return WB_OK;
}

static wb_status configure(wb_driver* d) {
  if (d->state != WB_UNCONFIGURED) return WB_BAD_STATE;
  d->state = WB_INACTIVE;
  return WB_OK;
}

static wb_status activate(wb_driver* d, int64_t timeout_ns, const wb_timeout_action* actions) {
  if (d->state != WB_INACTIVE) return WB_BAD_STATE;
  d->timeout_ns = timeout_ns;
  d->action = actions[0];
  d->commanded = d->stopped = d->timed_out = 0; /* the brake stays on until the first write */
  d->state = WB_ACTIVE;
  return WB_OK;
}

static wb_status deactivate(wb_driver* d) {
  if (d->state != WB_ACTIVE) return WB_BAD_STATE;
  d->state = WB_INACTIVE;
  return WB_OK;
}

static int follows(const wb_driver* d) {
  return d->state == WB_ACTIVE && d->commanded && !d->stopped &&
         d->commands.joints[0].kind == WB_CMD_IMPEDANCE;
}

static double clip(double value, double most) { return fmin(fmax(value, -most), most); }

/* One step of the motor. */
static void turn(wb_driver* d) {
  const double dt = 1e-9 * (double)kStepNs;
  const int damped = d->stopped && d->action == WB_TIMEOUT_DAMPED && d->state == WB_ACTIVE;
  if (follows(d)) {
    const double position = clip(d->commands.joints[0].position, kRange);
    const double velocity = clip(d->commands.joints[0].velocity, kVelocityMax);
    d->effort = clip(d->commands.joints[0].stiffness * (position - d->position) +
                         d->commands.joints[0].damping * (velocity - d->velocity) +
                         d->commands.joints[0].effort,
                     kEffortMax);
  } else if (damped) {
    d->effort = -clip(kDamping * d->velocity, kEffortMax);
  } else { /* brake */
    d->effort = d->velocity = 0;
  }
  d->velocity += dt * (d->effort - kFriction * d->velocity) / kInertia;
  d->velocity = clip(d->velocity, kVelocityMax);
  d->position = clip(d->position + dt * d->velocity, kRange);
}

static wb_status advance(wb_driver* d, int64_t t_ns) {
  if (d->state == WB_UNCONFIGURED) return WB_BAD_STATE;
  while (d->now_ns + kStepNs <= t_ns) {
    d->now_ns += kStepNs;
    if (d->state == WB_ACTIVE && d->commanded && !d->stopped &&
        d->now_ns - d->last_write_ns > d->timeout_ns)
      d->stopped = d->timed_out = 1;
    turn(d);
  }
  return WB_OK;
}

static wb_status read_port(wb_driver* d, wb_readings* out) {
  if (d->state == WB_UNCONFIGURED) return WB_BAD_STATE;
  memset(out, 0, sizeof *out);
  out->t_ns = d->now_ns;
  out->joints[0].position = d->position;
  out->joints[0].velocity = d->velocity;
  out->joints[0].effort = d->effort;
  out->joints[0].age_ns = 0; /* measured right now; a bus reports when its frame arrived */
  out->joints[0].quality = 1;
  out->joints[0].valid = 1;
  out->joints[0].status = follows(d)   ? WB_JOINT_FOLLOWING
                          : d->stopped ? WB_JOINT_STOPPED
                                       : WB_JOINT_DISABLED;
  out->timed_out = (uint32_t)d->timed_out;
  return WB_OK;
}

static wb_status write_port(wb_driver* d, const wb_commands* commands) {
  if (d->state != WB_ACTIVE) return WB_BAD_STATE;
  if (d->stopped) return WB_TIMED_OUT;
  const double sum = commands->joints[0].position + commands->joints[0].velocity +
                     commands->joints[0].effort + commands->joints[0].stiffness +
                     commands->joints[0].damping;
  if (!isfinite(sum)) return WB_ERROR;
  if (commands->joints[0].kind != WB_CMD_IMPEDANCE && commands->joints[0].kind != WB_CMD_NONE)
    return WB_ERROR;
  d->commands = *commands;
  d->commanded = 1;
  d->last_write_ns = d->now_ns;
  return WB_OK;
}

static wb_status stop(wb_driver* d) {
  if (d->state != WB_ACTIVE) return WB_BAD_STATE;
  d->stopped = 1;
  return WB_OK;
}

static wb_status acquire_frame(wb_driver* d, wb_frame* out) {
  (void)d, (void)out;
  return WB_NO_DATA; /* no camera */
}
static wb_status release_frame(wb_driver* d, uint64_t token) {
  (void)d, (void)token;
  return WB_ERROR;
}
static const void* get_extension(wb_driver* d, const char* name) {
  (void)d, (void)name;
  return NULL;
}

__attribute__((visibility("default"))) const wb_driver_api* wb_driver_entry(void) {
  static const wb_driver_api api = {
      .abi = WB_DRIVER_ABI,
      .size = sizeof(wb_driver_api),
      .create = create,
      .destroy = destroy,
      .describe = describe,
      .configure = configure,
      .activate = activate,
      .deactivate = deactivate,
      .read = read_port,
      .write = write_port,
      .stop = stop,
      .acquire_frame = acquire_frame,
      .release_frame = release_frame,
      .advance = advance,
      .get_extension = get_extension,
  };
  return &api;
}
