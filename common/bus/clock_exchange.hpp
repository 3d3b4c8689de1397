// Exchange of clock beacons with other hosts.
#pragma once

#include <condition_variable>
#include <cstdint>
#include <fastdds/dds/publisher/DataWriter.hpp>
#include <fastdds/dds/subscriber/DataReader.hpp>
#include <fastdds/dds/subscriber/DataReaderListener.hpp>
#include <mutex>
#include <thread>

#include "bus/bus.hpp"
#include "bus/host_clocks.hpp"

namespace softhand::bus::detail {

/// Exchanges beacons with other hosts, from which `clocks` computes offsets. The reader takes the time of arrival in
/// the thread that receives the beacon.
class ClockExchange final : public eprosima::fastdds::dds::DataReaderListener {
 public:
  ClockExchange(HostClocks& clocks, std::uint64_t epoch, eprosima::fastdds::dds::DataWriter* writer);
  ~ClockExchange() override;
  void on_data_available(eprosima::fastdds::dds::DataReader* reader) override;

 private:
  void run();

  HostClocks& clocks_;
  eprosima::fastdds::dds::DataWriter* writer_;
  ClockBeacon beacon_;
  Received<ClockBeacon> received_;  // of the receiving thread
  std::mutex mutex_;
  std::condition_variable wake_;
  bool stops_ = false;
  std::thread thread_;
};

}  // namespace softhand::bus::detail
