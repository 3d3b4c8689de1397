// The bus with Cyclone DDS, whose types come from the IDL files.
#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <string>

#include "bus/bus.hpp"
#include "integration/bus_harness.hpp"

namespace softhand::bus::bus_cyclone_test {
/// head_pose as an older program knows it: with the stamp only.
struct ShortHeadPose {
  std::uint32_t user = 0;
  Stamp stamp;
};
template <typename V, Is<ShortHeadPose> M>
constexpr void visit_fields(V&& v, M& m) {
  v.key("user", m.user);
  v.field("stamp", m.stamp);
}

namespace {

/// Sends a message through Cyclone's generated C type and back. The echo must have the same bytes. Returns the values
/// that the C program printed, by their names.
template <typename T>
std::map<std::string, std::string> through_cyclone(const Topic<T>& topic, T& sent, const std::string& hash = {}) {
  setenv("CYCLONEDDS_URI", "file://" SOFTHAND_SOURCE_DIR "/config/dds/cyclonedds.xml", 1);
  const Participant here("here", testing::own_domain());
  const std::string echo_name = std::string(topic.name) + "_echo";
  Topic<T> echo = topic;
  echo.name = echo_name;
  Writer writer(here, topic, 1);
  Reader reader(here, echo);
  std::vector<std::string> command{CYCLONE_SUBSCRIBER, std::to_string(testing::own_domain()), std::string(topic.name)};
  if (!hash.empty()) command.push_back(hash);
  Child cyclone(command);
  if (topic.lifespan_ms > 0) sent.stamp.publish_time = 0;  // the C program may need longer to start
  const auto got = std::make_unique<T>();
  EXPECT_TRUE(eventually([&] { return writer.has_readers(); })) << topic.name;
  bool same = eventually([&] {
    writer.write(sent);
    return reader.wait(50ms) && reader.take_latest(*got);
  });
  EXPECT_TRUE(same) << topic.name << ": no echo; refused " << reader.counters().refused << ", writers "
                    << reader.writer_count();
  EXPECT_EQ(bytes_of(*got), bytes_of(sent)) << topic.name;
  int exit_code = 0;
  auto lines = cyclone.finish(exit_code);
  EXPECT_EQ(exit_code, 0) << topic.name;
  return lines;
}

TEST(BusAndCyclone, EveryTopicPassesThroughUnchanged) {
  topics::for_each([&]<typename T>(const Topic<T>& topic) {
    const auto message = stamped<T>(5);
    through_cyclone(topic, *message);
  });
}

// The program sets its user data as docs/topics.md says, and looks at that of others.
TEST(BusAndCyclone, AnotherDefinitionOfATypeIsReportedByBothSides) {
  const auto skeleton = stamped<Skeleton>(5);
  for (const bool is_same : {true, false}) {
    char hash[17];
    std::snprintf(hash, sizeof hash, "%016llx",
                  static_cast<unsigned long long>(definition_hash<Skeleton>() + (is_same ? 0 : 1)));
    ::testing::internal::CaptureStderr();
    const auto lines = through_cyclone(topics::simulated_skeleton, *skeleton, hash);
    const std::string log = ::testing::internal::GetCapturedStderr();
    const std::string what =
        "here: topic softhand/v1/simulated_skeleton: module cyclone_subscriber has another definition";
    EXPECT_EQ(lines_with(log, what), is_same ? 0 : 1) << log;
    const auto found = lines.find("other_definition");
    EXPECT_EQ(found == lines.end() ? "" : found->second, is_same ? "" : "here");
  }
}

TEST(BusAndCyclone, MalformedSamplesAreCountedAndDisposedInstancesAreNot) {
  setenv("CYCLONEDDS_URI", "file://" SOFTHAND_SOURCE_DIR "/config/dds/cyclonedds.xml", 1);
  const Participant here("here", testing::own_domain()), older("older", testing::own_domain());
  Writer writer(here, topics::head_pose);
  const std::string echo_name = std::string(topics::head_pose.name) + "_echo";
  Topic<HeadPose> echo = topics::head_pose;
  echo.name = echo_name;
  Reader reader(here, echo);
  Reader older_reader(older, Topic<ShortHeadPose>{TopicRow(echo)});
  Child cyclone({CYCLONE_SUBSCRIBER, std::to_string(testing::own_domain()), std::string(topics::head_pose.name)});
  const auto sent = stamped<HeadPose>(5);
  ShortHeadPose taken;
  // Cyclone's writer finds the two readers at different times.
  EXPECT_TRUE(eventually([&] {
    writer.write(*sent);
    EXPECT_FALSE(older_reader.take_latest(taken));
    return older_reader.counters().refused > 0 && reader.wait(50ms);
  }));
  int exit_code = 0;
  cyclone.finish(exit_code);
  EXPECT_TRUE(eventually([&] { return reader.writer_count() == 0; }));
  HeadPose got;
  EXPECT_TRUE(reader.take_latest(got)) << "the last sample stays";
  EXPECT_EQ(reader.counters().refused, 0u);
}

double number(const std::map<std::string, std::string>& lines, const std::string& name) {
  const auto found = lines.find(name);
  EXPECT_NE(found, lines.end()) << name;
  return found == lines.end() ? 0 : std::strtod(found->second.c_str(), nullptr);
}

TEST(BusAndCyclone, CReadsTheFieldsUnderTheirNames) {
  const auto skeleton = stamped<Skeleton>(6);
  auto lines = through_cyclone(topics::simulated_skeleton, *skeleton);
  EXPECT_EQ(number(lines, "hand.side"), skeleton->hand.side);
  EXPECT_EQ(lines["stamp.sample_time"], std::to_string(skeleton->stamp.sample_time));
  EXPECT_EQ(number(lines, "confidence"), skeleton->confidence);
  EXPECT_EQ(number(lines, "joints[25].orientation.w"), skeleton->joints[25].orientation[3]);
  EXPECT_EQ(number(lines, "joints[25].radius"), skeleton->joints[25].radius);

  const auto contacts = stamped<Contacts>(6);
  lines = through_cyclone(topics::contacts, *contacts);
  const Contact& contact = contacts->contacts[contacts->contacts.size() - 1];
  EXPECT_EQ(number(lines, "contacts.length"), static_cast<double>(contacts->contacts.size()));
  EXPECT_EQ(number(lines, "fingers[5].area"), contacts->fingers[5].area);
  EXPECT_EQ(number(lines, "contacts[last].force.z"), contact.force[2]);
  EXPECT_EQ(number(lines, "contacts[last].slip_speed"), contact.slip_speed);

  const auto traction = stamped<SkinTraction>(6);
  lines = through_cyclone(topics::skin_traction, *traction);
  const SkinRegion& region = traction->regions[traction->regions.size() - 1];
  EXPECT_EQ(number(lines, "regions.length"), static_cast<double>(traction->regions.size()));
  EXPECT_EQ(static_cast<float>(number(lines, "regions[last].shear.y")), region.shear[1]);
  EXPECT_EQ(static_cast<float>(number(lines, "regions[last].area_rate")), region.area_rate);

  const auto objects = stamped<WorldObjects>(6);
  lines = through_cyclone(topics::objects, *objects);
  const ObjectState& object = objects->objects[objects->objects.size() - 1];
  EXPECT_EQ(number(lines, "objects[last].position.y"), object.position[1]);
  EXPECT_EQ(number(lines, "objects[last].planes[last].mass"), object.planes[object.planes.size() - 1].mass);

  const auto wrench = stamped<BoneWrench>(6);
  lines = through_cyclone(topics::bone_wrench, *wrench);
  EXPECT_EQ(number(lines, "bones[20].coupling_torque.y"), wrench->bones[20].coupling_torque[1]);

  const auto status = stamped<LoopStatus>(6);
  status->module = {"hand"};
  lines = through_cyclone(topics::loop_status, *status);
  EXPECT_EQ(lines["module_name"], std::string(status->module.data()));
  EXPECT_EQ(number(lines, "step_ms_p99"), status->step_ms_p99);
  EXPECT_EQ(number(lines, "passivity_energy"), status->passivity_energy);
  EXPECT_EQ(number(lines, "ledger[last].value"), status->ledger[status->ledger.size() - 1].value);

  const auto choices = stamped<RigChoices>(6);
  RigChoice& choice = choices->choices[choices->choices.size() - 1];
  choice.choice = {"lift"};
  lines = through_cyclone(topics::rig_choices, *choices);
  EXPECT_EQ(number(lines, "choices.length"), static_cast<double>(choices->choices.size()));
  EXPECT_EQ(lines["choices[last].choice"], "lift");
  EXPECT_EQ(number(lines, "choices[last].running"), choice.running);

  const auto soft = stamped<SoftObjectState>(6);
  lines = through_cyclone(topics::soft_object_state, *soft);
  EXPECT_EQ(number(lines, "object_id"), soft->object);
  EXPECT_EQ(number(lines, "owned"), soft->owned);
  EXPECT_EQ(number(lines, "nodes.length"), static_cast<double>(soft->nodes.size()));
  EXPECT_FLOAT_EQ(static_cast<float>(number(lines, "velocities[last].z")),
                  soft->velocities[soft->velocities.size() - 1][2]);
}

}  // namespace
}  // namespace softhand::bus::bus_cyclone_test
