// One run of one scene with one setting, and its recorded results.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "error_runtime/scenes.hpp"
#include "hand/hand_loop.hpp"

namespace softhand::error_runtime {

inline constexpr std::int64_t kTicksPerSecond = 1440;  ///< every rate of the study divides this value

inline constexpr std::int64_t kSampleTicks = kTicksPerSecond / 90;

/// State of hand and objects at one time, in quantities that all meshes share: embedded skin, joints, objects, nodes of
/// flexible objects, forces by finger.
struct Sample {
  std::int64_t tick = 0;  ///< ticks since the motion's start
  Eigen::Matrix3Xd skin;  ///< vertices of the skin, m, world
  /// Norm of the first Piola stress in the element that carries each skin vertex, Pa. Set every 1/30 s, else empty.
  Eigen::VectorXd stress;
  std::array<Pose, kJointCount> joints;
  std::array<FingerContact, 6> fingers;
  std::vector<Pose> objects;        ///< in the order of the scene
  Eigen::Matrix3Xd soft;            ///< nodes of all flexible objects, m, world
  std::vector<std::uint8_t> touch;  ///< state of each node of this mesh: 0 free, 1 sticking, 2 sliding
  std::size_t skin_contacts = 0;    ///< points that touch skin, or the surface of a flexible object
};

struct Trajectory {
  std::vector<Sample> samples;       ///< every 1/90 s, or every step if steps are longer
  std::vector<double> step_ms;       ///< CPU time of the thread, one value per step
  std::vector<double> penetrations;  ///< m, one value per (touching node, step)
  double iterations = 0;             ///< mean iterations per step
  double worst_residual = 0;         ///< N or N m, largest residual after a step
  int steps_not_converged = 0;       ///< steps whose status is not `converged`
  int steps_cut_off = 0;             ///< steps that the work budget ended
  int failed_steps = 0;              ///< steps that the solver gave up
  bool finite = true;
  int inverted = 0;  ///< inverted elements, most at any sample
  int inverted_at_end = 0;
  double energy_defect = 0;  ///< largest |residual| of the energy ledger over its scale
  double lag_ms = 0;         ///< lag of all joints behind their targets, least squares
};

/// The hand's loop of a scene. In its world only the hand moves objects: the copy of an owned object is always at its
/// twin.
class Player {
 public:
  /// `options` are the shipped defaults with the overrides of the scene and the setting.
  Player(const Scene& scene, const HandModel& hand, std::shared_ptr<const Motion> motion, const HandOptions& options);

  /// Holds the motion's start until the hand is at rest. Only flexible objects need what they lie on, so there are no
  /// objects if the scene has no flexible ones.
  void settle();
  /// Takes over the state of `other`, which must have the same mesh and objects.
  void take_state(const Player& other);
  /// Takes one step of the scene. Returns the CPU time of the loop's step, ms.
  double step();
  std::int64_t tick() const { return tick_; }
  const HandLoop& loop() const { return *loop_; }
  const HandOutput& output() const { return *output_; }
  const WorldObjects& world() const { return world_; }
  /// True if the present state belongs to the samples of a trajectory.
  bool at_sample() const { return tick_ % kSampleTicks == 0 || ticks_per_step_ > kSampleTicks; }
  /// Sums over all joints of (target - simulated) . target velocity, and of the squared target velocity. Their ratio
  /// over a run is the lag, s.
  double lag_numerator() const { return lag_numerator_; }
  double lag_denominator() const { return lag_denominator_; }

 private:
  double advance(double motion_time, bool has_begun);

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

/// The shipped defaults of the hand with the overrides of the scene, then these overrides. Throws ConfigError.
HandOptions options_of(const Scene& scene, const std::vector<std::string>& overrides);

/// Position of skin vertex `v` if the hand's nodes are at `nodes`.
Vector3 embedded(const HandModel& hand, std::size_t v, const Eigen::Matrix3Xd& nodes);

/// A sample of the player's present state.
Sample sample_of(const Player& player);

/// Plays the scene to its end from the player's present state. `before_step` may be empty.
Trajectory play(const Scene& scene, Player& player, const std::function<void(const Player&)>& before_step = {});

}  // namespace softhand::error_runtime
