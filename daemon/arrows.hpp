// Every arrow between loops, in one place (DESIGN.md, "The arrows"). Nothing else crosses threads.
#pragma once
#include "core/rt/latest.hpp"
#include "core/rt/queue.hpp"
#include "core/types/depth_frame.hpp"
#include "core/types/distance_field.hpp"
#include "core/types/object_plan.hpp"
#include "core/types/policy.hpp"
#include "core/types/reference.hpp"
#include "core/types/request.hpp"
#include "core/types/robot_state.hpp"
#include "daemon/records.hpp"
#include "daemon/service/service_snapshot.hpp"

namespace wb {

struct Arrows {
  explicit Arrows(const DistanceField& field_prototype, const DepthFrame& frame_prototype)
      : field(field_prototype), frames(frame_prototype), frame_records(frame_prototype) {}

  Latest<RobotState> state;                  // control -> MPC
  Latest<Reference> reference;               // control -> MPC
  Queue<RobotState, 512> states_to_mapping;  // control -> mapping: 1.28 s of history
  Queue<RobotState, 512> states_to_perception;
  Latest<Policy, 2> policy;                          // MPC -> control (0), service (1)
  Latest<DistanceField, 2> field;                    // mapping -> MPC (0), service (1)
  Latest<MpcRecord> mpc;                             // MPC -> service
  Latest<Reference> planned;                         // MPC -> service: solved for, with the route
  Latest<ObjectPlan> plan;                           // perception -> control
  Queue<DepthFrame, 16> frames;                      // driver ports -> mapping
  Queue<Request, kMaxRequests> requests_to_control;  // service ->
  Queue<Request, kMaxRequests> requests_to_perception;
  Queue<Request, kMaxRequests> requests_to_mpc;
  Queue<RequestStatus, 256> statuses;  // control -> service
  Queue<RequestStatus, 16> mpc_statuses;
  Latest<ServiceSnapshot> snapshot;  // control -> service

  // What each step was handed, for the recorder.
  Queue<ControlRecord, 1024> control_records;
  Queue<MpcRecord, 128> mpc_records;
  Queue<MappingRecord, 64> mapping_records;
  Queue<ObjectPlan, 64> plan_records;
  Queue<DepthFrame, 32> frame_records;
};

}  // namespace wb
