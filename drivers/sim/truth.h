/* What the simulator knows beyond the driver ABI, for oracles, benches, demos and tests: plain C
 * tables that get_extension() hands out. Called by the thread that calls advance(), never by a
 * controller. Frame S: the simulated world, floor at z = 0. SI units. X_AB maps coordinates in B to
 * coordinates in A. Names are zero-terminated; pointers to names live as long as the driver. */
#ifndef WB_SIM_TRUTH_H
#define WB_SIM_TRUTH_H
#include "drivers/driver.h"

#ifdef __cplusplus
extern "C" {
#endif

#define WB_SIM_TRUTH "wb.sim.truth/1" /* wb_sim_truth */
#define WB_SIM_VIEW "wb.sim.view/1"   /* wb_sim_view */
#define WB_SIM_FAULT "wb.sim.fault/1" /* wb_sim_fault */

typedef struct {
  double p[3];
  double q[4]; /* x y z w */
} wb_sim_pose;

typedef struct {
  wb_sim_pose X_SM; /* centre and axes */
  double half_extent[3];
} wb_sim_box;

typedef struct {
  char name[32];
  uint32_t is_revolute;
  double value, velocity, range; /* m or rad; range: the joint's upper limit, the lower is 0 */
  wb_sim_pose X_SG; /* handle: origin at the bar's centre, x along the bar, z into the front */
  double handle_radius, handle_length;
  double axis_origin[3], axis[3]; /* in S; positive values open along or about the axis */
  wb_sim_box carcass;             /* what stands still of the unit */
  wb_sim_box moving;              /* the part at its present value, handle included */
} wb_sim_object;

typedef struct {
  int64_t t_ns;           /* of the first touch, on the host's clock */
  const char* robot_geom; /* collision name of the URDF */
  const char* other_geom; /* solid of the scene, "floor", or another of the robot's */
  const char* object;     /* the object that other_geom moves with, or its unit, or "" */
} wb_sim_contact;

typedef struct {
  int64_t (*time_ns)(const wb_driver*); /* the plant's, on the host's clock */
  wb_sim_pose (*base_pose)(const wb_driver*);
  wb_sim_pose (*spawn_pose)(const wb_driver*); /* of the base at start, on the floor: X_SW of an
                                                  odometry frame that begins there */
  uint32_t (*object_count)(const wb_driver*);
  wb_status (*object)(const wb_driver*, uint32_t index, wb_sim_object*);
  /* Distinct pairs of geoms that have touched since the start, one of them the robot's; left out:
   * finger on handle, wheel or castor on floor. Grows only. */
  uint32_t (*contact_count)(const wb_driver*);
  wb_status (*contact)(const wb_driver*, uint32_t index, wb_sim_contact*);
  /* Smallest distance from the robot to any solid of the scene except the floor and the target's
   * unit (carcass and this part; other parts in the same carcass do count). target may be null. NaN
   * for an unknown name. About 0.13 ms. */
  double (*clearance)(wb_driver*, const char* target);
  wb_status (*link_pose)(const wb_driver*, const char* link,
                         wb_sim_pose* X_SL); /* any URDF link, cameras too */
  wb_status (*hand_in_handle)(const wb_driver*, uint32_t index,
                              wb_sim_pose* X_GE); /* its change since the grasp is slip */
  uint64_t (*frames_dropped)(const wb_driver*);   /* exposures without a free slot, and frames
                                                     overwritten before anyone took them */
} wb_sim_truth;

typedef struct {
  /* A picture of width * height * 3 bytes (RGB), with shadows. X_SC (optical frame) may be null:
   * the scene's view camera. width_rad: the horizontal field of view, 0: the scene's. Allocates; at
   * most 1920 x 1200. About 0.1 s at 1280 x 960. */
  wb_status (*render)(wb_driver*, uint32_t width, uint32_t height, const wb_sim_pose* X_SC,
                      double width_rad, uint8_t* rgb);
} wb_sim_view;

typedef struct {
  /* The plant goes on, but read and write return WB_ERROR. */
  wb_status (*stop_answering)(wb_driver*, uint32_t on);
  /* A hung bus: readings stay what they were, their age grows, and writes are lost (the time-out
   * runs). */
  wb_status (*freeze)(wb_driver*, uint32_t on);
  wb_status (*emergency_stop)(wb_driver*, uint32_t pressed); /* the input that read reports */
  wb_status (*set_object)(wb_driver*, uint32_t index, double value); /* puts a part, at rest */
  wb_status (*push)(wb_driver*, const char* link, const double force[3],
                    const double torque[3]); /* in S, until changed */
} wb_sim_fault;

#ifdef __cplusplus
}
#endif
#endif
