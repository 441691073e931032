#include "daemon/replay.hpp"

#include <cstdio>
#include <deque>
#include <map>

#include "control/controller.hpp"
#include "core/types/hash.hpp"
#include "daemon/json.hpp"
#include "daemon/recording.hpp"
#include "planning/motion_planner.hpp"

namespace wb {
namespace {

// The last values of a recomputed arrow, by sequence number. Far more than any reader can lag
// behind.
template <class T>
class History {
 public:
  explicit History(std::size_t depth) : depth_(depth) {}
  T& add(T value) {
    values_.push_back(std::move(value));
    if (values_.size() > depth_) values_.pop_front();
    return values_.back();
  }
  const T* find(std::uint64_t seq) const {
    if (values_.empty() || seq < values_.front().seq || seq > values_.back().seq) return nullptr;
    return &values_[seq - values_.front().seq];
  }

 private:
  std::size_t depth_;
  std::deque<T> values_;
};

}  // namespace

ReplayResult replay(const std::filesystem::path& file) {
  const RecordingReader in(file);
  ReplayResult out;
  if (hash_folder(in.header.robot) != in.header.robot_hash) {
    out.problem = "the robot's files in " + in.header.robot + " have changed since";
    return out;
  }
  if (in.control.empty()) {
    out.problem = "the recording holds no control step";
    return out;
  }
  const auto model = std::make_shared<const RobotModel>(RobotConfig::load(in.header.robot));
  Controller controller(model);
  MotionPlanner planner(model, in.header.disabled_terms);
  Mapper mapper(model);

  History<RobotState> states(4096);
  History<Reference> references(1024);
  History<Policy> policies(64);
  History<DistanceField> fields(16);
  std::map<std::uint64_t, const ObjectPlan*> plans;
  for (const ObjectPlan& p : in.plans) plans[p.seq] = &p;
  StateHash hash;

  // Steps run as soon as what they were handed exists: any order that respects this gives the same
  // values.
  std::size_t c = 0, m = 0, a = 0;
  std::vector<DepthFrame> frames(MappingRecord::kMaxFrames);
  bool progress = true;
  while (progress) {
    progress = false;
    while (c < in.control.size()) {
      const ControlRecord& r = in.control[c];
      const Policy* policy = r.policy_seq ? policies.find(r.policy_seq) : nullptr;
      if (r.policy_seq && !policy) break;
      const auto plan = plans.find(r.plan_seq);
      if (r.plan_seq && plan == plans.end()) {
        out.problem = "plan " + std::to_string(r.plan_seq) + " is missing";
        return out;
      }
      ControlInput input{r.t_ns,
                         &r.readings,
                         policy,
                         r.plan_seq ? plan->second : nullptr,
                         r.requests.data(),
                         r.request_count};
      ControlOutput output;
      RobotState state;
      Reference reference;
      output.state = &state;
      output.reference = &reference;
      controller.step(input, output);
      state.seq = reference.seq = c + 1;
      hash.add(state);
      hash.add(output.command);
      if (hash.value() != r.state_hash && out.first_difference < 0) {
        out.first_difference = static_cast<std::int64_t>(c);
        out.first_difference_s = to_seconds(r.t_ns - in.control[0].t_ns);
      }
      states.add(state);
      references.add(reference);
      ++c;
      progress = true;
      // The planner must get its turn before the history has moved on.
      if (m < in.mpc.size() && in.mpc[m].state_seq <= c) break;
    }
    while (a < in.mapping.size()) {
      const MappingRecord& r = in.mapping[a];
      if (r.first_state_seq + r.state_count > c + 1) break;
      for (int i = 0; i < r.state_count; ++i)
        mapper.push_state(*states.find(r.first_state_seq + i));
      const DepthFrame* views[MappingRecord::kMaxFrames];
      for (int i = 0; i < r.frame_count; ++i) {
        if (!in.frame(r.frame_seqs[i], frames[i])) {
          out.problem = "frame " + std::to_string(r.frame_seqs[i]) + " is missing";
          return out;
        }
        views[i] = &frames[i];
      }
      DistanceField& field = fields.add(mapper.make_field());
      mapper.update({views, static_cast<std::size_t>(r.frame_count)}, field);
      field.seq = r.field_seq;
      ++a;
      progress = true;
    }
    while (m < in.mpc.size()) {
      const MpcRecord& r = in.mpc[m];
      if (r.state_seq > c) break;
      const DistanceField* field = r.field_seq ? fields.find(r.field_seq) : nullptr;
      if (r.field_seq && !field) break;
      const RobotState* state = states.find(r.state_seq);
      const Reference* reference = references.find(r.reference_seq);
      if (!state || !reference) {
        out.problem = "state " + std::to_string(r.state_seq) + " of an MPC step is missing";
        return out;
      }
      Policy& policy = policies.add(Policy{});
      SolveReport report;
      if (r.cold) planner.reset();
      (void)planner.step(*state, *reference, field, policy, report, &r.weights);
      policy.seq = r.policy_seq;
      ++m;
      progress = true;
    }
  }
  out.control_steps = c;
  out.mpc_steps = m;
  out.mapping_steps = a;
  out.state_hash = hash.value();
  if (c < in.control.size())
    out.problem =
        "control step " + std::to_string(c) + " was handed a policy that no record explains";
  out.equal = out.problem.empty() && out.first_difference < 0;
  return out;
}

int replay_main(const std::filesystem::path& file, bool json) {
  ReplayResult r;
  try {
    r = replay(file);
  } catch (const std::exception& e) {
    std::fprintf(stderr, "%s\n", e.what());
    return 2;
  }
  if (json) {
    char hash[24];
    std::snprintf(hash, sizeof hash, "%016lx", r.state_hash);
    Json out = Json::object();
    out.add("equal", r.equal)
        .add("control_steps", r.control_steps)
        .add("mpc_steps", r.mpc_steps)
        .add("mapping_steps", r.mapping_steps);
    out.add("first_difference", r.first_difference)
        .add("state_hash", hash)
        .add("problem", r.problem);
    std::printf("%s\n", out.str().c_str());
  } else {
    std::printf("%lu control, %lu MPC and %lu mapping steps, state hash %016lx: ", r.control_steps,
                r.mpc_steps, r.mapping_steps, r.state_hash);
    if (r.equal) {
      std::printf("equal to the recording\n");
    } else if (!r.problem.empty()) {
      std::printf("cannot be replayed: %s\n", r.problem.c_str());
    } else {
      std::printf("control step %ld, %.4f s after the start, is the first that differs\n",
                  r.first_difference, r.first_difference_s);
    }
  }
  if (!r.problem.empty()) return 2;
  return r.equal ? 0 : 1;
}

}  // namespace wb
