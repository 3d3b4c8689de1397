// The fixture of the tests of whole rigs. It sets the domain before anything opens it.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <set>
#include <string>

#include "integration/rig_harness.hpp"
#include "runtime/clock.hpp"
#include "support/own_domain.hpp"

namespace softhand::rig {

using namespace std::chrono_literals;

inline constexpr const char* kDemo = "config/rigs/demo.toml";
inline const std::set<std::string> kModules{"world", "hand", "tracking", "haptic", "tactile", "tracker"};
/// m, mean over the joints: enough for a hand that lags, presses or holds, but follows the tracked one.
inline constexpr double kFollows = 0.02;

inline double milliseconds_between(Nanoseconds from, Nanoseconds to) { return static_cast<double>(to - from) * 1e-6; }

class Rig : public ::testing::Test {
 protected:
  Rig() { testing::use_own_domain(); }

  static bool all_present(const RigListener& listener) {
    return std::all_of(kModules.begin(), kModules.end(),
                       [&](const std::string& m) { return listener.process_id(m) > 0; });
  }
  /// True if the hand follows tracker samples taken after `since`, in each of the last `count` steps.
  static bool follows(const RigListener& listener, Nanoseconds since, std::size_t count = 10) {
    if (listener.simulated.size() < count) return false;
    return std::all_of(listener.simulated.end() - static_cast<std::ptrdiff_t>(count), listener.simulated.end(),
                       [&](const RigListener::HandSample& s) {
                         return s.tracker_sample > since && s.follow_error >= 0 && s.follow_error < kFollows;
                       });
  }
  static void expect_all_finite(const RigListener& listener) {
    for (const auto& [topic, count] : listener.nonfinite) EXPECT_EQ(count, 0u) << topic;
    for (const char* topic : {"simulated_skeleton", "intermediate_skeleton", "bone_wrench", "contacts", "skin_traction",
                              "object_coupling", "objects", "device_state"}) {
      EXPECT_GT(listener.heard.count(topic) != 0 ? listener.heard.at(topic) : 0u, 0u) << topic;
    }
  }
};

}  // namespace softhand::rig
