// What is published of the contacts: one row per contact, the sums per finger, and the penetration.
#pragma once

#include <cstdint>
#include <vector>

#include "contact/anchor_law.hpp"
#include "contact/contact_point.hpp"
#include "messages/messages.hpp"

namespace softhand {

/// Collects the contacts of one hand into a message. Allocates only at construction.
class ContactReport {
 public:
  ContactReport(const ContactPoints& points, int slots, std::size_t most_anchors);

  /// Starts a message. Does not touch its key and stamp.
  void begin(Contacts& out);
  /// Adds a contact. `position`: of the point, world. `object`: its id.
  void add(const ContactAnchor& anchor, const AnchorOffset& offset, const Vector3& position, std::uint32_t object,
           Contacts& out);
  /// Writes the sums per finger. `object_of(slot)` returns the id of the object in a slot.
  template <typename ObjectOf>
  void finish(ObjectOf&& object_of, Contacts& out) {
    for (std::size_t f = 0; f < sums_.size(); ++f) {
      write_finger(f, out.fingers[f]);
      if (sums_[f].count > 0) out.fingers[f].object = object_of(slot_of(f));
    }
  }

  /// Quantile of penetrations: call `begin_quantile`, `add_depth` for each contact, then `quantile`.
  void begin_quantile() { sorted_.clear(); }
  void add_depth(double depth) { sorted_.push_back(depth < 0 ? -depth : 0.0); }
  /// `fraction`: 0 to 1; 1: the largest. 0 without contacts. m.
  double quantile(double fraction);

 private:
  struct Sums {
    Vector3 force = Vector3::Zero(), centre = Vector3::Zero(), normal = Vector3::Zero();
    double pressure = 0, slip = 0, area = 0;
    std::uint32_t count = 0;
  };
  void write_finger(std::size_t finger, FingerContact& out) const;
  /// The slot of the object on which the finger presses most.
  int slot_of(std::size_t finger) const;

  const ContactPoints* points_;
  std::size_t slots_;
  std::array<Sums, 6> sums_;
  std::vector<double> finger_forces_;  // by (finger, slot)
  std::vector<double> sorted_;
};

}  // namespace softhand
