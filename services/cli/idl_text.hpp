// The IDL of the wire, built into the program, so that a recording explains itself.
#pragma once

#include <string>

namespace softhand {

/// The IDL that declares DDS type `softhand::v1::Name`, with all that it includes in place; empty when there is none.
std::string idl_of(const std::string& type);

}  // namespace softhand
