// One run of one scene with one setting, and what is kept of it.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "error_runtime/scenes.hpp"
#include "hand/hand_loop.hpp"

namespace softhand::error_runtime {

inline constexpr std::int64_t kTicksPerSecond = 1440;  ///< every rate of the knobs divides it

inline constexpr std::int64_t kSampleTicks = kTicksPerSecond / 90;

/// The hand's state at one time, in what all meshes share: the embedded skin, joints, objects, forces by finger.
struct Sample {
  std::int64_t tick = 0;   ///< since the motion's start
  Eigen::Matrix3Xd skin;   ///< vertices of the skin, m, world
  Eigen::VectorXd stress;  ///< norm of the first Piola stress in the element that carries each vertex of the skin, Pa;
                           ///< every 1/30 s, else empty
  std::array<Pose, kJointCount> joints;
  std::array<FingerContact, 6> fingers;
  std::vector<Pose> objects;        ///< in the order of the scene
  std::vector<std::uint8_t> touch;  ///< by node of this mesh: 0 free, 1 sticking, 2 sliding
};

struct Trajectory {
  std::vector<Sample> samples;       ///< every 1/90 s, or every step where steps are longer
  std::vector<double> step_ms;       ///< CPU time of the thread, a step each
  std::vector<double> penetrations;  ///< m, of every (touching node, step)
  double iterations = 0;             ///< mean a step
  double worst_residual = 0;         ///< N or N m, after the step
  int steps_not_converged = 0;       ///< whose solver ended by its iteration limit, not by a tolerance
  int steps_cut_off = 0;             ///< by the work budget
  int failed_steps = 0;              ///< that the solver gave up
  bool finite = true;
  int inverted = 0;  ///< elements, the most at any sample
  int inverted_at_end = 0;
  double energy_defect = 0;  ///< largest |residual| of the energy ledger over its scale
  double lag_ms = 0;         ///< of all joints behind their targets, least squares
};

/// The hand's loop of a scene with a world in which nothing moves but what the hand carries: an owned object's copy is
/// where its twin is.
class Player {
 public:
  /// `options` are the shipped defaults with the scene's and the setting's overrides.
  Player(const Scene& scene, const HandModel& hand, std::shared_ptr<const Motion> motion, const HandOptions& options);

  /// Holds the motion's start, without objects, until the hand has come to rest there.
  void settle();
  /// Goes on from where `other` stands in the scene; same mesh and objects.
  void take_state(const Player& other);
  /// One step of the scene; CPU time of the thread that the loop's step took, ms.
  double step();
  std::int64_t tick() const { return tick_; }
  const HandLoop& loop() const { return *loop_; }
  const HandOutput& output() const { return *output_; }
  const WorldObjects& world() const { return world_; }
  /// Whether the state now belongs into a trajectory's samples.
  bool at_sample() const { return tick_ % kSampleTicks == 0 || ticks_per_step_ > kSampleTicks; }
  /// A sum over all joints of (target - simulated) . target velocity, and of its square: their ratio over a run is the
  /// lag, s.
  double lag_numerator() const { return lag_numerator_; }
  double lag_denominator() const { return lag_denominator_; }

 private:
  double advance(double motion_time, bool world_there);

  const Scene& scene_;
  std::shared_ptr<const Motion> motion_;
  std::unique_ptr<HandLoop> loop_;
  const HandOutput* output_ = nullptr;
  Nanoseconds period_;
  std::int64_t ticks_per_step_;
  Nanoseconds now_ = 1'000'000'000;
  std::int64_t tick_ = 0;
  Skeleton skeleton_;
  WorldObjects world_;
  double lag_numerator_ = 0;
  double lag_denominator_ = 0;
};

/// The shipped defaults of the hand with the scene's and then these overrides. Throws ConfigError.
HandOptions options_of(const Scene& scene, const std::vector<std::string>& overrides);

/// Where vertex `v` of the skin is when the hand's nodes are at `nodes`.
Vector3 embedded(const HandModel& hand, std::size_t v, const Eigen::Matrix3Xd& nodes);

/// A sample of where the player stands.
Sample sample_of(const Player& player);

/// Plays the scene to its end from where the player stands. `before_step` may be empty.
Trajectory play(const Scene& scene, Player& player, const std::function<void(const Player&)>& before_step = {});

}  // namespace softhand::error_runtime
