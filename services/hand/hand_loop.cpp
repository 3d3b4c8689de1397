#include "hand/hand_loop.hpp"

#include <algorithm>
#include <stdexcept>
#include <string>

#include "device/answer.hpp"
#include "messages/age.hpp"
#include "messages/convert.hpp"

namespace softhand {
namespace {

// m. A hand of two whose pose is unknown is here, far from everything, and outside of a floor without an end.
constexpr double kParkedHeight = 100;

std::vector<HandModel> models_of(const std::vector<KeyedHand>& hands) {
  std::vector<HandModel> models;
  for (const KeyedHand& hand : hands) models.push_back(hand.model);
  if (hands.size() == 2 && (hands[0].key == hands[1].key || hands[0].key.user != hands[1].key.user))
    throw std::invalid_argument("two hands of one process, expected a left and a right hand of one user");
  return models;
}

}  // namespace

HandLoop::HandLoop(const HandModel& hand, const HandOptions& options, HandKey key, const ObjectSpring& object_spring,
                   std::vector<SoftObject> soft_objects)
    : HandLoop({{hand, key}}, options, object_spring, std::move(soft_objects)) {}

HandLoop::HandLoop(const std::vector<KeyedHand>& hands, const HandOptions& options, const ObjectSpring& object_spring,
                   std::vector<SoftObject> soft_objects)
    : options_(options),
      symmetric_(object_spring.linear_stiffness > 0),
      time_step_(1.0 / options.rate_hz),
      simulation_(std::make_unique<HandSimulation>(models_of(hands), options.simulation,
                                                   static_cast<int>(options.mirrored_objects),
                                                   static_cast<int>(options.static_objects), object_spring,
                                                   static_cast<int>(options.object_joints), std::move(soft_objects))),
      mirror_(*simulation_, options_, hands.front().key, symmetric_),
      soft_mirror_(*simulation_, options_, symmetric_) {
  for (const KeyedHand& hand : hands)
    hands_.push_back(std::make_unique<PlayedHand>(*simulation_, hand_count(), options_, hand.key));
  if (const SoftObjects* soft = simulation_->soft())
    output().soft_objects.resize(static_cast<std::size_t>(soft->count()));
  for (SoftObjectState& each : output().soft_objects) each.owner = key();
  park_unknown();
}

HandLoop::~HandLoop() = default;

// A hand alone makes no step before its pose is known.
void HandLoop::park_unknown() {
  for (int hand = 0; hand_count() > 1 && hand < hand_count(); ++hand) {
    if (!hands_[static_cast<std::size_t>(hand)]->is_known())
      simulation_->reposition({Vector3(hand, kParkedHeight, 0), Quaternion::Identity()}, hand);
  }
}

bool HandLoop::plays() const {
  return std::any_of(hands_.begin(), hands_.end(), [](const auto& hand) { return hand->is_known(); });
}

bool HandLoop::settles() const {
  return std::any_of(hands_.begin(), hands_.end(), [](const auto& hand) { return hand->settles(); });
}

void HandLoop::take_state(const HandLoop& other) {
  simulation_->take_state(*other.simulation_);
  for (std::size_t h = 0; h < hands_.size(); ++h) hands_[h]->take_state(*other.hands_[h]);
  mirror_.take_state(other.mirror_);
  soft_mirror_.take_state(other.soft_mirror_);
  reset_time_ = other.reset_time_;
  counters_ = other.counters_;
}

void HandLoop::reset(Nanoseconds time) {
  reset_time_ = time;
  for (const auto& hand : hands_) hand->reset(time);
  simulation_->clear_targets();
  mirror_.release_all();
  soft_mirror_.release_all();
  for (int i = 0; i < static_cast<int>(output().soft_objects.size()); ++i) simulation_->restart_soft_object(i);
  park_unknown();
}

void HandLoop::take_world(Nanoseconds now, const WorldObjects& world) {
  if (age_of(world.stamp.sample_time, now)) {
    mirror_.take_world(world);
  } else {
    ++counters_.refused_future;
  }
}

HandOutput& HandLoop::step(Nanoseconds now, const HandInput& input, const RequestedOutputs& requested) {
  for (const auto& hand : hands_) {
    if (input.head != nullptr && options_.direct) hand->take_head(now, *input.head);
  }
  if (input.skeleton != nullptr) hands_.front()->take_skeleton(now, *input.skeleton);
  if (input.second_skeleton != nullptr && hand_count() > 1) hands_[1]->take_skeleton(now, *input.second_skeleton);
  if (input.world != nullptr && input.world->stamp.sample_time > reset_time_) take_world(now, *input.world);
  for (const auto& hand : hands_) hand->set_targets(now);
  if (!plays()) {
    for (const auto& hand : hands_) hand->output().valid = false;
    output().report = {};
    return output();
  }
  for (const SoftObjectState& copy : input.soft_objects)
    if (copy.stamp.sample_time > reset_time_ && !soft_mirror_.take(now, copy)) ++counters_.refused_soft;
  soft_mirror_.begin_step(now, mirror_.knows_world());
  mirror_.begin_step(now, settles(), input.other_hands);
  simulation_->pass_through(settles());
  simulation_->enable_ledger(requested.ledger);
  if (input.work_budget > 0 && options_.simulation.solver.work_budget > 0)
    simulation_->set_work_budget(input.work_budget);
  StepReport& report = output().report;
  report = simulation_->step(time_step_);
  if (!report.state_changed) ++counters_.failed_steps;
  if (report.status == StepStatus::budget_spent) ++counters_.budget_steps;
  if (report.chord) ++counters_.chord_steps;
  soft_mirror_.end_step();
  for (const auto& hand : hands_) hand->end_step(now, time_step_, requested);
  write_outputs(now, requested);
  return output();
}

double HandLoop::input_age_ms(Nanoseconds now) const {
  double oldest = -1;
  for (const auto& hand : hands_) oldest = std::max(oldest, hand->input_age_ms(now));
  return oldest;
}

// Those of the process.
void HandLoop::write_outputs(Nanoseconds now, const RequestedOutputs& requested) {
  HandOutput& out = output();
  // The first hand's input is not known yet, if only the second hand plays.
  if (!out.valid) {
    ++out.simulated.stamp.sequence;
    out.coupling.stamp = {};
    out.coupling.stamp.sequence = out.simulated.stamp.sequence;
    out.coupling.stamp.sample_time = now;
  }
  ObjectCoupling& coupling = out.coupling;
  coupling.mode = symmetric_ ? 1 : 0;
  coupling.step_period = time_step_;
  mirror_.write_twins(coupling);
  if (!requested.soft_objects) return;
  for (std::size_t i = 0; i < out.soft_objects.size(); ++i) {
    out.soft_objects[i].stamp = coupling.stamp;
    out.soft_objects[i].owned = soft_mirror_.owns(static_cast<int>(i)) ? 1 : 0;
    simulation_->soft()->write_state(static_cast<int>(i), simulation_->state(), out.soft_objects[i]);
  }
}

HandCounters HandLoop::counters() const {
  HandCounters result = counters_;
  for (const auto& hand : hands_) {
    const PlayedHand::Counters& of = hand->counters();
    result.refused_nonfinite += of.refused_nonfinite;
    result.refused_future += of.refused_future;
    result.refused_order += of.refused_order;
    result.repositioned += of.repositioned;
    result.stale_steps += of.stale_steps;
  }
  result.refused_nonfinite += mirror_.counters().refused_nonfinite;
  result.objects_without_slot = mirror_.counters().without_slot;
  return result;
}

MessageReply HandLoop::answer(const Message& message, const std::string& module) {
  if (!is_addressed(message, module)) return reply_to(message, module, kReplyIgnored, "not for this module");
  if (get_text(message.key) == "reposition") {
    for (const auto& hand : hands_) hand->ask_reposition();
    return reply_to(message, module, kReplyApplied, "the hand goes to its target at once");
  }
  if (get_text(message.key) == "object.reset") return restart_soft_objects(message, module);
  return reply_to(message, module, kReplyIgnored, "unknown key; known: reposition, object.reset");
}

MessageReply HandLoop::restart_soft_objects(const Message& message, const std::string& module) {
  const std::string_view name = get_text(message.value);
  int restarted = 0;
  for (int i = 0; i < static_cast<int>(output().soft_objects.size()); ++i) {
    if (name != "*" && name != simulation_->soft()->object(i).name) continue;
    simulation_->restart_soft_object(i);
    soft_mirror_.release(i);
    ++restarted;
  }
  // The world has the other objects.
  if (restarted == 0) return reply_to(message, module, kReplyIgnored, "no such flexible object");
  return reply_to(message, module, kReplyApplied, "back at its start");
}

void HandLoop::fill_status(LoopStatus& status, Nanoseconds now) const {
  const StepReport& report = this->report();
  status.input_age_ms = input_age_ms(now);
  status.residual = report.residual;
  status.iterations = static_cast<std::uint32_t>(report.iterations);
  status.solver_status = static_cast<std::uint32_t>(report.status);
  status.contact_count = static_cast<std::uint32_t>(simulation_->contact_count() + simulation_->skin_contact_count());
  status.inverted_elements = static_cast<std::uint32_t>(simulation_->inverted_elements());
  status.penetration = simulation_->deepest_penetration();
  status.coupling_stretch = simulation_->largest_coupling_stretch();
  // Both hands have terms of the same names.
  simulation_->for_each_stored([&status](std::string_view name, double joules) {
    for (NamedValue& known : status.energies) {
      if (get_text(known.name) != name) continue;
      known.value += joules;
      return;
    }
    add_named(status.energies, name, joules);
  });
  if (simulation_->ledger().started()) {
    simulation_->ledger().for_each_row(
        [&status](std::string_view name, double joules) { add_named(status.ledger, name, joules); });
  }
  const HandCounters all = counters();
  std::uint64_t refused_nonfinite = all.refused_nonfinite, refused_order = all.refused_order, dropped_regions = 0;
  for (const auto& hand : hands_) {
    refused_nonfinite += hand->tracked_counters().refused_nonfinite;
    refused_order += hand->tracked_counters().refused_order;
    dropped_regions += hand->dropped_regions();
  }
  add_counter(status, "refused_nonfinite", static_cast<double>(refused_nonfinite));
  add_counter(status, "refused_order", static_cast<double>(refused_order));
  add_counter(status, "refused_future", static_cast<double>(all.refused_future));
  add_counter(status, "repositioned", static_cast<double>(all.repositioned));
  add_counter(status, "stale_steps", static_cast<double>(all.stale_steps));
  add_counter(status, "failed_steps", static_cast<double>(counters_.failed_steps));
  add_counter(status, "budget_steps", static_cast<double>(counters_.budget_steps));
  const WorkCounters work = simulation_->work();
  add_counter(status, "tissue_elements", static_cast<double>(work.tissue_elements));
  add_counter(status, "relaxing_elements", static_cast<double>(work.relaxing_elements));
  add_counter(status, "soft_elements", static_cast<double>(work.soft_elements));
  if (simulation_->soft() != nullptr) {
    add_counter(status, "passed_objects", simulation_->soft()->passing());
    add_counter(status, "refused_soft", static_cast<double>(counters_.refused_soft));
  }
  add_counter(status, "contact_queries", static_cast<double>(work.contact_queries));
  add_counter(status, "factorised_steps", static_cast<double>(work.factorised_steps));
  add_counter(status, "chord_steps", static_cast<double>(counters_.chord_steps));
  add_counter(status, "objects_without_slot", static_cast<double>(mirror_.counters().without_slot));
  add_counter(status, "untangled_nodes", static_cast<double>(simulation_->untangled_nodes()));
  add_counter(status, "dropped_contacts", static_cast<double>(work.dropped_contacts));
  add_counter(status, "dropped_regions", static_cast<double>(dropped_regions));
}

HandDescription HandLoop::description(int of) const {
  const HandModel& hand = simulation_->hand(of);
  HandDescription out;
  out.hand = key(of);
  out.node_count = static_cast<std::uint32_t>(hand.node_count());
  for (const SkinVertex& vertex : hand.skin_vertices) {
    const auto& nodes = hand.tetrahedra[static_cast<std::size_t>(vertex.tetrahedron)];
    std::array<std::uint32_t, 4> carriers{};
    for (std::size_t k = 0; k < 4; ++k) carriers[k] = static_cast<std::uint32_t>(nodes[k]);
    out.vertex_nodes.push_back(carriers);
    out.vertex_weights.push_back(vertex.weights);
  }
  for (const auto& triangle : hand.skin_triangles) {
    out.triangles.push_back({static_cast<std::uint32_t>(triangle[0]), static_cast<std::uint32_t>(triangle[1]),
                             static_cast<std::uint32_t>(triangle[2])});
  }
  return out;
}

std::vector<SoftObjectDescription> HandLoop::soft_object_descriptions() const {
  std::vector<SoftObjectDescription> all(output().soft_objects.size());
  for (std::size_t i = 0; i < all.size(); ++i) {
    const SoftObjects& soft = *simulation_->soft();
    const int k = static_cast<int>(i);
    const SoftObject& object = soft.object(k);
    SoftObjectDescription& out = all[i];
    out.object = SoftObjects::id(k);
    out.owner = key();
    set_text(out.name, object.name);
    set_text(out.file.name, object.file_name);
    set_text(out.file.sha256, object.file_sha256);
    out.file.position = to_wire(object.pose.position);
    out.file.orientation = to_wire(object.pose.orientation);
    out.node_count = static_cast<std::uint32_t>(soft.node_count(k));
    out.mass = soft.mass(k);
  }
  return all;
}

void HandLoop::save(ByteWriter& out) const {
  mirror_.save(out);
  out.write(soft_mirror_);
  out.write(reset_time_);
  out.write(counters_);
  for (const auto& hand : hands_) hand->save(out);
  simulation_->save(out);
}

void HandLoop::load(ByteReader& in) {
  mirror_.load(in);
  in.read(soft_mirror_);
  in.read(reset_time_);
  in.read(counters_);
  for (const auto& hand : hands_) hand->load(in);
  simulation_->load(in);
}

}  // namespace softhand
