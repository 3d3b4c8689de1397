#include "bus/dds_log.hpp"

#include <fastdds/dds/log/Log.hpp>
#include <fastdds/dds/log/StdoutErrConsumer.hpp>
#include <memory>
#include <utility>

namespace softhand::bus {

void log_to_stderr() {
  using namespace eprosima::fastdds::dds;
  auto consumer = std::make_unique<StdoutErrConsumer>();
  consumer->stderr_threshold(Log::Kind::Info);
  Log::ClearConsumers();
  Log::RegisterConsumer(std::move(consumer));
}

}  // namespace softhand::bus
