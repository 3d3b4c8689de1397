// bus_publisher DOMAIN STRENGTH: a tracker that a test kills. The skeleton's `source` holds its strength.
#include <cstdlib>
#include <thread>

#include "bus/bus.hpp"

int main(int argc, char** argv) {
  using namespace softhand;
  if (argc != 3) return 2;
  const bus::Participant participant("bus_publisher", std::atoi(argv[1]));
  bus::Writer tracked(participant, bus::topics::tracked_skeleton, std::atoi(argv[2]));
  Skeleton skeleton;
  skeleton.source = static_cast<std::uint32_t>(std::atoi(argv[2]));
  for (;;) {
    ++skeleton.stamp.sequence;
    tracked.write(skeleton);
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
}
