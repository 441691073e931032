#include <algorithm>
#include <cmath>
#include <map>

#include "drivers/check/checks.hpp"

namespace wb::check {
namespace {

void check_joints(const Session& s) {
  for (std::uint32_t j = 0; j < s.joints(); ++j) {
    const auto& r = s.readings().joints[j];
    const std::string joint = "joint " + s.joint(j);
    if (r.status > WB_JOINT_LOST) fail(joint, " has status ", r.status, ", which is none");
    if (!(r.quality >= 0 && r.quality <= 1))
      fail(joint, " has quality ", r.quality, ", allowed 0 to 1");
    if (r.valid > 1) fail(joint, " has valid ", r.valid, ", allowed 0 or 1");
    if (r.valid && !std::isfinite(r.position + r.velocity + r.effort))
      fail(joint, " is valid and reads ", r.position, ", ", r.velocity, ", ", r.effort);
    if (r.valid && r.age_ns > kNanosPerSecond)
      fail(joint, " is valid with an age of ", to_seconds(r.age_ns), " s");
  }
}

std::string read_inactive(const Options& options) {
  Session s(options);
  const TimeNs begin = s.now();
  s.start();
  for (int i = 0; i < 20; ++i) {
    s.tick();
    s.must_read();
    for (std::uint32_t j = 0; j < s.joints(); ++j) {
      if (!s.readings().joints[j].valid) fail("joint ", s.joint(j), " is no longer valid");
      if (s.readings().joints[j].status == WB_JOINT_FOLLOWING)
        fail("joint ", s.joint(j), " has status FOLLOWING while inactive");
    }
  }
  return "all joints valid within " +
         text_of(std::max(0.0, to_seconds(s.now() - begin) - 20 / options.rate_hz)) + " s";
}

std::string stamps(const Options& options) {
  Session s(options);
  s.start();
  s.activate();
  TimeNs last_t = s.readings().t_ns;
  std::vector<TimeNs> last_age(s.joints());
  TimeNs last_after = 0, oldest = 0;
  int fresh = 0;
  for (int i = 0; i < 400; ++i) {
    s.must_write(s.hold());
    s.tick();
    const TimeNs before = s.now();
    s.must_read();
    const TimeNs after = s.now(), t = s.readings().t_ns;
    if (t < last_t) fail("t_ns went back by ", to_seconds(last_t - t), " s");
    if (t > after) fail("t_ns is ", to_seconds(t - after), " s in the future");
    fresh += t > last_t;
    for (std::uint32_t j = 0; j < s.joints(); ++j) {
      const auto& r = s.readings().joints[j];
      if (!r.valid) continue;
      const std::string joint = "joint " + s.joint(j);
      if (r.age_ns < 0) fail(joint, " has the age ", to_seconds(r.age_ns), " s");
      // t_ns is the newest sample of all, so no joint's can be younger.
      if (r.age_ns < before - t - s.slack_ns())
        fail(joint, " has the age ", 1e3 * to_seconds(r.age_ns),
             " ms, but the newest sample of all is ", 1e3 * to_seconds(before - t), " ms old");
      if (i > 0 && t == last_t && r.age_ns < last_age[j] + (before - last_after) - s.slack_ns())
        fail(joint, " did not age, although no sample is newer than before");
      last_age[j] = r.age_ns;
      oldest = std::max(oldest, r.age_ns);
    }
    last_t = t;
    last_after = after;
  }
  if (s.joints() && fresh == 0) fail("t_ns never moved in 400 periods");
  return "oldest sample " + text_of(1e3 * to_seconds(oldest)) + " ms, new ones in " +
         std::to_string(fresh) + " of 400 reads";
}

std::string status(const Options& options) {
  Session s(options);
  s.start();
  check_joints(s);
  s.activate();
  const TimeNs begin = s.now();
  int following = 0;
  while (s.now() - begin < from_seconds(1.0)) {
    s.must_write(s.hold());
    s.tick();
    s.must_read();
    check_joints(s);
    following = 0;
    for (std::uint32_t j = 0; j < s.joints(); ++j) {
      const std::uint32_t st = s.readings().joints[j].status;
      if (st == WB_JOINT_UNKNOWN || st == WB_JOINT_FAULT || st == WB_JOINT_LOST)
        fail("joint ", s.joint(j), " has status ", joint_status_text(st), " (error code ",
             s.readings().joints[j].error_code, ") while it is commanded");
      following += st == WB_JOINT_FOLLOWING;
    }
    if (s.readings().timed_out) fail("timed_out is set although every period brought a write");
  }
  for (std::uint32_t j = 0; j < s.joints(); ++j) {
    if (s.readings().joints[j].status != WB_JOINT_FOLLOWING)
      fail("joint ", s.joint(j), " has status ", joint_status_text(s.readings().joints[j].status),
           " after 1 s of commands");
  }
  double quality = 1;
  for (std::uint32_t j = 0; j < s.joints(); ++j)
    quality = std::min(quality, s.readings().joints[j].quality);
  return std::to_string(following) + " joints follow, least quality " + text_of(quality);
}

std::string frames(const Options& options) {
  Session s(options);
  s.start();
  const wb_description& d = s.description();
  wb_frame f{};
  if (d.camera_count == 0) {
    if (const wb_status got = s.api().acquire_frame(s.get(), &f); got != WB_NO_DATA)
      fail("acquire_frame without cameras returned ", got, ", not WB_NO_DATA");
    return "no cameras";
  }
  double slowest = 1e9;
  for (std::uint32_t c = 0; c < d.camera_count; ++c) slowest = std::min(slowest, d.cameras[c].rate);
  std::map<std::uint32_t, TimeNs> newest;
  std::map<std::uint32_t, int> count;
  const auto take = [&] {
    const wb_status got = s.api().acquire_frame(s.get(), &f);
    if (got == WB_NO_DATA) return false;
    if (got != WB_OK) fail("acquire_frame returned ", got);
    if (f.camera >= d.camera_count)
      fail("a frame is of camera ", f.camera, ", there are ", d.camera_count);
    const wb_camera_info& c = d.cameras[f.camera];
    const std::string camera = std::string("camera ") + c.name;
    if (!f.depth && !f.points) fail(camera, " gave a frame without depth and points");
    if (newest.contains(f.camera) && f.t_ns <= newest[f.camera])
      fail(camera, " gave a frame that is not newer than the one before");
    if (f.t_ns > s.now()) fail(camera, " gave a frame from the future");
    newest[f.camera] = f.t_ns;
    ++count[f.camera];
    for (std::size_t i = 0; f.depth && i < std::size_t{c.width} * c.height; ++i) {
      if (!(f.depth[i] >= 0)) fail(camera, " gave the depth ", double{f.depth[i]});
    }
    unsigned sum = 0;  // every byte of what is promised can be read
    for (std::size_t i = 0; f.colour && i < std::size_t{3} * c.width * c.height; ++i)
      sum += f.colour[i];
    for (std::size_t i = 0; f.points && i < std::size_t{3} * f.point_count; ++i)
      sum += std::isfinite(f.points[i]);
    if (c.has_colour && !f.colour) fail(camera, " has colour and gave a frame without");
    return sum + 1 != 0;
  };
  const auto release = [&](std::uint64_t token) { return s.api().release_frame(s.get(), token); };

  for (const TimeNs end = s.now() + from_seconds(1.0 + 4.0 / slowest); s.now() < end;) {
    s.tick();
    s.must_read();
    while (take()) {
      if (const wb_status got = release(f.token); got != WB_OK)
        fail("release_frame returned ", got);
      if (release(f.token) == WB_OK) fail("release_frame accepted the same token twice");
    }
  }
  for (std::uint32_t c = 0; c < d.camera_count; ++c) {
    if (count[c] < 2)
      fail("camera ", d.cameras[c].name, " gave ", count[c], " frames in ", 1.0 + 4.0 / slowest,
           " s, its rate is ", d.cameras[c].rate, " Hz");
  }
  // A reader that keeps its frames uses the ring up; it must not stop read, and goes on afterwards.
  std::vector<std::uint64_t> kept;
  for (const TimeNs end = s.now() + from_seconds(1.0 + 4.0 / slowest); s.now() < end;) {
    s.tick();
    s.must_read();
    while (take()) kept.push_back(f.token);
    if (kept.size() > 4096) fail("more than 4096 frames are out at once: no ring");
  }
  for (const std::uint64_t token : kept) {
    if (const wb_status got = release(token); got != WB_OK)
      fail("release_frame returned ", got, " for one of ", kept.size(), " frames that were kept");
  }
  const int before = count[0];
  for (const TimeNs end = s.now() + from_seconds(1.0 + 4.0 / slowest);
       s.now() < end && count[0] == before;) {
    s.tick();
    s.must_read();
    while (take()) release(f.token);
  }
  if (count[0] == before) fail("no frame came any more after all had been kept and released");
  return std::to_string(kept.size()) + " frames were out at once";
}

}  // namespace

std::vector<Check> reading_checks() {
  return {
      {"read_inactive", "Every joint is measured while inactive, and none claims to follow.",
       read_inactive},
      {"stamps", "Stamps never go back or into the future, and ages are those of the samples.",
       stamps},
      {"status", "Commanded joints follow; status, quality and values are valid throughout.",
       status},
      {"frames", "Frames come in order from a ring, with their pixels; a token is released once.",
       frames},
  };
}

}  // namespace wb::check
