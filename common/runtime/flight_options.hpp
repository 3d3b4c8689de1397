// Options of the flight recorder: section [flight] of a scene.
#pragma once

#include "runtime/options.hpp"

namespace softhand {

struct FlightOptions {
  double seconds = 60;
  double snapshot_period = 10;
  std::int64_t megabytes = 96;
  std::int64_t inverted_elements = 500;
  double contact_force = 1000;
  double ledger_defect = 0;
};

inline void describe(OptionVisitor& v, FlightOptions& o) {
  v.number("seconds", o.seconds, "s", {0, 600},
           "The recorder keeps the inputs of this simulated time (docs/flight-recorder.md). 0: no recorder.");
  v.number("snapshot_period", o.snapshot_period, "s", {0.5, 60},
           "Simulated time between two snapshots. A recording begins at a snapshot.");
  v.integer("megabytes", o.megabytes, "MB", {1, 1024},
            "Memory of the recorder of one process. If it is too small for `seconds`, the recording is shorter.");
  v.integer("inverted_elements", o.inverted_elements, "1", {0, 1000000},
            "A file is written if more tetrahedra of the hand are inverted than this. 0: no limit.");
  v.number("contact_force", o.contact_force, "N", {0, 1e6},
           "A file is written if the contact force on one bone is larger than this. 0: no limit.");
  v.number("ledger_defect", o.ledger_defect, "1", {0, 1e6},
           "A file is written if the defect of the energy ledger is larger than this. The hand keeps a ledger only "
           "while somebody subscribes to its status. 0: no limit.");
}

}  // namespace softhand
