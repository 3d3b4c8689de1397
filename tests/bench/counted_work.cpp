// Work that callgrind counts. The program makes one callgrind dump per row and prints one line that describes the row.
// Its argument selects the work:
// - steps: Steps of the shipped hand of 400 nodes in the method's fast mode.
// - slots: The same beside near objects.
// - hands: The same beside a far hand.
// - queries: Queries of the closest point on a convex hull.
// - flight: A step of the hand of 1,450 nodes, and what the flight recorder does in a step.
#include <valgrind/callgrind.h>

#include <cmath>
#include <cstdio>
#include <memory>
#include <random>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "bench/pressing.hpp"
#include "flight/hand_flight.hpp"
#include "geometry/shape.hpp"

namespace {

// Few steps, because valgrind needs a second for a step: it computes fused multiply-adds one by one.
constexpr int kSettlingSteps = 20;

softhand::HandOptions fast_mode() {
  softhand::HandOptions options;
  options.simulation.solver.max_iterations = 1;
  options.simulation.solver.measure_result = false;
  return options;
}

void count_steps() {
  struct Row {
    int touched, untouched;
    double clearance;  // m
    std::unique_ptr<softhand::bench::Pressing> hand{};
  };
  std::vector<Row> rows;
  rows.push_back({1, 0, 0});
  rows.push_back({2, 0, 0});
  rows.push_back({3, 0, 0});
  rows.push_back({4, 0, 0});
  rows.push_back({5, 0, 0});
  rows.push_back({5, 95, 0.02});
  rows.push_back({5, 95, 0.5});
  // All hands settle before counting starts, because the start of counting makes valgrind translate all code again.
  for (Row& row : rows) {
    row.hand = std::make_unique<softhand::bench::Pressing>(row.touched, row.untouched, row.clearance,
                                                           "right_400.hand.json", fast_mode());
    row.hand->settle(kSettlingSteps);
  }
  CALLGRIND_START_INSTRUMENTATION;
  for (const Row& row : rows) {
    CALLGRIND_ZERO_STATS;
    row.hand->step([](auto&& work) { work(); });
    CALLGRIND_DUMP_STATS;
    std::printf("%d %d %d %g %d\n", row.touched, row.hand->touched_objects(), row.untouched, row.clearance,
                row.hand->contacts());
  }
}

// Rows: a step that touches one object, without and with 16 near objects that it does not touch. All have slots.
void count_slots() {
  for (const int near : {0, 16}) {
    softhand::HandOptions options = fast_mode();
    options.near_distance = 0.3;
    softhand::bench::Pressing hand(1, near, 0.02, "right_400.hand.json", options, near + 1);
    hand.settle(kSettlingSteps);
    CALLGRIND_START_INSTRUMENTATION;
    CALLGRIND_ZERO_STATS;
    hand.step([](auto&& work) { work(); });
    CALLGRIND_DUMP_STATS;
    CALLGRIND_STOP_INSTRUMENTATION;
    std::printf("%d %d\n", hand.touched_objects(), hand.mirrored_objects());
  }
}

// Rows: a step in the air and one that touches an object, without and with the option `other_hands`. With it, the hand
// is told of another hand that touches an object elsewhere.
void count_hands() {
  for (const int touched : {0, 1}) {
    for (const bool other_hands : {false, true}) {
      softhand::HandOptions options = fast_mode();
      options.simulation.other_hands = other_hands;
      softhand::bench::Pressing hand(touched, 0, 0, "right_400.hand.json", options),
          far(1, 0, 0, "right_400.hand.json", fast_mode());
      hand.settle(kSettlingSteps);
      far.settle(kSettlingSteps);
      const auto other = std::make_unique<softhand::ObjectCoupling>(far.coupling());
      other->hand.user = 1;
      other->twins[0].object += 100;
      if (other_hands) hand.hear({other.get(), 1});
      CALLGRIND_START_INSTRUMENTATION;
      CALLGRIND_ZERO_STATS;
      hand.step([](auto&& work) { work(); });
      CALLGRIND_DUMP_STATS;
      CALLGRIND_STOP_INSTRUMENTATION;
      std::printf("%d touched, %d twin of the other hand, %d patches written, %d used\n", hand.touched_objects(),
                  static_cast<int>(other->twins.size()), static_cast<int>(hand.coupling().patches.size()),
                  static_cast<int>(hand.simulation().work().patches_used));
    }
  }
}

void count_queries() {
  constexpr int kQueries = 1000;
  for (const int vertices : {16, 64, 256}) {
    std::mt19937_64 generator(1);
    const auto direction = [&generator] {
      std::normal_distribution<double> normal;
      const double x = normal(generator), y = normal(generator), z = normal(generator);
      return softhand::Vector3(x, y, z).normalized();
    };
    softhand::Shape shape;
    shape.kind = static_cast<std::uint32_t>(softhand::ShapeKind::convex_hull);
    for (int i = 0; i < vertices; ++i) {
      const softhand::Vector3 v = 0.03 * direction();  // m
      shape.vertices.push_back({v.x(), v.y(), v.z()});
    }
    const softhand::ShapeGeometry hull(shape);
    std::vector<softhand::Vector3> points;
    for (int i = 0; i < kQueries; ++i) points.push_back((0.031 + 0.02 * i / kQueries) * direction());
    double nearest = 1;
    CALLGRIND_START_INSTRUMENTATION;
    CALLGRIND_ZERO_STATS;
    for (const softhand::Vector3& point : points) nearest = std::min(nearest, hull.closest(point).distance);
    CALLGRIND_DUMP_STATS;
    CALLGRIND_STOP_INSTRUMENTATION;
    std::printf("%d %d %g\n", vertices, kQueries, nearest);
  }
}

// Rows: a step and the recording of a step, with an object that is touched and in free motion.
void count_flight() {
  for (const int touched : {1, 0}) {
    softhand::bench::Pressing rig(touched, 0, 0.02, "right_1450.hand.json");
    rig.settle(touched > 0 ? 4 : 8);  // a step in contact is cheaper once nothing moves
    const std::string folder = "unused";
    softhand::FlightRecorder recorder({}, {"count", folder}, "{}");
    const auto skeleton = std::make_unique<softhand::Skeleton>();
    const auto world = std::make_unique<softhand::WorldObjects>();
    world->objects.count = 2;
    recorder.begin_segment(0, [](softhand::ByteWriter& out) { out.write(1); });
    const softhand::HandInput input{skeleton.get(), nullptr, world.get()};
    const softhand::RequestedOutputs requested;
    const auto record = [&] {
      recorder.add(softhand::kFlightStep, 0, [&](softhand::ByteWriter& out) {
        softhand::FlightTraits<softhand::HandLoop>::write_input(out, {input, requested}, false);
      });
      recorder.add(softhand::kFlightResult, 0,
                   [&](softhand::ByteWriter& out) { out.write(softhand::flight_result(rig.hand())); });
    };
    record();
    CALLGRIND_START_INSTRUMENTATION;
    CALLGRIND_ZERO_STATS;
    rig.step([](auto&& work) { work(); });
    CALLGRIND_DUMP_STATS;
    std::printf("%d step\n", touched);
    CALLGRIND_ZERO_STATS;
    record();
    CALLGRIND_DUMP_STATS;
    CALLGRIND_STOP_INSTRUMENTATION;
    std::printf("%d record\n", touched);
  }
}

}  // namespace

int main(int argc, char** argv) {
  if (argc > 1 && std::string_view(argv[1]) == "slots") {
    count_slots();
  } else if (argc > 1 && std::string_view(argv[1]) == "hands") {
    count_hands();
  } else if (argc > 1 && std::string_view(argv[1]) == "queries") {
    count_queries();
  } else if (argc > 1 && std::string_view(argv[1]) == "flight") {
    count_flight();
  } else {
    count_steps();
  }
}
