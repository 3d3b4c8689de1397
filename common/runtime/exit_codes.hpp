// Exit codes with a meaning for whoever starts a process.
#pragma once

namespace softhand {

/// The process refuses its command line or its files. It would do so again, so it is not worth restarting.
inline constexpr int kExitConfiguration = 78;  // EX_CONFIG of sysexits.h

}  // namespace softhand
