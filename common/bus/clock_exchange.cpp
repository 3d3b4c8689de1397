#include "bus/clock_exchange.hpp"

#include <chrono>
#include <fastdds/dds/subscriber/SampleInfo.hpp>

#include "runtime/clock.hpp"

namespace softhand::bus::detail {

namespace dds = eprosima::fastdds::dds;

static constexpr std::chrono::milliseconds kBeaconPeriod{100};

ClockExchange::ClockExchange(HostClocks& clocks, std::uint64_t epoch, dds::DataWriter* writer)
    : clocks_(clocks), writer_(writer) {
  beacon_.stamp.epoch = epoch;
  beacon_.stamp.clock_id = clock_id();
  thread_ = std::thread([this] { run(); });
}

ClockExchange::~ClockExchange() {
  {
    const std::lock_guard lock(mutex_);
    stops_ = true;
  }
  wake_.notify_all();
  thread_.join();
}

void ClockExchange::on_data_available(dds::DataReader* reader) {
  dds::SampleInfo info;
  while (reader->take_next_sample(&received_, &info) == eprosima::fastrtps::types::ReturnCode_t::RETCODE_OK) {
    if (info.valid_data && received_.well_formed) clocks_.heard(received_.value, now(), wall_clock());
  }
}

void ClockExchange::run() {
  std::unique_lock lock(mutex_);
  while (!stops_) {
    const WallClock wall = wall_clock();
    beacon_.wall_offset = wall.offset;
    beacon_.wall_uncertainty = wall.uncertainty;
    clocks_.update(now(), beacon_.hosts);
    ++beacon_.stamp.sequence;
    beacon_.stamp.sample_time = beacon_.stamp.publish_time = now();
    writer_->write(&beacon_);
    wake_.wait_for(lock, kBeaconPeriod, [this] { return stops_; });
  }
}

}  // namespace softhand::bus::detail
