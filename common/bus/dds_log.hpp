// Where the messages of DDS itself go.
#pragma once

namespace softhand::bus {

/// Sends the messages of DDS in this process to stderr. By default they go to stdout, into the data of a program that
/// prints some. Call it before the first participant. Do not call it in a library: its host may have other wishes.
void log_to_stderr();

}  // namespace softhand::bus
