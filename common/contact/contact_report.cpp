#include "contact/contact_report.hpp"

#include <algorithm>
#include <limits>

#include "messages/convert.hpp"

namespace softhand {

ContactReport::ContactReport(const ContactPoints& points, int slots, std::size_t most_anchors)
    : points_(&points),
      slots_(static_cast<std::size_t>(slots)),
      finger_forces_(sums_.size() * static_cast<std::size_t>(slots), 0.0) {
  sorted_.reserve(most_anchors);
}

void ContactReport::begin(Contacts& out) {
  sums_.fill({});
  std::fill(finger_forces_.begin(), finger_forces_.end(), 0.0);
  out.contacts.clear();
  out.dropped = 0;
}

void ContactReport::add(const ContactAnchor& anchor, const AnchorOffset& o, const Vector3& position,
                        std::uint32_t object, Contacts& out) {
  const ContactPoint& point = (*points_)[anchor.point];
  const Finger finger = finger_of(static_cast<Body>(point.body));
  Contact contact;
  contact.node = static_cast<std::uint32_t>(points_->main_node(anchor.point));
  contact.body = point.body;
  contact.finger = static_cast<std::uint32_t>(finger);
  contact.object = object;
  contact.flags = anchor.sliding ? 0u : kContactSticking;
  contact.point = to_wire(Vector3(position - o.offset));
  contact.normal = to_wire(o.normal);
  contact.force = to_wire(anchor.force);
  contact.penetration = std::max(0.0, -o.depth);
  contact.area = point.area;
  contact.slip_speed = anchor.slip_speed;
  if (!out.contacts.push_back(contact)) ++out.dropped;

  const double pressure = std::max(0.0, o.normal.dot(anchor.force));
  Sums& sum = sums_[static_cast<std::size_t>(finger)];
  sum.force += anchor.force;
  sum.centre += pressure * position;
  sum.normal += pressure * o.normal;
  sum.pressure += pressure;
  sum.slip += pressure * anchor.slip_speed;
  sum.area += point.area;
  ++sum.count;
  // Slightly more than zero, so that an object touched without pressure comes before an object that is not touched.
  finger_forces_[static_cast<std::size_t>(finger) * slots_ + static_cast<std::size_t>(anchor.slot)] +=
      pressure + std::numeric_limits<double>::min();
}

void ContactReport::write_finger(std::size_t finger, FingerContact& out) const {
  const Sums& sum = sums_[finger];
  out = {};
  if (sum.count == 0) return;
  out.force = to_wire(sum.force);
  out.area = sum.area;
  out.contact_count = sum.count;
  if (!(sum.pressure > 0)) return;
  out.centre = to_wire(Vector3(sum.centre / sum.pressure));
  out.normal = to_wire(Vector3(sum.normal / std::max(sum.normal.norm(), std::numeric_limits<double>::min())));
  out.slip_speed = sum.slip / sum.pressure;
}

int ContactReport::slot_of(std::size_t finger) const {
  const auto first = finger_forces_.begin() + static_cast<std::ptrdiff_t>(finger * slots_);
  return static_cast<int>(std::max_element(first, first + static_cast<std::ptrdiff_t>(slots_)) - first);
}

double ContactReport::quantile(double fraction) {
  if (sorted_.empty()) return 0;
  const auto nth = sorted_.begin() + static_cast<std::ptrdiff_t>(std::clamp(fraction, 0.0, 1.0) *
                                                                 static_cast<double>(sorted_.size() - 1));
  std::nth_element(sorted_.begin(), nth, sorted_.end());
  return *nth;
}

}  // namespace softhand
