// What is published of the contacts: one row per contact, and the sums per finger.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "contact/anchor_law.hpp"
#include "contact/contact_point.hpp"
#include "messages/messages.hpp"

namespace softhand {

/// The row of an anchor of the hand's skin. `position`: of the contact point, world. `object`: its id. `velocity`: of
/// the object at the anchor, m/s, world.
Contact contact_row(const ContactPoints& points, const ContactAnchor& anchor, const AnchorOffset& offset,
                    const Vector3& position, std::uint32_t object, const Vector3& velocity);

/// Collects the contacts of one hand into a message. Allocates only at construction.
class ContactReport {
 public:
  /// `objects`: how many different objects the hand can touch.
  explicit ContactReport(int objects);

  /// Starts a message. Does not touch its key and stamp.
  void begin(Contacts& out);
  /// Adds a contact. `position`: of the skin, world. `place`: of the object, 0 to `objects` - 1.
  void add(const Contact& contact, const Vector3& position, int place, Contacts& out);
  /// Writes the sums per finger. `object_at(place)` returns the id of an object.
  template <typename ObjectAt>
  void finish(ObjectAt&& object_at, Contacts& out) const {
    for (std::size_t f = 0; f < sums_.size(); ++f) {
      write_finger(f, out.fingers[f]);
      if (sums_[f].count > 0) out.fingers[f].object = object_at(place_of(f));
    }
  }

 private:
  struct Sums {
    Vector3 force = Vector3::Zero(), centre = Vector3::Zero(), normal = Vector3::Zero();
    double pressure = 0, slip = 0, area = 0;
    std::uint32_t count = 0;
  };
  void write_finger(std::size_t finger, FingerContact& out) const;
  /// The place of the object on which the finger presses most.
  int place_of(std::size_t finger) const;

  std::size_t objects_;
  std::array<Sums, 6> sums_;
  std::vector<double> finger_forces_;  // by (finger, place)
};

}  // namespace softhand
