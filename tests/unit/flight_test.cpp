// Saved states of the loops, and the flight recorder beside a loop.
#include <gtest/gtest.h>
#include <unistd.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <functional>
#include <limits>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "flight/hand_flight.hpp"
#include "flight/repeat.hpp"
#include "flight/tracking_flight.hpp"
#include "flight/world_flight.hpp"
#include "runtime/record_file.hpp"
#include "scene_file.hpp"
#include "support/block_hand.hpp"
#include "support/count_allocations.hpp"
#include "support/counters.hpp"
#include "support/shapes.hpp"
#include "support/skeleton.hpp"
#include "unit/world_objects.hpp"

namespace softhand {
namespace {

namespace fs = std::filesystem;

constexpr Nanoseconds kStart = 1'000'000'000;
constexpr Nanoseconds kPeriod = 11'111'111;

// --- plain values ----------------------------------------------------------------------------------

struct Inner {
  double number = 0;
  std::vector<Vector3> points;
};
struct Outer {
  std::int32_t count = 0;
  std::array<Inner, 2> inner;
  Pose pose;
  Eigen::Matrix3Xd matrix;
  std::string text;
  bool flag = false;
};

TEST(PlainBytes, CountsTheMembersOfAggregates) {
  EXPECT_EQ(member_count<Pose>, 2u);
  EXPECT_EQ(member_count<Outer>, 6u);
  EXPECT_EQ(member_count<Skeleton>, 6u);
  EXPECT_EQ(member_count<ObjectState>, 12u);
  EXPECT_EQ(member_count<EnergyFlow>, 6u);
}

TEST(PlainBytes, ReadsWhatItWroteAndNamesTheFirstDifference) {
  Outer one;
  one.count = 3;
  one.inner[1].points = {Vector3(1, 2, 3), Vector3(4, 5, 6)};
  one.pose.position = Vector3(7, 8, 9);
  one.matrix = Eigen::Matrix3Xd::Random(3, 5);
  one.text = "text";
  one.flag = true;
  std::vector<std::byte> memory(4096);
  ByteWriter out(memory);
  out.write(one);
  ASSERT_FALSE(out.overflowed());
  Outer two;
  ByteReader in(out.written());
  in.read(two);
  EXPECT_TRUE(in.rest().empty());
  EXPECT_EQ(plain_hash(one), plain_hash(two));
  EXPECT_EQ(two.inner[1].points, one.inner[1].points);
  EXPECT_EQ(two.matrix, one.matrix);
  EXPECT_EQ(two.text, "text");
  two.inner[1].points[1].y() = -5;
  PlainComparison comparison(out.written());
  comparison.compare("outer", two);
  EXPECT_TRUE(comparison.differs());
  EXPECT_EQ(comparison.where().substr(0, 13), "outer.1.1.1.1") << comparison.where();
  EXPECT_NE(plain_hash(one), plain_hash(two));
}

TEST(PlainBytes, RefusesBytesThatAreTooShort) {
  std::vector<std::byte> memory(10);
  ByteWriter out(memory);
  out.write(Pose{});
  EXPECT_TRUE(out.overflowed());
  ByteReader in(memory);
  Pose pose;
  EXPECT_THROW(in.read(pose), std::runtime_error);
}

// A count of a file is four bytes. It must not allocate gigabytes.
TEST(PlainBytes, RefusesACountThatTheBytesCannotFill) {
  std::vector<std::byte> memory(8);
  ByteWriter out(memory);
  out.write(std::uint32_t{9'000'000});
  ByteReader text(memory), numbers(memory), structs(memory);
  EXPECT_THROW(text.take<std::string>(), std::runtime_error);
  EXPECT_THROW(numbers.take<std::vector<double>>(), std::runtime_error);
  std::vector<ObjectCoupling> couplings;
  EXPECT_THROW(structs.read(couplings), std::runtime_error);
  EXPECT_LE(couplings.size(), 1u);
}

TEST(PlainBytes, RefusesAMatrixOfAnotherShape) {
  std::vector<std::byte> memory(1000);
  for (const std::array<std::uint32_t, 2> shape : {std::array{1u, 5u}, std::array{5u, 3u}, std::array{0u, 2u}}) {
    ByteWriter out(memory);
    out.write(shape);
    ByteReader in(memory);
    EXPECT_THROW(in.take<Eigen::Matrix3Xd>(), std::runtime_error) << shape[0] << " x " << shape[1];
  }
  for (const std::array<std::uint32_t, 2> shape : {std::array{5u, 0u}, std::array{5u, 2u}}) {
    ByteWriter out(memory);
    out.write(shape);
    ByteReader in(memory);
    EXPECT_THROW(in.take<Eigen::VectorXd>(), std::runtime_error) << shape[0] << " x " << shape[1];
  }
}

TEST(PlainBytes, RefusesATruthValueThatIsNone) {
  const std::array memory{std::byte{1}, std::byte{2}};
  ByteReader in(memory);
  EXPECT_TRUE(in.take<bool>());
  EXPECT_THROW(in.take<bool>(), std::runtime_error);
}

TEST(FlightFiles, AHeaderWithoutACalibrationForEachHandIsRefused) {
  FlightHeader header;
  header.hands = {"one", "two"};
  header.calibrations = {"", "text"};
  EXPECT_EQ(flight_header_from_json(to_json(header)), header);
  header.calibrations.pop_back();
  EXPECT_THROW(flight_header_from_json(to_json(header)), std::runtime_error);
}

TEST(FlightFiles, AHeaderWithMoreHandsThanTheSceneIsRefused) {
  FlightHeader header;
  header.scene = SOFTHAND_SOURCE_DIR "/config/scenes/pinch_lift.toml";
  header.hands = header.calibrations = {"", ""};
  EXPECT_THROW(scenes_of(header), std::runtime_error);
}

// A path is any bytes, here "Gerät" in Latin-1. The process did not start.
TEST(FlightFiles, AHeaderMayHaveAPathThatIsNotUtf8) {
  FlightHeader header;
  header.scene = "/Ger\xe4t/scene.toml";
  EXPECT_EQ(flight_header_from_json(to_json(header)).scene, "/Ger\ufffdt/scene.toml");
}

TEST(FlightFiles, AnUnknownStatusHasAText) {
  EXPECT_STREQ(FlightTraits<HandLoop>::status_text(0), "converged");
  EXPECT_STREQ(FlightTraits<HandLoop>::status_text(1'000'000), "unknown");
}

// --- saved states ------------------------------------------------------------------------------------

template <typename Loop>
std::vector<std::byte> saved(const Loop& loop) {
  std::vector<std::byte> memory(4'000'000);
  ByteWriter out(memory);
  FlightTraits<Loop>::save(loop, out);
  EXPECT_FALSE(out.overflowed());
  memory.resize(out.size());
  return memory;
}

template <typename Loop>
void expect_same(const Loop& one, const Loop& two, const std::string& where) {
  const FlightResult a = flight_result(one), b = flight_result(two);
  std::size_t part = 0;
  one.for_each_part([&](const char* name, const auto&) {
    EXPECT_EQ(a.hashes[part], b.hashes[part]) << name << ", " << where;
    ++part;
  });
}

const HandModel& hand() {
  static const HandModel model = testing::block_hand(1);
  return model;
}

HandOptions hand_options() {
  HandOptions o;
  o.simulation.solver.max_iterations = 8;
  o.mirrored_objects = 1;
  o.static_objects = 0;
  return o;
}

ObjectDescription cube() {
  ObjectDescription d;
  d.object = 3;
  d.mass = 0.05;
  d.inertia = {1.33e-5, 1.33e-5, 1.33e-5};
  d.friction = 0.8;
  d.shape = testing::cube_shape(0.02);
  return d;
}

// Inputs of a step in which the hand presses a cube from above, holds it, and leaves it.
struct Scene {
  std::unique_ptr<Skeleton> skeleton = std::make_unique<Skeleton>();
  std::unique_ptr<WorldObjects> world = std::make_unique<WorldObjects>();

  HandInput at(int i) {
    const Nanoseconds now = time(i);
    const double y = i < 40 ? -0.0001 * i : i < 80 ? -0.004 : 0.03;
    *skeleton = testing::skeleton_at(hand(), {Vector3(0.0005 * i, y, 0), Quaternion::Identity()}, now,
                                     static_cast<std::uint64_t>(i) + 1);
    *world = {};
    world->stamp.sample_time = now;
    ObjectState state;
    state.object = 3;
    state.position = {-0.012, -0.039, -0.092};
    world->objects.push_back(state);
    return {skeleton.get(), nullptr, world.get()};
  }
  static Nanoseconds time(int i) { return kStart + i * kPeriod; }
};

// At each of these steps the state is saved and loaded into a new loop. Both loops then go on side by side.
class HandRestore : public ::testing::TestWithParam<int> {};
INSTANTIATE_TEST_SUITE_P(Step, HandRestore, ::testing::Values(0, 1, 5, 30, 60, 84, 110));
TEST_P(HandRestore, ALoopThatLoadsAStateContinuesWithTheSameBits) {
  HandLoop one(hand(), hand_options(), {}), two(hand(), hand_options(), {});
  one.describe_object(cube());
  Scene scene;
  for (int i = 0; i < GetParam(); ++i) one.step(Scene::time(i), scene.at(i), {});
  const std::vector<std::byte> bytes = saved(one);
  one.forget();
  ByteReader in(bytes);
  two.load(in);
  EXPECT_TRUE(in.rest().empty());
  for (int i = GetParam(); i < 130; ++i) {
    one.step(Scene::time(i), scene.at(i), {});
    two.step(Scene::time(i), scene.at(i), {});
    expect_same(one, two, "step " + std::to_string(i));
    if (HasFailure()) break;
  }
  EXPECT_EQ(saved(one), saved(two));
}

TEST(HandRestore, ASnapshotChangesTheRunOnlyByRounding) {
  HandLoop one(hand(), hand_options(), {}), two(hand(), hand_options(), {});
  one.describe_object(cube());
  two.describe_object(cube());
  Scene scene;
  for (int i = 0; i < 130; ++i) {
    one.step(Scene::time(i), scene.at(i), {});
    if (i % 10 == 0) two.forget();
    two.step(Scene::time(i), scene.at(i), {});
  }
  EXPECT_LT((one.simulation().state().node_positions - two.simulation().state().node_positions).cwiseAbs().maxCoeff(),
            2e-4);
}

TEST(HandRestore, RefusesTheStateOfAnotherHand) {
  HandLoop one(hand(), hand_options(), {});
  HandLoop other(testing::block_hand(2), hand_options(), {});
  const std::vector<std::byte> bytes = saved(one);
  ByteReader in(bytes);
  EXPECT_THROW(other.load(in), std::runtime_error);
}

TEST(HandRestore, RefusesAStateWithAVelocityTooFew) {
  HandSimulation simulation(hand(), hand_options().simulation, 0, 0);
  std::vector<std::byte> memory(4'000'000), changed(memory.size());
  ByteWriter out(memory);
  simulation.save(out);
  ByteReader in(out.written());
  ByteWriter writer(changed);
  writer.write(in.take<Eigen::Matrix3Xd>());
  const auto velocities = in.take<Eigen::Matrix3Xd>();
  writer.write(Eigen::Matrix3Xd(velocities.leftCols(velocities.cols() - 1)));
  writer.bytes(in.rest().data(), in.rest().size());
  ByteReader broken(writer.written());
  EXPECT_THROW(simulation.load(broken), std::runtime_error);
}

// A target that is not finite makes the step fail. The loop itself refuses such inputs.
TEST(HandRestore, AFailedStepChangesNothing) {
  SimulationOptions options = hand_options().simulation;
  HandSimulation one(hand(), options, 0, 0), two(hand(), options, 0, 0);
  const auto aim = [](HandSimulation& simulation, double x) {
    for (int b = 0; b < kBodyCount; ++b) {
      const Body body = static_cast<Body>(b);
      Pose target = hand().rest_joints[static_cast<std::size_t>(index_of(joint_of(body)))];
      target.position.x() += x;
      simulation.set_target(body, target, {});
    }
  };
  for (int i = 0; i < 10; ++i) {
    aim(one, 0.001 * i);
    aim(two, 0.001 * i);
    one.step(1.0 / 90);
    two.step(1.0 / 90);
  }
  const State before = one.state();
  aim(one, std::numeric_limits<double>::quiet_NaN());
  const StepReport report = one.step(1.0 / 90);
  EXPECT_EQ(report.status, StepStatus::nonfinite);
  EXPECT_FALSE(report.state_changed);
  EXPECT_EQ(plain_hash(one.state()), plain_hash(before));
  // The failed step has dropped the factor, as a snapshot does.
  two.forget();
  for (int i = 10; i < 40; ++i) {
    aim(one, 0.001 * i);
    aim(two, 0.001 * i);
    one.step(1.0 / 90);
    two.step(1.0 / 90);
    ASSERT_EQ(plain_hash(one.state()), plain_hash(two.state())) << i;
  }
}

TEST(TrackingRestore, ALoopThatLoadsAStateContinuesWithTheSameBits) {
  TrackingLoop one({}, 90, hand(), {}), two({}, 90, hand(), {});
  const auto step = [](TrackingLoop& loop, int i) {
    const Nanoseconds now = kStart + Nanoseconds{i} * 1'000'000;
    TrackingInput input;
    Skeleton sample;
    if (i % 11 == 0) {
      sample = testing::skeleton_at(hand(), {Vector3(1e-4 * i, 0, 0), Quaternion::Identity()}, now,
                                    static_cast<std::uint64_t>(i) + 1);
      input.tracked = &sample;
      if (i % 22 == 0) input.simulated = &sample;
    }
    loop.step(now, input);
  };
  for (int i = 0; i < 300; ++i) step(one, i);
  const std::vector<std::byte> bytes = saved(one);
  ByteReader in(bytes);
  in.read(two);
  for (int i = 300; i < 600; ++i) {
    step(one, i);
    step(two, i);
    expect_same(one, two, "step " + std::to_string(i));
    if (HasFailure()) break;
  }
  EXPECT_EQ(saved(one), saved(two));
}

// A cube falls on a table, comes to rest, sleeps, and is teleported.
class WorldRestore : public ::testing::TestWithParam<int> {};
INSTANTIATE_TEST_SUITE_P(Step, WorldRestore, ::testing::Values(0, 20, 100, 2000));
TEST_P(WorldRestore, ALoopThatLoadsAStateContinuesWithTheSameBits) {
  const std::vector<ObjectOptions> objects{test::table(), test::cube(0.1, 0.1)};
  WorldLoop one({}, objects), two({}, objects);
  const auto step = [](WorldLoop& loop, int i) {
    if (i == GetParam() + 300) {
      Message message;
      set_text(message.module, "world");
      set_text(message.key, "object.teleport");
      set_text(message.value, "cube 0.1 0.2 0");
      EXPECT_EQ(loop.answer(message).result, kReplyApplied);
    }
    loop.step(kStart + Nanoseconds{i} * 4'000'000, {});
  };
  for (int i = 0; i < GetParam(); ++i) step(one, i);
  const std::vector<std::byte> bytes = saved(one);
  one.forget();
  ByteReader in(bytes);
  two.load(in);
  for (int i = GetParam(); i < GetParam() + 600; ++i) {
    step(one, i);
    step(two, i);
    expect_same(one, two, "step " + std::to_string(i));
    if (HasFailure()) break;
  }
  EXPECT_EQ(saved(one), saved(two));
}

// A button that moves on its spring, and a mug above it. Both consist of convex pieces.
SceneOptions button_and_mug() {
  const fs::path path = fs::path(::testing::TempDir()) / ("softhand_button_" + std::to_string(getpid()) + ".toml");
  const std::string entry = "[[objects]]\nshape = \"file\"\nfile = \"" SOFTHAND_SOURCE_DIR "/config/objects/";
  std::ofstream(path) << entry << "button.object.json\"\nname = \"button\"\nfixed = true\n"
                      << entry << "mug.object.json\"\nname = \"mug\"\nposition = [0, 0.06, 0]\n";
  const SceneOptions scene = read_scene(path.string()).options;
  fs::remove(path);
  return scene;
}

TEST(WorldRestore, ObjectFilesAndTheirJointsContinueWithTheSameBits) {
  const SceneOptions scene = button_and_mug();
  WorldLoop one(scene.world, scene.objects, 1.0 / 90, scene.joints),
      two(scene.world, scene.objects, 1.0 / 90, scene.joints);
  const auto step = [](WorldLoop& loop, int i) { loop.step(kStart + Nanoseconds{i} * 4'000'000, {}); };
  double pressed = 0;
  for (int i = 0; i < 20; ++i) step(one, i);
  const std::vector<std::byte> bytes = saved(one);
  one.forget();
  ByteReader in(bytes);
  two.load(in);
  for (int i = 20; i < 300; ++i) {
    step(one, i);
    step(two, i);
    expect_same(one, two, "step " + std::to_string(i));
    pressed = std::min(pressed, one.joint_coordinate("button.button"));
    EXPECT_LT(one.joint_gap("button.button"), 1e-3);
    if (HasFailure()) break;
  }
  EXPECT_LT(pressed, -0.001) << "the mug did not press the button";
  EXPECT_EQ(saved(one), saved(two));
}

// A scene with convex pieces, a joint, and contacts that begin and end.
TEST(WorldRestore, ForgettingAllocatesNothing) {
  const SceneOptions scene = button_and_mug();
  WorldLoop loop(scene.world, scene.objects, 1.0 / 90, scene.joints);
  int i = 0;
  const auto run = [&](int steps) {
    for (const int end = i + steps; i < end; ++i) loop.step(kStart + Nanoseconds{i} * 4'000'000, {});
  };
  run(1);
  counting = true;
  run(100);
  const long before = std::exchange(allocations, 0);
  loop.forget();
  const long by_forgetting = std::exchange(allocations, 0);
  run(100);
  loop.forget();
  run(100);
  counting = false;
  EXPECT_EQ(before, 0) << "in the steps before it";
  EXPECT_EQ(by_forgetting, 0);
  EXPECT_EQ(std::exchange(allocations, 0), 0) << "in the steps after it";
}

TEST(WorldRestore, ASleepingObjectSleepsOn) {
  WorldLoop loop({}, {test::table(), test::cube(0.1, 0.01)});
  const auto asleep = [&loop] {
    LoopStatus status;
    loop.fill_status(status, 0);
    return testing::counter_of(status, "asleep");
  };
  int i = 0;
  while (i < 5000 && asleep() < 1) loop.step(kStart + Nanoseconds{++i} * 4'000'000, {});
  ASSERT_EQ(asleep(), 1);
  const Vec3 before = loop.objects().objects[1].position;
  loop.forget();
  for (int more = 0; more < 100; ++more) loop.step(kStart + Nanoseconds{++i} * 4'000'000, {});
  EXPECT_EQ(asleep(), 1);
  EXPECT_NEAR(loop.objects().objects[1].position[1], before[1], 1e-6);
}

TEST(FlightMessages, AnUnknownKeyIsAnsweredWithAllKnownKeys) {
  WorldLoop world({}, {test::table()});
  TrackingLoop tracking({}, 90, hand(), {});
  HandLoop simulated(hand(), hand_options(), {});
  const auto text_of = [](auto& loop, const char* to) {
    Message message;
    set_text(message.module, to);
    set_text(message.key, "nonsense");
    const MessageReply reply = Flight(loop, nullptr).answer(message, "module");
    EXPECT_EQ(reply.result, kReplyIgnored);
    return std::string(get_text(reply.text));
  };
  EXPECT_EQ(text_of(world, "module"), "unknown key; known: object.reset, object.remove, object.teleport, flight.write");
  EXPECT_EQ(text_of(tracking, "*"), "unknown key; known: reposition, feedback_ratio, flight.write");
  EXPECT_EQ(text_of(simulated, "module"), "unknown key; known: reposition, object.reset, flight.write");
  EXPECT_EQ(text_of(world, "other"), "not for this module");
}

// --- the recorder --------------------------------------------------------------------------------------

class Recorder : public ::testing::Test {
 protected:
  Recorder() : folder_(fs::path(::testing::TempDir()) / ("softhand_flight_" + std::to_string(getpid()))) {
    fs::remove_all(folder_);
  }
  ~Recorder() override { fs::remove_all(folder_); }
  std::unique_ptr<FlightRecorder> make(const FlightOptions& options) const {
    return std::make_unique<FlightRecorder>(options, FlightRecorder::Place{"test", folder_.string()}, "{}");
  }
  std::vector<fs::path> files() const {
    std::vector<fs::path> found;
    if (fs::exists(folder_))
      for (const auto& entry : fs::directory_iterator(folder_)) found.push_back(entry.path());
    return found;
  }
  static std::vector<RecordedMessage> records(const fs::path& path) {
    RecordReader file(path.string());
    std::vector<RecordedMessage> all;
    for (RecordedMessage record; file.next(record);) all.push_back(record);
    return all;
  }
  fs::path folder_;
};

TEST_F(Recorder, KeepsTheLastMinuteAndBeginsWithASnapshot) {
  FlightOptions options;
  options.seconds = 2;
  options.snapshot_period = 0.5;
  options.megabytes = 1;
  auto recorder = make(options);
  for (int i = 0; i < 1000; ++i) {
    const Nanoseconds now = kStart + Nanoseconds{i} * 10'000'000;
    if (recorder->is_due(now)) recorder->begin_segment(now, [](ByteWriter& out) { out.write(7); });
    recorder->add(kFlightInput, now, [i](ByteWriter& out) { out.write(i); });
  }
  EXPECT_EQ(recorder->segments_begun(), 20u);
  recorder->finish("because");
  ASSERT_EQ(files().size(), 1u);
  const auto all = records(files()[0]);
  ASSERT_GT(all.size(), 200u);
  EXPECT_NE(std::string(reinterpret_cast<const char*>(all[0].payload.data()), all[0].payload.size()).find("because"),
            std::string::npos);
  EXPECT_EQ(all[1].payload[0], std::byte{kFlightSnapshot});
  const double kept = static_cast<double>(all.back().log_time - all[1].log_time) * 1e-9;
  EXPECT_GE(kept, 2);
  EXPECT_LE(kept, 2.5);
}

// Anybody can make a folder in /tmp, or a link to the files of this user.
TEST_F(Recorder, WithoutAFolderTheFilesAreInOneOfThisUserAlone) {
  const char* const temporary = std::getenv("TMPDIR");
  const std::string former = temporary == nullptr ? "" : temporary;
  fs::create_directories(folder_ / "elsewhere");
  setenv("TMPDIR", folder_.c_str(), 1);
  const auto write = [] {
    FlightOptions options;
    options.megabytes = 1;
    FlightHeader header;
    header.module = "test";
    const auto recorder = make_flight_recorder(options, header, "");
    recorder->begin_segment(kStart, [](ByteWriter& out) { out.write(7); });
    recorder->finish("because");
  };
  const fs::path own = folder_ / ("softhand-" + std::to_string(getuid()));
  fs::create_directory_symlink(folder_ / "elsewhere", own);
  write();
  EXPECT_TRUE(fs::is_empty(folder_ / "elsewhere"));
  fs::remove(own);
  write();
  ASSERT_TRUE(fs::exists(own / "flight"));
  EXPECT_EQ(fs::status(own).permissions(), fs::perms::owner_all);
  EXPECT_EQ(std::distance(fs::directory_iterator(own / "flight"), {}), 1);
  former.empty() ? unsetenv("TMPDIR") : setenv("TMPDIR", former.c_str(), 1);
}

TEST_F(Recorder, BeginsTheNextSegmentBeforeOneIsFull) {
  FlightOptions options;
  options.seconds = 4;
  options.snapshot_period = 2;
  options.megabytes = 1;
  auto recorder = make(options);
  const std::array<std::byte, 1000> large{};
  for (int i = 0; i < 3000; ++i) {
    const Nanoseconds now = kStart + Nanoseconds{i} * 5'000'000;
    if (recorder->is_due(now)) recorder->begin_segment(now, [](ByteWriter& out) { out.write(7); });
    recorder->add(kFlightInput, now, [&](ByteWriter& out) { out.write(large); });
  }
  recorder->finish("because");
  ASSERT_EQ(files().size(), 1u);
  int inputs = 0;
  for (const RecordedMessage& record : records(files()[0]))
    if (record.payload[0] == std::byte{kFlightInput}) ++inputs;
  EXPECT_GT(inputs, 400) << "the memory was not used";
}

TEST_F(Recorder, WritesAFileWhileTheLoopRecordsOn) {
  FlightOptions options;
  options.seconds = 2;
  options.snapshot_period = 0.5;
  auto recorder = make(options);
  int written = 0;
  for (int i = 0; i < 3000; ++i) {
    const Nanoseconds now = kStart + Nanoseconds{i} * 10'000'000;
    if (recorder->is_due(now)) recorder->begin_segment(now, [](ByteWriter& out) { out.write(7); });
    recorder->add(kFlightInput, now, [i](ByteWriter& out) { out.write(i); });
    if (i % 500 == 499 && recorder->request("again")) ++written;
    if (i % 500 == 499) usleep(50'000);
  }
  recorder->finish({});
  EXPECT_GT(written, 1);
  EXPECT_EQ(files().size(), static_cast<std::size_t>(written));
  for (const fs::path& path : files()) {
    int next = -1;
    for (const RecordedMessage& record : records(path)) {
      if (record.payload[0] != std::byte{kFlightInput} || record.sequence == 0) continue;
      ByteReader in(std::span(record.payload).subspan(1));
      const int i = in.take<int>();
      EXPECT_TRUE(next < 0 || i == next) << path << ": " << i << " after " << next - 1;
      next = i + 1;
    }
  }
}

// A reason comes from a message. Its end may be half a character.
TEST_F(Recorder, WritesAFileForAReasonThatIsNoText) {
  auto recorder = make({});
  recorder->begin_segment(kStart, [](ByteWriter& out) { out.write(7); });
  recorder->finish("h\xc3");
  ASSERT_EQ(files().size(), 1u);
  EXPECT_EQ(files()[0].extension(), ".flight");
}

TEST_F(Recorder, AStepWithARecorderAllocatesNothing) {
#ifndef SOFTHAND_COUNT_MALLOC
  GTEST_SKIP() << "the sanitizer brings its own malloc";
#endif
  FlightOptions options;
  options.seconds = 2;
  options.snapshot_period = 0.05;
  auto recorder = make(options);
  HandLoop loop(hand(), hand_options(), {});
  Flight flight(loop, recorder.get());
  const ObjectDescription description = cube();
  flight.describe(kFlightObject, description, [&] { loop.describe_object(description); });
  Scene scene;
  HandInvariants invariants(options);
  for (int i = 0; i < 130; ++i) {
    const HandInput input = scene.at(i);
    const RequestedOutputs requested;
    counting = true;
    flight.step(Scene::time(i), {input, requested},
                [&]() -> HandOutput& { return loop.step(Scene::time(i), input, requested); });
    if (const char* wrong = invariants.check(loop)) flight.report(wrong);
    counting = false;
  }
  EXPECT_GE(recorder->segments_begun(), 2u);
  EXPECT_EQ(std::exchange(allocations, 0), 0);
}

}  // namespace
}  // namespace softhand
