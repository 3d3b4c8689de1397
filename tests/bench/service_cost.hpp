// Start and memory of the hand's service, as a process of its own.
#pragma once

#include <cmath>
#include <string>

namespace softhand::bench {

/// NaN: not measured, because the service did not start in time.
struct ServiceCost {
  double start_seconds = std::nan("");  ///< from exec to the first simulated skeleton
  double megabytes = std::nan("");      ///< resident, with the memory that the service locks
};
/// `scene`: path of its scene file. The services are those of this build.
ServiceCost measure_service(const std::string& scene);

}  // namespace softhand::bench
