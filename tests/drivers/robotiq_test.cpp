// The Robotiq plugin against a simulated gripper on a pseudo-terminal. The line is served in real
// time; what is asserted are states and counts, never times.
#include <dlfcn.h>
#include <fcntl.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <chrono>
#include <cmath>
#include <filesystem>
#include <functional>
#include <string>
#include <thread>

#include "core/rt/allocation_count.hpp"
#include "drivers/driver.h"
#include "drivers/robotiq/operation.hpp"
#include "drivers/robotiq/simulated_gripper.hpp"

namespace wb::robotiq {
namespace {

constexpr double kOpen_m = 0.085;
constexpr double kResolution_m = kOpen_m / 255;
constexpr double kPatience_s = 60;  // reached only when a test fails
constexpr std::int64_t kLong_ns = 60'000'000'000, kShort_ns = 100'000'000;

bool wait_until(const std::function<bool()>& condition) {
  const auto end = std::chrono::steady_clock::now() + std::chrono::duration<double>(kPatience_s);
  while (!condition()) {
    if (std::chrono::steady_clock::now() > end) return false;
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
  }
  return true;
}

class RobotiqTest : public ::testing::Test {
 protected:
  void SetUp() override {
    port_ = std::filesystem::temp_directory_path() /
            ("wb_gripper_" + std::to_string(getpid()) + "_" +
             ::testing::UnitTest::GetInstance()->current_test_info()->name());
    gripper_.emplace(port_, Stroke{kOpen_m, 0, 255}, fingers_around(object_m_, kOpen_m));
    void* library = dlopen(WB_BUILD_DIR "/drivers/libwb_driver_robotiq.so", RTLD_NOW | RTLD_LOCAL);
    ASSERT_NE(library, nullptr) << dlerror();
    api_ = reinterpret_cast<wb_driver_entry_fn>(dlsym(library, WB_DRIVER_ENTRY))();
  }
  void TearDown() override {
    if (driver_ != nullptr) api_->destroy(driver_);
  }

  std::string config(const std::string& more = "") const {
    // An answer may be late on a loaded machine; only the tests about silence want it soon.
    return "{device: " + port_.string() +
           ", opening_max_m: 0.085, silence_max_ms: 5000, response_timeout_ms: 200" + more + "}";
  }
  void start(std::int64_t timeout_ns = kLong_ns, const std::string& text = "") {
    driver_ = api_->create((text.empty() ? config() : text).c_str(), "/", note, &log_);
    ASSERT_NE(driver_, nullptr) << log_;
    ASSERT_EQ(api_->configure(driver_), WB_OK) << log_;
    ASSERT_EQ(api_->activate(driver_, timeout_ns, nullptr), WB_OK);
  }
  wb_status write(double opening_m, double force_n = 60) {
    wb_commands c{};
    c.gripper = {opening_m, force_n};
    return api_->write(driver_, &c);
  }
  wb_readings read(wb_status expected = WB_OK) {
    wb_readings out{};
    EXPECT_EQ(api_->read(driver_, &out), expected);
    return out;
  }
  wb_status read_status() {
    wb_readings out{};
    return api_->read(driver_, &out);
  }
  // Writes until the fingers are there. A machine that lets nobody run for seconds makes silence an
  // error, rightly; it passes.
  bool reaches(double opening_m, double force_n = 60) {
    return wait_until([&] {
      EXPECT_EQ(write(opening_m, force_n), WB_OK);
      wb_readings r{};
      return api_->read(driver_, &r) == WB_OK && r.gripper.valid &&
             std::abs(r.gripper.opening - opening_m) < 2 * kResolution_m;
    });
  }
  bool grasps(double force_n = 60) {
    return wait_until([&] {
      EXPECT_EQ(write(0, force_n), WB_OK);
      wb_readings r{};
      return api_->read(driver_, &r) == WB_OK && r.gripper.force > 0;
    });
  }
  std::uint64_t counter(const std::string& name) {
    const auto* d =
        static_cast<const wb_diagnostics*>(api_->get_extension(driver_, WB_DIAGNOSTICS));
    std::vector<std::uint64_t> values(d->count);
    d->read(driver_, values.data());
    for (std::uint32_t i = 0; i < d->count; ++i) {
      if (name == d->names[i]) return values[i];
    }
    ADD_FAILURE() << "no counter " << name;
    return 0;
  }
  // Several answers later, that is: what the driver does by then, it does.
  void let_it_work() {
    const std::uint64_t then = gripper_->requests() + 10;
    ASSERT_TRUE(wait_until([&] { return gripper_->requests() >= then; }));
  }

  static void note(void* user, wb_log_level, const char* text) {
    *static_cast<std::string*>(user) += std::string(text) + "\n";
  }

  std::filesystem::path port_;
  std::atomic<double> object_m_{0};
  std::atomic<bool> may_pass_{false};
  std::optional<SimulatedGripper> gripper_;
  const wb_driver_api* api_ = nullptr;
  wb_driver* driver_ = nullptr;
  std::string log_;
};

TEST_F(RobotiqTest, ClosesAndOpensToTheCommandedOpening) {
  start();
  EXPECT_TRUE(reaches(0.02));
  EXPECT_EQ(gripper_->activations(), 1);
  EXPECT_TRUE(reaches(0.07));
  EXPECT_TRUE(reaches(0.0));
  EXPECT_EQ(gripper_->activations(), 1);
  EXPECT_EQ(read().gripper.force, 0);  // nothing in between
}

TEST_F(RobotiqTest, NothingMovesBeforeTheFirstWrite) {
  start();
  let_it_work();
  EXPECT_EQ(gripper_->activations(), 0);
  EXPECT_FALSE(gripper_->order().activate);
  EXPECT_FALSE(read().gripper.valid);  // where the fingers are is not known yet
}

TEST_F(RobotiqTest, ForceAndSpeedReachTheGripperInItsCounts) {
  start(kLong_ns, config(", speed_mps: 0.0851"));
  ASSERT_TRUE(reaches(0.04, 127.5));
  EXPECT_EQ(gripper_->order().force, 128);  // half way from 20 to 235 N
  EXPECT_EQ(gripper_->order().speed, 128);  // half way from 20 to 150 mm/s
  ASSERT_TRUE(reaches(0.05, 1000));
  EXPECT_EQ(gripper_->order().force, 255);
  ASSERT_TRUE(reaches(0.06, 0));
  EXPECT_EQ(gripper_->order().force, 0);
}

TEST_F(RobotiqTest, ObjectBetweenTheFingersShowsAsForceAndOpening) {
  object_m_ = 0.012;
  start();
  ASSERT_TRUE(grasps(60));
  EXPECT_NEAR(read().gripper.opening, 0.012, 2 * kResolution_m);
  EXPECT_NEAR(read().gripper.force, 60, 1);
  ASSERT_TRUE(reaches(0.08));
  EXPECT_EQ(read().gripper.force, 0);
}

TEST_F(RobotiqTest, HoldsItsObjectWhenCommandsCease) {
  object_m_ = 0.012;
  start();
  ASSERT_TRUE(grasps(60));
  // Only now a time-out that a loaded machine may fail to meet.
  ASSERT_EQ(api_->deactivate(driver_), WB_OK);
  ASSERT_EQ(api_->activate(driver_, kShort_ns, nullptr), WB_OK);
  write(0);
  ASSERT_TRUE(wait_until([&] {
    wb_readings r{};
    api_->read(driver_, &r);
    return r.timed_out != 0;
  }));
  let_it_work();
  EXPECT_EQ(gripper_->order().position, 255);
  EXPECT_TRUE(gripper_->order().go);
  EXPECT_NEAR(read().gripper.force, 60, 1);
  EXPECT_EQ(write(0.08), WB_TIMED_OUT);  // latched
  let_it_work();
  EXPECT_NEAR(read().gripper.opening, 0.012, 2 * kResolution_m);
}

TEST_F(RobotiqTest, FingersStopWhereTheyAreWhenTheyWereStillMoving) {
  // Fingers that wait on their way until this thread has had its time: no race with the stop.
  gripper_.reset();
  gripper_.emplace(port_, Stroke{kOpen_m, 0, 255},
                   [this, opening = kOpen_m](const FingerOrder& order, double dt_s) mutable {
                     const double travel = order.move ? order.speed_mps * dt_s : 0;
                     opening += std::clamp(order.opening_m - opening, -travel, travel);
                     if (!may_pass_) opening = std::max(opening, 0.04);
                     return Fingers{opening, false};
                   });
  start();
  ASSERT_TRUE(reaches(0.08));
  ASSERT_TRUE(wait_until([&] {
    write(0);
    wb_readings r{};
    return api_->read(driver_, &r) == WB_OK && r.gripper.valid && r.gripper.opening < 0.05;
  }));
  ASSERT_EQ(api_->stop(driver_), WB_OK);
  ASSERT_TRUE(wait_until([&] { return !gripper_->order().go; }));
  may_pass_ = true;
  let_it_work();
  const std::uint8_t there = gripper_->status().position;
  EXPECT_GT(there, 0);
  EXPECT_LT(there, 250);
  let_it_work();
  EXPECT_EQ(gripper_->status().position, there);
  EXPECT_EQ(read().timed_out, 1u);
  EXPECT_EQ(write(0), WB_TIMED_OUT);
}

TEST_F(RobotiqTest, DeactivatingAndActivatingAgainKeepsTheGrasp) {
  object_m_ = 0.012;
  start();
  ASSERT_TRUE(grasps());
  ASSERT_EQ(api_->deactivate(driver_), WB_OK);
  EXPECT_EQ(write(0.08), WB_BAD_STATE);
  let_it_work();
  ASSERT_EQ(api_->activate(driver_, kLong_ns, nullptr), WB_OK);
  let_it_work();
  EXPECT_EQ(gripper_->order().position, 255);
  EXPECT_EQ(read().timed_out, 0u);
  EXPECT_NEAR(read().gripper.opening, 0.012, 2 * kResolution_m);
  ASSERT_TRUE(reaches(0.08));
  EXPECT_EQ(gripper_->activations(), 1);
}

TEST_F(RobotiqTest, SpoiltAnswersAreCountedAndOverlooked) {
  start();
  ASSERT_TRUE(reaches(0.03));
  const std::uint64_t before = counter("checksum_errors"), late = counter("time_outs");
  gripper_->spoil_answers(5);
  ASSERT_TRUE(wait_until([&] { return counter("checksum_errors") >= before + 5; }));
  ASSERT_TRUE(reaches(0.06));
  // An answer that comes after its time-out may spoil the next one; nothing else may.
  EXPECT_LE(counter("checksum_errors"), before + 5 + (counter("time_outs") - late));
  EXPECT_GE(counter("exchanges"), before + 5);
}

TEST_F(RobotiqTest, SilenceIsAnErrorUntilItAnswersAgain) {
  object_m_ = 0.012;
  start(kLong_ns, "{device: " + port_.string() + ", opening_max_m: 0.085, silence_max_ms: 200}");
  ASSERT_TRUE(wait_until([&] {
    write(0);
    return gripper_->status().motion == Motion::kObjectClosing;
  }));
  gripper_->be_silent(true);
  ASSERT_TRUE(wait_until([&] { return read_status() == WB_ERROR; }));
  EXPECT_EQ(write(0), WB_OK);  // the port goes on taking commands, and does not wait
  ASSERT_TRUE(wait_until([&] { return counter("time_outs") > 0; }));
  gripper_->be_silent(false);
  ASSERT_TRUE(wait_until([&] { return read_status() == WB_OK; }));
  EXPECT_EQ(gripper_->activations(), 1);
  EXPECT_EQ(gripper_->status().motion, Motion::kObjectClosing);  // held all the time
}

TEST_F(RobotiqTest, PluggedInAgainItGoesOnWithoutLettingGo) {
  object_m_ = 0.012;
  start(kLong_ns, "{device: " + port_.string() + ", opening_max_m: 0.085, silence_max_ms: 200}");
  ASSERT_TRUE(wait_until([&] {
    write(0);
    return gripper_->status().motion == Motion::kObjectClosing;
  }));
  gripper_->unplug();
  ASSERT_TRUE(wait_until([&] { return read_status() == WB_ERROR; }));
  ASSERT_TRUE(wait_until([&] { return counter("port_losses") == 1; }));
  gripper_->plug_in();
  ASSERT_TRUE(wait_until([&] { return read_status() == WB_OK; }));
  EXPECT_EQ(gripper_->activations(), 1);
  EXPECT_EQ(gripper_->status().motion, Motion::kObjectClosing);
}

TEST_F(RobotiqTest, LostActivationIsAnErrorAndIsNotRenewedByItself) {
  start();
  ASSERT_TRUE(reaches(0.03));
  gripper_->power_cycle();
  ASSERT_TRUE(wait_until([&] {
    write(0.03);
    return read_status() == WB_ERROR;
  }));
  let_it_work();
  EXPECT_EQ(gripper_->activations(), 1);
  ASSERT_EQ(api_->deactivate(driver_), WB_OK);
  ASSERT_EQ(api_->activate(driver_, kLong_ns, nullptr), WB_OK);
  EXPECT_TRUE(reaches(0.05));
  EXPECT_EQ(gripper_->activations(), 2);
}

TEST_F(RobotiqTest, FaultOfTheGripperIsAnErrorUntilItIsActivatedAgain) {
  start();
  ASSERT_TRUE(reaches(0.03));
  gripper_->fault(kOvercurrent);
  ASSERT_TRUE(wait_until([&] {
    write(0.06);
    return read_status() == WB_ERROR;
  }));
  ASSERT_EQ(api_->deactivate(driver_), WB_OK);
  ASSERT_EQ(api_->activate(driver_, kLong_ns, nullptr), WB_OK);
  EXPECT_TRUE(reaches(0.06));
}

TEST_F(RobotiqTest, MissingPortAndSilentGripperAreNamedAtConfiguration) {
  driver_ = api_->create("{device: /dev/no_such_port, opening_max_m: 0.085}", "/", note, &log_);
  ASSERT_NE(driver_, nullptr);
  EXPECT_EQ(api_->configure(driver_), WB_ERROR);
  EXPECT_NE(log_.find("/dev/no_such_port, slave 9: the port cannot be opened"), std::string::npos)
      << log_;
  api_->destroy(driver_);
  gripper_->be_silent(true);
  driver_ = api_->create(("{device: " + port_.string() + ", opening_max_m: 0.085}").c_str(), "/",
                         note, &log_);
  EXPECT_EQ(api_->configure(driver_), WB_ERROR);
  EXPECT_NE(log_.find("no answer"), std::string::npos) << log_;
}

TEST_F(RobotiqTest, WrongConfigurationIsRefusedByName) {
  EXPECT_EQ(
      api_->create("{device: /dev/null, opening_max_m: 0.085, spede_mps: 0.1}", "/", note, &log_),
      nullptr);
  EXPECT_NE(log_.find("spede_mps"), std::string::npos) << log_;
}

TEST_F(RobotiqTest, CommandsThatAreNotFiniteAreRefused) {
  start();
  ASSERT_TRUE(reaches(0.03));
  EXPECT_EQ(write(std::nan("")), WB_ERROR);
  EXPECT_EQ(write(0.03, INFINITY), WB_ERROR);
  EXPECT_TRUE(reaches(0.05));
}

TEST_F(RobotiqTest, PortsDoNotAllocate) {
  if (!allocations_are_counted()) GTEST_SKIP() << "a sanitizer owns malloc";
  start();
  ASSERT_TRUE(reaches(0.03));
  wb_readings out{};
  wb_commands c{};
  c.gripper = {0.05, 60};
  const std::uint64_t before = thread_allocations();
  for (int i = 0; i < 1000; ++i) {
    api_->write(driver_, &c);
    api_->read(driver_, &out);
  }
  api_->stop(driver_);
  EXPECT_EQ(thread_allocations(), before);
}

// The frames that the manufacturer's manual prints, byte for byte.
TEST(SimulatedGripperTest, AnswersTheManualsFrames) {
  const auto port =
      std::filesystem::temp_directory_path() / ("wb_gripper_frames_" + std::to_string(getpid()));
  std::atomic<double> object{0};
  SimulatedGripper gripper(port, Stroke{kOpen_m, 0, 255}, fingers_around(object, kOpen_m));
  const int fd = open(port.c_str(), O_RDWR | O_NOCTTY);
  ASSERT_GE(fd, 0);
  const auto exchange = [&](std::vector<std::uint8_t> bytes, std::size_t length) {
    EXPECT_EQ(::write(fd, bytes.data(), bytes.size()), static_cast<ssize_t>(bytes.size()));
    std::vector<std::uint8_t> reply(length);
    for (std::size_t n = 0; n < length;) {
      const ssize_t m = ::read(fd, reply.data() + n, length - n);
      if (m <= 0) break;
      n += static_cast<std::size_t>(m);
    }
    return reply;
  };
  using Bytes = std::vector<std::uint8_t>;
  const Bytes written = {0x09, 0x10, 0x03, 0xE8, 0x00, 0x03, 0x01, 0x30};
  // Reset, activate, wait for the activation, close at full speed and force.
  EXPECT_EQ(exchange({0x09, 0x10, 0x03, 0xE8, 0x00, 0x03, 0x06, 0, 0, 0, 0, 0, 0, 0x73, 0x30}, 8),
            written);
  EXPECT_EQ(
      exchange({0x09, 0x10, 0x03, 0xE8, 0x00, 0x03, 0x06, 0x01, 0, 0, 0, 0, 0, 0x72, 0xE1}, 8),
      written);
  const Bytes read_one = {0x09, 0x03, 0x07, 0xD0, 0x00, 0x01, 0x85, 0xCF};
  ASSERT_TRUE(wait_until([&] { return gripper.status().activation == Activation::kDone; }));
  EXPECT_EQ(
      exchange({0x09, 0x10, 0x03, 0xE8, 0x00, 0x03, 0x06, 0x09, 0, 0, 0xFF, 0xFF, 0xFF, 0x42, 0x29},
               8),
      written);
  ASSERT_TRUE(wait_until([&] { return gripper.status().position == 255; }));
  EXPECT_EQ(exchange(read_one, 7), (Bytes{0x09, 0x03, 0x02, 0xF9, 0x00, 0x1B, 0xD5}));
  // The beginning of a long frame, broken off: after a silence the next one is understood.
  const Bytes broken = {0x09, 0x17, 0x07, 0xD0, 0x00, 0x03, 0x03, 0xE8, 0x00, 0x03, 0xFF};
  EXPECT_EQ(::write(fd, broken.data(), broken.size()), static_cast<ssize_t>(broken.size()));
  std::this_thread::sleep_for(std::chrono::milliseconds(500));
  EXPECT_EQ(exchange(read_one, 7), (Bytes{0x09, 0x03, 0x02, 0xF9, 0x00, 0x1B, 0xD5}));
  close(fd);
}

}  // namespace
}  // namespace wb::robotiq
