// Folders that only one user can read and write.
#pragma once

#include <string>

namespace softhand {

/// True if `path` is a folder of this user, and not a link.
bool is_own_folder(const std::string& path);

/// Makes a folder for this user alone (mode 0700), or takes one that exists. Anybody can make a folder in /tmp: throws
/// std::runtime_error if it belongs to another user, or is a link.
void make_own_folder(const std::string& path);

}  // namespace softhand
