// The IDL files as strings in the program, so that a recording contains the description of its own messages.
#pragma once

#include <string>

namespace softhand {

/// Returns the IDL file that declares DDS type `softhand::v1::Name`, with its includes expanded in place. Returns an
/// empty string for an unknown type.
std::string idl_of(const std::string& type);

}  // namespace softhand
