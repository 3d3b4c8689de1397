#include "contact/contact_report.hpp"

#include <algorithm>
#include <limits>

#include "messages/convert.hpp"

namespace softhand {

Contact contact_row(const ContactPoints& points, const ContactAnchor& anchor, const AnchorOffset& o,
                    const Vector3& position, std::uint32_t object, const Vector3& velocity) {
  const ContactPoint& point = points[anchor.point];
  Contact contact;
  contact.node = static_cast<std::uint32_t>(points.main_node(anchor.point));
  contact.body = point.body % kBodyCount;
  contact.finger = static_cast<std::uint32_t>(finger_of(static_cast<Body>(contact.body)));
  contact.object = object;
  contact.flags = anchor.sliding ? 0u : kContactSticking;
  contact.point = to_wire(Vector3(position - o.offset));
  contact.normal = to_wire(o.normal);
  contact.force = to_wire(anchor.force);
  contact.penetration = std::max(0.0, -o.depth);
  contact.area = point.area;
  contact.slip_speed = anchor.slip_speed;
  contact.velocity = to_wire(velocity);
  return contact;
}

ContactReport::ContactReport(int objects)
    : objects_(static_cast<std::size_t>(objects)), finger_forces_(sums_.size() * objects_, 0.0) {}

void ContactReport::begin(Contacts& out) {
  sums_.fill({});
  std::fill(finger_forces_.begin(), finger_forces_.end(), 0.0);
  out.contacts.clear();
  out.dropped = 0;
}

void ContactReport::add(const Contact& contact, const Vector3& position, int place, Contacts& out) {
  if (!out.contacts.push_back(contact)) ++out.dropped;
  const Vector3 force = to_vector(contact.force), normal = to_vector(contact.normal);
  const double pressure = std::max(0.0, normal.dot(force));
  Sums& sum = sums_[contact.finger];
  sum.force += force;
  sum.centre += pressure * position;
  sum.normal += pressure * normal;
  sum.pressure += pressure;
  sum.slip += pressure * contact.slip_speed;
  sum.area += contact.area;
  ++sum.count;
  // Slightly more than zero, so that an object touched without pressure comes before an object that is not touched.
  finger_forces_[contact.finger * objects_ + static_cast<std::size_t>(place)] +=
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

int ContactReport::place_of(std::size_t finger) const {
  const auto first = finger_forces_.begin() + static_cast<std::ptrdiff_t>(finger * objects_);
  return static_cast<int>(std::max_element(first, first + static_cast<std::ptrdiff_t>(objects_)) - first);
}

}  // namespace softhand
