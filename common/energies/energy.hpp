// The interface of an energy term. The solver knows nothing else about a term.
#pragma once

#include <cstdint>
#include <limits>
#include <span>
#include <string_view>

#include "energies/energy_ledger.hpp"
#include "math/block_matrix.hpp"
#include "model/state.hpp"

namespace softhand {

class ByteReader;  // messages/plain_bytes.hpp
class ByteWriter;

/// The kind of a Hessian: exact (for derivative tests and for eq. 16 as written) or positive semi-definite (for the
/// solver).
enum class Curvature { exact, projected };

/// One term of the total potential, in joules. Derivatives are with respect to the increment of `apply_increment` at
/// zero. Nodes and body translations are in metres. Body rotations are spatial increments in radians, in world axes. A
/// term returns dU/dq, never a force.
///
/// Call order: `add_pattern` and `bind` once. Then per step: `begin_step`, any number of evaluations, `end_step`. Some
/// inputs stay constant during a step (contact planes, copies of other processes, friction bounds). A term fixes them
/// in `begin_step`, so `value` is one fixed function while the solver minimises. Nothing after `bind` allocates.
class Energy {
 public:
  virtual ~Energy() = default;
  virtual std::string_view name() const = 0;
  /// True for contact and friction: the Hessian jumps often, in few blocks. The solver renews this part of its factor
  /// alone, and its blocks are the unknowns of the solve of contact alone. A Hessian that jumps rarely or in many
  /// blocks (limits of joints and strain) is false: the solver renews everything once a step converges slowly.
  virtual bool has_kinks() const { return false; }
  /// True if the term depends only on positions and poses, not on values fixed in `begin_step`. Then its value at the
  /// end of one step equals its value at the start of the next.
  virtual bool is_potential() const { return false; }
  /// Within a step, the term depends on the poses of this many bodies, the first ones of the state. 0: only on node
  /// positions. The default is right for every term. A smaller number saves evaluations.
  virtual int needed_bodies() const { return std::numeric_limits<int>::max(); }
  /// Adds every block that `add_hessian` can ever touch to the pattern.
  virtual void add_pattern(BlockPattern& pattern) const = 0;
  /// Looks up the slots of those blocks and stores them.
  virtual void bind(const BlockMatrix& matrix) = 0;
  /// `state` is the state at the start of the step of `time_step` seconds (> 0).
  virtual void begin_step(const State& /*state*/, double /*time_step*/) {}
  virtual double value(const State& state) const = 0;
  /// Also returns the value, because value and gradient share most of their work.
  virtual double add_gradient(const State& state, VectorX& gradient) const = 0;
  virtual void add_hessian(const State& state, BlockMatrix& hessian, Curvature curvature) const = 0;
  /// Adds gradient and Hessian at one state and returns the value.
  virtual double add_all(const State& state, VectorX& gradient, BlockMatrix& hessian, Curvature curvature) const {
    add_hessian(state, hessian, curvature);
    return add_gradient(state, gradient);
  }
  /// Adds the elements around some nodes, as a function of the positions of these nodes alone. `nodes` ascend. Those of
  /// other parts have no elements. Three entries of `gradient` (N) belong to each node. `blocks`: the lower triangle of
  /// the projected Hessian (N/m) by rows of blocks, nine numbers per block, column-major, then one block of scratch.
  /// The default is right for a term without elements that stiffen much within a step.
  struct Around {
    double energy = 0;  ///< J
    double share = 0;   ///< of the term's elements that were evaluated
  };
  virtual Around add_around(std::span<const std::int32_t> /*nodes*/, const State& /*state*/, double* /*gradient*/,
                            double* /*blocks*/) const {
    return {};
  }
  /// Called after an iteration that moved the step's start to `state`. A term may change what it fixed in `begin_step`,
  /// because the iteration went another way than predicted. Example: it crossed a surface. Returns whether `value` has
  /// changed; the minimisation then continues with the new function.
  virtual bool revise(const State& /*state*/) { return false; }
  /// Called after the solver has finished the step: anchors slide, contacts begin and end, inertia writes the new
  /// velocities into `state`.
  virtual void end_step(State& /*state*/) {}
  /// Called instead of `end_step` after a step that failed. A step that begins and does not end has no effect on the
  /// next one, whether this is called or not. A term overrides this if callers read its memory between steps.
  virtual void cancel_step() {}
  /// What a step carries to the next one. A term with memory derives from `EnergyWithMemory` (memory.hpp), which
  /// overrides these. Reset: the caller moved the state, so the term forgets what the last steps left.
  /// Copy: from a term of the same kind and size.
  virtual void save_memory(ByteWriter& /*out*/) const {}
  virtual void load_memory(ByteReader& /*in*/) {}
  virtual void copy_memory(const Energy& /*other*/) {}
  virtual void reset_memory() {}
  /// The energy ledger's entry for the last step. The minimisation changed the value from `start` to `end`, and
  /// dU/dq . dq = `taken`. The default holds for a potential that depends only on the state. Its force at the step's
  /// end did the work (for a convex potential, backward Euler loses energy).
  virtual EnergyFlow flow(double start, double end, double taken) const {
    return {.stored = end, .integrator = start - end + taken};
  }
};

}  // namespace softhand
