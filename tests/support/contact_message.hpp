// The message about the contacts of one contact set, as the hand publishes it.
#pragma once

#include <vector>

#include "contact/contact_report.hpp"
#include "energies/contact.hpp"

namespace softhand::testing {

/// `ids`: of the objects, by slot.
inline Contacts contact_message(const ContactSet& contacts, const State& state, const std::vector<std::uint32_t>& ids) {
  Contacts message;
  ContactReport report(static_cast<int>(ids.size()));
  report.begin(message);
  contacts.write(state, report, message);
  report.finish([&ids](int slot) { return ids[static_cast<std::size_t>(slot)]; }, message);
  return message;
}

}  // namespace softhand::testing
